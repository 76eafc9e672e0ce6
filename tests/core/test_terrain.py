"""The ground as numbers: of voxels, of triangles, of floors, of returns and of a stated height."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

import maxjax
from maxjax.core.grid import Grid
from maxjax.core.terrain import Terrain
from maxjax.io.geo.triangles import crests
from maxjax.io.kinds.bare_ground import terrain_of
from maxjax.io.kinds.contents import PointCloud

GRID = Grid((12, 9, 8), 2.0, (3.0, -5.0, 10.0))


def centres() -> np.ndarray:
    x, y = (GRID.origin[k] + GRID.spacing * np.arange(GRID.shape[k]) for k in (0, 1))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)


def test_crests_are_the_triangles_at_the_centres() -> None:
    rng = np.random.default_rng(3)
    corners = np.column_stack([rng.uniform((4.0, -8.0), (24.0, 10.0), (40, 2)), rng.uniform(8.0, 30.0, 40)])
    oracle = LinearNDInterpolator(corners[:, :2], corners[:, 2])
    found = crests(corners[oracle.tri.simplices], GRID)
    wanted = oracle(centres())
    assert np.isfinite(wanted).any()
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_of_two_triangles_the_higher_counts() -> None:
    low = np.array([[[0.0, -20.0, 1.0], [60.0, -20.0, 1.0], [0.0, 60.0, 1.0]]])
    np.testing.assert_allclose(crests(np.concatenate([low + np.array([0, 0, 4.25]), low]), GRID), 5.25)


def test_returns_are_averaged_and_the_nearest_fills_up() -> None:
    place = centres()[[2, 2, 9], [3, 3, 5]]
    aside = np.array([[0.5, 0.5], [-0.5, 0.2], [0.0, 0.0]])
    points = np.column_stack([place + aside, [7.0, 8.0, 15.0]]).astype(np.float32)
    cloud = PointCloud(points, np.array([0.0, 0.0, 5.0]), np.ones(3, bool), np.zeros(3, bool), "a")
    terrain = terrain_of(cloud, GRID)
    assert terrain is not None
    assert terrain.at(*place[0]) == pytest.approx(12.5, abs=1e-5)
    x = centres().reshape(-1, 2)
    nearer = np.linalg.norm(x - place[0], axis=1) - np.linalg.norm(x - place[2], axis=1)
    clear = np.abs(nearer) > 1e-6
    np.testing.assert_allclose(terrain.heights.ravel()[clear], np.where(nearer < 0, 12.5, 20.0)[clear], atol=1e-5)


def buildings(folder: Path, *elevations: float | None) -> Path:
    """Houses of 20 by 20 m, 60 m apart, in metres of EPSG:28992."""
    features = []
    for k, ele in enumerate(elevations):
        x, y = 85_000.0 + 60.0 * k, 447_000.0
        ring = [[x, y], [x + 20, y], [x + 20, y + 20], [x, y + 20], [x, y]]
        known = {"height": 20.0} | ({} if ele is None else {"ele": ele})
        features.append(
            {"type": "Feature", "properties": known, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        )
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    file = folder / "houses.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return file


def test_floors_are_the_ground_to_the_millimetre(tmp_path: Path) -> None:
    city = maxjax.load_map(buildings(tmp_path, 9.13, 11.37), spacing=2.0)
    assert [city.terrain.at(x, 447_010.0) for x in (85_010.0, 85_070.0)] == pytest.approx([9.13, 11.37], abs=1e-9)
    assert city.terrain.at(85_030.0, 447_010.0) == pytest.approx(9.13, abs=1e-9)
    # Voxels hold it only to a voxel.
    assert Terrain.of(city.ground, city.grid).at(85_010.0, 447_010.0) != pytest.approx(9.13, abs=1e-3)
    start = city.point((*city.earth.geodetic(np.array([[85_030.0, 447_010.0, 0.0]]))[0, :2], 30.0))  # type: ignore[union-attr]
    assert start[2] == pytest.approx(39.13, abs=1e-6)


def test_heights_in_larger_columns_are_those_at_their_centres() -> None:
    terrain = Terrain(np.random.default_rng(2).uniform(0.0, 9.0, (12, 9)), GRID)
    coarse = terrain.on(Grid((5, 4, 2), 6.0, (5.0, -3.0, 10.0)))
    assert np.isnan(coarse.heights[4]).all()
    for i in range(4):
        for j in range(3):
            assert coarse.heights[i, j] == terrain.at(5.0 + 6.0 * i, -3.0 + 6.0 * j)


def test_a_stated_ground_is_just_there(tmp_path: Path) -> None:
    city = maxjax.load_map(buildings(tmp_path, 9.13), spacing=2.0, ground=8.77)
    assert (city.terrain.heights == 8.77).all()
    assert city.terrain.doubt == 0.0


def test_of_a_plain_map_its_voxels_tell() -> None:
    ground = np.zeros((4, 4, 6), bool)
    ground[:, :, :2] = True
    where = maxjax.VoxelMap.of(ground, spacing=2.0, origin=(0.0, 0.0, 1.0), ground=ground)
    assert (where.terrain.at(1.0, 1.0), where.terrain.doubt) == (4.0, 2.0)
    with pytest.raises(ValueError, match="batch of 2"):
        _ = maxjax.VoxelMap.of(np.stack([ground] * 2), spacing=2.0, origin=(0.0, 0.0, 1.0)).terrain
