"""Clusters: against union-find in NumPy, across the seam, and what is left out is said."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from maxjax.sim.movers.clusters import Signs, cluster_returns, gather_rays
from maxjax.sim.sensors.lidar import directions
from tests.sim.movers.scenes import LIDAR, SIGHT

RAYS = np.asarray(directions(LIDAR), float)
jit_clustered = jax.jit(cluster_returns)


def drawn(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A range image with blobs that move, and the blob pixels."""
    distance = np.full((32, 256), np.inf)
    for _ in range(7):
        row, column, reach = rng.integers(3, 29), rng.integers(-60, 60), rng.uniform(4.0, 12.0)
        for i in range(-2, 3):
            for j in range(-3, 4):
                if rng.uniform() < 0.7:
                    distance[row + i, (column + j) % 256] = reach + 0.05 * rng.normal()
    return distance.reshape(-1), np.isfinite(distance.reshape(-1))


def twin(distance: np.ndarray, chosen: np.ndarray) -> list[frozenset[int]]:
    """Components of all pairs, by the rule in the module, in float64."""
    rays = np.flatnonzero(chosen)
    row, column = rays // 256, rays % 256
    across = np.abs(column[:, None] - column)
    close = (np.abs(row[:, None] - row) <= 2) & (np.minimum(across, 256 - across) <= 3)
    points = distance[rays, None] * RAYS[rays]
    gap = 0.2 + 0.65 * np.deg2rad(60.0 / 31) * (distance[rays, None] + distance[rays])
    close &= np.linalg.norm(points[:, None] - points, axis=2) <= gap
    _, label = connected_components(coo_matrix(close))
    return [frozenset(rays[label == k].tolist()) for k in np.unique(label)]


def test_components_are_those_of_all_pairs() -> None:
    rng = np.random.default_rng(0)
    seam = 0
    for _ in range(12):
        distance, chosen = drawn(rng)
        points = np.where(chosen[:, None], distance[:, None], 0.0) * RAYS
        signs = Signs(jnp.asarray(chosen), jnp.zeros(LIDAR.rays, bool), jnp.asarray(chosen))
        found = jit_clustered(jnp.asarray(points, jnp.float32), jnp.asarray(distance, jnp.float32), signs, SIGHT)
        ray, cluster = np.asarray(found.ray), np.asarray(found.cluster)
        given = {frozenset(ray[cluster == k].tolist()) for k in range(8) if found.used[k]}
        expected = [c for c in twin(distance, chosen) if len(c) >= 2]
        nearest = sorted(expected, key=lambda c: min(distance[list(c)]))[:8]
        assert given == set(nearest)
        assert bool(found.overflow) == (len(expected) > 8)
        seam += any({0, 255} <= {r % 256 for r in c} for c in given)
    assert seam


def test_the_nearest_returns_are_gathered_and_more_are_flagged() -> None:
    rng = np.random.default_rng(1)
    distance, chosen = rng.uniform(1.0, 40.0, 8192), rng.uniform(size=8192) < 0.1
    ray, there, many = gather_rays(jnp.asarray(distance, jnp.float32), jnp.asarray(chosen), 1024)
    assert not many
    assert set(np.asarray(ray)[np.asarray(there)].tolist()) == set(np.flatnonzero(chosen).tolist())
    ray, there, many = gather_rays(jnp.asarray(distance, jnp.float32), jnp.asarray(chosen), 100)
    assert many
    kept = np.asarray(ray)[np.asarray(there)]
    order = np.flatnonzero(chosen)[np.argsort(distance[chosen])]
    assert 95 <= len(kept) <= 100
    assert set(kept.tolist()) == set(order[: len(kept)].tolist())


def test_a_body_in_the_air_is_taken_whole_and_a_wall_is_not() -> None:
    """Two moving pixels of a small body: all its returns are its cluster's. Of a wall six, and two are too few."""
    distance = np.full((32, 256), 20.0)
    distance[14:18, 100:105] = 8.0
    sight = dataclasses.replace(SIGHT, points=2048)
    for wall, pair, expected in ((False, 2, 20), (True, 2, 0), (True, 6, 6)):
        image = distance.copy()
        if wall:
            image[10:22, 80:125] = 8.0
        moves = np.zeros((32, 256), bool)
        moves[15, 97 : 97 + pair] = True
        if not wall:
            moves = np.roll(moves, 4, axis=1)
        points = jnp.asarray(image.reshape(-1, 1) * RAYS, jnp.float32)
        around = jnp.asarray((np.abs(image - 8.0) < 1.0).reshape(-1))
        signs = Signs(jnp.asarray(moves.reshape(-1)), jnp.zeros(8192, bool), around)
        found = jit_clustered(points, jnp.asarray(image.reshape(-1), jnp.float32), signs, sight)
        assert int(found.used.sum()) == (expected > 0)
        assert int(found.count[0]) == expected
