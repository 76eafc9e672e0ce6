"""The flood fill equals SciPy's labelling, whatever the shape does to the packing of words."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Bool, Int32

from maxjax.fields.connectivity import first_joined, flood
from tests.references import component_of, serpentine

fill = jax.jit(flood)


@jax.jit
def first_of(
    maps: Bool[Array, "m nx ny nz"], first: Int32[Array, ""], a: Int32[Array, " 3"], b: Int32[Array, " 3"]
) -> tuple[Int32[Array, ""], Bool[Array, ""]]:
    return first_joined(lambda k: maps[k], first, len(maps) - 1, a, b)


def reach(free: Array, a: Array, b: Array) -> bool:
    return bool(first_of(free[None], jnp.int32(0), a, b)[1])


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
            for other in rng.integers(-1, np.add(shape, 1), (4, 3)):
                inside = np.all((other >= 0) & (other < shape))
                meets = reach(jnp.asarray(free), jnp.asarray(seed, jnp.int32), jnp.asarray(other, jnp.int32))
                assert meets == (inside and bool(given[tuple(other)]))


def test_follows_a_long_corridor_to_its_end() -> None:
    blocked = serpentine(23, 24, 2)
    assert fill(jnp.asarray(~blocked), jnp.asarray([0, 0, 0], jnp.int32)).sum() == (~blocked).sum()
    assert reach(jnp.asarray(~blocked), jnp.asarray([0, 0, 0], jnp.int32), jnp.asarray([22, 5, 1], jnp.int32))
    blocked[11, :, :] = True
    expected = component_of(~blocked, (22, 5, 1))
    np.testing.assert_array_equal(fill(jnp.asarray(~blocked), jnp.asarray([22, 5, 1], jnp.int32)), expected)


def test_the_first_map_that_joins_two_voxels_is_found() -> None:
    """Also where several have to be filled first, where the first ones are passed over, and where none does."""
    rng = np.random.default_rng(7)
    shape, runs = (34, 9, 11), jax.vmap(first_of, in_axes=(None, None, 0, 0))
    values, found = rng.random(shape), set()
    maps = np.stack([values < density for density in (0.4, 0.45, 0.6, 0.75, 0.9)])
    a, b = rng.integers(-1, np.add(shape, 1), (2, 60, 3)).astype(np.int32)
    for first in (0, 2):
        given = [np.asarray(x) for x in runs(maps, jnp.int32(first), a, b)]
        for k, meets, start, end in zip(*given, a, b, strict=True):
            inside = all(((x >= 0) & (x < shape)).all() for x in (start, end))
            joins = [inside and component_of(free, tuple(start))[tuple(end)] for free in maps[first:]]
            assert bool(meets) == any(joins)
            assert int(k) == (first + joins.index(True) if any(joins) else len(maps) - 1)
            found.add((int(k), bool(meets)))
    assert len(found) == 6


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


def test_a_flood_that_is_not_over_is_not_given_up_for_the_next_map() -> None:
    """A way of some three hundred steps, of which a look at the result takes 32, and then a map without walls."""
    blocked = serpentine(25, 25, 1)
    maps = jnp.asarray(np.stack([~blocked, np.ones_like(blocked)]))
    a, b = jnp.array([0, 0, 0]), jnp.array([24, 20, 0])
    k, joined = first_of(maps, jnp.int32(0), a, b)
    assert joined
    assert k == 0
