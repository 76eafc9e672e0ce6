"""Only a verified path leaves the planner; every other outcome has its status, and no path."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import random_blocks, random_free, serpentine

from maxjax import Grid, Plan, Status, plan, solve_potential, verify
from maxjax.planning.ascent import Ascent
from maxjax.planning.batch import plan_paths
from maxjax.planning.planner import PathFinder, Route, Stage, Stopwatch, field_path, plan_path
from maxjax.planning.problem import Problem

GRID = Grid((16, 18, 20), 2.0, (-10.0, 3.0, 1.0))
EMPTY = np.zeros(GRID.shape, bool)
START, GOAL = np.array([-8.3, 5.1, 3.7], np.float32), np.array([18.9, 36.2, 38.4], np.float32)


def run(find: PathFinder, occupied: np.ndarray = EMPTY, goal: np.ndarray = GOAL) -> Plan:
    return plan_path(find, occupied, START, goal, GRID, margin=2.0, ground=EMPTY, method="test")


def check_failed(found: Plan, status: Status) -> None:
    assert found.status is status
    assert found.path.shape == (0, 3)
    assert math.isnan(found.length)
    assert math.isnan(found.clearance)


def returning(path: Callable[[Problem], np.ndarray]) -> PathFinder:
    return lambda problem, grid, watch: Route(path(problem).astype(np.float32), Status.OK, certified=True)


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
    found = run(returning(lambda problem: np.stack([problem.start, problem.start, problem.goal, problem.goal])))
    assert found.path.dtype == np.float32
    np.testing.assert_array_equal(found.path, np.stack([START, GOAL]))  # repeated points are left out
    assert found.length == pytest.approx(math.dist(START, GOAL), rel=1e-6)
    assert found.clearance == math.inf


def capped(sigma: jax.Array, goal: jax.Array) -> object:
    return solve_potential(sigma, goal, max_iterations=0, max_sweeps=0, screening_length=2.0)


def underflowing(sigma: jax.Array, goal: jax.Array) -> object:
    return solve_potential(sigma, goal, screening_length=0.1)


def flat(sigma: jax.Array, goal: jax.Array) -> object:
    """A field that claims more than it holds."""
    potential = solve_potential(sigma, goal)
    return dataclasses.replace(potential, phi=jnp.where(sigma > 0, 1.0, 0.0))


def test_a_field_that_fails_gives_its_status() -> None:
    check_failed(run(field_path(capped)), Status.NOT_CONVERGED)  # type: ignore[arg-type]
    check_failed(run(field_path(underflowing)), Status.NOT_CERTIFIED)  # type: ignore[arg-type]
    check_failed(run(field_path(flat, Ascent(steps=8))), Status.PATH_STALLED)  # type: ignore[arg-type]


def test_a_wrong_problem_is_never_handed_to_a_path_finder() -> None:
    def never(problem: Problem, grid: Grid, watch: Stopwatch) -> Route:
        raise AssertionError

    check_failed(run(never, goal=START), Status.START_EQUALS_GOAL)
    check_failed(run(never, goal=np.float32([999, 0, 0])), Status.GOAL_OUTSIDE_MAP)
    sealed = EMPTY.copy()
    sealed[8] = True
    check_failed(run(never, sealed), Status.NO_VALID_PATH)


def test_a_maze_gets_more_steps_alone_and_in_a_batch() -> None:
    """The first attempt's steps do not suffice; the answer is the same for one problem and for many."""
    maze = np.repeat(serpentine(15, 18, 1), 20, axis=2)
    maze = np.concatenate([maze, np.ones((1, 18, 20), bool)])
    start, goal = (np.array(GRID.origin, np.float32) + 2 * np.float32(v) for v in ([0, 0, 9], [14, 0, 9]))
    settings = Ascent(steps=64)
    alone = plan_path(
        field_path(solve_potential, settings), maze, start, goal, GRID, margin=0.0, ground=EMPTY, method="solver"
    )
    batch = plan_paths(
        solve_potential, maze[None], start[None], goal[None], GRID,
        margin=0.0, ground=EMPTY[None], method="solver", settings=settings, chunk=1,
    )  # fmt: skip
    assert alone.status is Status.OK
    assert verify(alone.path, maze, maze, GRID).ok
    assert batch[0].status is Status.OK
    assert batch[0].length == pytest.approx(alone.length, rel=1e-3)


def test_random_problems_are_solved_verified_and_certified() -> None:
    rng = np.random.default_rng(4)
    outcomes = []
    for _ in range(30):
        occupied = random_blocks(rng, GRID.shape, int(rng.integers(1, 40)), 5)
        ends = np.array(GRID.origin) + GRID.spacing * (random_free(rng, occupied, 2) + rng.uniform(-0.4, 0.4, (2, 3)))
        found = plan(occupied, *ends, GRID, margin=4.0)
        outcomes.append(found.status)
        if found.status is Status.OK:
            assert found.certified
            verdict = verify(found.path, occupied, occupied, GRID)
            assert verdict.ok
            assert verdict.length == found.length >= math.dist(*ends) * (1 - 1e-6)
            assert verdict.clearance == found.clearance > 0
            np.testing.assert_array_equal(found.path[[0, -1]], ends.astype(np.float32))
        else:
            assert found.status is Status.NO_VALID_PATH
    assert outcomes.count(Status.OK) > 20


def test_stages_are_timed_apart_from_their_compilation() -> None:
    stage = Stage("double", lambda x, scale: scale * x, static=("scale",))
    first, second, third = Stopwatch(), Stopwatch(), Stopwatch()
    assert stage(first, jnp.float32(2), scale=2.0) == 4
    assert stage(second, jnp.float32(3), scale=2.0) == 6
    assert stage(third, jnp.float32(3), scale=3.0) == 9
    assert first.report()["compile"] > 0
    assert second.report()["compile"] == 0
    assert third.report()["compile"] > 0
    assert second.report()["total"] == second.report()["double"] > 0
