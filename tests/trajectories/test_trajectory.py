"""Trajectories: limits between samples, the hard radius by SciPy's distances, times beside toppra's, and bad input."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial import cKDTree

import maxjax
from maxjax.planning.plan import Plan
from maxjax.trajectories.limits import PX4, PX4_MISSION
from tests.planners import bare_plan
from tests.references import random_blocks

GRID = maxjax.Grid((41, 41, 21), 2.0, (500.0, -40.0, 1.0))
COUNT = 8


class Case(NamedTuple):
    occupied: np.ndarray
    plan: Plan
    limits: maxjax.FlightLimits
    trajectory: maxjax.Trajectory


@functools.cache
def cases() -> list[Case]:
    """Random boxes, a plan from corner to corner by A*, and its trajectory; all presets take turns."""
    found: list[Case] = []
    seed = 0
    while len(found) < COUNT:
        rng = np.random.default_rng(seed)
        occupied = random_blocks(rng, GRID.shape, 25, 9)
        low, high = np.array(GRID.lower) + 2.0, np.array(GRID.upper) - 2.0
        start = rng.uniform(low, low + (high - low) * [0.2, 1.0, 1.0])
        goal = rng.uniform(low + (high - low) * [0.8, 0.0, 0.0], high)
        plan = maxjax.plan(
            maxjax.VoxelMap.on(GRID, occupied),
            start,
            goal,
            planner=maxjax.AStar(),
            distances=maxjax.Distances(radius=1.0, margin=6.0),
        )
        seed += 1
        if plan.status == maxjax.Status.OK:
            limits = (PX4, PX4_MISSION)[len(found) % 2]
            found.append(Case(occupied, plan, limits, maxjax.trajectory(plan, limits)))
    return found


def distances(points: np.ndarray, occupied: np.ndarray, reach: float) -> np.ndarray:
    """Exact distance to the cubes of occupied voxels, from SciPy's tree of their centres; at least `reach` beyond."""
    h = GRID.spacing
    centres = np.array(GRID.origin) + h * np.argwhere(occupied)
    tree = cKDTree(centres)
    away, corner = np.asarray(tree.query(points)[0]), 0.5 * math.sqrt(3.0) * h
    found = away - corner  # a lower bound
    near = np.flatnonzero(found < reach)
    # The nearest cube has its centre within this: its surface is no further than the nearest centre.
    for k, cubes in zip(near, tree.query_ball_point(points[near], away[near] + corner + 1e-9), strict=True):
        gap = np.maximum(np.abs(points[k] - centres[cubes]) - 0.5 * h, 0.0)
        found[k] = np.sqrt((gap**2).sum(axis=1).min())
    return found


def polyline(points: np.ndarray) -> Plan:
    """A plan by hand, in a map without obstacles."""
    # Longer than the others' map, as some paths are.
    where = maxjax.VoxelMap.on(dataclasses.replace(GRID, shape=(301, 41, 21)), np.zeros((301, 41, 21), bool))
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return bare_plan(where, points, length=length, clearance_at=np.full(len(points), np.inf))


def flown(points: Any, limits: maxjax.FlightLimits = PX4, **options: Any) -> maxjax.Trajectory:
    return maxjax.trajectory(polyline(np.array(points, float)), limits, **options)


def norm(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values, axis=-1)


@pytest.mark.large
def test_limits_hold_at_every_millisecond() -> None:
    more = 1.0 + 1e-6
    for case in cases():
        motion, limits = case.trajectory.sampled(1e-3), case.limits
        assert norm(motion.velocity).max() <= limits.speed * more
        assert norm(motion.acceleration).max() <= limits.acceleration * more
        assert norm(motion.jerk).max() <= limits.jerk * more
        assert -limits.descent * more <= motion.velocity[:, 2].min() <= motion.velocity[:, 2].max()
        assert motion.velocity[:, 2].max() <= limits.ascent * more
        assert np.abs(motion.yaw_rate).max() <= limits.yaw_rate * more


