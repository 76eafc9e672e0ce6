"""From a plan to a trajectory: round its corners, verify, find the times, verify again.

    plan → rounded curves between rests → clear? → speeds and times → B-spline → clear? → Trajectory

A corner whose rounding is not clear is rounded less; one that cannot be rounded is passed at rest, on the plan's own
verified path (`trajectories.clear_curve`). Near walls it is slower (`FlightLimits.near`).

Flights in closed loop have a reference of their own (`trajectories.online`): there a plan is replaced every second,
from whatever speed the vehicle has, in float32 on a device, and needs no limit of jerk. Both round corners by one
formula.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.status import Status
from maxjax.planning.plan import Plan
from maxjax.trajectories.clear_curve import ClearCurve, project
from maxjax.trajectories.corner_rounding import Curve
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.parametrise import STEP, cutting, time_spline
from maxjax.trajectories.spline import duration, evaluate
from maxjax.trajectories.trajectory import Trajectory
from maxjax.trajectories.yaw_profile import headings

# What is left of a corner's blend where it is not clear, and the least width of one [m].
_SHARE, _NARROWEST = 0.6, 0.1
# Longest time at rest that can be asked for [s].
_HOVER = 3600.0
# Rounds of rounding less before it rests at every corner.
_TRIES = 60
# Distance of the places where clearance is measured [m].
_STATIONS = 0.1


class _Course(NamedTuple):
    """The request: the path from (0, 0, 0) on, its hover times [s] by point, and its verifier."""

    plan: Plan
    local: Float64[np.ndarray, "n 3"]
    hovers: Mapping[int, float]
    limits: FlightLimits
    around: ClearCurve
    speeds: Float64[np.ndarray, " e"]  # greatest speed on each edge of the path [m/s]


def schedule_plan(
    plan: Plan,
    limits: FlightLimits,
    hovers: Mapping[int, float],
    around: ClearCurve,
    speeds: Float64[np.ndarray, " e"] | None = None,
) -> Trajectory:
    """The trajectory of a plan; see `maxjax.trajectory`.

    Args:
        plan: with a path.
        limits: to keep.
        hovers: times [s] to rest at points of the path, by index.
        around: its path in the map.
        speeds: greatest speed on each edge of the path [m/s]. None: that of the limits.

    Raises:
        ValueError: for a plan without a path, repeated points, or hovers that are no times at points in between.
    """
    path = _checked(plan, hovers)
    speeds = np.full(len(path) - 1, limits.speed) if speeds is None else speeds
    course = _Course(plan, path - path[0], hovers, limits, around, speeds)
    shares = np.full(len(path), 1.0)
    shares[list(hovers)] = 0.0
    for tries in itertools.count():
        if tries == _TRIES:
            shares[:] = 0.0
        curves = _curves(course, shares)
        unclear = _unclear_geometry(course, curves)
        if not unclear.size:
            found, rests = _flown(course, curves)
            unclear = _unclear_flight(course, found)
            if not unclear.size:
                break
        _lower(shares, unclear, curves)
    control, step = found
    clearance = around.least_clearance(path[0] + _knots(control))
    yaw = headings(control, step, limits.yaw_rate)
    x, y, z = path[0].tolist()
    ends = np.array([0.0, duration(control, step)])
    return Trajectory((x, y, z), control, yaw, step, limits, plan.radius, plan.exemptions, clearance, rests, ends, plan)


def _checked(plan: Plan, hovers: Mapping[int, float]) -> Float64[np.ndarray, "n 3"]:
    if plan.status != Status.OK:
        raise ValueError(f"plan: expected one that is OK, given {plan.status.name}: {plan.status.advice}")
    path = np.asarray(plan.path, np.float64)
    if path.ndim != 2 or path.shape[1] != 3 or len(path) < 2 or not np.isfinite(path).all():
        raise ValueError(f"plan.path: expected at least two finite points (n, 3), given shape {path.shape}")
    repeated = np.flatnonzero((path[1:] == path[:-1]).all(axis=1))
    if repeated.size:
        k = int(repeated[0])
        raise ValueError(f"plan.path: expected neighbours that differ, given {path[k].tolist()} twice, at {k}, {k + 1}")
    for k, seconds in hovers.items():
        if not 0 < k < len(path) - 1 or not 0.0 <= seconds <= _HOVER:
            raise ValueError(
                f"hovers: expected times from 0 to {_HOVER:g} s at points 1 to {len(path) - 2}, given {seconds} at {k}"
            )
    return path


def _curves(course: _Course, shares: Float64[np.ndarray, " n"]) -> list[Curve]:
    """The path cut where it rests, each part rounded by the corners' shares; too narrow a corner becomes a rest."""
    while True:
        rests = [0, *(np.flatnonzero(shares[1:-1] == 0.0) + 1).tolist(), len(shares) - 1]
        curves, narrow = [], []
        for first, last in itertools.pairwise(rests):
            part = slice(first, last + 1)
            curves.append(Curve.of(course.local[part]).rounded(course.limits.deviation, shares[part]))
            bent = np.linalg.norm(curves[-1].turns[1:-1], axis=1) > 1e-9
            narrow += (first + 1 + np.flatnonzero(bent & (curves[-1].widths[1:-1] < _NARROWEST))).tolist()
        if not narrow:
            return curves
        shares[narrow] = 0.0


