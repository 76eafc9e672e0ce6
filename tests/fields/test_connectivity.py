"""The flood fill equals SciPy's labelling, whatever the shape does to the packing of words."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import component_of, grid_graph, serpentine
from scipy.sparse.csgraph import dijkstra

from maxjax.fields.connectivity import extent, flood

fill = jax.jit(flood)


@pytest.mark.parametrize(
    "shape", [(9, 8, 31), (9, 8, 32), (8, 9, 33), (5, 6, 64), (4, 5, 101), (1, 7, 40), (20, 1, 1), (1, 1, 1)]
)
def test_equals_label(shape: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(sum(shape))
    for density in (0.0, 0.3, 0.55, 0.69):
        free = rng.random(shape) >= density
        for seed in rng.integers(0, shape, (4, 3)):
            given = fill(free, jnp.asarray(seed, jnp.int32))
            np.testing.assert_array_equal(given, component_of(free, tuple(seed)))


def test_follows_a_long_corridor_to_its_end() -> None:
    blocked = serpentine(23, 24, 2)
    assert fill(jnp.asarray(~blocked), jnp.asarray([0, 0, 0], jnp.int32)).sum() == (~blocked).sum()
    blocked[11, :, :] = True
    expected = component_of(~blocked, (22, 5, 1))
    np.testing.assert_array_equal(fill(jnp.asarray(~blocked), jnp.asarray([22, 5, 1], jnp.int32)), expected)


def test_bits_do_not_leak_between_rows_or_words() -> None:
    """A column that ends at the top of one row is no neighbour of the bottom of the next."""
    free = np.zeros((2, 2, 64), bool)
    free[0, 0, 40:] = True
    free[0, 1, :20] = free[1, 0, :32] = True
    np.testing.assert_array_equal(
        fill(jnp.asarray(free), jnp.asarray([0, 0, 63], jnp.int32)), component_of(free, (0, 0, 63))
    )


@pytest.mark.parametrize("seed", [(-1, 0, 0), (0, 8, 0), (0, 0, 31), (99, -99, 5), (2, 3, 4)])
def test_seeds_outside_or_occupied_fill_nothing(seed: tuple[int, int, int]) -> None:
    free = jnp.ones((9, 8, 31), bool).at[2, 3, 4].set(False)
    assert not fill(free, jnp.asarray(seed, jnp.int32)).any()


def test_vmap_equals_a_loop() -> None:
    rng = np.random.default_rng(5)
    free = jnp.asarray(rng.random((5, 9, 8, 31)) < 0.5)
    seeds = jnp.asarray(rng.integers(0, (9, 8, 31), (5, 3)), jnp.int32)
    batch = jax.vmap(flood)(free, seeds)
    np.testing.assert_array_equal(batch, jnp.stack([fill(f, s) for f, s in zip(free, seeds, strict=True)]))


@pytest.mark.parametrize("density", [0.0, 0.2, 0.4])
def test_extent_is_about_the_farthest_distance(density: float) -> None:
    """Beside the shortest 26-neighbour path: shorter on space diagonals, longer by the rounding to a multiple of 8."""
    rng = np.random.default_rng(6)
    shape = (24, 20, 33)
    free = rng.random(shape) >= density
    seed = tuple(np.argwhere(free)[0])
    distance = dijkstra(grid_graph(~free), indices=np.ravel_multi_index(seed, shape))
    farthest = distance[np.isfinite(distance)].max()
    component = component_of(free, seed)
    given = int(jax.jit(extent)(jnp.asarray(component), jnp.asarray(seed, jnp.int32)))
    assert given % 8 == 0
    assert 0.6 * farthest <= given <= 1.1 * farthest + 16


def test_extent_of_a_long_corridor_is_its_length() -> None:
    blocked = serpentine(23, 24, 1)
    given = int(jax.jit(extent)(jnp.asarray(~blocked), jnp.asarray([0, 0, 0], jnp.int32)))
    assert 0.6 * (~blocked).sum() <= given <= (~blocked).sum() + 16
