"""Only a verified path leaves the planner; every other outcome has its status, and no path."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, Plan, Potential, Status, VoxelMap, plan, solve_potential, verify
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Route, RouteFn, Routes, no_route, route_of
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.longer_ascents import with_longer_ascents
from maxjax.planning.run.shared_goal import plan_to_goal
from maxjax.planning.run.stages import PotentialFn
from maxjax.planning.run.verifying import verify_routes
from tests.planners import ByFunction
from tests.references import random_blocks, random_free, serpentine

GRID = Grid((16, 18, 20), 2.0, (-10.0, 3.0, 1.0))
EMPTY = np.zeros(GRID.shape, bool)
START, GOAL = np.array([-8.3, 5.1, 3.7]), np.array([18.9, 36.2, 38.4])


def run(find: RouteFn | FieldPlanner, occupied: np.ndarray = EMPTY, goal: np.ndarray = GOAL) -> Plan:
    planner = find if isinstance(find, FieldPlanner) else ByFunction(find)
    return plan_task(Task.of(VoxelMap.on(GRID, occupied), START[None], goal, Distances(1.0, 2.0)), planner)[0]


def check_failed(plan: Plan, status: Status) -> None:
    assert plan.status is status
    assert plan.path.shape == (0, 3)
    assert math.isnan(plan.length)
    assert math.isnan(plan.clearance)


def returning(path: Callable[[Problem], np.ndarray]) -> RouteFn:
    return lambda problem: route_of(path(problem), certified=True)


def test_a_path_through_a_wall_is_withheld() -> None:
    wall = EMPTY.copy()
    wall[8, :, :18] = True
    straight = returning(lambda problem: np.stack([problem.start, problem.goal]))
    assert run(straight).status is Status.OK
    check_failed(run(straight, wall), Status.PATH_IN_COLLISION)


@pytest.mark.parametrize("value", [math.nan, 1e6])
def test_paths_that_are_no_numbers_or_leave_the_map_are_withheld(value: float) -> None:
    broken = returning(lambda problem: np.stack([problem.start, np.full(3, value), problem.goal]))
    check_failed(run(broken), Status.PATH_IN_COLLISION)


def test_ends_are_the_given_points_bit_by_bit() -> None:
    plan = run(returning(lambda problem: np.stack([problem.start, problem.start, problem.goal, problem.goal])))
    assert plan.path.dtype == np.float64
    np.testing.assert_array_equal(plan.path, np.stack([START, GOAL]))  # repeated points are left out
    assert plan.length == pytest.approx(math.dist(START, GOAL), rel=1e-9)
    assert plan.clearance == math.inf


def test_a_plan_says_how_safe_it_is_and_what_it_pays() -> None:
    """An occupied voxel stands beside the start: nearer than the radius, which only a ball excuses."""
    beside = EMPTY.copy()
    x, y, z = np.floor((START - GRID.origin) / GRID.spacing + 0.5).astype(int)
    beside[x - 1, y, z] = True
    task = Task.of(VoxelMap.on(GRID, beside), START[None], GOAL, Distances(1.9))
    loose = Task.of(VoxelMap.on(GRID, beside), START[None], GOAL, Distances(0.0))
    bare = route_of((np.stack([START, GOAL]) - GRID.origin) / GRID.spacing, certified=True)
    numbers = {"exemptions": np.float32([3, 0]), "geodesic": np.bool_(True), "cost": np.float32(99.5)}
    excused = dataclasses.replace(bare, **{name: np.asarray(number) for name, number in numbers.items()})
    check_failed(verify_routes(Routes.of([bare]).route, task, "test")[0], Status.PATH_IN_COLLISION)
    (plan,) = verify_routes(Routes.of([excused]).route, task, "test")
    (free,) = verify_routes(Routes.of([bare]).route, loose, "test")
    verdict = verify(plan.path, VoxelMap.on(GRID, beside))
    assert plan.status is free.status is Status.OK
    assert (plan.radius, plan.exemptions, plan.cost, plan.stats.potential) == (1.9, (3.0, 0.0), 99.5, "geodesic")
    assert (free.radius, free.exemptions, free.cost, free.stats.potential) == (0.0, (0.0, 0.0), free.length, "maxwell")
    assert plan.clearance < 1.9 < plan.cruise_clearance
    for one in (plan, free):
        assert (one.clearance, one.cruise_clearance) == pytest.approx((verdict.clearance, verdict.cruise_clearance))
        np.testing.assert_allclose(one.clearance_at, verdict.clearance_at, rtol=1e-9)


def flat(sigma: jax.Array, goal: jax.Array, price: jax.Array) -> Potential:
    """A field that claims more than it holds; for goals in the lower half none is found."""
    none, certified = jnp.int32(0), goal[2] > GRID.shape[2] // 2
    status = jnp.where(certified, Status.OK, Status.NOT_CONVERGED)
    log_phi = jnp.where(sigma > 0, jnp.float32(0), -jnp.inf)
    return Potential(
        log_phi, status.astype(jnp.int32), none, none, jnp.float32(0), certified, none, jnp.float32(2), jnp.array(False)
    )


@pytest.mark.large
def test_a_field_that_fails_gives_its_status() -> None:
    planner = FieldPlanner(flat, focus=False)
    check_failed(run(planner, goal=np.array([*GOAL[:2], 5.0])), Status.NOT_CONVERGED)
    check_failed(run(planner), Status.PATH_STALLED)


@dataclasses.dataclass(frozen=True)
class StrangersClimber:
    """A field climber by its members alone; its route as one function is not to be asked for on a CPU."""

    ascent: Ascent = Ascent()  # noqa: RUF009 (frozen)
    focus: bool = True
    name: str = "stranger"
    batched: bool = True

    @property
    def potential(self) -> PotentialFn:
        return solve_potential

    def with_ascent(self, ascent: Ascent) -> StrangersClimber:
        return dataclasses.replace(self, ascent=ascent)

    def route(self, problem: Problem) -> Route:
        raise AssertionError


@pytest.mark.parametrize("focus", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_planner_with_the_members_of_a_field_climber_is_carried_out_in_stages(focus: bool) -> None:
    """Whatever its class: with more steps where it has too few, and shared among starts."""
    climber, task = StrangersClimber(Ascent(steps=64), focus), Task.of(VoxelMap.on(GRID, EMPTY), START[None], GOAL)
    plan, same = plan_task(task, climber)[0], plan_task(task, FieldPlanner(solve_potential, climber.ascent, focus))[0]
    assert plan.status is Status.OK
    assert {"solve", "ascend", "tighten"} <= set(plan.timings)
    np.testing.assert_array_equal(plan.path, same.path)
    np.testing.assert_allclose(plan_to_goal(task, climber).length, plan.length, rtol=1e-2)


def test_a_wrong_problem_is_never_handed_to_a_planner() -> None:
    def never(problem: Problem, grid: Grid) -> Route:
        raise AssertionError

    check_failed(run(never, goal=START), Status.START_EQUALS_GOAL)
    check_failed(run(never, goal=np.array([999.0, 0, 0])), Status.GOAL_OUTSIDE_MAP)
    sealed = EMPTY.copy()
    sealed[8] = True
    check_failed(run(never, sealed), Status.NO_VALID_PATH)


@pytest.mark.large
def test_a_maze_without_a_price_is_climbed_alone_and_in_a_batch() -> None:
    """The answer is the same for one problem and for many; where steps do not suffice: test_pipeline.py."""
    maze = np.repeat(serpentine(15, 18, 1), 20, axis=2)
    maze = np.concatenate([maze, np.ones((1, 18, 20), bool)])
    start, goal = (np.array(GRID.origin) + 2 * np.array(v) for v in ([0, 0, 9], [14, 0, 9]))
    climb, task = (
        FieldPlanner(solve_potential, Ascent(steps=256)),
        Task.of(VoxelMap.on(GRID, maze), start[None], goal, Distances(0.0, 0.0)),
    )
    alone = plan_task(task, dataclasses.replace(climb, focus=False))[0]
    batch = plan_task(task, climb, chunk=1)
    assert alone.status is Status.OK
    assert verify(alone.path, VoxelMap.on(GRID, maze)).ok
    assert batch[0].status is Status.OK
    assert batch[0].length == pytest.approx(alone.length, rel=1e-3)


@pytest.mark.large
def test_a_way_that_is_longer_than_sixteen_ascents_is_climbed_and_pulled_taut() -> None:
    """One voxel wide, in a flat map, with the steps of the fourth attempt of `plan`."""
    maze = serpentine(131, 131, 1)
    assert (~maze).sum() > 16 * Ascent().steps
    grid, ends = Grid(maze.shape, 2.0, (0.0, 0.0, 0.0)), 2.0 * np.array([[0, 0, 0], [130, 130, 0]])
    task = Task.of(VoxelMap.on(grid, maze), ends[:1], ends[1], Distances(0.0, 0.0))
    one = plan_task(task, FieldPlanner(solve_potential, Ascent(steps=64 * Ascent().steps), focus=False))[0]
    assert one.status is Status.OK
    assert one.certified
    assert one.length > 2 * 16 * Ascent().steps
    assert verify(one.path, VoxelMap.on(grid, maze)).ok


@pytest.mark.large
def test_a_plan_that_is_not_safe_names_the_largest_radius_that_joins() -> None:
    wall = EMPTY.copy()
    wall[8] = True
    wall[8, 8:11, 9:12] = False  # a door whose middle keeps 1.5 voxels
    ends = [np.array(GRID.origin) + 2.0 * np.array(v) for v in ([0, 9, 10], [15, 9, 10])]
    tight = plan(VoxelMap.on(GRID, wall), *ends, distances=Distances(radius=3.4, margin=4.0))
    assert tight.status is Status.NO_SAFE_PATH
    assert tight.path.shape == (0, 3)
    assert tight.radius == pytest.approx(3.0)
    wide = plan(VoxelMap.on(GRID, wall), *ends, distances=Distances(radius=tight.radius, margin=4.0))
    assert wide.status is Status.OK
    assert wide.clearance == pytest.approx(3.0, abs=2e-3)


@pytest.mark.large
def test_random_problems_are_solved_verified_and_certified() -> None:
    rng = np.random.default_rng(4)
    outcomes = []
    for _ in range(30):
        occupied = random_blocks(rng, GRID.shape, int(rng.integers(1, 40)), 5)
        ends = np.array(GRID.origin) + GRID.spacing * (random_free(rng, occupied, 2) + rng.uniform(-0.4, 0.4, (2, 3)))
        one = plan(VoxelMap.on(GRID, occupied), *ends, distances=Distances(margin=4.0))
        outcomes.append(one.status)
        if one.status is Status.OK:
            assert one.certified
            verdict = verify(one.path, VoxelMap.on(GRID, occupied), radius=1.0, exemptions=one.exemptions)
            assert verdict.ok
            assert one.cost >= one.length * (1 - 1e-5)
            assert verdict.length == pytest.approx(one.length, rel=1e-12)
            assert one.length >= math.dist(*ends) * (1 - 1e-12)
            assert verdict.clearance == pytest.approx(one.clearance, rel=1e-9)
            assert one.clearance > 0
            np.testing.assert_array_equal(one.path[[0, -1]], ends)
        else:
            assert one.status is Status.NO_VALID_PATH
    assert outcomes.count(Status.OK) > 20


def test_those_that_stall_go_again_by_themselves_with_longer_ascents() -> None:
    """Problem k needs 10^k steps; the one that fails otherwise is left alone."""
    attempts: list[tuple[list[int], int]] = []

    def attempt(which: np.ndarray, settings: Ascent) -> Routes:
        attempts.append((which.tolist(), settings.steps))
        assert settings.rate == 0.2

        def route(k: int) -> Route:
            if k == 1:
                return no_route(Status.NOT_CERTIFIED)
            return (
                route_of(np.full((1, 3), float(k)), certified=True)
                if settings.steps >= 10**k
                else no_route(Status.PATH_STALLED)
            )

        return Routes.of([route(k) for k in which.tolist()])

    routes = with_longer_ascents(attempt, 5, Ascent(steps=8, rate=0.2)).route
    assert attempts == [
        ([0, 1, 2, 3, 4], 8), ([2, 3, 4], 32), ([2, 3, 4], 128), ([3, 4], 512), ([3, 4], 2048), ([4], 8192),
    ]  # fmt: skip
    assert [Status(status) for status in routes.status.tolist()] == [
        Status.OK, Status.NOT_CERTIFIED, Status.OK, Status.OK, Status.PATH_STALLED,
    ]  # fmt: skip
    assert float(routes.path[2, 0, 0]) == 2


def test_a_default_ascent_may_grow_to_half_a_million_steps() -> None:
    def attempt(which: np.ndarray, settings: Ascent) -> Routes:
        arrives = settings.steps > 500_000
        one = route_of(np.zeros((1, 3)), certified=True) if arrives else no_route(Status.PATH_STALLED)
        return Routes.of([one] * len(which))

    assert with_longer_ascents(attempt, 2, Ascent()).route.status.tolist() == [Status.OK] * 2
