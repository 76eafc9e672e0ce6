"""A map is a value: checked when it is made, a pytree, one or a batch, with what paths enter and keep off."""

from __future__ import annotations

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, VoxelMap
from maxjax.core.status import Closure
from maxjax.core.voxel_map import check_map

GRID = Grid((4, 5, 6), 2.0, (1.0, -2.0, 3.0))
RNG = np.random.default_rng(0)
OCCUPIED = RNG.random(GRID.shape) < 0.4
GROUND = np.zeros(GRID.shape, bool)
GROUND[:, :, 0] = True


def test_ground_is_occupied_and_no_ground_is_none() -> None:
    found = VoxelMap.of(OCCUPIED, spacing=2.0, origin=(1.0, -2.0, 3.0), ground=GROUND)
    assert found.grid == GRID
    assert found.batch is None
    np.testing.assert_array_equal(found.occupied, OCCUPIED | GROUND)
    np.testing.assert_array_equal(found.barred, found.occupied)
    np.testing.assert_array_equal(found.kept_off, GROUND)
    assert not np.any(VoxelMap.on(GRID, OCCUPIED).ground)
    assert not np.any(found.shut)


def test_what_is_closed_is_barred_and_kept_off_where_nothing_stands() -> None:
    reasons = RNG.integers(0, 3, GRID.shape).astype(np.uint8)
    found = VoxelMap.on(GRID, OCCUPIED, GROUND).closing(reasons)
    held = OCCUPIED | GROUND
    np.testing.assert_array_equal(found.shut, (reasons > 0) & ~held)
    np.testing.assert_array_equal(found.barred, held | (reasons > 0))
    np.testing.assert_array_equal(found.kept_off, GROUND | ((reasons > 0) & ~held))
    np.testing.assert_array_equal(found.occupied, held)
    index = tuple(np.argwhere(np.asarray(found.shut))[0].tolist())
    assert found.closure_of(index) == Closure(int(reasons[index]))
    assert found.closure_of((9, 0, 0)) is Closure.OPEN


def test_a_batch_is_several_maps_and_may_share_its_ground() -> None:
    maps = RNG.random((3, *GRID.shape)) < 0.3
    found = VoxelMap.on(GRID, maps, GROUND)
    assert found.batch == 3
    for k in (0, 2, -1):
        np.testing.assert_array_equal(found[k].occupied, maps[k] | GROUND)
        np.testing.assert_array_equal(found[k].ground, GROUND)
    for k in (3, -4):
        with pytest.raises(IndexError, match="expected one of 3 maps"):
            found[k]
    with pytest.raises(IndexError):
        VoxelMap.on(GRID, OCCUPIED)[0]


def test_it_passes_through_jit_and_vmap_with_a_static_grid() -> None:
    def counted(where: VoxelMap) -> jax.Array:
        assert where.grid == GRID
        return jnp.sum(where.barred) + 1000 * jnp.sum(where.kept_off)

    maps = RNG.random((3, *GRID.shape)) < 0.3
    several = VoxelMap.on(GRID, maps, np.stack([GROUND] * 3))
    alone = [int(counted(several[k])) for k in range(3)]
    assert jax.vmap(counted)(several).tolist() == alone
    assert int(jax.jit(counted)(several[1])) == alone[1]
    made = jax.jit(lambda occupied: VoxelMap.on(GRID, occupied, jnp.asarray(GROUND)))(jnp.asarray(OCCUPIED))
    np.testing.assert_array_equal(np.asarray(made.occupied), OCCUPIED | GROUND)


@pytest.mark.parametrize(
    ("occupied", "ground", "message"),
    [
        (None, None, "occupied: expected dtype bool, given object"),
        ([[[True], [True, False]]], None, "occupied: expected an array, given list"),
        (OCCUPIED.astype(np.uint8), None, "occupied: expected dtype bool, given uint8; compare with a threshold"),
        (OCCUPIED[0], None, r"occupied: expected shape \(nx, ny, nz\) or \(b, nx, ny, nz\), given \(5, 6\)"),
        (OCCUPIED[:3], None, r"occupied: expected shape \(\.\.\., 4, 5, 6\), given \(3, 5, 6\)"),
        (OCCUPIED, GROUND[:2], r"ground: expected shape \(4, 5, 6\), given \(2, 5, 6\)"),
        (OCCUPIED, GROUND * 1.0, "ground: expected dtype bool, given float64"),
    ],
)
def test_what_cannot_be_used_is_told(occupied: object, ground: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VoxelMap.on(GRID, occupied, ground)


@pytest.mark.parametrize("grid", [None, (4, 5, 6)])
def test_a_grid_is_a_grid(grid: object) -> None:
    with pytest.raises(ValueError, match=r"grid: expected a maxjax\.Grid, given (NoneType|tuple)"):
        inspect.unwrap(VoxelMap.on.__func__)(VoxelMap, grid, OCCUPIED)


def test_an_array_in_place_of_a_map_is_told_with_the_call_that_makes_one() -> None:
    with pytest.raises(
        ValueError, match=r"map: expected a maxjax\.VoxelMap, given an array of shape \(4, 5, 6\); .*of\("
    ):
        check_map(OCCUPIED)
