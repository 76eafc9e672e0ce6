"""Distances to voxel cubes: those to the nearest of all cubes, one by one."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.fields.distance import cube_distance, metres

SHAPE = (9, 13, 7)


def quarters_by_brute_force(occupied: np.ndarray) -> np.ndarray:
    centres, cubes = np.argwhere(np.ones(SHAPE)), np.argwhere(occupied)
    gap = np.maximum(np.abs(centres[:, None] - cubes[None]) - 0.5, 0)
    return np.min(4 * (gap**2).sum(axis=-1), axis=1, initial=np.inf).reshape(SHAPE)


@pytest.mark.parametrize(
    ("reach", "dtype"), [(0.0, "uint8"), (0.5, "uint8"), (2.5, "uint8"), (4.0, "uint8"), (9.0, "uint16")]
)
def test_is_that_to_the_nearest_cube_up_to_the_reach(reach: float, dtype: str) -> None:
    rng = np.random.default_rng(0)
    maps = np.stack([rng.random(SHAPE) < density for density in (0.0, 0.003, 0.01, 0.1)])
    found = jax.jit(jax.vmap(cube_distance, (0, None)), static_argnums=1)(jnp.asarray(maps), reach)
    assert found.dtype == dtype
    for quarters, occupied in zip(np.asarray(found), maps, strict=True):
        expected = quarters_by_brute_force(occupied)
        np.testing.assert_array_equal(quarters, np.minimum(expected, int(4 * reach**2) + 1))
        near = expected <= 4 * reach**2
        np.testing.assert_allclose(
            np.asarray(metres(jnp.asarray(quarters), 2.0))[near], np.sqrt(expected[near]), rtol=1e-6
        )


def test_a_reach_beyond_the_map_is_exact_everywhere() -> None:
    occupied = np.zeros(SHAPE, bool)
    occupied[0, 0, 0] = True
    np.testing.assert_array_equal(cube_distance(jnp.asarray(occupied), 200.0), quarters_by_brute_force(occupied))
