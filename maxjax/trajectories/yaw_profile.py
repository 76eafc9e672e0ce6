"""Where the nose points: along the horizontal course or as waypoints say, turning no faster than a limit.

With the course ψ*_k at steps h apart, and r h the most that the heading may change in a step,

    ψ_k = ½ [max_j (ψ*_j − r h |k − j|) + min_j (ψ*_j + r h |k − j|)].

Both envelopes change by at most r h a step, so does their mean; it is ψ* wherever ψ* keeps the limit, and elsewhere
begins to turn as long before a corner as it ends after it. A moving average then rounds it, and keeps the limit.

On a leg whose waypoint has a heading or a point of interest, ψ* is that. While the vehicle rests there it holds it:
from the end of the rest on, ψ* changes by no more than the limit, so that no envelope turns before.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.planning.waypoint import Waypoint
from maxjax.trajectories.envelope import least_envelope
from maxjax.trajectories.spline import average_neighbours

# Horizontal speed below which a course says nothing [m/s], and width of the average [s].
_SLOW, _ROUNDING = 0.3, 0.3
# More than rounding adds.
_SLACK = 1e-9


@dataclasses.dataclass(frozen=True)
class Aim:
    """Where the nose points on a leg.

    Attributes:
        waypoint: that the leg leads to.
        leaves: time at which the vehicle leaves it [s].
        rests: whether it rests there.
    """

    waypoint: Waypoint
    leaves: float
    rests: bool


def headings(
    control: Float64[np.ndarray, "n 3"], step: float, rate: float, aims: Sequence[Aim] = ()
) -> Float64[np.ndarray, " n"]:
    """Control points of the yaw [rad] for those of a position.

    Args:
        control: of the position [m], from the world's origin where an aim has a point of interest.
        step: between control points [s].
        rate: greatest rate of change [rad/s].
        aims: of the legs in order, each from where the one before is left.
    """
    course = np.diff(control[:, :2], axis=0, append=control[-1:, :2])
    moves = np.linalg.norm(course, axis=1) > _SLOW * step
    wanted = _filled(np.where(moves, np.arctan2(course[:, 1], course[:, 0]), np.nan))
    wanted = _aimed(wanted, control, step, rate, aims)
    steps, limit = np.arange(len(wanted), dtype=np.float64), rate * step * (1.0 - _SLACK)
    count = 2 * math.ceil(0.5 * _ROUNDING / step) + 1
    upper, lower = least_envelope(wanted, steps, limit), -least_envelope(-wanted, steps, limit)
    rounded = average_neighbours(0.5 * (upper + lower), count)
    half = count // 2
    found: Float64[np.ndarray, " n"] = rounded[half : len(rounded) - half]
    return found


def _filled(yaw: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    """Yaws without jumps by 2π, the last one before where there is none (NaN); the first ones that of the first known.

    Where a vehicle rests, or flies straight up or down, the last course holds.
    """
    known = np.flatnonzero(np.isfinite(yaw))
    if not known.size:
        return np.zeros(len(yaw))
    before = np.clip(np.searchsorted(known, np.arange(len(yaw)), side="right") - 1, 0, None)
    found: Float64[np.ndarray, " n"] = np.unwrap(yaw[known])[before]
    return found


def _aimed(
    course: Float64[np.ndarray, " n"],
    control: Float64[np.ndarray, "n 3"],
    step: float,
    rate: float,
    aims: Sequence[Aim],
) -> Float64[np.ndarray, " n"]:
    """The wanted yaw of some legs; arguments as of `headings`."""
    times, wanted, held, first = step * (np.arange(len(course)) - 1.0), course, list[int](), 0
    for aim in aims:
        last = int(np.searchsorted(times, aim.leaves, side="right")) if aim is not aims[-1] else len(course)
        asked = aim.waypoint.yaw_from(control[first:last])
        wanted = np.concatenate([wanted[:first], np.where(np.isnan(asked), wanted[first:last], asked), wanted[last:]])
        held += [last] * (aim.rests and aim.waypoint.aims and last < len(course))
        first = last
    wanted = _filled(wanted)
    for last in held:
        # Further than this from what was held, an envelope would turn before the rest has ended.
        turn = rate * step * np.clip(np.arange(len(wanted) - last) - math.ceil(0.5 * _ROUNDING / step) - 1, 0, None)
        wanted[last:] = np.clip(wanted[last:], wanted[last - 1] - turn, wanted[last - 1] + turn)
    return wanted
