"""Missions: legs are plans, the whole is one verified line, its trajectory keeps what was asked of each leg."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

import maxjax
from maxjax import Status, Waypoint
from maxjax.planning import mission as missions
from maxjax.planning.mission import Mission
from tests.references import random_blocks

GRID = maxjax.Grid((41, 41, 21), 2.0, (500.0, -40.0, 1.0))
A, B, C, D = (506.0, -36.0, 21.0), (576.0, -36.0, 21.0), (576.0, 36.0, 31.0), (506.0, 36.0, 21.0)  # centres of voxels
LIMITS = maxjax.FlightLimits(speed=9.0)


@functools.cache
def town() -> np.ndarray:
    occupied = random_blocks(np.random.default_rng(5), GRID.shape, 25, 9)
    for point in (A, B, C, D):
        x, y, z = np.round((np.array(point) - GRID.origin) / GRID.spacing).astype(int)
        occupied[max(x - 3, 0) : x + 4, max(y - 3, 0) : y + 4, max(z - 3, 0) : z + 4] = False
    return occupied


def planned(*waypoints: Any, **options: Any) -> Mission:
    given = {"planner": maxjax.AStar(), "distances": maxjax.Distances(margin=6.0)} | options
    return maxjax.plan_mission(maxjax.VoxelMap.on(GRID, town()), waypoints, **given)


@functools.cache
def tour() -> Mission:
    """Flown through B, slowly to C, where it hovers, with more radius to D, and back."""
    return planned(A, B, Waypoint(C, hover=3.0, speed=4.0), Waypoint(D, radius=1.5), return_to_start=True)


@functools.cache
def flown() -> maxjax.Trajectory:
    return maxjax.trajectory(tour(), LIMITS)


def norm(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values, axis=-1)


def test_legs_are_plans_and_the_whole_is_one_line() -> None:
    mission = tour()
    assert mission.status == Status.OK
    assert not mission.failed
    assert len(mission.legs) == 4
    np.testing.assert_array_equal(mission.path[mission.places], [A, B, C, D, A])
    for k, (start, goal, radius) in enumerate([(A, B, 1.0), (B, C, 1.0), (C, D, 1.5), (D, A, 1.0)]):
        alone = maxjax.plan(
            maxjax.VoxelMap.on(GRID, town()),
            start,
            goal,
            planner=maxjax.AStar(),
            distances=maxjax.Distances(radius=radius, margin=6.0),
        )
        np.testing.assert_array_equal(mission.leg_path(k), alone.path)
        assert mission.legs[k].radius == radius
    assert mission.length == pytest.approx(norm(np.diff(mission.path, axis=0)).sum())
    assert mission.clearance == min(leg.clearance for leg in mission.legs)
    assert mission.timings["verify"] > 0.0


@pytest.mark.large
def test_legs_of_one_goal_share_a_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """And are the plans that each has by itself."""
    fleets = []

    def counted(task: Any, *rest: Any) -> Any:
        fleets.append(len(task))
        return real(task, *rest)

    real = missions.plan_to_goal
    monkeypatch.setattr(missions, "plan_to_goal", counted)
    ways = A, B, A, C, A
    shared = planned(*ways, planner=maxjax.Field())
    assert fleets == [2]
    monkeypatch.setattr(missions, "LARGEST_SHARED", 0)
    alone = planned(*ways, planner=maxjax.Field())
    assert fleets == [2]
    assert (shared.status, alone.status) == (Status.OK, Status.OK)
    assert [leg.certified for leg in shared.legs] == [True] * 4
    assert shared.length == pytest.approx(alone.length, rel=1e-3)


def test_what_is_wrong_with_a_leg_stays_with_it() -> None:
    occupied = town().copy()
    occupied[18:25, 18:25, :] = True
    occupied[20:23, 20:23, :] = False  # a shaft in a block, open to nothing
    shaft, wall, outside, nowhere = (542.0, 2.0, 11.0), (536.0, 0.0, 11.0), (400.0, 0.0, 9.0), (math.nan, 0.0, 0.0)
    middle = {
        shaft: (Status.NO_VALID_PATH, Status.NO_VALID_PATH),
        wall: (Status.GOAL_OCCUPIED, Status.START_OCCUPIED),
        outside: (Status.GOAL_OUTSIDE_MAP, Status.START_OUTSIDE_MAP),
        nowhere: (Status.NONFINITE_INPUT, Status.NONFINITE_INPUT),
        A: (Status.START_EQUALS_GOAL, Status.OK),
    }
    for waypoint, statuses in middle.items():
        mission = maxjax.plan_mission(
            maxjax.VoxelMap.on(GRID, occupied),
            [A, waypoint, C, D],
            planner=maxjax.AStar(),
            distances=maxjax.Distances(margin=6.0),
        )
        assert tuple(leg.status for leg in mission.legs) == (*statuses, Status.OK)
        assert mission.status == statuses[0]
        assert mission.failed == ((0,) if waypoint == A else (0, 1))
        assert mission.path.shape == (0, 3)
        assert math.isnan(mission.length)
        assert math.isnan(mission.clearance)
        with pytest.raises(ValueError, match=f"mission: expected one that is OK, given {statuses[0].name}"):
            maxjax.trajectory(mission, LIMITS)


def test_the_first_legs_are_a_mission_of_their_own() -> None:
    task = missions.Task.of(maxjax.VoxelMap.on(GRID, town()), *missions.legs_of([Waypoint(p) for p in (A, B, C)]))
    mission = planned(A, B, (400.0, 0.0, 9.0), C)
    part = missions.first_legs(mission, task)
    assert part is not None
    assert (part.status, len(part.legs), len(part.waypoints)) == (Status.OK, 1, 2)
    np.testing.assert_array_equal(part.path, mission.legs[0].path)
    assert missions.first_legs(planned((400.0, 0.0, 9.0), A, B), task) is None


def test_the_judge_sees_the_joined_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """A leg that the planner would let pass, and that touches something, is refused with the whole mission."""
    through = np.zeros(GRID.shape, bool)
    through[20, :, :] = True
    task = missions.Task.of(maxjax.VoxelMap.on(GRID, through), *missions.legs_of([Waypoint(A), Waypoint(B)]))
    free = maxjax.plan(maxjax.VoxelMap.on(GRID, np.zeros(GRID.shape, bool)), A, B, planner=maxjax.AStar())
    mission = missions.join_legs([Waypoint(A), Waypoint(B)], [free], task, {})
    assert mission.status == Status.PATH_IN_COLLISION
    assert mission.path.shape == (0, 3)


def test_a_trajectory_keeps_the_speed_of_each_leg_and_hovers() -> None:
    trajectory = flown()
    motion, passes = trajectory.sampled(1e-3), trajectory.passes
    speed, more = norm(motion.velocity), 1.0 + 1e-6
    assert len(passes) == len(tour().waypoints)
    assert (passes[0], passes[-1]) == (0.0, pytest.approx(trajectory.duration))
    assert (np.diff(passes) > 0.0).all()
    # It comes by B, and is at the others.
    away = norm(trajectory.at(passes).position - np.array([A, B, C, D, A]))
    assert away[1] <= LIMITS.deviation + 0.3  # and what averages cut off
    assert away[[0, 2, 3, 4]].max() < 1e-6
    assert speed[np.searchsorted(motion.time, passes[1])] > 1.0
    slow = (motion.time > passes[1] + 1.0) & (motion.time < passes[2])
    assert speed[slow].max() <= 4.0 * more
    assert speed.max() > 6.0
    hovering = trajectory.at(np.linspace(passes[2], passes[2] + 3.0, 50))
    assert norm(hovering.velocity).max() < 1e-9
    assert passes[2] in trajectory.rests
    assert norm(motion.acceleration).max() <= LIMITS.acceleration * more
    assert norm(motion.jerk).max() <= LIMITS.jerk * more
    assert np.abs(motion.yaw_rate).max() <= LIMITS.yaw_rate * more


def test_a_trajectory_keeps_the_radius_of_each_leg() -> None:
    """By SciPy's distances to the centres of voxels, less half their diagonal and to their cubes where that is near."""
    h, trajectory, mission = GRID.spacing, flown(), tour()
    centres = np.array(GRID.origin) + h * np.argwhere(town())
    tree, reach = cKDTree(centres), 0.5 * math.sqrt(3.0) * h
    motion = trajectory.sampled(trajectory.step / 5.0)
    leg = np.clip(np.searchsorted(trajectory.passes, motion.time, "right") - 1, 0, 3)
    radius = np.array([one.radius for one in mission.legs])[leg]
    assert not np.any([one.exemptions for one in mission.legs])
    for point, kept in zip(motion.position, radius, strict=True):
        near = centres[tree.query_ball_point(point, kept + reach)]
        gap = np.linalg.norm(np.maximum(np.abs(point - near) - 0.5 * h, 0.0), axis=1).min(initial=math.inf)
        assert gap >= kept - 2e-3 * h


