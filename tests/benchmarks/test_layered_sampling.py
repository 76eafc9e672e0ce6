"""Paths through random layers: as short as SciPy's shortest paths over the same graphs."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse.csgraph import dijkstra

from benchmarks.common.layered_sampling import layered_paths
from maxjax.core.grid import Grid

GRID = Grid.centered((0.0, 0.0, 0.0), (21, 21, 21), 1.0)
ENDS = np.array([[-8.0, 0.0, 0.0], [8.0, 0.0, 0.0]], np.float32)
LAYERS, POINTS, CHECKS = 2, 12, 40


def shortest(blocked: np.ndarray, key: jax.Array) -> float:
    """The least length over all ways through the layers of a key [m]; infinite where there is none."""
    drawn = jax.random.uniform(key, (LAYERS, POINTS, 3), minval=jnp.array(GRID.lower), maxval=jnp.array(GRID.upper))
    places = np.concatenate([ENDS[:1], np.asarray(drawn).reshape(-1, 3), ENDS[1:]])
    level = np.repeat([0, 1, 2, 3], [1, POINTS, POINTS, 1])
    graph = np.zeros((len(places), len(places)))
    for i, j in np.argwhere(level[None] == level[:, None] + 1):
        on = places[i] + np.linspace(0, 1, CHECKS, dtype=np.float32)[:, None] * (places[j] - places[i])
        at = np.floor((on - np.array(GRID.origin)) / GRID.spacing + 0.5).astype(int)
        if not blocked[tuple(at.T)].any():
            graph[i, j] = np.linalg.norm(places[j] - places[i])
    return float(dijkstra(graph)[0, -1])


def test_paths_are_the_shortest_through_their_layers() -> None:
    blocked = np.zeros(GRID.shape, bool)
    blocked[10, 4:, 6:] = True
    keys = jax.random.split(jax.random.key(0), 20)
    sizes = LAYERS, POINTS, CHECKS
    paths = np.asarray(layered_paths(jnp.asarray(blocked), jnp.asarray(ENDS), keys, GRID, sizes))
    lengths = np.linalg.norm(np.diff(paths, axis=1), axis=2).sum(axis=1)
    expected = np.array([shortest(blocked, key) for key in keys])
    assert np.isfinite(expected).sum() >= 10
    np.testing.assert_allclose(np.where(np.isnan(lengths), np.inf, lengths), expected, rtol=1e-5)
    some = paths[np.isfinite(lengths)]
    np.testing.assert_array_equal(some[:, [0, -1]], np.broadcast_to(ENDS, (len(some), 2, 3)))


def test_a_closed_wall_lets_nothing_through() -> None:
    blocked = np.zeros(GRID.shape, bool)
    blocked[8:12] = True
    paths = layered_paths(jnp.asarray(blocked), jnp.asarray(ENDS), jax.random.split(jax.random.key(1), 5), GRID)
    assert np.isnan(np.asarray(paths)).all()
