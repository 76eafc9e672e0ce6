"""The hard set against brute force: distances from points to all cubes, and voxels seen free."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from maxjax.sim.movers.hard_set import gaps, hard_set, seen_free


def test_gaps_are_distances_to_cubes_as_far_as_a_voxel_reaches_and_bounds_as_far_as_two() -> None:
    rng = np.random.default_rng(0)
    shape, spacing, origin = (7, 8, 6), 2.0, np.array([-3.0, 5.0, 1.0])
    blocked, seen = rng.random(shape) < 0.15, rng.random(shape) < 0.5
    hard = hard_set(jnp.asarray(blocked), jnp.asarray(seen), jnp.asarray(origin, jnp.float32), spacing)
    low, high = origin - 0.5 * spacing, origin + spacing * (np.array(shape) - 0.5)
    points = rng.uniform(low, high, (500, 3))
    centres = origin + spacing * np.argwhere(blocked)
    outside = np.maximum(np.abs(points[:, None] - centres) - 0.5 * spacing, 0.0)
    apart = np.linalg.norm(outside, axis=-1).min(axis=1)
    found = np.asarray(gaps(hard, jnp.asarray(points, jnp.float32)), float)
    near = apart <= spacing
    assert near.any()
    np.testing.assert_allclose(found[near], apart[near], atol=1e-4)
    assert (found <= np.minimum(apart, 2.0 * spacing) + 1e-4).all()
    assert (found[~near] >= spacing - 1e-4).all()
    # Along an axis from a face it is the distance itself.
    alone = hard_set(jnp.zeros((7, 1, 1), bool).at[0].set(True), jnp.ones((7, 1, 1), bool), jnp.zeros(3), spacing)
    away = jnp.stack([jnp.linspace(1.0, 7.0, 13), jnp.zeros(13), jnp.zeros(13)], axis=1)
    np.testing.assert_allclose(gaps(alone, away), np.minimum(np.asarray(away)[:, 0] - 1.0, 4.0), atol=1e-5)
    index = np.floor((points - origin) / spacing + 0.5).astype(int)
    assert (np.asarray(seen_free(hard, jnp.asarray(points, jnp.float32))) == seen[tuple(index.T)]).all()


def test_outside_the_box_nothing_is_known() -> None:
    every = jnp.ones((3, 3, 3), bool)
    hard = hard_set(~every, every, jnp.zeros(3), 1.0)
    beyond = jnp.array([[3.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [jnp.nan, 1.0, 1.0]])
    assert seen_free(hard, beyond).tolist() == [False, False, True, False]
    assert gaps(hard, beyond)[:3].tolist() == [2.0, 2.0, 2.0]
