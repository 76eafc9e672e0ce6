"""The judge of safety agrees with brute force, with plain Dijkstra on the whole map, and with geometry."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from benchmarks.common import safety
from benchmarks.common.safety import Walls
from tests.references import priced_graph, random_blocks, random_free


def walls_of(occupied: np.ndarray, spacing: float = 2.0) -> Walls:
    return Walls(occupied, np.zeros(occupied.shape, bool), spacing)


def to_cubes(solid: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance from each point to the nearest closed cube, by looking at all of them."""
    gaps = np.maximum(np.abs(points[:, None] - np.argwhere(solid)) - 0.5, 0)
    return np.linalg.norm(gaps, axis=-1).min(axis=1)


def test_distances_are_those_to_cubes() -> None:
    rng = np.random.default_rng(0)
    occupied = random_blocks(rng, (24, 20, 14), 8, 5)
    ground = np.zeros(occupied.shape, bool)
    ground[:, :, 0] = True
    walls, solid = Walls(occupied | ground, ground, 2.0), occupied & ~ground
    points = rng.uniform(0, (23, 19, 13), (300, 3))
    points = points[~solid[tuple(np.floor(points + 0.5).astype(int).T)]]
    np.testing.assert_allclose(walls.distance_at(points), to_cubes(solid, points), atol=1e-12)
    halves = np.argwhere(np.ones(walls.halves.shape)) / 2 - 0.5
    chosen = rng.integers(len(halves), size=400)
    np.testing.assert_allclose(walls.halves.ravel()[chosen], to_cubes(solid, halves[chosen]), atol=1e-6)
    np.testing.assert_array_equal(walls.distance, walls.halves[1::2, 1::2, 1::2])
    assert not walls.free[:, :, :2].any()  # the ground and the layer above it


def test_the_cheapest_way_is_that_of_the_whole_map() -> None:
    rng = np.random.default_rng(1)
    blocked = random_blocks(rng, (16, 15, 12), 25, 6)
    walls = walls_of(blocked)
    prices = safety.price(walls.distance, 3.0, "quadratic", 9.0) * rng.uniform(1, 1.5, blocked.shape)
    graph = priced_graph(blocked, prices)
    ends = random_free(rng, blocked, 8)
    for start in ends[:2]:
        costs = dijkstra(graph, indices=np.ravel_multi_index(tuple(start), blocked.shape)).reshape(blocked.shape)
        for goal in ends[2:]:
            found = safety.cheapest(walls, start.astype(float), goal.astype(float), prices)
            assert found == pytest.approx(costs[tuple(goal)], rel=1e-9)


def test_off_the_centres_a_way_is_at_most_as_long_as_through_them() -> None:
    walls, start, goal = walls_of(np.zeros((20, 9, 9), bool)), np.array([2.3, 4.2, 4.4]), np.array([17.4, 4.2, 4.4])
    offset = np.linalg.norm(start - [2, 4, 4]) + np.linalg.norm(goal - [17, 4, 4])
    found = safety.way(walls, start, goal)
    assert np.linalg.norm(goal - start) <= found < 15 + offset - 0.3


def test_a_way_with_clearance_takes_the_wider_gap_and_may_start_beside_a_wall() -> None:
    occupied = np.zeros((41, 41, 5), bool)
    occupied[20] = True
    occupied[20, 19:22] = occupied[20, 30:37] = False  # gaps of 3 and of 7 voxels
    occupied[:, :, 0] = occupied[:, :, -1] = True
    walls = Walls(occupied, occupied & (np.arange(5) % 4 == 0), 2.0)  # floor and ceiling are ground
    start, goal = np.array([4.0, 20, 2]), np.array([36.0, 20, 2])
    direct, wide = safety.way(walls, start, goal), safety.way(walls, start, goal, 2.5)
    assert direct == pytest.approx(32)
    assert wide > direct + 5
    assert safety.way(walls, start, goal, 1.5) == pytest.approx(direct)  # from the middle of 3 voxels
    assert safety.way(walls, start, goal, 2.5, 1.1 * direct) == np.inf
    assert safety.way(walls, start, goal, 4.0) == np.inf
    # Within 10 m of an end anything unoccupied will do.
    assert safety.way(walls, np.array([17.0, 20, 2]), goal, 2.5) == pytest.approx(19)
    assert walls.labels[4, 20, 2] == walls.labels[36, 20, 2] > 0


