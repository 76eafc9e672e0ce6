"""How long PX4's missions take: along straight lines, by the speeds at which it passes waypoints.

    v ≤ √(½ MPC_ACC_HOR r tan ½α)     past a corner between legs at the angle α (π: straight on), within the radius r
    v ≤ what it can brake from to rest on the next leg, since it looks no further than the waypoint after the next
    v = 0                             at a hold, and where the next waypoint lies within the radius

A change of speed Δ takes Δ/a + a/j, or 2 √(Δ/j) where that does not reach a, at the mean of both speeds. By PX4's
public description of its jerk-limited missions (MPC_XY_TRAJ_P 0.5); no flight of a PX4 was measured.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from maxjax.io.export.autopilot import Autopilot, MissionLimits
from maxjax.io.export.blended_legs import Vectors
from maxjax.io.export.s_curve import Vector

_GAIN = 0.5  # MPC_XY_TRAJ_P
_HALVINGS = 40


def px4_duration(places: Vectors, speeds: Vector, holds: Vector, accepted: Vector, autopilot: Autopilot) -> float:
    """How long PX4 takes from the first waypoint to the last one [s].

    Args:
        places: of the waypoints [m].
        speeds: greatest horizontal one on the way to each [m/s]; NaN: its own.
        holds: at each [s].
        accepted: acceptance radius of each [m].
        autopilot: PX4.
    """
    limits, steps = autopilot.mission, np.diff(places, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    passing = [0.0]
    for k in range(1, len(places) - 1):
        radius = autopilot.radius_of(float(accepted[k]))
        if holds[k] > 0.0 or lengths[k] < radius or lengths[k - 1] == 0.0:
            passing.append(0.0)
            continue
        cosine = float(steps[k - 1] @ steps[k]) / (lengths[k - 1] * lengths[k])
        half = 0.5 * (math.pi - math.acos(min(max(cosine, -1.0), 1.0)))
        turn = math.sqrt(_GAIN * limits.acceleration * radius * min(math.tan(half), 1e6))
        passing.append(min(turn, _fastest(float(lengths[k]), 0.0, math.inf, limits)))
    passing.append(0.0)
    took = float(np.sum(holds[:-1]))
    for k, (start, end) in enumerate(itertools.pairwise(passing)):
        cruise = limits.speed if math.isnan(speeds[k + 1]) else float(speeds[k + 1])
        climb = float(steps[k, 2])
        level = _time(math.hypot(*steps[k, :2].tolist()), min(start, cruise), min(end, cruise), cruise, limits)
        took += max(level, abs(climb) / (limits.ascent if climb > 0.0 else limits.descent))
    return took


def _change(difference: float, limits: MissionLimits) -> float:
    """How long a change of speed takes [s]."""
    if difference >= limits.acceleration**2 / limits.jerk:
        return difference / limits.acceleration + limits.acceleration / limits.jerk
    return 2.0 * math.sqrt(max(difference, 0.0) / limits.jerk)


def _way(one: float, other: float, limits: MissionLimits) -> float:
    """How far a change of speed leads [m]."""
    return 0.5 * (one + other) * _change(abs(one - other), limits)


def _fastest(way: float, end: float, cruise: float, limits: MissionLimits) -> float:
    """Greatest speed from which another one is reached on a way [m/s]."""
    low, high = end, min(cruise, end + math.sqrt(2.0 * limits.acceleration * way) + 1e-9)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _way(middle, end, limits) <= way else (low, middle)
    return low


def _time(way: float, start: float, end: float, cruise: float, limits: MissionLimits) -> float:
    """Least time of a way between two speeds [s]."""
    if way <= 0.0:
        return 0.0
    end = min(end, _fastest(way, start, cruise, limits))
    start = min(start, _fastest(way, end, cruise, limits))
    low, high = max(start, end), max(start, end, cruise)
    for _ in range(_HALVINGS):
        peak = 0.5 * (low + high)
        fits = _way(start, peak, limits) + _way(peak, end, limits) <= way
        low, high = (peak, high) if fits else (low, peak)
    changes = _change(low - start, limits) + _change(low - end, limits)
    left = max(0.0, way - _way(start, low, limits) - _way(low, end, limits))
    return changes + left / max(low, 1e-3)
