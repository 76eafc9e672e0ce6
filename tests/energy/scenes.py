"""What the tests of energy fly: an open field with ground, places around home, and trajectories between them."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

import maxjax
from maxjax.planning.mission import Mission, join_legs
from maxjax.planning.problem.task import Task
from tests.planners import bare_plan

LIMITS = maxjax.FlightLimits(speed=8.0, acceleration=2.0, jerk=4.0)
HOME = (0.0, 0.0, 10.0)


def field() -> maxjax.VoxelMap:
    """400 x 400 x 60 m with nothing on it; the ground ends at z = 0."""
    ground = np.zeros((100, 100, 16), bool)
    ground[:, :, 0] = True
    return maxjax.VoxelMap.of(ground.copy(), spacing=4.0, origin=(-198.0, -198.0, -2.0), ground=ground)


def mission_over(*stops: maxjax.Waypoint | Sequence[float]) -> Mission:
    """Straight legs between some places, each as if it had been planned."""
    given = [stop if isinstance(stop, maxjax.Waypoint) else maxjax.Waypoint(tuple(stop)) for stop in stops]
    where, points = field(), np.array([stop.position for stop in given])
    legs = [
        bare_plan(where, pair, length=float(np.linalg.norm(pair[1] - pair[0])), clearance=np.inf, radius=1.0,
                  exemptions=(0.0, 0.0), clearance_at=np.full(2, np.inf))
        for pair in map(np.array, itertools.pairwise(points))
    ]  # fmt: skip
    return join_legs(given, legs, Task.of(where, points[:-1], points[1:]), {})


def trajectory_over(*stops: maxjax.Waypoint | Sequence[float], **limits: float) -> maxjax.Trajectory:
    """The same in time."""
    return maxjax.trajectory(mission_over(*stops), dataclasses.replace(LIMITS, **limits))
