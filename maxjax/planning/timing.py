"""When a curve is flown: a B-spline in time that keeps limits of speed, climb, acceleration and jerk.

The fastest way without a limit of jerk (`planning.passes`), q(t), is sampled every `STEP`, and its moving average over
w = acceleration / jerk is the control polygon of the answer:

    c_k = mean of q over [t_k − w, t_k].

Averages stay in convex sets, so c keeps the limits of speed, climb and acceleration that q keeps; its jerk is
(q̈(t) − q̈(t − w)) / w, which keeps its limit where q̈ changes by no more than `acceleration` within w. Where it changes
by more (from full thrust to full braking, say), q is planned again with less acceleration at both places, round after
round. What is left above a limit is removed by one factor on all times, and the fastest round is taken. The average
cuts corners by at most acceleration · w² / 24. Other widths w are tried as well (`windows`).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from maxjax.planning.limits import FlightLimits
from maxjax.planning.passes import fastest, positions
from maxjax.planning.rounding import Curve
from maxjax.planning.spline import averaged, differences

STEP = 0.02  # between control points, before the factor [s]
# Widths of the average, in shares of acceleration / jerk.
_WIDTHS = (1.0, 1.25, 1.5)
# Rounds of planning q, and the factor on all times that needs no further one.
_ROUNDS, _ENOUGH = 24, 1.002
# More than rounding adds to a limit.
_SLACK = 1e-9
# Of a limit: what counts as kept, and the least that is planned with.
_JUST, _WEAKEST = 0.999, 0.3
_RISES = 1e-6  # slope of a climb below which none is limited


def windows(limits: FlightLimits) -> list[int]:
    """Samples in a moving average, for each width that is tried: none is the fastest for all curves."""
    shortest = limits.acceleration / (limits.jerk * STEP)
    return sorted({max(math.ceil(share * shortest - _SLACK), 1) for share in _WIDTHS})


def cutting(limits: FlightLimits, window: int) -> float:
    """Greatest distance [m] between the curve and what is flown, by averages and the B-spline's own."""
    return limits.acceleration * STEP**2 * ((window**2 - 1) / 24.0 + 1.0 / 6.0)


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
    fastest_allowed = np.minimum(np.minimum(limits.speed, caps) / length, 1.0 / np.maximum(rises, _RISES))
    strength = np.full(len(s), limits.acceleration)
    best, shortest, chosen = np.zeros((0, 3)), math.inf, 1.0
    for _ in range(_ROUNDS):
        at = positions(s, fastest(s, slope, bend, fastest_allowed, strength), STEP)
        q = curve.at(at)[0]
        control = np.concatenate([q[[0, 0]], averaged(q, window), q[[-1, -1]]])
        factor = needed(control, limits)
        if len(control) * factor < shortest:
            best, shortest, chosen = control, len(control) * factor, factor
        if factor < _ENOUGH:
            break
        strength = _weaker(q, at, s, window, strength, limits)
    best[[0, 1, 2]], best[[-1, -2, -3]] = curve.points[0], curve.points[-1]
    return best, chosen


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


def _weaker(
    q: Float64[np.ndarray, "t 3"],
    at: Float64[np.ndarray, " t"],
    s: Float64[np.ndarray, " m"],
    window: int,
    strength: Float64[np.ndarray, " m"],
    limits: FlightLimits,
) -> Float64[np.ndarray, " m"]:
    """The acceleration to plan with at each sample, that acceleration and jerk of the next q keep their limits."""
    padded = np.pad(q, ((window, window), (0, 0)), "edge")
    at = np.pad(at, window, "edge")
    acceleration = np.zeros_like(padded)
    acceleration[1:-1] = differences(padded, STEP, 2)
    size = np.linalg.norm(acceleration, axis=1)
    jerk = np.linalg.norm(acceleration[window:] - acceleration[:-window], axis=1) / (window * STEP)
    over = jerk > limits.jerk / _JUST
    # Half of what is missing (as a power): switching points move with every round, and too little is never undone.
    share = np.sqrt(np.minimum(limits.jerk / np.maximum(jerk, 1e-12), 1.0))
    target = np.full(len(padded), math.inf)
    target[window:] = np.where(over, share * size[window:], math.inf)
    target[:-window] = np.minimum(target[:-window], np.where(over, share * size[:-window], math.inf))
    # Where q itself exceeds the limit, which its planner keeps at samples only.
    beyond = np.where(size > limits.acceleration / _JUST, limits.acceleration / np.maximum(size, 1e-12), math.inf)

    found = strength.copy()
    before = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
    first, last = np.searchsorted(at, s, side="left"), np.searchsorted(at, s, side="right")
    for i in (before, before + 1):
        np.minimum.at(found, i, np.minimum(target, strength[i] * beyond))
    for j in (first - 1, first, last - 1, last):
        j = np.clip(j, 0, len(at) - 1)
        found = np.minimum(found, np.minimum(target[j], strength * beyond[j]))
    weaker: Float64[np.ndarray, " m"] = np.maximum(found, _WEAKEST * limits.acceleration)
    return weaker
