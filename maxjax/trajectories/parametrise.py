"""When a curve is flown: a B-spline in time that keeps limits of speed, climb, acceleration and jerk.

    the fastest way without a limit of jerk (`trajectories.speed_profile`) → its moving average, a start
    → the shortest time at a long step h (`trajectories.time_optimal`) → control points every `STEP`

Control points are places on the curve h apart, so that the spline cuts its corners by at most A h²/6: h is a third of
acceleration / jerk, below which a spline gains nothing in time. The answer's control points are the spline at times
`STEP` apart: differences of samples are averages of derivatives, and keep the limits that these keep. What rounding
adds is removed by one factor on all times.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from maxjax.trajectories.corner_rounding import Curve
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.speed_profile import check_duration, fastest, positions
from maxjax.trajectories.spline import average_neighbours, differences, duration, evaluate
from maxjax.trajectories.time_optimal import Way, factor_to_keep, shortest

STEP = 0.02  # between control points, before the factor [s]
# The long step: a share of acceleration / jerk, at most one that cuts so much [m], and so many in a curve at least.
_SHARE, _CUT, _FEWEST = 1.0 / 3.0, 0.04, 24
# Steps in a curve at most, whose times are sought together: they take a minute.
_MOST = 50_000
_LONGEST = 0.2  # of the steps that a search begins with [s]
# Width of the average that a search starts from, in shares of acceleration / jerk, and steps at least.
_WIDTH, _STEPS = 1.5, 3.0
# More than rounding adds to a limit.
_SLACK = 1e-9
_FASTER = 1.2  # than the fastest dσ/dt without a limit of jerk
_RISES = 1e-6  # slope of a climb below which none is limited


def _long_step(limits: FlightLimits, takes: float) -> float:
    """Step of the spline whose time is the shortest [s], for a curve that takes about so long [s]."""
    # In half of its time the acceleration rises.
    acceleration = min(limits.acceleration, 0.5 * limits.jerk * takes)
    cut = math.sqrt(6.0 * _CUT / acceleration)
    return max(min(_SHARE * limits.acceleration / limits.jerk, cut, takes / _FEWEST), STEP)


def cutting(limits: FlightLimits) -> float:
    """Greatest distance [m] between the curve and what is flown."""
    bound = limits.acceleration * max(_SHARE * limits.acceleration / limits.jerk, STEP) ** 2 / 6.0
    return min(bound, _CUT) + limits.acceleration * STEP**2 / 6.0


def time_spline(
    curve: Curve, stations: Float64[np.ndarray, " k"], caps: Float64[np.ndarray, " k"], limits: FlightLimits
) -> tuple[Float64[np.ndarray, "n 3"], float]:
    """Control points, from rest to rest, and the factor on `STEP` with which they keep the limits.

    Args:
        curve: to be flown.
        stations: rising arc lengths from its start to its end.
        caps: greatest speed at these [m/s]; its square is linear in between, and changes by 2 acceleration a metre at
            most.
        limits: of the answer.

    Raises:
        ValueError: for limits with which it takes days, or too many steps.
    """
    way, start = _start(curve, stations, caps, limits)
    takes = STEP * len(start)
    aim = _long_step(limits, takes)
    if (count := math.ceil(takes / aim)) > _MOST:
        raise ValueError(
            f"limits: expected ones with which a path takes at most {_MOST} samples, given some with which one of "
            f"{curve.arclength[-1]:g} m takes {count}, {aim:.3g} s apart; raise the acceleration or lower the jerk"
        )
    halvings = max(math.floor(math.log2(min(_LONGEST, takes / _FEWEST) / aim) + _SLACK), 0)
    step = aim * 2.0**halvings
    at = np.linspace(0.0, len(start) - 1.0, math.ceil(takes / step) + 1)
    sigma = np.pad(np.interp(at, np.arange(float(len(start))), start), 2, "edge")
    check_duration(duration(sigma, step * factor_to_keep(way, sigma, step)), curve.arclength[-1])
    sigma, step = shortest(way, sigma, step, halvings)
    times = STEP * np.arange(-2.0, math.ceil(duration(sigma, step) / STEP) + 3.0)
    control = evaluate(way.place(sigma), step, times)
    control[:3], control[-3:] = curve.points[0], curve.points[-1]
    # Half-way between two times, where the difference of their control points is the velocity.
    place = evaluate(sigma, step, times[:-1] + 0.5 * STEP)
    speed = np.linalg.norm(differences(control, STEP, 1), axis=1)
    beyond = float((speed / np.sqrt(np.interp(place, stations, caps**2))).max())
    return control, max(needed(control, limits), beyond * (1.0 + _SLACK))


def _start(
    curve: Curve, stations: Float64[np.ndarray, " k"], caps: Float64[np.ndarray, " k"], limits: FlightLimits
) -> tuple[Way, Float64[np.ndarray, " t"]]:
    """The curve to fly, and σ at times `STEP` apart: the fastest without a limit of jerk, averaged."""
    s = curve.samples()
    _, slope, bend = curve.at(s)
    length = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    rises = slope[:, 2] / np.where(slope[:, 2] > 0.0, limits.ascent, -limits.descent)
    along = np.sqrt(np.interp(s, stations, caps**2)) / length
    speed = np.minimum(along, 1.0 / np.maximum(rises, _RISES))
    square = fastest(s, slope, bend, speed, np.full(len(s), limits.acceleration))
    # Far apart, control points could leap over a bend: they are held to about what the curve itself allows.
    held = np.maximum(_FASTER**2 * square, (limits.acceleration * _LONGEST) ** 2)
    way = Way.of(curve, s, np.minimum(along**2, held), limits)
    at = positions(s, square, STEP)
    width = max(_WIDTH * min(limits.acceleration / limits.jerk, STEP * len(at)), _STEPS * _LONGEST)
    return way, average_neighbours(at, max(round(width / STEP), 1))


def needed(control: Float64[np.ndarray, "n 3"], limits: FlightLimits) -> float:
    """The factor on all times, at least 1, with which the spline of these control points keeps its limits."""
    velocity, acceleration, jerk = (differences(control, STEP, order) for order in (1, 2, 3))

    def most(values: Float64[np.ndarray, "n ..."]) -> float:
        return float(np.linalg.norm(values, axis=-1).max(initial=0.0) if values.ndim > 1 else values.max(initial=0.0))

    ratios = (
        most(velocity) / limits.speed,
        most(velocity[:, 2]) / limits.ascent,
        most(-velocity[:, 2]) / limits.descent,
        math.sqrt(most(acceleration) / limits.acceleration),
        math.cbrt(most(jerk) / limits.jerk),
    )
    return max(1.0, *ratios) * (1.0 + _SLACK)
