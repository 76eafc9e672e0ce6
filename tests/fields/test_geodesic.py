"""Distance by floods: its component, its steps, and what they cost, against a flood voxel by voxel."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from maxjax.fields.geodesic import geodesic
from tests.references import component_of, serpentine

measure = jax.jit(geodesic)


def _touched(reached: np.ndarray, cheap: np.ndarray, cube: bool) -> np.ndarray:
    """Neighbours of a set; those of the cube along z, then y, then x, by way of voxels of toll 1."""
    if not cube:
        return ndimage.binary_dilation(reached)
    found = reached.copy()
    for axis in (2, 1, 0):
        line = np.zeros((3, 3, 3), bool)
        line[tuple(slice(None) if k == axis else 1 for k in range(3))] = True
        found |= ndimage.binary_dilation(reached | (found & cheap), line)
    return found


def test_tolls_equal_a_flood_voxel_by_voxel_and_leave_no_voxel_without_a_nearer_one() -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        shape = (34, 9, 7)
        toll = np.where(rng.random(shape) < 0.3, 0, rng.integers(1, 5, shape))
        free, start = toll > 0, tuple(np.argwhere(toll > 0)[rng.integers((toll > 0).sum())])
        steps = np.where(free, 10**6, 0)
        steps[start] = 0
        arrives: dict[int, np.ndarray] = {}
        reached = np.zeros(shape, bool)
        reached[start] = True
        for k in itertools.count(1):
            touched = _touched(reached, toll == 1, cube=k % 3 == 0)
            for price in range(1, 5):
                arrives[k + price - 1] = arrives.get(k + price - 1, np.zeros(shape, bool)) | (touched & (toll == price))
            new = arrives.pop(k) & ~reached
            steps[new], reached = k, reached | new
            if not new.any() and not any((late & ~reached).any() for late in arrives.values()):
                break
        component, found = measure(jnp.asarray(free), jnp.asarray(start, jnp.int32), jnp.asarray(toll, jnp.float32))
        np.testing.assert_array_equal(component, component_of(free, start))
        np.testing.assert_array_equal(found, np.where(component, steps, 0))


def test_prices_are_rounded_and_cut_off_and_one_is_none() -> None:
    free, start = jnp.ones((40, 3, 3), bool), jnp.zeros(3, jnp.int32)
    ones = jnp.ones(free.shape)
    np.testing.assert_array_equal(measure(free, start, ones)[1], measure(free, start)[1])
    for price, toll in ((2.4, 2), (2.6, 3), (90.0, 4)):
        np.testing.assert_array_equal(measure(free, start, price * ones)[1][:, 0, 0], toll * np.arange(40))


@pytest.mark.parametrize("density", [0.0, 0.3, 0.55])
def test_finds_the_component_and_counts_its_steps(density: float) -> None:
    """Between the fewest 26-neighbour moves and the fewest 6-neighbour moves; Euclid's distance in free space."""
    rng = np.random.default_rng(6)
    shape = (24, 20, 33)
    free = rng.random(shape) >= density
    seed = tuple(np.argwhere(free)[len(free)])
    component, steps = (np.asarray(a) for a in measure(jnp.asarray(free), jnp.asarray(seed, jnp.int32)))
    np.testing.assert_array_equal(component, component_of(free, seed))
    assert (steps[~component] == 0).all()
    assert steps[seed] == 0
    assert (steps[component] > 0).sum() == component.sum() - 1
    faces = np.full(shape, -1)
    reached, count = np.zeros(shape, bool), 0
    reached[seed] = True
    while (faces[component] < 0).any():
        faces[reached & (faces < 0)] = count
        reached, count = ndimage.binary_dilation(reached) & free, count + 1
    assert (steps <= faces)[component].all()
    straight = np.linalg.norm(np.argwhere(component) - np.array(seed), axis=1)
    assert (steps[component] >= 0.9 * straight - 1).all()
    if density == 0:
        assert (steps[component] <= straight / 0.94 + 2).all()


def test_does_not_squeeze_through_corners() -> None:
    free = np.zeros((8, 8, 8), bool)
    free[:4, :4, :4] = free[4:, 4:, 4:] = True
    component, steps = measure(jnp.asarray(free), jnp.asarray([3, 3, 3], jnp.int32))
    assert component.sum() == 64
    assert int(steps.max()) <= 9


@pytest.mark.parametrize("turns", [23, 60])
def test_along_a_corridor_is_its_length(turns: int) -> None:
    blocked = serpentine(turns, turns + 1, 1)
    _, steps = measure(jnp.asarray(~blocked), jnp.asarray([0, 0, 0], jnp.int32))
    assert 0.75 * (~blocked).sum() <= int(steps.max()) <= (~blocked).sum()


def test_from_outside_or_an_obstacle_reaches_nothing() -> None:
    free = jnp.ones((9, 8, 31), bool).at[2, 3, 4].set(False)
    for seed in ((-1, 0, 0), (0, 0, 31), (2, 3, 4)):
        component, steps = measure(free, jnp.asarray(seed, jnp.int32))
        assert not component.any()
        assert not steps.any()


@pytest.mark.large
def test_under_vmap_equals_a_loop() -> None:
    """Also for a map that is counted through long before another, one map with several seeds, and a vmap of vmaps."""
    rng = np.random.default_rng(8)
    maze = ~serpentine(23, 24, 1)
    free = jnp.asarray(np.stack([maze, np.ones_like(maze), rng.random(maze.shape) < 0.7, np.zeros_like(maze)]))
    seeds = jnp.asarray([[0, 0, 0], [22, 23, 0], [11, 12, 0], [3, 4, 0]], jnp.int32)

    def check(batch: tuple[jax.Array, jax.Array], free: jax.Array, seeds: jax.Array) -> None:
        for index, (f, s) in enumerate(zip(free, seeds, strict=True)):
            for one, many in zip(measure(f, s), batch, strict=True):
                np.testing.assert_array_equal(one, many[index])

    check(jax.vmap(geodesic)(free, seeds), free, seeds)
    check(jax.vmap(geodesic, in_axes=(None, 0))(free[0], seeds), jnp.stack([free[0]] * 4), seeds)
    check(jax.vmap(geodesic, in_axes=(0, None))(free, seeds[0]), free, jnp.stack([seeds[0]] * 4))
    nested = jax.vmap(jax.vmap(geodesic))(free.reshape(2, 2, *maze.shape), seeds.reshape(2, 2, 3))
    check(jax.tree.map(lambda x: x.reshape(4, *maze.shape), nested), free, seeds)
