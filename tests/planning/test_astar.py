"""A* is optimal, cuts no corner, and names every failure."""

from __future__ import annotations

import inspect
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

from maxjax import Status
from maxjax.planning.search import astar as module
from maxjax.planning.search import steps
from maxjax.planning.search.astar import astar
from tests.references import cuts_no_corner, grid_graph, priced_graph, random_free


def euclidean_length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def check(blocked: np.ndarray, start: tuple[int, ...], goal: tuple[int, ...], optimum: float) -> None:
    """A* agrees with the optimum (infinite if there is no path), and its path proves its length."""
    result = astar(blocked, start, goal)
    if math.isinf(optimum):
        assert result.status is Status.NO_VALID_PATH
        assert math.isinf(result.length)
        assert result.path.shape == (0, 3)
        return
    assert result.status is Status.OK
    assert result.length == pytest.approx(optimum, rel=1e-9)
    assert euclidean_length(result.path) == pytest.approx(optimum, rel=1e-9)
    assert tuple(result.path[0]) == tuple(start)
    assert tuple(result.path[-1]) == tuple(goal)
    assert cuts_no_corner(result.path, blocked)


@settings(max_examples=150, deadline=None)
@given(
    shape=st.tuples(*[st.integers(1, 7)] * 3),
    density=st.sampled_from([0.0, 0.1, 0.2, 0.3, 0.45]),
    seed=st.integers(0, 2**32 - 1),
)
def test_equals_dijkstra_between_random_voxels(shape: tuple[int, int, int], density: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocked = rng.random(shape) < density
    free = np.argwhere(~blocked).tolist()
    if not free:
        return
    start, *goals = (tuple(free[k]) for k in rng.integers(len(free), size=4))
    distance = dijkstra(grid_graph(blocked), indices=np.ravel_multi_index(start, shape)).reshape(shape)
    for goal in goals:
        check(blocked, start, goal, distance[goal])


@pytest.mark.parametrize("density", [0.05, 0.15, 0.3])
def test_equals_dijkstra_to_every_voxel(density: float) -> None:
    rng = np.random.default_rng(int(100 * density))
    blocked = rng.random((11, 10, 9)) < density
    start = (0, 4, 8)
    blocked[start] = False
    distance = dijkstra(grid_graph(blocked), indices=np.ravel_multi_index(start, blocked.shape)).reshape(blocked.shape)
    for goal in map(tuple, np.argwhere(~blocked).tolist()):
        check(blocked, start, goal, distance[goal])


def test_equals_dijkstra_among_boxes() -> None:
    """Walls, slits and dead ends, over distances at which a pruning error would add up."""
    rng = np.random.default_rng(7)
    blocked = np.zeros((40, 36, 20), bool)
    for _ in range(60):
        corner, size = rng.integers(0, blocked.shape), rng.integers(1, (9, 9, 16))
        blocked[tuple(slice(c, c + s) for c, s in zip(corner, size, strict=True))] = True
    free = np.argwhere(~blocked).tolist()
    graph = grid_graph(blocked)
    for start in (tuple(free[k]) for k in rng.integers(len(free), size=5)):
        distance = dijkstra(graph, indices=np.ravel_multi_index(start, blocked.shape)).reshape(blocked.shape)
        for goal in (tuple(free[k]) for k in rng.integers(len(free), size=40)):
            check(blocked, start, goal, distance[goal])


@pytest.mark.large
@pytest.mark.parametrize("name", ["Simple", pytest.param("Complex", marks=pytest.mark.nightly)])  # compiled: both
def test_finds_the_stated_optimum_of_every_warframe_scenario(name: str, data: Path) -> None:
    with np.load(data / "warframe" / f"crop101_{name}.npz") as crop:
        blocked, starts, goals, optima = (crop[k] for k in ("occupancy", "start", "goal", "optimal_length"))
    for start, goal, optimum in zip(starts.tolist(), goals.tolist(), optima, strict=True):
        result = astar(blocked, tuple(start), tuple(goal))
        assert result.status is Status.OK
        assert result.length == pytest.approx(optimum, abs=1e-7)  # the files state eight decimals
        assert cuts_no_corner(result.path, blocked)


@pytest.mark.parametrize("density", [0.05, 0.25])
def test_a_price_makes_the_path_the_cheapest(density: float) -> None:
    rng = np.random.default_rng(int(100 * density))
    blocked = rng.random((12, 11, 9)) < density
    price = rng.choice([1.0, 1.3, 3.0, 9.0], blocked.shape)
    graph = priced_graph(blocked, price)
    for start in map(tuple, random_free(rng, blocked, 3).tolist()):
        costs = dijkstra(graph, indices=np.ravel_multi_index(start, blocked.shape)).reshape(blocked.shape)
        for goal in map(tuple, random_free(rng, blocked, 60).tolist()):
            result = astar(blocked, start, goal, price)
            assert result.cost == pytest.approx(costs[goal], rel=1e-9)
            if result.status is Status.OK:
                assert result.length == pytest.approx(euclidean_length(result.path), abs=1e-9)
                assert cuts_no_corner(result.path, blocked)


def test_a_price_of_one_changes_nothing_and_others_are_checked() -> None:
    rng = np.random.default_rng(2)
    blocked = rng.random((12, 11, 9)) < 0.2
    start, goal = map(tuple, random_free(rng, blocked, 2).tolist())
    bare, one = astar(blocked, start, goal), astar(blocked, start, goal, np.ones(blocked.shape, np.float32))
    np.testing.assert_array_equal(bare.path, one.path)
    assert (bare.expanded, bare.length, bare.cost) == (one.expanded, one.length, one.length)
    for wrong in (0.99, np.nan, np.inf):
        price = np.ones(blocked.shape)
        price[3, 4, 5] = wrong
        with pytest.raises(ValueError, match="price: expected finite numbers of at least 1"):
            astar(blocked, start, goal, price)
    with pytest.raises(ValueError, match=r"price: expected shape \(12, 11, 9\), given \(12, 11\)"):
        inspect.unwrap(astar)(blocked, start, goal, np.ones((12, 11)))


def test_empty_space_leaves_one_natural_successor_per_axis_subset() -> None:
    for arrival, step in enumerate(steps.STEPS):
        onward = [steps.STEPS[k] for k in steps.successors(0, arrival)]
        # The steps along some of the axes of the last one, and nothing else.
        assert len(onward) == 2 ** np.count_nonzero(step) - 1
        assert all(n in (0, s) for a in onward for n, s in zip(a, step, strict=True))
    assert len(steps.successors(0, steps.AT_START)) == 26


def test_heuristic_is_exact_in_empty_space() -> None:
    shape, goal = (6, 9, 5), (2, 7, 1)
    distance = dijkstra(grid_graph(np.zeros(shape, bool)), indices=np.ravel_multi_index(goal, shape))
    np.testing.assert_allclose(module._octile(shape, goal).ravel() / 8, distance, rtol=1e-10)


def test_window_codes_hold_the_neighbourhood() -> None:
    blocked = np.random.default_rng(3).random((4, 5, 6)) < 0.4
    codes = steps.window_codes(blocked)
    padded = np.pad(blocked, 1, constant_values=True)
    for x, y, z in np.ndindex(blocked.shape):
        window = padded[x : x + 3, y : y + 3, z : z + 3].ravel()
        assert codes[x + 1, y + 1, z + 1] == sum(1 << k for k in np.flatnonzero(window))


def test_does_not_slip_through_closed_corners() -> None:
    edge = np.zeros((2, 2, 1), bool)
    edge[0, 1] = edge[1, 0] = True  # the free voxels share an edge
    assert astar(edge, (0, 0, 0), (1, 1, 0)).status is Status.NO_VALID_PATH
    corner = np.ones((2, 2, 2), bool)
    corner[0, 0, 0] = corner[1, 1, 1] = False  # the free voxels share a corner
    assert astar(corner, (0, 0, 0), (1, 1, 1)).status is Status.NO_VALID_PATH
    one = np.zeros((2, 2, 2), bool)
    one[1, 0, 0] = True  # one voxel of eight closes the spatial diagonal
    assert astar(one, (0, 0, 0), (1, 1, 1)).length == pytest.approx(1 + math.sqrt(2))


def test_sealed_goal_has_no_path_and_the_input_is_left_alone() -> None:
    blocked = np.zeros((12, 12, 12), bool)
    blocked[5:10, 5:10, 5:10] = True
    blocked[7, 7, 7] = False
    before = blocked.copy()
    result = astar(blocked, (0, 0, 0), (7, 7, 7))
    assert result.status is Status.NO_VALID_PATH
    assert result.expanded == (~blocked).sum() - 1
    np.testing.assert_array_equal(blocked, before)


def test_start_equal_to_goal_is_a_path_of_one_voxel() -> None:
    result = astar(np.zeros((3, 3, 3), bool), (1, 2, 0), (1, 2, 0))
    assert result.status is Status.OK
    assert result.path.tolist() == [[1, 2, 0]]
    assert result.length == 0


@pytest.mark.parametrize(
    ("start", "goal", "status"),
    [
        ((-1, 0, 0), (1, 1, 1), Status.START_OUTSIDE_MAP),
        ((0, 0, 3), (1, 1, 1), Status.START_OUTSIDE_MAP),
        ((1, 1, 1), (0, 3, 0), Status.GOAL_OUTSIDE_MAP),
        ((0, 0, 0), (1, 1, 1), Status.START_OCCUPIED),
        ((1, 1, 1), (0, 0, 0), Status.GOAL_OCCUPIED),
        ((0, 0, 0), (0, 0, 0), Status.START_OCCUPIED),
    ],
)
def test_names_what_is_wrong_with_start_and_goal(
    start: tuple[int, int, int], goal: tuple[int, int, int], status: Status
) -> None:
    blocked = np.zeros((3, 3, 3), bool)
    blocked[0, 0, 0] = True
    result = astar(blocked, start, goal)
    assert result.status is status
    assert result.path.shape == (0, 3)


def test_wrong_shapes_are_told_with_what_was_given() -> None:
    unchecked = inspect.unwrap(astar)  # without the run-time type checks of the tests, as users call it
    with pytest.raises(ValueError, match=r"expected bool of shape .*given bool \(3, 3\)"):
        unchecked(np.zeros((3, 3), bool), (0, 0, 0), (1, 1, 1))
    with pytest.raises(ValueError, match=r"expected bool of shape .*given float64"):
        unchecked(np.zeros((3, 3, 3)), (0, 0, 0), (1, 1, 1))
    with pytest.raises(ValueError, match=r"goal: expected three voxel indices, given \(1, 1\)"):
        unchecked(np.zeros((3, 3, 3), bool), (0, 0, 0), (1, 1))