def test_a_way_back_and_hovers_at_both_ends_are_flown() -> None:
    empty = np.zeros(GRID.shape, bool)
    ways = [Waypoint(A, hover=2.0), Waypoint(B), Waypoint(A, hover=1.0)]
    mission = maxjax.plan_mission(maxjax.VoxelMap.on(GRID, empty), ways, planner=maxjax.AStar())
    trajectory = maxjax.trajectory(mission, LIMITS)
    motion = trajectory.sampled(0.01)
    assert motion.position[:, 0].max() <= B[0] + 1e-9
    assert norm(motion.velocity[motion.time < 2.0]).max() < 1e-9
    assert norm(motion.velocity[motion.time > trajectory.duration - 1.0]).max() < 1e-9
    assert norm(trajectory.at(trajectory.passes).position - np.array([A, B, A])).max() < 1e-6


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"hover": -1.0}, "Waypoint.hover: expected seconds from 0 to 3600, given -1.0"),
        ({"hover": math.nan}, "Waypoint.hover: expected seconds from 0 to 3600, given nan"),
        ({"hover": 4000.0}, "Waypoint.hover: expected seconds from 0 to 3600, given 4000.0"),
        ({"speed": 0.0}, "Waypoint.speed: expected a positive number of m/s, given 0.0"),
        ({"speed": math.inf}, "Waypoint.speed: expected a positive number"),
    ],
)
def test_what_is_no_waypoint_is_refused(given: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Waypoint(**{"position": A} | given)


def test_what_is_no_mission_is_refused() -> None:
    for waypoints in ((), (A,)):
        with pytest.raises(ValueError, match="waypoints: expected at least two, the start first, given"):
            planned(*waypoints)
    with pytest.raises(ValueError, match=r"waypoints: expected numbers of shape \(3,\) \[m\], given float64 \(2,\)"):
        planned(A, (1.0, 2.0))
    with pytest.raises(ValueError, match="margin: expected at least the radius, 3 m, given 2"):
        planned(A, Waypoint(B, radius=3.0, margin=2.0))
    with pytest.raises(ValueError, match="hovers: a mission's waypoints say"):
        maxjax.trajectory(tour(), LIMITS, hovers={1: 1.0})
    with pytest.raises(ValueError, match="limits: expected ones with which a path takes at most"):
        maxjax.trajectory(planned(A, Waypoint(B, speed=1e-9)), LIMITS)
