"""A tightened path keeps its ends, is never longer, stays clear, and is taut."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import csgraph

from maxjax import Grid, Status, VoxelMap, verify
from maxjax.planning.path.line_of_sight import clear_and_costs, sight_of
from maxjax.planning.path.string_pulling import WINDOW, tighten
from maxjax.planning.search.astar import astar
from tests.references import component_of, grid_graph, keeps, random_blocks, random_free, serpentine

SHAPE = (16, 18, 20)
ROOM = 200  # length of the arrays

pull = jax.jit(lambda blocked, path: tighten(sight_of(blocked), path))


def padded(path: np.ndarray, room: int = ROOM) -> np.ndarray:
    assert len(path) <= room
    return np.concatenate([path, np.repeat(path[-1:], room - len(path), axis=0)]).astype(np.float32)


def length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path.astype(float), axis=0), axis=1).sum())


def check(blocked: np.ndarray, path: np.ndarray) -> float:
    """Pull a path taut and judge it independently; returns the new length."""
    taut = np.asarray(pull(blocked, path))
    assert taut.shape == path.shape
    np.testing.assert_array_equal(taut[0], path[0])
    np.testing.assert_array_equal(taut[-1], path[-1])
    verdict = verify(taut, VoxelMap.on(Grid(blocked.shape, 1.0, (0.0, 0.0, 0.0)), blocked))  # type: ignore[arg-type]
    assert verdict.ok, verdict
    assert length(taut) <= length(path) * (1 + 1e-6)
    return length(taut)


def shortest(blocked: np.ndarray, start: tuple[int, ...], goal: tuple[int, ...]) -> np.ndarray:
    found = astar(blocked, start, goal)  # type: ignore[arg-type]
    assert found.status is Status.OK
    return found.path


def test_random_scenes() -> None:
    rng = np.random.default_rng(1)
    paths = 0
    for count in (0, 10, 30, 60, 90):
        blocked = random_blocks(rng, SHAPE, count, 6)
        for _ in range(6):
            start, goal = (tuple(v) for v in random_free(rng, blocked, 2).tolist())
            if component_of(~blocked, start)[goal]:
                path = shortest(blocked, start, goal)
                paths += 1
                assert check(blocked, padded(path)) >= math.dist(start, goal) * (1 - 1e-6)
    assert paths > 15


def test_an_empty_grid_leaves_the_straight_line() -> None:
    empty = np.zeros(SHAPE, bool)
    for start, goal in (((0, 0, 0), (15, 17, 19)), ((3, 17, 2), (3, 0, 2)), ((5, 5, 5), (6, 5, 5))):
        assert check(empty, padded(shortest(empty, start, goal))) == pytest.approx(math.dist(start, goal), rel=1e-5)


def test_around_a_box_is_nearly_the_analytic_optimum() -> None:
    """A box of full height between two points: the string runs over two of its edges."""
    blocked = np.zeros(SHAPE, bool)
    blocked[6:10, :12] = True
    for start, goal in (((1, 3, 5), (14, 2, 5)), ((0, 8, 2), (15, 4, 17)), ((2, 11, 10), (12, 1, 3))):
        # The faces lie half a voxel beyond the centres; unfolded about the edges of the box, the way is straight.
        first = math.dist(start[:2], (5.5, 11.5))
        last = math.dist(goal[:2], (9.5, 11.5))
        flat = first + 4 + last
        optimum = math.hypot(flat, goal[2] - start[2])
        given = check(blocked, padded(shortest(blocked, start, goal)))
        assert optimum * (1 - 1e-6) <= given <= 1.025 * optimum


def test_points_of_any_spacing_and_repeated_points() -> None:
    """An ascent's path: hundreds of short steps, some of them none at all."""
    rng = np.random.default_rng(2)
    blocked = np.zeros(SHAPE, bool)
    blocked[6:10, :12] = True
    corners = padded(shortest(blocked, (1, 3, 5), (14, 2, 5)), 60)[:60]
    steps = np.sort(np.concatenate([np.linspace(0, 59, 90), rng.uniform(0, 59, 60)]))
    dense = np.stack([np.interp(steps, np.arange(60), corners[:, axis]) for axis in range(3)], axis=1)
    # A sampled diagonal may leave out the corner of its polyline by less than a step: all it needs is to be legal.
    start = check(blocked, padded(np.repeat(corners[:40], 3, axis=0)))
    assert check(blocked, padded(dense.astype(np.float32))) == pytest.approx(start, rel=0.02)


