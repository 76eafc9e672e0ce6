"""The loop on board: what is handed out was verified in the map of its call, and nothing compiles after `warmup`."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from inspect import unwrap as unwrapped  # without the run-time type checks of the tests, as users call it
from typing import Any

import jax
import numpy as np
import pytest

import maxjax
from benchmarks.common.compilations import compilations
from maxjax import Distances, Field, Grid, Problem, Replanned, Replanner, Route, Status, VoxelMap, plan_scan, verify
from maxjax.planning.path.route import Routes
from maxjax.planning.problem.task import Task
from maxjax.planning.run.remainder import remainder
from maxjax.planning.windows import fixed_shapes
from maxjax.planning.windows import focus_window as focus
from maxjax.planning.windows.focus_window import View
from tests.planners import bare_plan
from tests.references import random_blocks

GRID = Grid((22, 20, 12), 2.0, (3.0, -7.0, 1.0))
DISTANCES = Distances(1.0, 4.0)
SMALL = ((8, 8, 6), (12, 12, 8))
# The middle of a wall across the grid, with a gate, and places on both of its sides.
WALL, GATE = 11, (slice(6, 13), slice(3, 10))


def at(x: float, y: float, z: float) -> np.ndarray:
    return np.array(GRID.origin) + GRID.spacing * np.array([x, y, z])


BEFORE, AFTER, GOAL = at(3, 9.2, 6), at(16, 9.2, 6), at(19, 9.2, 6)


def cloud_of(occupied: np.ndarray) -> np.ndarray:
    return np.array(GRID.origin) + GRID.spacing * np.argwhere(occupied)


def wall(*, open_gate: bool = True) -> np.ndarray:
    occupied = np.zeros(GRID.shape, bool)
    occupied[WALL] = True
    if open_gate:
        occupied[(WALL, *GATE)] = False
    return occupied


def warm(planner: Field, **options: Any) -> Replanner:
    made = Replanner(GRID, planner, DISTANCES, **options)
    made.warmup()
    return made


@pytest.fixture(scope="module")
def in_windows() -> Iterator[Replanner]:
    """One that is warm, with windows of few voxels, so that its small grid has some."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(focus, "SHAPES", SMALL)
        yield warm(Field(), points=512)


@pytest.fixture(scope="module")
def in_the_whole_grid() -> Replanner:
    return warm(Field(focus=False), points=512)


@pytest.fixture
def replanner(in_the_whole_grid: Replanner) -> Replanner:
    """One that knows of no earlier call."""
    in_the_whole_grid._last = in_the_whole_grid._seen = None
    return in_the_whole_grid


def passes(found: Replanned, occupied: np.ndarray) -> bool:
    """Whether what was handed out keeps its word in a map."""
    assert found.plan is not None
    where = VoxelMap.on(found.plan.map.grid, occupied)
    return verify(found.plan.path, where, radius=DISTANCES.radius, exemptions=found.plan.exemptions).ok


# --- Whatever comes, in windows. ---


