"""Where the nose points on a mission: along the course, or as waypoints say."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

import maxjax
from maxjax import Waypoint

RATE = 0.8
LIMITS = maxjax.FlightLimits(speed=6.0, yaw_rate=RATE)
SEEN = (20.0, 30.0, 5.0)


@functools.cache
def flown(*waypoints: Waypoint) -> maxjax.Trajectory:
    grid = maxjax.Grid((41, 41, 15), 2.0, (-40.0, -40.0, 0.0))
    where = maxjax.VoxelMap.on(grid, np.zeros(grid.shape, bool))
    return maxjax.trajectory(maxjax.plan_mission(where, waypoints), LIMITS)


def turned(yaw: np.ndarray, wanted: np.ndarray | float) -> np.ndarray:
    """Angles between two directions [rad]."""
    return np.abs((yaw - wanted + math.pi) % (2.0 * math.pi) - math.pi)


def square(**middle: object) -> maxjax.Trajectory:
    """East, then north with a rest of 6 s on the way, then on north."""
    return flown(
        Waypoint((-30.0, -30.0, 10.0)),
        Waypoint((30.0, -30.0, 10.0)),
        Waypoint((30.0, 0.0, 10.0), hover=6.0, **middle),  # type: ignore[arg-type]
        Waypoint((30.0, 30.0, 10.0)),
    )


@pytest.mark.parametrize("heading", [0.0, 90.0, 200.0, -170.0])
def test_a_heading_is_held_at_rest_from_arrival_until_it_leaves(heading: float) -> None:
    """Clockwise from north, as a compass has it; turns keep their rate and begin only when the rest has ended."""
    trajectory = square(heading=heading)
    arrives = float(trajectory.passes[2])
    motion = trajectory.at(np.linspace(arrives, arrives + 5.9, 50))
    assert np.abs(motion.velocity).max() < 1e-6
    assert turned(motion.yaw, math.radians(90.0 - heading)).max() < 1e-3
    every = trajectory.sampled(0.02)
    assert np.abs(every.yaw_rate).max() <= RATE + 1e-9
    # Before the leg and at its end the nose points along the course.
    assert turned(trajectory.at([2.0]).yaw, 0.0) < 1e-3
    assert turned(every.yaw[-1:], math.pi / 2) < 1e-3


def test_a_point_of_interest_is_looked_at_all_along_the_leg() -> None:
    trajectory = square(look_at=SEEN)
    begins, arrives = trajectory.passes[1:3].tolist()
    motion = trajectory.at(np.linspace(begins + 0.6 * (arrives - begins), arrives + 6.0, 80))
    away = np.array(SEEN) - motion.position
    assert turned(motion.yaw, np.arctan2(away[:, 1], away[:, 0])).max() < 0.06
    assert np.abs(trajectory.sampled(0.02).yaw_rate).max() <= RATE + 1e-9


def test_the_start_has_a_heading_while_it_rests_there() -> None:
    trajectory = flown(Waypoint((0.0, 0.0, 10.0), hover=8.0, heading=180.0), Waypoint((30.0, 0.0, 10.0)))
    motion = trajectory.at(np.linspace(0.0, 7.9, 40))
    assert turned(motion.yaw, -math.pi / 2).max() < 1e-3
    assert turned(trajectory.sampled(0.05).yaw[-1:], 0.0) < 1e-3


def test_above_the_point_of_interest_the_nose_stays_as_it_was() -> None:
    trajectory = flown(Waypoint((-30.0, 0.0, 10.0)), Waypoint((0.0, 0.0, 10.0), hover=2.0, look_at=(0.0, 0.0, 0.0)))
    assert np.isfinite(trajectory.headings).all()
    assert turned(trajectory.sampled(0.05).yaw, 0.0).max() < 1e-3


def test_without_an_aim_the_course_is_as_it_was() -> None:
    plain = square()
    motion = plain.sampled(0.02)
    moves = np.linalg.norm(motion.velocity[:, :2], axis=1) > 3.0
    assert turned(motion.yaw[moves], np.arctan2(motion.velocity[moves, 1], motion.velocity[moves, 0])).max() < 0.6
    assert turned(motion.yaw[-1:], math.pi / 2) < 1e-3


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"heading": 361.0}, "Waypoint.heading: expected degrees from -360 to 360, given 361.0"),
        ({"heading": math.nan}, "Waypoint.heading: expected degrees"),
        ({"heading": 0.0, "look_at": SEEN}, "expected heading or look_at, given both"),
        ({"look_at": (0.0, math.nan, 0.0)}, "Waypoint.look_at"),
    ],
)
def test_what_is_no_direction_is_refused(given: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Waypoint((0.0, 0.0, 0.0), **given)  # type: ignore[arg-type]
