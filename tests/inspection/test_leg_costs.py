"""Costs between places: straight ones by hand, those around a wall by SciPy's Dijkstra on the lattice."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

import maxjax
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.leg_costs import TimeCost, costs_between, straight_legs
from maxjax.trajectories.limits import FlightLimits
from tests.references import grid_graph

LIMITS = FlightLimits(speed=5.0, acceleration=2.0, ascent=2.0, descent=1.0)


def length(starts: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Metres as cost."""
    return np.linalg.norm(np.asarray(goals) - starts, axis=1)


def wall(gap: bool = True) -> maxjax.VoxelMap:
    """A wall across the map, with a gap at one end or none."""
    occupied = np.zeros((40, 30, 16), bool)
    occupied[19:21] = True
    occupied[19:21, 24:, :] = not gap
    return maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("way", "seconds"),
    [
        ((50.0, 0.0, 0.0), 10.0 + 2.5),
        ((0.0, 0.0, 40.0), 20.0 + 2.5),
        ((0.0, 0.0, -40.0), 40.0 + 2.5),
        ((50.0, 0.0, 4.0), 10.0 + 2.5),
        ((2.0, 0.0, 0.0), 0.4 + 2.0),
        ((0.0, 0.0, 0.0), 0.0),
    ],
)
def test_seconds_of_straight_legs(way: tuple[float, float, float], seconds: float) -> None:
    """Speeds level and upright, and what starting and braking add; a short leg never reaches the speed."""
    cost = TimeCost(LIMITS, stay=3.0)
    assert cost(np.zeros((1, 3)), np.array([way]))[0] == pytest.approx(seconds + 3.0)


def test_legs_are_straight_where_the_verifier_allows_it() -> None:
    """Pairs of random places: what is free keeps the radius; what the verifier finds closed is not free."""
    where, rng = wall(), np.random.default_rng(0)
    free = FreeSpace.of(where, 1.5)
    places = rng.uniform((1.0, 1.0, 1.0), (38.0, 28.0, 14.0), (60, 3))
    places = places[free.holds(places)]
    first, second = np.triu_indices(len(places), 1)
    straight = straight_legs(places, first, second, free)
    assert 0.2 < straight.mean() < 0.9
    for k in np.random.default_rng(1).choice(len(first), 120, replace=False):
        found = maxjax.verify(places[[first[k], second[k]]], where, radius=1.5)
        assert found.ok or not straight[k]


@pytest.mark.parametrize("count", [2, 40])
def test_ways_around_a_wall(count: int) -> None:
    """Over other places, or by a flood where two places are alone: near the shortest way on the lattice of 26."""
    where, rng = wall(), np.random.default_rng(2)
    free = FreeSpace.of(where, 1.0)
    index = np.argwhere(free.free)
    sides = [index[index[:, 0] < 15], index[index[:, 0] > 25]]
    chosen = np.concatenate([side[rng.choice(len(side), count // 2, replace=False)] for side in sides])
    costs = costs_between(chosen.astype(float), free, length)
    np.testing.assert_allclose(costs, costs.T)
    nodes = np.ravel_multi_index(tuple(chosen.T), free.free.shape)
    shortest = dijkstra(grid_graph(~free.free), indices=nodes)[:, nodes]
    across = (slice(None, count // 2), slice(count // 2, None))
    # The lattice's own ways are up to 1.13 times the straight ones; those over other places may be detours.
    ratio = costs[across] / shortest[across]
    assert ratio.min() > 0.85
    assert ratio.mean() < 1.25


def test_places_that_no_way_joins() -> None:
    """Behind a wall without a gap the cost is infinite."""
    free = FreeSpace.of(wall(gap=True), 1.0)
    closed = FreeSpace(free.free & (np.arange(40) != 30)[:, None, None], free.open, free.grid, 1.0)
    places = np.array([[5.0, 5.0, 8.0], [25.0, 5.0, 8.0], [35.0, 5.0, 8.0]])
    costs = costs_between(places, closed, length)
    assert math.isfinite(costs[0, 1])
    assert costs[0, 2] == math.inf
