"""When a curve is flown: a B-spline in time that keeps limits of speed, climb, acceleration and jerk.

The fastest way without a limit of jerk (`planning.passes`), q(t), is sampled every `STEP`, and its moving average over
w = acceleration / jerk is the control polygon of the answer:

    c_k = mean of q over [t_k − w, t_k].

Averages stay in convex sets, so c keeps the limits of speed, climb and acceleration that q keeps; its jerk is
(q̈(t) − q̈(t − w)) / w, which keeps its limit where q̈ changes by no more than `acceleration` within w. Where it changes
by more (from full thrust to full braking, say), q is planned again with less acceleration at both places, round after
round; and with less speed where its average is faster than the place allows. What is left above a limit is removed by
one factor on all times, and the fastest round is taken. The average cuts corners by at most acceleration · w² / 24.
Other widths w are tried as well (`windows`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from numpy.lib.stride_tricks import sliding_window_view

from maxjax.planning.limits import FlightLimits
from maxjax.planning.passes import fastest, positions
from maxjax.planning.rounding import Curve
from maxjax.planning.spline import averaged, differences

STEP = 0.02  # between control points, before the factor [s]
# Widths of the average, in shares of acceleration / jerk.
_WIDTHS = (1.0, 1.25, 1.5)
_LONGEST = 2.0  # first of them [s]
# Rounds of planning q, and the factor on all times that needs no further one.
_ROUNDS, _ENOUGH = 24, 1.002
# More than rounding adds to a limit.
_SLACK = 1e-9
# Of a limit: what counts as kept, and the least that is planned with.
_JUST, _WEAKEST = 0.999, 0.15
_RISES = 1e-6  # slope of a climb below which none is limited


def planned_acceleration(limits: FlightLimits) -> float:
    """What q is planned with at most [m/s²]: less than its limit where jerk takes long to build that up."""
    return min(limits.acceleration, _LONGEST * limits.jerk)


def _first_acceleration(window: int, limits: FlightLimits) -> float:
    """What the first round plans with [m/s²]."""
    most, width = planned_acceleration(limits), window * STEP
    return min(most, 0.5 * limits.jerk * width) if width * limits.jerk < most * (1.0 - _SLACK) else most


def windows(limits: FlightLimits, length: float) -> list[int]:
    """Samples in a moving average, for each width that is tried: none is the fastest for all curves.

    On a short curve the acceleration has no time to reach its limit. With w jerk / 2 for it every change keeps the
    limit of jerk, and 2 √(length / acceleration) + w is least for w = (2 length / jerk)^⅓.
    """
    shortest = planned_acceleration(limits) / limits.jerk
    widths = [share * shortest for share in _WIDTHS]
    short = math.cbrt(2.0 * length / limits.jerk)
    if short < shortest:
        widths.append(short)
    return sorted({max(math.ceil(width / STEP - _SLACK), 1) for width in widths})


def cutting(limits: FlightLimits, window: int) -> float:
    """Greatest distance [m] between the curve and what is flown, by averages and the B-spline's own."""
    return limits.acceleration * STEP**2 * ((window**2 - 1) / 24.0 + 1.0 / 6.0)


class _Allowed(NamedTuple):
    """What q is planned with, at the samples s of a curve."""

    s: Float64[np.ndarray, " m"]
    speed: Float64[np.ndarray, " m"]  # greatest ds/dt
    acceleration: Float64[np.ndarray, " m"]


class _Attempt(NamedTuple):
    """A way q, sampled in time with its ends repeated, and its average."""

    q: Float64[np.ndarray, "t 3"]
    s: Float64[np.ndarray, " t"]
    control: Float64[np.ndarray, "n 3"]
    window: int


