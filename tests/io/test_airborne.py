"""Buildings seen from above become solid: on a made-up street exactly, in Delft as a model has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from maxjax.core.grid import Grid
from maxjax.io import PointCloud, ground_mask, read_map, solidify
from tests.io.cityjson import column_heights

GRID = Grid((12, 10, 15), 2.0, (-11.0, -9.0, -4.0))


def cloud_of(points: np.ndarray, ground: np.ndarray, solid: np.ndarray) -> PointCloud:
    return PointCloud(points.astype(np.float32), np.zeros(3), ground, solid, "made up")


def street() -> tuple[PointCloud, np.ndarray, np.ndarray]:
    """Sloping terrain, a flat roof, two single returns; true columns of the house, its roof's index."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-12, 12, 8000), rng.uniform(-10, 10, 8000)
    inside = (x > -4) & (x < 6) & (y > -4) & (y < 4)
    z = np.where(inside, 15.5, 0.05 * x)
    other = np.array([[9.0, 0.0, 9.0], [-9.0, 0.0, 11.0], [np.nan, 0.0, 3.0], [1e30, 0.0, 3.0]])
    points = np.concatenate([np.column_stack([x, y, z]), other])
    ground = np.concatenate([~inside, np.zeros(4, bool)])
    cloud = cloud_of(points, ground, np.concatenate([inside, np.zeros(4, bool)]))
    cx, cy = (GRID.origin[axis] + 2.0 * np.arange(GRID.shape[axis]) for axis in (0, 1))
    house = ((cx > -4) & (cx < 6))[:, None] & ((cy > -4) & (cy < 4))
    return cloud, house, np.where(house, (15.5 + 5) // 2, -1)


def test_a_roof_becomes_a_body_down_to_the_terrain_and_nothing_else_does() -> None:
    cloud, house, roof = street()
    body, ground = solidify(cloud, GRID), ground_mask(cloud, GRID)
    level = np.arange(GRID.shape[2])
    np.testing.assert_array_equal(body.any(axis=2), house)
    np.testing.assert_array_equal(body, house[:, :, None] & (level <= roof[:, :, None]) & (level >= 2))
    # The terrain runs from -0.6 to 0.6 m, all of it in voxel 2 (-1 to 1 m), under the house too.
    np.testing.assert_array_equal(ground, np.broadcast_to(level <= 2, GRID.shape))


def test_terrain_under_a_house_is_that_of_the_nearest_street() -> None:
    x = np.repeat(np.arange(-11.0, 12, 2), 10)
    points = np.column_stack([x, np.tile(np.arange(-9.0, 10, 2), 12), np.where(x < 0, 0.0, 6.0)])
    house = np.abs(x) < 4
    points[house, 2] = 20.0
    body = solidify(cloud_of(points, ~house, house), GRID)
    lowest = np.where(body.any(axis=2), body.argmax(axis=2), -1)
    np.testing.assert_array_equal(lowest[:, 0], [-1, -1, -1, -1, 2, 2, 5, 5, -1, -1, -1, -1])


def test_without_ground_returns_buildings_reach_the_floor_of_the_grid() -> None:
    points = np.array([[1.0, 1.0, 8.0]])
    cloud = cloud_of(points, np.array([False]), np.array([True]))
    assert solidify(cloud, GRID)[6, 5].tolist() == [level <= 6 for level in range(15)]
    assert not ground_mask(cloud, GRID).any()


def test_roofs_and_terrain_beyond_the_grid_are_clipped() -> None:
    points = np.array([[1.0, 1.0, 500.0], [3.0, 1.0, -500.0], [5.0, 1.0, -500.0]])
    cloud = cloud_of(points, np.array([False, True, False]), np.array([True, False, True]))
    body = solidify(cloud, GRID)
    assert body[6, 5].all()
    assert body.sum() == GRID.shape[2]
    assert not ground_mask(cloud, GRID).any()


@pytest.fixture(scope="module")
def delft(data: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Grid]:
    """Building voxels of the scan, its roofs [m]; base and roof of the model on a finer lattice; the grid."""
    pytest.importorskip("laspy")
    cloud = read_map(data / "ahn3_delft" / "ahn3_cropped_1.laz")
    middle = 0.5 * (cloud.points.min(0) + cloud.points.max(0)).astype(float)
    grid = Grid.centered((middle[0], middle[1], middle[2]))
    fine = [grid.lower[axis] + 0.5 * (np.arange(404) + 0.5) + cloud.offset[axis] for axis in (0, 1)]
    base, roof, covered = column_heights(data / "ahn3_delft" / "testarea.city.json", *fine)
    column = np.floor((cloud.points[:, :2] - np.array(grid.lower[:2])) / 2).astype(int)
    inside = ((column >= 0) & (column < 101)).all(axis=1)
    seen = np.zeros((101, 101), bool)
    seen[tuple(column[inside].T)] = True
    highest = np.full((101, 101), -np.inf)
    top = inside & cloud.solid
    np.maximum.at(highest, tuple(column[top].T), cloud.points[top, 2])
    # Only where both data sets say something: a face of the model (of any kind) and a return of the scan.
    zone = blocks(covered).all(axis=(1, 3)) & ndimage.binary_fill_holes(seen)
    base[~np.repeat(np.repeat(zone, 4, 0), 4, 1)] = np.nan
    roof[np.isnan(base)] = np.nan
    return solidify(cloud, grid) & zone[:, :, None], highest, base, roof, grid


def blocks(fine: np.ndarray) -> np.ndarray:
    return fine.reshape(101, 4, 101, 4)


def test_buildings_of_delft_agree_with_the_city_model(delft: tuple[np.ndarray, ...]) -> None:
    body, highest, base, roof, grid = delft
    z = grid.origin[2] + grid.spacing * np.arange(101)
    # A voxel counts as the model's if the model touches it, as a return anywhere in it makes it the scan's.
    low = np.fmin.reduce(np.fmin.reduce(blocks(base), axis=3), axis=1)[:, :, None]
    high = np.fmax.reduce(np.fmax.reduce(blocks(roof), axis=3), axis=1)[:, :, None]
    touched = (z + 1 > low) & (z - 1 <= high)
    # Or if its centre lies in the model: here, in the lattice column just beside the centre.
    base, roof = base[2::4, 2::4, None], roof[2::4, 2::4, None]
    filled = (z >= base) & (z <= roof)

    def overlap(a: np.ndarray, b: np.ndarray) -> float:
        return float((a & b).sum() / (a | b).sum())

    near = np.ones((3, 3, 3), bool)
    figures = {
        "touched": overlap(body, touched),
        "filled": overlap(body, filled),
        "model found": (filled & body).sum() / filled.sum(),
        "scan within a voxel of the model": (body & ndimage.binary_dilation(filled, near)).sum() / body.sum(),
        "model within a voxel of the scan": (filled & ndimage.binary_dilation(body, near)).sum() / filled.sum(),
    }
    wall_free = ndimage.binary_erosion(filled.any(axis=2)) & np.isfinite(highest)
    error = highest[wall_free] - roof[:, :, 0][wall_free]
    figures |= {"median": np.median(error), "mean": np.abs(error).mean(), "2 m": (np.abs(error) < 2).mean()}
    print({name: round(float(value), 3) for name, value in figures.items()}, filled.sum(), wall_free.sum())
    assert figures["touched"] > 0.75
    assert figures["filled"] > 0.53
    assert figures["model found"] > 0.9
    assert figures["scan within a voxel of the model"] > 0.97
    assert figures["model within a voxel of the scan"] > 0.98
    assert abs(figures["median"]) < 0.3
    assert figures["mean"] < 0.8
    assert figures["2 m"] > 0.92
