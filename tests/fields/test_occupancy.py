"""Points become voxels as in a histogram, and margins are Euclidean balls, as SciPy's distance transform has them."""

from __future__ import annotations

import inspect
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from maxjax import Grid, dilate, voxelize
from maxjax.fields.occupancy import squared_distance

GRID = Grid((16, 18, 20), 2.0, (-15.0, 4.0, 0.0))
MARGINS = [0.0, 0.3, 2.0, 2.9, 4.0, 4.5, 6.0, 7.0, 7.9, 8.0]


def distance(occupied: np.ndarray) -> np.ndarray:
    """Distance to the nearest occupied voxel [voxels], float64; infinite where there is none."""
    return distance_transform_edt(~occupied) if occupied.any() else np.full(occupied.shape, np.inf)


def within(occupied: np.ndarray, margin: float, grid: Grid) -> np.ndarray:
    return np.round(distance(occupied) ** 2) <= (margin / grid.spacing) ** 2 * (1 + 1e-12) + 1e-9


def test_equals_a_histogram() -> None:
    rng = np.random.default_rng(1)
    lower, upper = np.array(GRID.lower), np.array(GRID.upper)
    points = (lower + (upper - lower) * rng.uniform(-0.2, 1.2, (3000, 3))).astype(np.float32)
    missing = np.array(
        [[0, 0, 0], [-0.0, 0, 0], [np.nan, 9, 9], [0, 9, np.nan], [np.inf, 9, 9], [9, 9, -np.inf]], np.float32
    )
    far = np.array([[1e30, 9, 9], [-3e38, 9, 9], [0, 9, 1e10]], np.float32)
    cloud = rng.permutation(np.concatenate([points, points[:500], missing, far]))
    edges = [low + GRID.spacing * np.arange(n + 1) for low, n in zip(lower, GRID.shape, strict=True)]
    counts, _ = np.histogramdd(np.concatenate([points, points[:500]]).astype(float), edges)
    scan = voxelize(jnp.asarray(cloud), GRID)
    np.testing.assert_array_equal(scan.occupied, counts > 0)
    assert scan.kept == counts.sum()
    assert scan.missing == len(missing)
    assert scan.outside == len(cloud) - len(missing) - counts.sum()


@pytest.mark.parametrize("count", [0, 5])
def test_scans_without_a_return_mark_nothing(count: int) -> None:
    scan = voxelize(jnp.full((count, 3), jnp.nan), GRID)
    assert not scan.occupied.any()
    assert (int(scan.kept), int(scan.outside), int(scan.missing)) == (0, 0, count)


def test_points_of_the_highest_voxel_do_not_wrap_around() -> None:
    corners = np.array([GRID.lower, np.array(GRID.upper) - 1e-3, np.array(GRID.upper) + 1e-3], np.float32)
    scan = voxelize(jnp.asarray(corners), GRID)
    assert np.argwhere(scan.occupied).tolist() == [[0, 0, 0], [n - 1 for n in GRID.shape]]
    assert (int(scan.kept), int(scan.outside)) == (2, 1)


def test_voxelize_under_jit_and_vmap_equals_a_loop() -> None:
    clouds = jnp.asarray(np.random.default_rng(2).uniform(-20, 45, (3, 50, 3)), jnp.float32)
    batch = jax.jit(jax.vmap(lambda points: voxelize(points, GRID)))(clouds)
    for k, cloud in enumerate(clouds):
        for given, expected in zip(jax.tree.leaves(batch), jax.tree.leaves(voxelize(cloud, GRID)), strict=True):
            np.testing.assert_array_equal(given[k], expected)


@pytest.mark.parametrize("margin", MARGINS)
def test_dilation_equals_the_distance_transform(margin: float) -> None:
    rng = np.random.default_rng(3)
    for density in (0.0, 0.0005, 0.01):
        occupied = rng.random(GRID.shape) < density
        np.testing.assert_array_equal(dilate(jnp.asarray(occupied), margin, GRID), within(occupied, margin, GRID))


@pytest.mark.parametrize("margin", [3.99998, 5.99998])
def test_a_margin_one_rounding_short_of_whole_voxels_counts_as_whole(margin: float) -> None:
    occupied = np.random.default_rng(3).random(GRID.shape) < 0.002
    given = dilate(jnp.asarray(occupied), margin, GRID)
    np.testing.assert_array_equal(given, within(occupied, round(margin), GRID))
    assert not dilate(jnp.zeros(GRID.shape, bool), margin, GRID).any()


@pytest.mark.parametrize("spacing", [0.3, 0.7, 1.1])
def test_dilation_by_whole_voxels_is_inclusive_at_any_spacing(spacing: float) -> None:
    grid = Grid((12, 11, 13), spacing)
    occupied = np.random.default_rng(4).random(grid.shape) < 0.003
    np.testing.assert_array_equal(
        dilate(jnp.asarray(occupied), 3 * spacing, grid), np.round(distance(occupied) ** 2) <= 9
    )


@pytest.mark.parametrize("name", ["Complex", "Simple"])
def test_squared_distances_equal_the_distance_transform_on_real_maps(name: str, data: Path) -> None:
    with np.load(data / "warframe" / f"crop101_{name}.npz") as crop:
        occupied = crop["occupancy"]
    exact = np.round(distance(occupied) ** 2).astype(int)
    squared = squared_distance(jnp.asarray(occupied), 4)
    np.testing.assert_array_equal(np.where(exact <= 16, squared, 0), np.where(exact <= 16, exact, 0))
    assert np.asarray(squared)[exact > 16].min(initial=99) > 16


@pytest.mark.parametrize("margin", [0.0, 1.0, 2.0, 8.0])
def test_ground_is_dilated_by_one_voxel_at_most(margin: float) -> None:
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, 0] = True
    ground[3, 4, 1] = True
    wall = np.zeros(GRID.shape, bool)
    wall[10, 9, 6] = True
    expected = within(wall, margin, GRID) | within(ground, min(margin, GRID.spacing), GRID)
    given = dilate(jnp.asarray(wall | ground), margin, GRID, jnp.asarray(ground))
    np.testing.assert_array_equal(given, expected)


@pytest.mark.parametrize("margin", [-1.0, 41.0, math.nan, math.inf])
def test_bad_margins_are_refused(margin: float) -> None:
    with pytest.raises(ValueError, match=f"margin: expected 0 to 40 m, the map's edge, given {margin}"):
        dilate(jnp.zeros(GRID.shape, bool), margin, GRID)


def test_wrong_shapes_are_told_with_what_was_given() -> None:
    with pytest.raises(ValueError, match=r"points: expected shape \(n, 3\) \[m\], given \(7, 2\)"):
        inspect.unwrap(voxelize)(jnp.zeros((7, 2)), GRID)
    with pytest.raises(ValueError, match=r"occupied: expected shape \(..., 16, 18, 20\), given \(4, 5, 6\)"):
        dilate(jnp.zeros((4, 5, 6), bool), 2.0, GRID)
    with pytest.raises(ValueError, match=r"ground: expected shape .*given \(4, 5, 6\)"):
        inspect.unwrap(dilate)(jnp.zeros(GRID.shape, bool), 2.0, GRID, jnp.zeros((4, 5, 6), bool))