@pytest.mark.large
def test_derivatives_are_those_of_the_position() -> None:
    """Central differences of what comes before, at a distance of 1 ms."""
    for case in cases()[:4]:
        motion = case.trajectory.sampled(1e-3)
        inner, gap = slice(1, -2), 2e-3
        for values, slope, tolerance in (
            (motion.position, motion.velocity, 1e-5),
            (motion.velocity, motion.acceleration, 5e-3),
            (motion.yaw, motion.yaw_rate, 5e-3),
        ):
            differences = (values[2:] - values[:-2])[:-1] / gap
            np.testing.assert_allclose(differences, slope[inner], atol=tolerance)


def test_it_is_twice_continuously_differentiable() -> None:
    """Nothing jumps between neighbouring times, whatever their distance."""
    for case in cases()[:4]:
        knots = case.trajectory.step * np.arange(1, int(case.trajectory.duration / case.trajectory.step))
        before, after = case.trajectory.at(knots - 1e-9), case.trajectory.at(knots + 1e-9)
        for name in ("position", "velocity", "acceleration", "yaw", "yaw_rate"):
            np.testing.assert_allclose(getattr(before, name), getattr(after, name), atol=1e-6)


@pytest.mark.large
def test_it_rests_at_both_ends_of_the_plan() -> None:
    for case in cases():
        motion = case.trajectory.at([-1.0, 0.0, case.trajectory.duration, case.trajectory.duration + 5.0])
        ends = case.plan.path[[0, 0, -1, -1]]
        np.testing.assert_allclose(motion.position, ends, atol=1e-9)
        assert norm(motion.velocity).max() < 1e-9
        assert norm(motion.acceleration).max() < 1e-6


def test_the_hard_radius_is_kept_between_all_samples() -> None:
    """Ten samples a control interval, by distances that maxjax does not compute; in exemptions an end's own."""
    for case in cases():
        trajectory = case.trajectory
        points = trajectory.sampled(trajectory.step / 10.0).position
        kept = np.full(len(points), case.plan.radius)
        own = distances(case.plan.path[[0, -1]], case.occupied, 3.0)
        for end, distance, ball in zip(case.plan.path[[0, -1]], own, case.plan.exemptions, strict=True):
            exempt = norm(points - end) <= ball
            kept[exempt] = np.minimum(kept[exempt], distance)
        assert (distances(points, case.occupied, 3.0) >= kept - 2e-3 * GRID.spacing).all()
        within = distances(points, case.occupied, 3.0).min()
        assert within > 0.0
        assert trajectory.clearance == pytest.approx(within, abs=2e-3) or within >= 3.0


def test_it_is_slower_near_walls() -> None:
    for case in cases():
        motion = case.trajectory.sampled(0.01)
        clearance = distances(motion.position, case.occupied, 20.0)
        room = np.maximum(clearance - case.plan.radius, 0.0)
        allowed = np.sqrt(case.limits.near**2 + 2.0 * case.limits.acceleration * room)
        assert (norm(motion.velocity) <= allowed + 1e-6).all()


def test_corners_are_rounded_within_the_deviation() -> None:
    corner = [[520.0, -30.0, 20.0], [550.0, -30.0, 20.0], [550.0, 10.0, 20.0]]
    for deviation in (0.2, 1.0):
        motion = flown(corner, maxjax.FlightLimits(deviation=deviation)).sampled(0.01)
        gap = norm(motion.position - corner[1]).min()
        assert 0.3 * deviation < gap <= deviation + 0.2
        assert norm(motion.velocity[(motion.time > 1.0) & (motion.time < motion.time[-1] - 1.0)]).min() > 1.0


def test_where_no_rounding_is_clear_it_stays_on_the_plan() -> None:
    """In a channel of one voxel, where the path keeps the radius and nothing beside it does."""
    corner = np.array([[520.0, -30.0, 21.0], [550.0, -30.0, 21.0], [550.0, 10.0, 21.0]])
    occupied = np.ones(GRID.shape, bool)
    (first, x, y), (_, turn, _), (_, _, last) = [np.round((p - GRID.origin) / 2).astype(int)[[2, 0, 1]] for p in corner]
    occupied[x : turn + 1, y, first] = occupied[turn, y : last + 1, first] = False
    where = maxjax.VoxelMap.on(GRID, occupied)
    plan = bare_plan(where, corner, maxjax.Distances(radius=1.0), clearance_at=np.ones(3), radius=1.0)
    assert maxjax.verify(corner, where, radius=1.0).ok
    trajectory = maxjax.trajectory(plan)
    motion = trajectory.sampled(0.01)
    off = np.minimum(
        norm(motion.position[:, [1, 2]] - corner[0, [1, 2]]), norm(motion.position[:, [0, 2]] - corner[1, [0, 2]])
    )
    assert off.max() < 1e-9
    assert len(trajectory.rests) == 1
    assert norm(trajectory.at(trajectory.rests).velocity).max() < 1e-9