def scans(count: int, seed: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Voxels, returns (with misses and some outside the grid) and ends, which may lie anywhere, far apart or not."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        occupied = random_blocks(rng, GRID.shape, int(rng.integers(0, 14)), 5)
        points = cloud_of(occupied) + rng.uniform(-0.9, 0.9, (int(occupied.sum()), 3))
        outside = rng.uniform(600, 900, (rng.integers(0, 700), 3))
        start = at(0, 0, 0) + rng.uniform(-2, (43, 39, 23))
        goal = start + rng.uniform(-9, 9, 3) if rng.random() < 0.6 else at(0, 0, 0) + rng.uniform(-2, (43, 39, 23))
        yield occupied, np.concatenate([points, outside, np.zeros((3, 3))]), np.stack([start, goal])


def noting(replanner: Replanner, patch: pytest.MonkeyPatch) -> list[tuple[int, ...]]:
    """The shapes that it asks from now on."""
    asked, real = [], replanner._shapes._ask

    def note(view: View) -> Routes:
        asked.append(view.grid.shape)
        return real(view)

    patch.setattr(replanner._shapes, "_ask", note)
    return asked


@pytest.mark.large
@pytest.mark.parametrize("count", [100, pytest.param(500, marks=pytest.mark.nightly)])
def test_nothing_compiles_over_random_scans_starts_and_goals(
    in_windows: Replanner, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    statuses, sizes, older = [], set(), 0
    asked = noting(in_windows, monkeypatch)
    with compilations() as compiled:
        for k, (occupied, points, ends) in enumerate(scans(count, seed=5)):
            found = in_windows.replan(points, *ends, deadline=1e-3 if k % 2 else math.inf)
            statuses.append(found.status)
            sizes.add(len(points))
            if found.plan is not None:
                assert passes(found, occupied | np.asarray(found.plan.map.occupied))
                assert (found.age == 0.0) == (found.status == Status.OK)
                older += found.age > 0
    assert compiled == []
    assert len(sizes) > 0.6 * count
    assert {*SMALL, GRID.shape} == set(asked)
    assert statuses.count(Status.OK) > 0.2 * count
    assert {Status.START_OCCUPIED, Status.GOAL_OUTSIDE_MAP, Status.TIMEOUT, Status.EMPTY_SCAN} <= set(statuses)


@pytest.mark.large
def test_a_new_plan_is_that_of_plan_scan(in_windows: Replanner) -> None:
    ok = 0
    for _, points, ends in scans(12, seed=6):
        found = in_windows.replan(points, *ends, deadline=math.inf)
        expected = plan_scan(points, *ends, GRID, distances=DISTANCES)
        assert found.status == expected.status
        if expected.status == Status.OK:
            assert found.plan is not None
            np.testing.assert_allclose(found.plan.path, expected.path, atol=1e-5)
            np.testing.assert_allclose(found.plan.cost, expected.cost, rtol=1e-5)
            ok += 1
    assert ok > 3


@pytest.mark.large
def test_what_a_window_found_is_the_answer_where_there_is_no_time_for_a_larger_one(
    in_windows: Replanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a way around a wall that leaves the ellipsoid of the straight line."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[WALL, :12] = True
    ends = at(9.5, 9, 6), at(12.5, 9, 6)
    asked = noting(in_windows, monkeypatch)
    cheapest = in_windows.replan(cloud_of(occupied), *ends, deadline=math.inf)
    assert len(asked) > 1
    monkeypatch.setitem(in_windows._shapes._seconds, SMALL[1], 1e9)
    monkeypatch.setitem(in_windows._shapes._seconds, GRID.shape, 1e9)
    found = in_windows.replan(cloud_of(occupied), *ends, deadline=10.0)
    assert cheapest.plan is not None
    assert found.status == Status.OK
    assert found.plan is not None
    assert passes(found, occupied)
    assert found.plan.cost >= cheapest.plan.cost - 1e-3
    assert not found.late


def test_the_first_flight_of_each_shape_leads_through_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the way from both sides, so that what is timed is neither the shortest nor the longest way."""
    asked: list[View] = []
    monkeypatch.setattr(fixed_shapes.FixedShapes, "_ask", lambda _, view: asked.append(view))
    shapes = fixed_shapes.FixedShapes(Grid((41, 41, 17), 2.0, (0.0, 0.0, 0.0)), Field(focus=False), DISTANCES)
    shapes.warm_up()
    (task, again) = (view.task for view in asked)
    assert task is again
    voxels = np.array([task.starts[0], task.goals[0]]) / 2.0
    np.testing.assert_array_equal(voxels, [[10.0, 10.0, 4.0], [30.0, 30.0, 12.0]])


@pytest.mark.large
def test_as_one_program_as_on_an_accelerator(replanner: Replanner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fixed_shapes, "target", lambda: "cuda")
    whole = warm(Field(focus=False), points=512)
    with compilations() as compiled:
        for occupied, points, ends in scans(20, seed=7):
            found, expected = (one.replan(points, *ends, deadline=math.inf) for one in (whole, replanner))
            assert found.status == expected.status
            if found.status == Status.OK:
                assert passes(found, occupied)
                np.testing.assert_allclose(found.plan.cost, expected.plan.cost, rtol=1e-3)  # type: ignore[union-attr]
    assert not compiled


# --- The last plan, for want of a new one. ---


def test_too_late_for_a_new_plan_what_is_left_of_the_last_one_is_verified_anew(replanner: Replanner) -> None:
    first = replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=math.inf)
    assert (first.status, first.age, first.late) == (Status.OK, 0.0, False)
    assert passes(first, wall())
    here = at(6, 9.4, 6)
    found = replanner.replan(cloud_of(wall()), here, GOAL, deadline=1e-3)
    assert found.status == Status.TIMEOUT
    assert found.plan is not None
    assert 0.0 < found.age < 60.0
    np.testing.assert_array_equal(found.plan.path[[0, -1]], [here, GOAL])
    assert found.plan.length < first.plan.length  # type: ignore[union-attr]
    assert passes(found, wall())
    # Now the gate is seen to be closed: what is left leads into it, until the vehicle has passed.
    closed = wall(open_gate=False)
    assert replanner.replan(cloud_of(closed), here, GOAL, deadline=1e-3).plan is None
    found = replanner.replan(cloud_of(closed), AFTER, GOAL, deadline=1e-3)
    assert passes(found, closed)


def test_a_way_that_no_new_plan_has_is_said_and_not_flown(replanner: Replanner) -> None:
    replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=math.inf)
    found = replanner.replan(cloud_of(wall(open_gate=False)), BEFORE, GOAL, deadline=math.inf)
    assert found.status == Status.NO_VALID_PATH
    assert found.plan is None
    assert math.isnan(found.age)


def test_an_empty_scan_leaves_the_last_plan_as_far_as_the_last_scan_allows(replanner: Replanner) -> None:
    nothing = np.zeros((2, 3))
    assert replanner.replan(nothing, BEFORE, GOAL).plan is None
    replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=math.inf)
    found = replanner.replan(nothing, BEFORE, GOAL)
    assert found.status == Status.EMPTY_SCAN
    assert passes(found, wall())
    # The gate was seen to be closed just before the blackout.
    replanner.replan(cloud_of(wall(open_gate=False)), BEFORE, GOAL, deadline=1e-3)
    assert replanner.replan(np.zeros((0, 3)), BEFORE, GOAL).plan is None
    # And what is known without any scan counts as well.
    replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=math.inf)
    known = VoxelMap.on(GRID, wall(open_gate=False))
    assert replanner.replan(nothing, BEFORE, GOAL, known=known).plan is None


def test_what_is_left_of_a_plan_to_another_goal_is_not_flown(replanner: Replanner) -> None:
    replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=math.inf)
    beside = replanner.replan(cloud_of(wall()), BEFORE, GOAL + 0.5, deadline=1e-3)
    assert beside.plan is not None
    assert beside.status == Status.TIMEOUT
    np.testing.assert_array_equal(beside.plan.path[-1], GOAL + 0.5)
    assert passes(beside, wall())
    assert replanner.replan(cloud_of(wall()), BEFORE, GOAL - [0, 6, 0], deadline=1e-3).plan is None


def test_of_a_deadline_some_is_kept_for_the_verifier(replanner: Replanner, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes, asked = replanner._shapes, []
    real = shapes.route

    def route(task: Task, until: float) -> Any:
        asked.append(until - time.perf_counter())
        return real(task, until)

    monkeypatch.setattr(shapes, "route", route)
    replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=5.0)
    (left,) = asked
    assert left <= 5.0 - 0.005


def test_a_plan_that_is_late_says_so_and_no_other_is_begun_for_a_while(
    replanner: Replanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    shapes, deadline = replanner._shapes, 0.2
    real = shapes._finder

    def slow(problem: Problem) -> Route:
        time.sleep(0.25)
        return real(problem)

    monkeypatch.setitem(shapes._seconds, GRID.shape, 0.0)
    with monkeypatch.context() as patch:
        patch.setattr(shapes, "_finder", slow)
        found = replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=deadline)
    assert found.seconds > 0.25
    assert (found.status, found.late) == (Status.OK, True)
    assert passes(found, wall())
    # A slow turn is not held against a shape for ever.
    later = [replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=deadline) for _ in range(12)]
    assert (later[0].status, later[0].late) == (Status.TIMEOUT, False)
    assert later[0].plan is not None
    assert later[-1].status == Status.OK


# --- Maps. ---


def test_a_cloud_of_more_points_than_a_program_takes_loses_none(replanner: Replanner) -> None:
    occupied = random_blocks(np.random.default_rng(2), GRID.shape, 60, 6)
    points = cloud_of(occupied)
    assert len(points) > 2 * replanner.points
    with compilations() as compiled:
        seen, kept = replanner._add_scan(points, replanner._known_map(None))
    np.testing.assert_array_equal(seen.occupied, occupied)
    assert kept == len(points)
    assert not compiled


def test_the_grid_may_lie_elsewhere_and_hold_what_is_known(replanner: Replanner) -> None:
    here = replanner.replan(cloud_of(wall()), BEFORE, GOAL, deadline=math.inf)
    shift = np.array([84_888.0, 447_501.0, 12.0])
    x, y, z = (np.array(GRID.origin) + shift).tolist()
    known = VoxelMap.on(Grid(GRID.shape, GRID.spacing, (x, y, z)), wall())
    with compilations() as compiled:
        one = at(0, 0, 0)[None] + shift
        away = replanner.replan(one, BEFORE + shift, GOAL + shift, deadline=math.inf, known=known)
    assert here.plan is not None
    assert away.plan is not None
    np.testing.assert_allclose(away.plan.path - shift, here.plan.path, atol=1e-6)
    assert not compiled


def test_clouds_of_plan_scan_share_programs_up_to_a_power_of_two() -> None:
    """Of an end that is taken, nothing else is computed."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[2:9, 9, 6] = True
    for _ in range(2):
        with compilations() as compiled:
            for count in (5, 6, 7):
                found = plan_scan(cloud_of(occupied)[:count], BEFORE, GOAL, GRID, distances=DISTANCES)
                assert found.status == Status.START_OCCUPIED
                np.testing.assert_array_equal(np.argwhere(found.map.occupied), np.argwhere(occupied)[:count])
    assert not compiled


def test_the_count_sees_a_program_that_compiles() -> None:
    with compilations() as compiled:
        jax.jit(lambda x: 3 * x)(np.arange(7))
    assert compiled


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Replanner(Grid((300, 200, 100), 1.0)), "at most 4194304 voxels, given .300"),
        (lambda: unwrapped(Replanner.__init__)(object.__new__(Replanner), GRID, maxjax.AStar()), "that climbs a field"),
        (lambda: Replanner(GRID, distances=Distances(margin=60.0)), "margin: expected at most 44 m"),
        (lambda: Replanner(GRID, points=0), "points: expected at least 1"),
    ],
)
def test_what_cannot_be_planned_in_is_refused(make: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


def test_calls_that_cannot_be_answered_are_refused(replanner: Replanner) -> None:
    with pytest.raises(RuntimeError, match=r"expected a call of warmup\(\)"):
        Replanner(GRID).replan(np.zeros((1, 3)), BEFORE, GOAL)
    for deadline in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="deadline: expected a positive time"):
            replanner.replan(np.zeros((1, 3)), BEFORE, GOAL, deadline=deadline)
    for known in (Grid(), VoxelMap.on(Grid(GRID.shape, 1.0), wall()), VoxelMap.on(GRID, wall()[None])):
        with pytest.raises(ValueError, match="known: expected one map or grid of shape"):
            replanner.replan(np.zeros((1, 3)), BEFORE, GOAL, known=known)
    with pytest.raises(ValueError, match="points: expected numbers of shape"):
        unwrapped(Replanner.replan)(replanner, np.zeros((4, 2)), BEFORE, GOAL)


