"""Cost-to-go of a window against SciPy's Dijkstra, and what a crowd costs against brute force."""

from __future__ import annotations

import dataclasses
import itertools
import math

import jax.numpy as jnp
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from maxjax.sim.movers.local_value import Crowding, cost_to_go, crowding, local_value
from maxjax.sim.movers.reachable_sets import no_tracks


def test_costs_are_those_of_dijkstra() -> None:
    rng = np.random.default_rng(0)
    shape, spacing = (7, 6, 5), 2.0
    free, price = rng.random(shape) < 0.8, rng.uniform(1.0, 5.0, shape)
    ends = np.where(rng.random(shape) < 0.1, rng.uniform(0.0, 10.0, shape), np.inf)
    rows, columns, costs = [], [], []
    for cell in map(tuple, np.argwhere(free)):
        for offset in itertools.product((-1, 0, 1), repeat=3):
            other = tuple(np.add(cell, offset))
            if any(offset) and all(0 <= x < n for x, n in zip(other, shape, strict=True)) and free[other]:
                rows.append(np.ravel_multi_index(cell, shape))
                columns.append(np.ravel_multi_index(other, shape))
                costs.append(0.5 * (price[cell] + price[other]) * spacing * np.linalg.norm(offset))
    # One more vertex stands for the end; its edges are what a way costs that ends there.
    last = np.prod(shape)
    for cell in map(tuple, np.argwhere(free & np.isfinite(ends))):
        rows.append(last)
        columns.append(np.ravel_multi_index(cell, shape))
        costs.append(ends[cell])
    graph = coo_matrix((costs, (rows, columns)), (last + 1, last + 1)).tocsr()
    expected = dijkstra(graph, indices=last)[:-1].reshape(shape)
    goal = jnp.full(3, 1e3)
    window = jnp.zeros(3), spacing
    found = local_value(jnp.asarray(free), window, (jnp.asarray(ends), goal), jnp.asarray(price), 40)
    reached = free & np.isfinite(expected)
    assert reached.sum() > 100
    np.testing.assert_allclose(np.asarray(found.value)[reached], expected[reached], rtol=1e-5)
    assert (np.asarray(found.value)[~reached] > 1e3).all()
    # At a voxel's centre its own value, half way between two their mean.
    cell = next(c for c in map(tuple, np.argwhere(reached)) if c[0] + 1 < shape[0] and reached[c[0] + 1, c[1], c[2]])
    mean = 0.5 * (expected[cell] + expected[cell[0] + 1, cell[1], cell[2]])
    between = jnp.asarray(
        [np.multiply(cell, spacing), np.multiply(cell, spacing) + np.array([1.0, 0.0, 0.0])], jnp.float32
    )
    np.testing.assert_allclose(cost_to_go(found, between), [expected[cell], mean], rtol=1e-3)
    # Beside the goal voxels are too coarse: the distance itself, least at the goal.
    beside = dataclasses.replace(found, end=between[0] + 0.3)
    np.testing.assert_allclose(cost_to_go(beside, between[:1]), [0.3 * math.sqrt(3.0)], rtol=1e-5)
    np.testing.assert_allclose(cost_to_go(beside, beside.end[None]), [0.0], atol=1e-6)


def test_a_metre_costs_more_where_a_mover_will_be_when_the_vehicle_can_be_there() -> None:
    crowd = Crowding(price=8.0, reach=2.0, earlier=0.0, later=0.0)
    tracks = dataclasses.replace(
        no_tracks(2),
        used=jnp.array([True, False]),
        place=jnp.array([[20.0, 10.0, 0.0], [0.0, 0.0, 0.0]]),
        velocity=jnp.array([[0.0, -5.0, 0.0], [0.0, 0.0, 0.0]]),
        half=jnp.full((2, 3), 0.5),
    )
    here = jnp.zeros(3)
    asked = jnp.array([[10.0, 0.0, 0.0], [20.0, 10.0, 0.0], [20.0, 0.0, 0.0], [20.0, 1.0, 0.0]])
    # At 10 m/s the vehicle is at (20, 0, 0) after two seconds, as the mover is; at its present place it is gone.
    given = np.asarray(crowding(asked, here, 10.0, tracks, jnp.zeros(1), crowd))
    np.testing.assert_allclose(given[[0, 2]], [1.0, 9.0], atol=1e-4)
    assert given[1] == 1.0
    # A metre beside it, a moment later: the distance from the box, priced by the law.
    gap = max(abs(1.0 - (10.0 - 5.0 * np.hypot(20.0, 1.0) / 10.0)) - 0.5, 0.0)
    np.testing.assert_allclose(given[3], 1.0 + 8.0 * (1.0 - gap / 2.0) ** 2, rtol=1e-4)
    assert 1.0 < given[3] < 9.0


def test_what_motions_keep_of_a_mover_costs_too() -> None:
    """At rest, 6 m of it are kept, of another one nothing: the share that a place is within, of the nearer one."""
    used = jnp.ones(2, bool)
    place = jnp.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    tracks = dataclasses.replace(no_tracks(2), used=used, place=place, half=jnp.full((2, 3), 0.5))
    crowd = Crowding(price=8.0, reach=1.0, keeping=3.0)
    asked = jnp.array([[0.0, 0.0, 0.0], [0.0, 3.5, 0.0], [0.0, -2.0, 0.5], [7.0, 0.0, 0.0], [18.0, 0.0, 0.0]])
    given = np.asarray(crowding(asked, jnp.array([0.0, 0.0, 50.0]), 5.0, tracks, jnp.array([6.0, 0.0]), crowd))
    np.testing.assert_allclose(given, [1.0 + 8.0 + 3.0, 1.0 + 3.0 * 0.5, 1.0 + 3.0 * 0.75, 1.0, 1.0], rtol=1e-5)


def test_an_empty_sky_costs_what_it_measures() -> None:
    asked = jnp.asarray(np.random.default_rng(1).normal(size=(50, 3)), jnp.float32)
    assert (crowding(asked, jnp.zeros(3), 5.0, no_tracks(4), jnp.zeros(4), Crowding()) == 1.0).all()