def test_it_stops_where_asked() -> None:
    trajectory = flown([[520.0, -30.0, 20.0], [540.0, -30.0, 20.0], [560.0, -25.0, 20.0]], hovers={1: 2.5})
    (rest,) = trajectory.rests
    motion = trajectory.at(np.linspace(rest, rest + 2.5, 100))
    np.testing.assert_allclose(motion.position, np.broadcast_to([540.0, -30.0, 20.0], (100, 3)), atol=1e-9)
    assert norm(motion.velocity).max() < 1e-9


def test_the_nose_points_along_the_course() -> None:
    motion = flown([[520.0, -30.0, 20.0], [560.0, -30.0, 20.0], [560.0, 20.0, 20.0]]).sampled(0.01)
    fast = norm(motion.velocity[:, :2]) > 3.0
    course = np.arctan2(motion.velocity[fast, 1], motion.velocity[fast, 0])
    away = np.abs(np.angle(np.exp(1j * (course - motion.yaw[fast]))))
    assert np.quantile(away, 0.9) < math.radians(10.0)


def test_a_vertical_path_and_a_path_that_turns_back_are_flown() -> None:
    up = flown([[540.0, 0.0, 5.0], [540.0, 0.0, 35.0]])
    assert up.duration >= 30.0 / PX4.ascent
    back = flown([[540.0, 0.0, 5.0], [560.0, 0.0, 5.0], [540.0, 0.0, 5.0]])
    assert back.sampled(0.01).position[:, 0].max() <= 560.0 + 1e-9


@pytest.mark.large
def test_times_are_near_those_of_toppra() -> None:
    """On the flown curve, under the same limits of speed, climb, acceleration and clearance; toppra knows no jerk.

    A limit of jerk costs acceleration / jerk between two rests whatever the path, so that a high one is compared.
    """
    pytest.importorskip("toppra", reason="needs toppra (extra bench)")
    from benchmarks.common.time_oracle import fastest_time

    ratios = []
    for case in cases():
        limits = dataclasses.replace(case.limits, jerk=100.0)
        trajectory = maxjax.trajectory(case.plan, limits)
        if len(trajectory.rests):
            continue
        points = trajectory.sampled(0.01).position
        room = np.maximum(distances(points, case.occupied, 20.0) - case.plan.radius, 0.0)
        caps = np.minimum(np.sqrt(limits.near**2 + 2.0 * limits.acceleration * room), limits.speed)
        ratios.append(trajectory.duration / fastest_time(points, caps, limits))
    assert len(ratios) > COUNT / 2
    assert min(ratios) > 0.95  # toppra samples a tenth of a metre apart
    assert max(ratios) <= 1.10


@pytest.mark.parametrize("length", [1e-7, 1e-3, 0.05, 0.3, 400.0])
def test_short_and_long_paths_are_flown(length: float) -> None:
    start = np.array([510.0, -30.0, 5.0])
    goal = start + np.array([0.6 * length, 0.8 * length, 0.0])
    trajectory = maxjax.trajectory(polyline(np.array([start, goal])))
    assert norm(trajectory.at([trajectory.duration]).position[0] - start) == pytest.approx(length)
    # Without a cap, half the way is flown with the greatest jerk at best.
    assert trajectory.duration >= min(4.0 * (length / (4.0 * PX4.jerk)) ** (1 / 3), length / PX4.speed)


def test_a_low_limit_of_jerk_is_kept() -> None:
    limits = maxjax.FlightLimits(jerk=0.1)
    motion = flown([[520.0, -30.0, 20.0], [550.0, -30.0, 20.0], [550.0, 10.0, 20.0]], limits).sampled(0.01)
    assert norm(motion.jerk).max() <= 0.1 * (1.0 + 1e-6)