def test_long_mazes_with_more_corners_than_a_window_stay_valid() -> None:
    blocked = np.repeat(serpentine(80, 12, 1), 2, axis=2)
    path = shortest(blocked, (0, 0, 0), (78, 0, 1))
    turns = np.count_nonzero((np.diff(path, n=2, axis=0) != 0).any(axis=1))
    assert turns > WINDOW
    assert check(blocked, padded(path, 600)) < length(path)


@pytest.mark.parametrize("room", [2, 3, 5, 9, 33])
def test_short_arrays_keep_the_goal(room: int) -> None:
    """A path that fills its array leaves no room for further corners."""
    blocked = np.zeros((16, 18, 20), bool)
    blocked[7, :10, :10] = True
    path = np.array(
        [[6, 9, 9], [6, 10, 9], [7, 10, 9], [8, 10, 9], [8, 9, 9], [8, 8, 9], [8, 7, 8], [8, 6, 7], [8, 5, 6]]
    )
    check(blocked, padded(path[:room], room))


def test_start_equal_to_goal() -> None:
    path = np.full((ROOM, 3), 4, np.float32)
    np.testing.assert_array_equal(pull(np.zeros(SHAPE, bool), path), path)


def test_with_a_price_it_pays_less_than_dijkstra_and_never_more_than_before() -> None:
    rng = np.random.default_rng(4)
    tight = jax.jit(lambda sight, path, price: tighten(sight, path, price))
    paid = jax.jit(lambda sight, path, price: clear_and_costs(sight, price, path[:-1], path[1:]))
    ratios = []
    for count in (5, 15, 20):
        blocked = random_blocks(rng, SHAPE, count, 6)
        far = ndimage.distance_transform_edt(~blocked) - 0.5
        price = (1 + 4 * np.maximum(1 - far / 4, 0) ** 2).astype(np.float32)
        graph, n = grid_graph(blocked).tocoo(), price.ravel()
        graph.data *= (n[graph.row] + n[graph.col]) / 2
        start, goal = np.ravel_multi_index(random_free(rng, blocked, 2).T, SHAPE)
        cost, before = csgraph.dijkstra(graph.tocsr(), indices=start, return_predecessors=True)
        if not np.isfinite(cost[goal]):
            continue
        way = [goal]
        while way[-1] != start:
            way.append(before[way[-1]])
        path = padded(np.stack(np.unravel_index(way[::-1], SHAPE), axis=1))
        sight = sight_of(jnp.asarray(blocked), 0.5)
        taut = np.asarray(tight(sight, path, price))
        np.testing.assert_array_equal(taut[[0, -1]], path[[0, -1]])
        (_, old), (clear, new) = paid(sight, path, price), paid(sight, taut, price)
        assert clear.all()
        assert keeps(taut, blocked, 0.5 - 1e-3)
        assert new.sum() <= old.sum() * (1 + 1e-6)
        ratios.append(float(new.sum()) / cost[goal])
    assert len(ratios) > 1
    assert np.mean(ratios) < 1


def test_vmap_equals_a_loop() -> None:
    rng = np.random.default_rng(3)
    blocked = np.stack([random_blocks(rng, SHAPE, 20, 5) for _ in range(3)])
    blocked[:, 0, 0, 0] = blocked[:, 15, 17, 19] = False
    blocked[:, 0] = blocked[:, :, 17] = blocked[:, :, :, 19] = False
    paths = np.stack([padded(shortest(b, (0, 0, 0), (15, 17, 19))) for b in blocked])
    batch = jax.jit(jax.vmap(lambda b, p: tighten(sight_of(b), p)))(blocked, paths)
    for k in range(3):
        np.testing.assert_allclose(batch[k], pull(blocked[k], jnp.asarray(paths[k])), atol=1e-5)
