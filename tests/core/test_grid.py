"""Where voxels lie: half-open faces, round trips, and points that lie nowhere."""

from __future__ import annotations

import inspect
import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid
from maxjax.core import grid as module

GRIDS = [
    Grid(),
    Grid((3, 10, 4), 0.5, (1.25, -7.5, 0.0)),
    Grid((7, 1, 33), 0.7, (-33.3, 12.1, 5.55)),
    Grid.centered((10.0, -20.0, 30.0), (6, 5, 4), 2.0),
]


def index_of(grid: Grid, points: np.ndarray) -> np.ndarray:
    return np.asarray(grid.index_of(jnp.asarray(points, jnp.float32)))


def contains(grid: Grid, points: np.ndarray) -> np.ndarray:
    return np.asarray(grid.contains(jnp.asarray(points, jnp.float32)))


@pytest.mark.parametrize("grid", GRIDS)
def test_every_voxel_holds_its_centre(grid: Grid) -> None:
    index = np.indices(grid.shape).reshape(3, -1).T.astype(np.int32)
    centers = grid.center_of(jnp.asarray(index))
    np.testing.assert_allclose(centers, np.array(grid.origin) + grid.spacing * index, rtol=1e-6, atol=1e-5)
    np.testing.assert_array_equal(index_of(grid, np.asarray(centers)), index)
    assert contains(grid, np.asarray(centers)).all()


@pytest.mark.parametrize("grid", GRIDS)
def test_contains_exactly_the_points_whose_voxel_is_in_the_grid(grid: Grid) -> None:
    """Also on the faces and one float beside them, where the two could disagree by a rounding."""
    rng = np.random.default_rng(1)
    size = np.array(grid.shape) * grid.spacing
    points = [np.array(grid.lower) + size * rng.uniform(-0.3, 1.3, (500, 3))]
    for k in range(-1, max(grid.shape) + 2):
        face = np.float32(np.array(grid.lower) + k * grid.spacing)
        points += [face[None], np.nextafter(face, np.float32(-1e9))[None], np.nextafter(face, np.float32(1e9))[None]]
    cloud = np.concatenate(points).astype(np.float32)
    index = index_of(grid, cloud)
    np.testing.assert_array_equal(contains(grid, cloud), ((index >= 0) & (index < grid.shape)).all(axis=1))


def test_voxels_are_half_open() -> None:
    grid = GRIDS[0]  # spacing and origin are exact in binary, so faces are too
    faces = np.arange(102) * 2.0 - 101.0
    np.testing.assert_array_equal(index_of(grid, np.stack([faces] * 3, axis=1))[:, 0], np.arange(102))
    below = faces - 1e-4
    np.testing.assert_array_equal(index_of(grid, np.stack([below] * 3, axis=1))[:, 1], np.arange(102) - 1)
    lowest, highest = np.array([[-101.0] * 3]), np.array([[101.0] * 3])
    assert contains(grid, lowest).all()
    assert not contains(grid, highest).any()
    assert grid.lower == (-101.0, -101.0, -101.0)
    assert grid.upper == (101.0, 101.0, 101.0)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("value", [1e9, -1e9, 3e38, -3e38, math.inf, -math.inf, math.nan])
def test_far_points_and_nan_lie_nowhere(grid: Grid, value: float) -> None:
    for axis in range(3):
        point = np.array(grid.center_of(jnp.asarray([0, 0, 0], jnp.int32)))[None].copy()
        point[0, axis] = value
        assert not contains(grid, point).any()
        if not math.isnan(value):
            index = index_of(grid, point)
            assert index[0, axis] < 0 or index[0, axis] >= grid.shape[axis]


@pytest.mark.parametrize("grid", GRIDS)
def test_index_coordinates_round_trip(grid: Grid) -> None:
    points = np.random.default_rng(2).uniform(-40, 40, (4, 5, 3)).astype(np.float32)
    back = grid.to_world(grid.fractional_index(jnp.asarray(points)))
    np.testing.assert_allclose(back, points, atol=2e-5)
    whole = grid.fractional_index(grid.center_of(jnp.asarray([[0, 0, 2]], jnp.int32)))
    np.testing.assert_allclose(whole, [[0, 0, 2]], atol=1e-5)


@pytest.mark.parametrize("shape", [(101, 101, 101), (4, 5, 6)])
def test_centered_puts_its_middle_at_the_point(shape: tuple[int, int, int]) -> None:
    grid = Grid.centered((3.0, -4.0, 5.5), shape, 1.5)
    np.testing.assert_allclose((np.array(grid.lower) + grid.upper) / 2, (3.0, -4.0, 5.5))
    assert grid.shape == shape
    assert grid.spacing == 1.5


def test_is_static_and_hashable() -> None:
    one, same = Grid((2, 3, 4), 1.0, (0.0, 0.0, 0.0)), Grid((2, 3, 4), 1.0, (0.0, 0.0, 0.0))
    assert one == same
    assert hash(one) == hash(same)
    assert jax.tree.leaves(one) == []
    traces = []

    @jax.jit
    def volume(grid: Grid, scale: jax.Array) -> jax.Array:
        traces.append(grid)
        return scale * math.prod(grid.shape)

    assert volume(one, jnp.float32(1)) == volume(same, jnp.float32(1)) == 24
    assert len(traces) == 1


def test_bad_grids_are_told_with_what_was_given() -> None:
    # As users build them: without the run-time type checks of the tests.
    def build(shape: object = (2, 2, 2), spacing: object = 1.0, origin: object = (0.0, 0.0, 0.0)) -> Grid:
        grid = object.__new__(Grid)
        for name, value in (("shape", shape), ("spacing", spacing), ("origin", origin)):
            object.__setattr__(grid, name, value)
        inspect.unwrap(Grid.__post_init__)(grid)
        return grid

    build()
    for shape in ((0, 2, 2), (2, 2), (2, 2, 2, 2), (2, -1, 2), (10.7, 2, 2), (2, math.inf, 2), (2, 2, None)):
        with pytest.raises(ValueError, match=r"Grid.shape: expected three positive integers, given \("):
            build(shape=shape)
    for other in (5, None, "222", True, [[2, 2], 2, 2]):
        with pytest.raises(
            ValueError, match="Grid.shape: expected three positive integers, given " + re.escape(repr(other))
        ):
            build(shape=other)
    for spacing in (0.0, -1.0, math.nan, math.inf, "2", None, True, 2j, [2.0]):
        given = re.escape(repr(spacing))
        with pytest.raises(ValueError, match=f"Grid.spacing: expected a positive .*given {given}"):
            build(spacing=spacing)
    for origin in ((0.0, 0.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), 0.0, None, "000", (0.0, 0.0, 1j)):
        with pytest.raises(ValueError, match=r"Grid.origin: expected three finite .*given " + re.escape(repr(origin))):
            build(origin=origin)
    assert build(shape=np.array([2, 3, 4]), spacing=np.float32(2), origin=[1, 2, 3]).local.origin == (0.0, 0.0, 0.0)


def test_check_volume_tells_both_shapes() -> None:
    grid = module.Grid((2, 3, 4))
    grid.check_volume("occupied", np.zeros((2, 3, 4)))
    grid.check_volume("occupied", np.zeros((7, 2, 3, 4)))
    with pytest.raises(ValueError, match=r"occupied: expected shape \(..., 2, 3, 4\), given \(4, 3, 2\)"):
        grid.check_volume("occupied", np.zeros((4, 3, 2)))
    with pytest.raises(ValueError, match=r"given \(3, 4\)"):
        grid.check_volume("occupied", np.zeros((3, 4)))
