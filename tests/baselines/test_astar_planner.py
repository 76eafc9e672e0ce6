"""A* in the loop of a flight is A*: the same corners, from exact start to exact goal, alone and under `vmap`."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.baselines.astar_planner import AStar
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.line_of_sight import clear, sight_of
from maxjax.planning.planner import POINTS, corners_of, pure_route
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate
from maxjax.planning.search.astar import astar


def problem_of(seed: int) -> Problem:
    rng = np.random.default_rng(seed)
    grid = Grid((14, 12, 9), 2.0, (0.0, 0.0, 0.0))
    occupied = rng.random(grid.shape) < 0.25
    start, goal = np.array([1.0, 1.0, 1.0]) * 2 + 0.3, np.array([12.0, 10.0, 7.0]) * 2 - 0.3
    occupied[1, 1, 1] = occupied[12, 10, 7] = False
    if seed == 2:
        occupied[5] = True
    nothing = jnp.zeros(grid.shape, bool)
    ends = grid.fractional_index(jnp.stack([jnp.asarray(start), jnp.asarray(goal)]))
    return formulate(jnp.asarray(occupied), nothing, ends, Distances(0.0, 0.0), grid)


@pytest.mark.large
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_astar_in_the_loop_is_astar(seed: int) -> None:
    problem = problem_of(seed)
    route = jax.jit(pure_route(AStar()))(problem)
    path, status, certified = route.path, route.status, route.certified
    expected = astar(np.asarray(problem.blocked), (1, 1, 1), (12, 10, 7))
    assert path.shape == (POINTS, 3) == (Ascent().steps + 1, 3)
    assert not certified
    assert int(status) == expected.status == (Status.NO_VALID_PATH if seed == 2 else Status.OK)
    if expected.status != Status.OK:
        assert np.all(path == path[0])
        return
    found = np.asarray(path)
    np.testing.assert_allclose(found[0], problem.start)
    np.testing.assert_allclose(found[-1], problem.goal)
    # From the exact start past its voxel's centre, then through A*'s corners, in order, to the exact goal.
    corners = corners_of(expected.path)[1:]
    inner = found[:-1][np.any(np.diff(found, axis=0) != 0, axis=1)]
    np.testing.assert_array_equal(inner[-len(corners) :], corners)
    assert len(inner) == len(corners) + 1 or np.array_equal(inner[1], expected.path[1])
    bits = sight_of(problem.blocked)
    assert all(clear(bits, jnp.asarray(a), jnp.asarray(b)) for a, b in itertools.pairwise(inner))


@pytest.mark.large
def test_astar_in_the_loop_under_vmap_is_each_by_itself() -> None:
    problems = [problem_of(seed) for seed in (0, 1, 2)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *problems)
    routes = jax.vmap(lambda one: pure_route(AStar())(one))(batch)
    for problem, path, status in zip(problems, routes.path, routes.status, strict=True):
        alone = pure_route(AStar())(problem)
        np.testing.assert_array_equal(path, alone.path)
        assert status == alone.status


@pytest.mark.large
@pytest.mark.parametrize("seed", [0, 1])
def test_on_the_host_every_voxel_on_the_way_is_a_point(seed: int) -> None:
    problem = problem_of(seed)
    route = AStar().route(problem)
    expected = astar(np.asarray(problem.blocked), (1, 1, 1), (12, 10, 7))
    assert route.status == Status.OK
    np.testing.assert_array_equal(route.path[1:-1], expected.path)
    np.testing.assert_array_equal(route.path[[0, -1]], np.stack([problem.start, problem.goal]))


def test_corners_keep_the_line() -> None:
    path = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 1, 0], [4, 2, 0], [4, 2, 1]], np.int32)
    np.testing.assert_array_equal(corners_of(path), path[[0, 2, 4, 5]])
    np.testing.assert_array_equal(corners_of(path[:1]), path[:1])
    np.testing.assert_array_equal(corners_of(path[:2]), path[:2])