def _unclear_geometry(course: _Course, curves: list[Curve]) -> Float64[np.ndarray, " k"]:
    """Arc lengths of the path where the rounded curves are not clear."""
    points, bulge = [], 1e-6
    for curve in curves:
        s = curve.samples()
        point, _, bend = curve.at(s)
        size = np.linalg.norm(bend, axis=1)
        # Between samples x″ is linear, or nearly so.
        bulge = max(bulge, float((1.5 * np.maximum(size[1:], size[:-1]) * np.diff(s) ** 2).max() / 8.0))
        points.append(point)
    samples = np.concatenate(points) + course.plan.path[0]
    return _places(course, samples, course.around.unclear(samples, bulge))


def _unclear_flight(course: _Course, found: tuple[Float64[np.ndarray, "n 3"], float]) -> Float64[np.ndarray, " k"]:
    """Arc lengths of the path where the trajectory is not clear."""
    control, step = found
    samples = _knots(control) + course.plan.path[0]
    bulge = course.limits.acceleration * step**2 / 8.0
    return _places(course, samples, course.around.unclear(samples, bulge))


def _places(
    course: _Course, samples: Float64[np.ndarray, "m 3"], unclear: Bool[np.ndarray, " m"]
) -> Float64[np.ndarray, " k"]:
    return project(samples[unclear] - course.plan.path[0], course.local)[1]


def _lower(shares: Float64[np.ndarray, " n"], unclear: Float64[np.ndarray, " k"], curves: list[Curve]) -> None:
    """Round the corners less whose blends reach a place that is not clear; where none does, the nearest one."""
    starts = np.cumsum([0.0, *(curve.arclength[-1] for curve in curves)])
    corners = np.concatenate([start + c.arclength[:-1] for start, c in zip(starts, curves, strict=False)])
    widths = np.concatenate([curve.widths[:-1] for curve in curves])
    gap = np.abs(unclear[:, None] - corners)
    gap[:, widths == 0.0] = math.inf
    guilty = (gap <= widths) | (gap == gap.min(axis=1, keepdims=True))
    shares[:-1][guilty.any(axis=0)] *= _SHARE


def _flown(
    course: _Course, curves: list[Curve]
) -> tuple[tuple[Float64[np.ndarray, "n 3"], float], Float64[np.ndarray, " k"]]:
    """Control points of all curves, one after the other, their step [s], and the times at rest in between."""
    found, edge = [], 0
    for curve in curves:
        stations = np.linspace(0.0, curve.arclength[-1], math.ceil(curve.arclength[-1] / _STATIONS) + 1)
        asked = course.speeds[edge : edge + len(curve.directions)]
        edge += len(curve.directions)
        found.append(time_spline(curve, stations, _caps(course, curve, stations, asked), course.limits))
    parts, step = [control for control, _ in found], STEP * max(factor for _, factor in found)
    whole, rests, point = parts[0], [], 0
    for curve, part in zip(curves, parts[1:], strict=False):
        rests.append(duration(whole, step))
        point += len(curve.points) - 1
        pause = math.ceil(course.hovers.get(point, 0.0) / step)
        # Both have three equal control points at the rest, of which one set stays.
        whole = np.concatenate([whole, np.repeat(whole[-1:], pause, axis=0), part[3:]])
    return (whole, step), np.array(rests)


def _caps(
    course: _Course, curve: Curve, stations: Float64[np.ndarray, " k"], asked: Float64[np.ndarray, " e"]
) -> Float64[np.ndarray, " k"]:
    """Greatest speed at evenly spread stations of a curve, from the clearance around each and what is asked [m/s]."""
    limits, apart = course.limits, float(stations[1])
    # A place between two stations is at most half their distance from one, and what is flown is off by the cutting.
    lost = 0.5 * apart + cutting(limits) + course.plan.radius
    spare = np.maximum(_clearance(course, curve, stations) - lost, 0.0)
    before, after = (np.searchsorted(curve.arclength[1:-1], stations, side) for side in ("left", "right"))
    slowest = np.minimum(np.minimum(asked[before], asked[after]), limits.speed)
    square = np.minimum(limits.near**2 + 2.0 * limits.acceleration * spare, slowest**2)
    # It takes some way to brake from one edge's speed to the next one's.
    rise = 2.0 * limits.acceleration * stations
    reached = np.minimum.accumulate(square - rise) + rise
    reached = np.minimum.accumulate((reached + rise)[::-1])[::-1] - rise
    caps: Float64[np.ndarray, " k"] = np.sqrt(np.maximum(reached, square.min()))
    return caps


def _clearance(course: _Course, curve: Curve, stations: Float64[np.ndarray, " k"]) -> Float64[np.ndarray, " k"]:
    """Clearance of places of a curve [m]."""
    return course.around.clearance(curve.at(stations)[0] + course.plan.path[0])


def _knots(control: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    """The spline where its pieces meet."""
    return evaluate(control, 1.0, np.arange(len(control) - 2.0))
