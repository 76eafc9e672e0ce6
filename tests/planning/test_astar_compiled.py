"""The compiled A* is the one in Python, voxel by voxel and expansion by expansion, and nothing needs it."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

import maxjax
from maxjax import Status
from maxjax.compile import native
from maxjax.compile.native import NotCompiledError
from maxjax.planning.search import astar_compiled
from maxjax.planning.search.astar import AstarResult, astar
from maxjax.planning.search.astar_compiled import Queries, Query, Search
from tests.references import cuts_no_corner, grid_graph, priced_graph, random_free, serpentine

Index = tuple[int, int, int]
PRICES = [None, (1.0,), (1.0, 1.5, 3.0), (1.0, 1.3, 4.7, 9.1)]


def check(blocked: np.ndarray, start: Index, goal: Index, price: np.ndarray | None = None) -> AstarResult:
    found, expected = (find(blocked, start, goal, price) for find in (astar_compiled.astar_in_cpp, astar))
    assert found.status is expected.status
    np.testing.assert_array_equal(found.path, expected.path)
    assert (found.length, found.cost, found.expanded) == (expected.length, expected.cost, expected.expanded)
    return found


@pytest.mark.usefixtures("compiled_astar")
@settings(max_examples=200, deadline=None)
@given(
    shape=st.tuples(*[st.integers(1, 9)] * 3),
    density=st.sampled_from([0.0, 0.1, 0.25, 0.45]),
    prices=st.sampled_from(PRICES),
    seed=st.integers(0, 2**32 - 1),
)
def test_is_the_search_in_python(shape: Index, density: float, prices: tuple[float, ...] | None, seed: int) -> None:
    """Slabs and lines among the shapes; start and goal anywhere, also blocked, equal, or sealed off."""
    rng = np.random.default_rng(seed)
    blocked = rng.random(shape) < density
    price = None if prices is None else rng.choice(prices, shape).astype(np.float32)
    for _ in range(4):
        start, goal = (tuple(end) for end in rng.integers(0, shape, (2, 3)).tolist())
        check(blocked, start, goal, price)


@pytest.mark.usefixtures("compiled_astar")
@pytest.mark.parametrize("priced", [False, True])
def test_equals_dijkstra_among_boxes(priced: bool) -> None:
    rng = np.random.default_rng(8)
    blocked = np.zeros((34, 30, 16), bool)
    for _ in range(45):
        corner, size = rng.integers(0, blocked.shape), rng.integers(1, (9, 9, 16))
        blocked[tuple(slice(c, c + s) for c, s in zip(corner, size, strict=True))] = True
    price = rng.choice([1.0, 1.3, 2.9], blocked.shape).astype(np.float32) if priced else None
    graph = grid_graph(blocked) if price is None else priced_graph(blocked, price)
    for start in map(tuple, random_free(rng, blocked, 4).tolist()):
        costs = dijkstra(graph, indices=np.ravel_multi_index(start, blocked.shape)).reshape(blocked.shape)
        for goal in map(tuple, random_free(rng, blocked, 30).tolist()):
            found = check(blocked, start, goal, price)
            assert found.cost == pytest.approx(costs[goal], rel=1e-9)
            assert math.isinf(costs[goal]) or cuts_no_corner(found.path, blocked)


@pytest.mark.usefixtures("compiled_astar")
@pytest.mark.parametrize("name", ["Complex", "Simple"])
def test_finds_the_stated_optimum_of_every_warframe_scenario(name: str, data: Path) -> None:
    with np.load(data / "warframe" / f"crop101_{name}.npz") as crop:
        blocked, starts, goals, optima = (crop[k] for k in ("occupancy", "start", "goal", "optimal_length"))
    ends = zip(map(tuple, starts.tolist()), map(tuple, goals.tolist()), strict=True)
    queries = Queries([Query(blocked, *pair) for pair in ends])
    queries.run([Search(blocked.shape) for _ in range(2)])
    for k, optimum in enumerate(optima):
        found = queries.result(k)
        assert found.length == pytest.approx(optimum, abs=1e-7)  # the files state eight decimals
        assert cuts_no_corner(found.path, blocked)


@pytest.mark.usefixtures("compiled_astar")
def test_answers_do_not_depend_on_threads_nor_on_earlier_queries() -> None:
    rng = np.random.default_rng(4)
    maps = rng.random((3, 12, 11, 10)) < 0.25
    price = rng.choice([1.0, 2.7], maps.shape).astype(np.float32)
    asked = []
    for k in range(300):
        ends = map(tuple, random_free(rng, maps[k % 3], 2).tolist())
        asked.append(Query(maps[k % 3], *ends, price=price[k % 3] if k % 2 else None))  # type: ignore[misc]
    expected = [astar(*query) for query in asked]
    searches = [Search(maps.shape[1:]) for _ in range(3)]
    for threads in (1, 3):
        queries = Queries(asked)
        queries.run(searches[:threads])
        for k, one in enumerate(expected):
            found = queries.result(k)
            assert (found.status, found.cost, found.expanded) == (one.status, one.cost, one.expanded)
            np.testing.assert_array_equal(found.path, one.path)
    with ThreadPoolExecutor(4) as pool:
        costs = list(pool.map(lambda query: astar_compiled.astar_in_cpp(*query).cost, asked))
    assert costs == [one.cost for one in expected]


@pytest.mark.usefixtures("compiled_astar")
def test_a_path_longer_than_was_reckoned_with_is_whole() -> None:
    maze = serpentine(41, 41, 3)
    free = np.argwhere(~maze)
    found = check(maze, tuple(free[0].tolist()), tuple(free[-1].tolist()))
    assert len(found.path) > astar_compiled._ROOM


@pytest.mark.usefixtures("compiled_astar")
def test_wrong_queries_are_told_with_what_was_given() -> None:
    blocked = np.zeros((3, 4, 5), bool)
    blocked[1, 1, 1] = True
    ones = np.ones(blocked.shape, np.float32)
    for queries, message in (
        ([Query(blocked, (0, 0, 0), (1, 1, 1))], r"ends in free voxels, given .*\(1, 1, 1\): GOAL_OCCUPIED"),
        ([Query(blocked, (0, 9, 0), (1, 1, 2))], "START_OUTSIDE_MAP"),
        ([Query(blocked, (0, 0, 0), (1, 1, 2)), Query(blocked[:2], (0, 0, 0), (1, 1, 2))], r"given bool \(2, 4, 5\)"),
        ([Query(blocked, (0, 0, 0), (1, 1, 2), ones.astype(float))], "float32.*given float64"),  # type: ignore[arg-type]
    ):
        with pytest.raises(ValueError, match=message):
            Queries(queries)
    with pytest.raises(ValueError, match=r"at least 1, given 0\.5"):
        astar_compiled.astar_in_cpp(blocked, (0, 0, 0), (1, 1, 2), 0.5 * ones)
    with pytest.raises(ValueError, match="searches: expected maps of"):
        Queries([Query(blocked, (0, 0, 0), (1, 1, 2))]).run([Search((3, 3, 3))])


def plan_by_astar() -> maxjax.Plan:
    grid = maxjax.Grid((9, 8, 7), 2.0, (0.0, 0.0, 0.0))
    occupied = np.zeros(grid.shape, bool)
    occupied[4, 2:, :] = True
    return maxjax.plan(
        maxjax.VoxelMap.on(grid, occupied),
        (2.0, 12.0, 6.0),
        (14.0, 12.0, 6.0),
        planner=maxjax.AStar(),
        distances=maxjax.Distances(radius=0.0, margin=2.0),
    )


@pytest.mark.usefixtures("compiled_astar")
def test_without_a_library_the_search_in_python_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = plan_by_astar()
    assert "search" in expected.timings
    monkeypatch.setattr(native, "cache_folder", lambda: None)
    native._outcome.cache_clear()
    with pytest.raises(NotCompiledError, match=r"astar\.cpp: there is no folder"):
        native.library(astar_compiled.SOURCE)
    found = plan_by_astar()
    assert found.status is Status.OK
    assert "search in Python" in found.timings
    np.testing.assert_array_equal(found.path, expected.path)
    native._outcome.cache_clear()
