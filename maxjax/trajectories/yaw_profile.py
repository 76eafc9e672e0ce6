"""Where the nose points: along the horizontal course, turning no faster than a limit.

With the course ψ*_k at steps h apart, and r h the most that the heading may change in a step,

    ψ_k = ½ [max_j (ψ*_j − r h |k − j|) + min_j (ψ*_j + r h |k − j|)].

Both envelopes change by at most r h a step, so does their mean; it is ψ* wherever ψ* keeps the limit, and elsewhere
begins to turn as long before a corner as it ends after it. A moving average then rounds it, and keeps the limit.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from maxjax.trajectories.spline import average_neighbours

# Horizontal speed below which a course says nothing [m/s], and width of the average [s].
_SLOW, _ROUNDING = 0.3, 0.3
# More than rounding adds.
_SLACK = 1e-9


def headings(control: Float64[np.ndarray, "n 3"], step: float, rate: float) -> Float64[np.ndarray, " n"]:
    """Control points of the yaw [rad] for those of a position.

    Args:
        control: of the position [m].
        step: between control points [s].
        rate: greatest rate of change [rad/s].
    """
    course = np.diff(control[:, :2], axis=0, append=control[-1:, :2])
    known = np.flatnonzero(np.linalg.norm(course, axis=1) > _SLOW * step)
    if not known.size:
        return np.zeros(len(control))
    angle = np.unwrap(np.arctan2(course[known, 1], course[known, 0]))
    # In between, and where it flies straight up or down, the last course holds.
    before = np.clip(np.searchsorted(known, np.arange(len(control)), side="right") - 1, 0, None)
    wanted = angle[before]
    limit = rate * step * (1.0 - _SLACK)
    count = 2 * math.ceil(0.5 * _ROUNDING / step) + 1
    rounded = average_neighbours(0.5 * (_upper(wanted, limit) - _upper(-wanted, limit)), count)
    half = count // 2
    found: Float64[np.ndarray, " n"] = rounded[half : len(rounded) - half]
    return found


def _upper(values: Float64[np.ndarray, " n"], limit: float) -> Float64[np.ndarray, " n"]:
    """The least envelope above some values that changes by at most `limit` a step."""
    ramp = limit * np.arange(len(values))
    rising = np.maximum.accumulate(values + ramp) - ramp
    falling = np.maximum.accumulate((values - ramp)[::-1])[::-1] + ramp
    upper: Float64[np.ndarray, " n"] = np.maximum(rising, falling)
    return upper