# --- What is left of a plan. ---


def test_the_remainder_of_a_plan_leads_from_beside_it_to_its_goal_and_is_no_longer_than_the_way_there() -> None:
    where = VoxelMap.on(GRID, wall())
    path = np.stack([BEFORE, at(11, 9, 6), at(14, 13, 6), GOAL])
    plan = bare_plan(where, path, DISTANCES, clearance_at=np.zeros(len(path)))
    rng = np.random.default_rng(4)
    edges = np.linalg.norm(np.diff(path, axis=0), axis=1)
    for along in rng.uniform(0, edges.sum(), 30):
        place = np.array([np.interp(along, np.concatenate([[0.0], np.cumsum(edges)]), path[:, k]) for k in range(3)])
        here = place + rng.uniform(-0.3, 0.3, 3)
        left = remainder(plan, here, GOAL, where)
        assert left is not None
        np.testing.assert_array_equal(left.path[[0, -1]], [here, GOAL])
        assert verify(left.path, where, radius=plan.radius).ok
        assert left.length <= edges.sum() - along + 2 * math.dist(here, place) + 1e-9
        assert len(left.clearance_at) == len(left.path)


def test_an_exemption_shrinks_as_its_end_is_left() -> None:
    """Beside a wall at take-off: what is left may stay as near as the exemption's ball reaches, and no farther."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[:, 5] = True
    where, start = VoxelMap.on(GRID, occupied), at(3, 5.75, 6)  # half a metre off the wall's face
    path = np.stack([start, at(3, 9, 6), GOAL])
    plan = bare_plan(where, path, DISTANCES, exemptions=(3.0, 0.0), clearance_at=np.zeros(3))
    left = remainder(plan, start + np.array([0.0, 0.2, 0.0]), GOAL, where)
    assert left is not None
    assert left.exemptions == pytest.approx((2.8, 0.0))
    assert remainder(plan, start + np.array([4.0, 0.0, 0.0]), GOAL, where) is None