@pytest.mark.parametrize(("name", "value"), [("speed", 1e-9), ("acceleration", 1e-9), ("jerk", 1e-12)])
def test_limits_that_take_days_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match="limits: expected ones with which a path takes at most"):
        flown([[520.0, 0.0, 5.0], [540.0, 0.0, 5.0]], maxjax.FlightLimits(**{name: value}))


@pytest.mark.parametrize("acceleration", [1e-4, 1e-6])
def test_limits_that_take_too_many_samples_are_refused(acceleration: float) -> None:
    with pytest.raises(ValueError, match=r"limits: expected ones with which a path takes at most 50000 samples, given"):
        flown([[520.0, 0.0, 5.0], [572.0, 0.0, 5.0]], maxjax.FlightLimits(acceleration=acceleration))


def test_clearance_leaves_the_ground_out_without_a_radius() -> None:
    occupied = np.zeros(GRID.shape, bool)
    occupied[:, :, 0] = True
    ground = occupied.copy()
    occupied[-1, -1, -1] = True
    city = maxjax.VoxelMap.on(GRID, occupied, ground)
    low = np.array(GRID.origin) + GRID.spacing * np.array([1.0, 1.0, 1.25])
    plan = maxjax.plan(
        city,
        low,
        low + np.array([10.0, 4.0, 0.0]),
        planner=maxjax.AStar(),
        distances=maxjax.Distances(radius=0.0, margin=1.0),
    )
    assert plan.status == maxjax.Status.OK
    assert maxjax.trajectory(plan).clearance == pytest.approx(
        distances(plan.path, occupied & ~ground, 1e3).min(), rel=0.1
    )


@pytest.mark.parametrize("jerk", [0.01, 0.1, 8.0, 40.0, 1000.0])
def test_a_straight_line_takes_as_long_as_jerk_demands(jerk: float) -> None:
    """The shortest time from rest to rest in closed form: jerk up, even, down, and the same to brake."""
    length, limits = 20.0, maxjax.FlightLimits(jerk=jerk)
    trajectory = flown([[520.0, 0.0, 5.0], [520.0 + length, 0.0, 5.0]], limits)
    rise = limits.acceleration / jerk
    least = (32.0 * length / jerk) ** (1.0 / 3.0)
    if least > 4.0 * rise:  # the acceleration reaches its limit
        least = rise + math.sqrt(rise**2 + 4.0 * length / limits.acceleration)
    assert length < limits.speed**2 / limits.acceleration  # and the speed does not
    assert least <= trajectory.duration <= 1.02 * least + 0.1


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(maxjax.FlightLimits)])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_are_positive_numbers(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"FlightLimits.{name}: expected a positive"):
        maxjax.FlightLimits(**{name: value})


def test_plans_without_a_path_are_refused() -> None:
    failed = dataclasses.replace(
        polyline(np.eye(3)), status=maxjax.Status.NO_SAFE_PATH, path=np.zeros((0, 3)), clearance_at=np.zeros(0)
    )
    with pytest.raises(ValueError, match="expected one that is OK, given NO_SAFE_PATH"):
        maxjax.trajectory(failed)


def test_repeated_points_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected neighbours that differ, given .* twice, at 1, 2"):
        flown([[520.0, 0.0, 5.0], [530.0, 0.0, 5.0], [530.0, 0.0, 5.0], [540.0, 0.0, 5.0]])


@pytest.mark.parametrize("hovers", [{0: 1.0}, {2: 1.0}, {1: -1.0}, {1: math.nan}, {1: math.inf}])
def test_hovers_are_times_at_points_in_between(hovers: dict[int, float]) -> None:
    with pytest.raises(ValueError, match="hovers: expected times"):
        flown([[520.0, 0.0, 5.0], [530.0, 0.0, 5.0], [540.0, 0.0, 5.0]], hovers=hovers)


@pytest.mark.parametrize("time", [[1.0, 0.5], [0.0, math.nan], [[0.0]], [math.inf]])
def test_times_run_forwards(time: Any) -> None:
    with pytest.raises(ValueError, match="time: expected"):
        flown([[520.0, 0.0, 5.0], [540.0, 0.0, 5.0]]).at(time)