def test_windows_hold_the_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ways with and without clearance, costs and fast marching: as in the whole map, which costs more to search."""
    pytest.importorskip("skfmm", reason="fast marching is scikit-fmm's: pip install 'maxjax[bench]'")
    rng = np.random.default_rng(3)
    occupied = random_blocks(rng, (36, 34, 12), 24, 7)
    walls = walls_of(occupied)
    prices = safety.price(2.0 * walls.distance, 8.0, "quadratic", 4.0).astype(np.float64)
    window, sizes = safety._window, []
    pairs = list(random_free(rng, occupied, 12).reshape(-1, 2, 3).astype(float))

    def found(start: np.ndarray, goal: np.ndarray) -> list[float]:
        direct, cost = safety.way(walls, start, goal), safety.cheapest(walls, start, goal, prices)
        ways = [safety.way(walls, start, goal, clearance, 1.2 * direct) for clearance in (1.0, 4.0)]
        return [direct, cost, *ways, safety.marched(walls, start, goal, prices, cost)]

    def recorded(*given: Any) -> Any:
        sizes.append(int(window(*given).inside.sum()))
        return window(*given)

    monkeypatch.setattr(safety, "_window", recorded)
    restricted = [found(*ends) for ends in pairs]
    assert min(sizes) < 0.2 * occupied.size
    monkeypatch.setattr(safety, "_window", lambda shape, start, goal, bound: window(shape, start, goal, 1e6))
    for ours, whole in zip(restricted, [found(*ends) for ends in pairs], strict=True):
        np.testing.assert_allclose(ours[:4], whole[:4], rtol=1e-9)
        np.testing.assert_allclose(ours[4], whole[4], rtol=1e-3)  # fast marching is of second order, not exact
    assert np.isfinite(restricted).any(axis=0).all()
    assert np.isinf(np.array(restricted)[:, 3]).any()


def test_what_a_path_keeps() -> None:
    occupied = np.zeros((41, 11, 11), bool)
    occupied[20, 5, 5] = occupied[2, 5, 8] = True
    walls = walls_of(occupied)
    path = np.array([[0.0, 5, 7.25], [20, 5, 7.25], [40.0, 5, 7.25]])
    found = safety.kept(walls, path)
    assert found.least == pytest.approx(0.25)
    assert found.cruise == pytest.approx(1.75)  # the nearer cube lies within 10 m of the start
    assert found.cruise < found.mean < 20
    assert safety.kept(walls, path, (3.0, 0.0)).outside == pytest.approx(np.hypot(0.5, 0.25), abs=0.03)
    assert not found.occupied
    assert not found.below
    through = safety.kept(walls, path - [0, 0, 2])
    assert through.occupied
    assert through.below
    assert through.least == 0
    assert safety.kept(walls, path + np.array([1.0, 0, 0])).occupied  # beyond the map
    ground = dataclasses.replace(walls, ground=occupied)
    assert safety.kept(ground, path - [0, 0, 1.5]).below  # a neighbour of ground
    assert not safety.kept(ground, path[:2] - [0, 0, 1.0], (3.0, 3.0)).below
    assert safety.kept(ground, path).least == np.inf


@pytest.mark.parametrize("shape", ["quadratic", "exponential", "speed"])
def test_prices_fall_from_the_wall_to_one(shape: str) -> None:
    n = safety.price(np.linspace(0, 12, 100), 8.0, shape, 4.0)
    assert n[0] == pytest.approx(5)
    assert np.all(np.diff(n) <= 1e-12)
    np.testing.assert_allclose(n[67:], 1)
    np.testing.assert_allclose(safety.price(np.zeros(3), 0.0, shape, 4.0), 1)


def test_cost_and_fast_marching_agree_with_a_speed_that_rises_linearly() -> None:
    """v = v₀ + b x: rays are circles, and the time between two points has a closed form."""
    x = np.arange(48.0)
    v = 0.2 + 0.015 * x
    prices = np.broadcast_to((1 / v)[:, None, None], (48, 48, 12)).copy()
    assert prices.min() >= 1
    start, goal = np.array([6.3, 5.8, 6.2]), np.array([8.1, 40.6, 5.7])
    time = np.arccosh(1 + (0.015 * np.linalg.norm(goal - start)) ** 2 / (2 * np.prod(np.interp([6.3, 8.1], x, v))))
    walls = walls_of(np.zeros(prices.shape, bool))
    straight = safety.cost(np.stack([start, goal]), prices)
    assert safety.marched(walls, start, goal, prices, straight) == pytest.approx(time / 0.015, rel=0.01)
    way = safety.cheapest(walls, start, goal, prices)
    assert time / 0.015 < way < 1.1 * time / 0.015
    assert straight > time / 0.015
    line = np.array([[3.0, 7, 7], [40.0, 7, 7]])
    assert safety.cost(line, prices) == pytest.approx(np.log(0.8 / 0.245) / 0.015, rel=1e-3)