def timed(
    curve: Curve, s: Float64[np.ndarray, " m"], caps: Float64[np.ndarray, " m"], window: int, limits: FlightLimits
) -> tuple[Float64[np.ndarray, "n 3"], float]:
    """Control points, from rest to rest, and the factor on `STEP` with which they keep the limits.

    Args:
        curve: to be flown.
        s: its samples.
        caps: greatest speed at these [m/s].
        window: samples in the moving average.
        limits: of the answer.
    """
    _, slope, bend = curve.at(s)
    length = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    rises = slope[:, 2] / np.where(slope[:, 2] > 0.0, limits.ascent, -limits.descent)
    speed = np.minimum(np.minimum(limits.speed, caps) / length, 1.0 / np.maximum(rises, _RISES))
    allowed = _Allowed(s, speed, np.full(len(s), _first_acceleration(window, limits)))
    best, shortest, chosen = np.zeros((0, 3)), math.inf, 1.0
    for _ in range(_ROUNDS):
        at = positions(s, fastest(s, slope, bend, allowed.speed, allowed.acceleration), STEP)
        q = curve.at(at)[0]
        control = np.concatenate([q[[0, 0]], averaged(q, window), q[[-1, -1]]])
        tried = _Attempt(np.pad(q, ((window, window), (0, 0)), "edge"), np.pad(at, window, "edge"), control, window)
        beyond = _beyond_caps(tried, s, caps)
        factor = max(needed(control, limits), float(beyond.max()) * (1.0 + _SLACK))
        if len(control) * factor < shortest:
            best, shortest, chosen = control, len(control) * factor, factor
        if factor < _ENOUGH:
            break
        allowed = _less(allowed, tried, beyond, limits)
    best[[0, 1, 2]], best[[-1, -2, -3]] = curve.points[0], curve.points[-1]
    return best, chosen


def _beyond_caps(
    tried: _Attempt, s: Float64[np.ndarray, " m"], caps: Float64[np.ndarray, " m"]
) -> Float64[np.ndarray, " n"]:
    """By how much each difference of control points is faster than the place in the middle of its average allows.

    One that is at rest has 0; a difference k of control points averages the steps k − 1 to k + window − 2 of q.
    """
    speed = np.linalg.norm(differences(tried.control, STEP, 1), axis=1)
    first = np.arange(len(speed)) - 1
    reach = [np.clip(first + share, 0, len(tried.s) - 1) for share in (tried.window // 2, (tried.window + 1) // 2 + 1)]
    places = [np.interp(tried.s[k], s, caps) for k in reach]
    ratio: Float64[np.ndarray, " n"] = speed / np.minimum(*places)
    return ratio


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


def _less(allowed: _Allowed, tried: _Attempt, beyond: Float64[np.ndarray, " n"], limits: FlightLimits) -> _Allowed:
    """Speed and acceleration to plan with at each sample, that the next average keeps caps and limits."""
    window, acceleration = tried.window, np.zeros_like(tried.q)
    acceleration[1:-1] = differences(tried.q, STEP, 2)
    size = np.linalg.norm(acceleration, axis=1)
    jerk = np.linalg.norm(acceleration[window:] - acceleration[:-window], axis=1) / (window * STEP)
    over = jerk > limits.jerk / _JUST
    # Half of what is missing (as a power): switching points move with every round, and too little is never undone.
    share = np.sqrt(np.minimum(limits.jerk / np.maximum(jerk, 1e-12), 1.0))
    target = np.full(len(size), math.inf)
    target[window:] = np.where(over, share * size[window:], math.inf)
    target[:-window] = np.minimum(target[:-window], np.where(over, share * size[:-window], math.inf))
    # Where q itself exceeds the limit, which its planner keeps at samples only.
    weaker = np.where(size > limits.acceleration / _JUST, limits.acceleration / np.maximum(size, 1e-12), 1.0)
    # All that an average is made of is slowed down by as much as it is too fast.
    fast = np.ones(len(size) + 2)
    fast[: len(beyond)] = np.where(beyond > 1.0 / _JUST, beyond, 1.0)
    together = sliding_window_view(np.pad(fast, (0, window), constant_values=1.0), window + 1)
    slower = 1.0 / together.max(axis=1)[: len(size)]
    target, weaker, slower = (_at_samples(values, tried.s, allowed.s) for values in (target, weaker, slower))
    less = np.minimum(allowed.acceleration * weaker, target)
    return _Allowed(allowed.s, allowed.speed * slower, np.maximum(less, _WEAKEST * planned_acceleration(limits)))


def _at_samples(
    values: Float64[np.ndarray, " t"], at: Float64[np.ndarray, " t"], s: Float64[np.ndarray, " m"]
) -> Float64[np.ndarray, " m"]:
    """The least of some values, of times at which a curve is at `at`, around each sample s."""
    found = np.full(len(s), math.inf)
    before = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
    for i in (before, before + 1):
        np.minimum.at(found, i, values)
    first, last = np.searchsorted(at, s, side="left"), np.searchsorted(at, s, side="right")
    for j in (first - 1, first, last - 1, last):
        found = np.minimum(found, values[np.clip(j, 0, len(at) - 1)])
    return found
