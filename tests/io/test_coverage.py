"""What lies within the data: hulls by SciPy's triangulation, at places that do not depend on how a column is cut."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay, cKDTree

import maxjax
from maxjax.core.grid import Grid
from maxjax.io import Window, map_of
from maxjax.io.kinds.coverage import within_data
from maxjax.io.kinds.mesh import mesh_of
from maxjax.io.kinds.point_cloud import PointCloud, StoredVoxels

GRID = Grid((40, 30, 6), 2.0, (-39.0, -29.0, 1.0))


def cloud(points: np.ndarray, offset: Any = (0.0, 0.0, 0.0)) -> PointCloud:
    none = np.zeros(len(points), bool)
    return PointCloud(np.asarray(points, float), np.array(offset), none, none, "scan")


def centres(grid: Grid) -> np.ndarray:
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape[:2]), indexing="ij"), axis=-1)
    return np.array(grid.origin[:2]) + grid.spacing * index


@pytest.mark.parametrize("seed", range(5))
def test_points_cover_their_hull(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal((3.0, -2.0, 5.0), (12.0, 7.0, 2.0), (60, 3))
    points[::9] = np.nan
    found = within_data(cloud(points), GRID)
    hull = Delaunay(points[np.isfinite(points).all(axis=1), :2])
    ring = GRID.spacing * np.array([(x, y) for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)])
    touched = np.array([hull.find_simplex(centres(GRID) + shift) >= 0 for shift in ring]).any(axis=0)
    assert (found >= touched).all()
    far = np.array([hull.find_simplex(centres(GRID) + 2.0 * shift) < 0 for shift in ring]).all(axis=0)
    # A column beside a corner may count as touched, one further away does not.
    assert (found & far).sum() <= 12
    shifted = within_data(cloud(points - np.array([100.0, 0.0, 0.0]), (100.0, 0.0, 0.0)), GRID)
    np.testing.assert_array_equal(shifted, found)


def test_a_survey_covers_what_is_near_a_return_and_the_rest_is_closed(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-60, 60, (20_000, 2)), np.zeros(20_000)])
    hole = np.linalg.norm(points[:, :2] - [20.0, -10.0], axis=1) < 15.0  # a lake, which sends nothing back
    survey = dataclasses.replace(cloud(points[~hole]), ground=np.ones((~hole).sum(), bool))
    survey = dataclasses.replace(survey, classes=np.full((~hole).sum(), 2, np.uint8))
    found = map_of(survey, Window(bounds=(-80.0, -80.0, -4.0, 80.0, 80.0, 20.0)))
    nearest = cKDTree(points[~hole, :2]).query(centres(found.grid).reshape(-1, 2))[0].reshape(found.grid.shape[:2])
    assert not found.file.within[nearest > 6.5].any()  # two columns, and what a return may lie beside a centre
    assert found.file.within[nearest < 3.0].all()
    np.testing.assert_array_equal(found.occupied.all(axis=2), ~found.file.within)
    assert any("not covered by the survey, and are closed" in remark for remark in found.file.remarks)
    opened = map_of(survey, Window(bounds=(-80.0, -80.0, -4.0, 80.0, 80.0, 20.0)), maxjax.Reading(unknown="free"))
    assert not opened.occupied.all(axis=2).any()
    np.testing.assert_array_equal(opened.file.within, found.file.within)
    scan = map_of(cloud(points[~hole]), Window())
    assert not scan.occupied.all(axis=2).any()
    assert "what the scan did not see is taken as free" in scan.file.remarks


def test_a_sparse_survey_covers_more_around_a_return() -> None:
    x, y = np.meshgrid(np.arange(-36.0, 37.0, 6.0), np.arange(-24.0, 25.0, 6.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    survey = dataclasses.replace(cloud(points), classes=np.full(len(points), 2, np.uint8))
    inside = (np.abs(centres(GRID)) <= (36.0, 24.0)).all(axis=-1)
    assert within_data(survey, GRID)[inside].all()


def test_few_points_cover_their_box() -> None:
    x, y = (centres(GRID)[..., axis] for axis in (0, 1))
    for points in ([[1.0, 1.0, 3.0]], [[-9.0, 0.2, 3.0], [9.0, 0.2, 3.0]], [[k, 0.2, 3.0] for k in range(-9, 10)]):
        found = within_data(cloud(np.array(points)), GRID)
        (x0, y0), (x1, y1) = np.min(points, axis=0)[:2] - 1.0, np.max(points, axis=0)[:2] + 1.0
        np.testing.assert_array_equal(found, (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))
    assert not within_data(cloud(np.full((3, 3), np.nan)), GRID).any()


def test_a_mesh_and_voxels_cover_what_they_span() -> None:
    triangles = np.array([[[0.0, 0.0, 0.0], [20.0, 0.0, 3.0], [0.0, 20.0, 5.0]]])
    mesh = mesh_of(triangles[0], np.array([[0, 1, 2]]), Path("town.obj"))
    found = within_data(mesh, GRID)
    x, y = (centres(GRID)[..., axis] for axis in (0, 1))
    assert found[(x > 0.0) & (y > 0.0) & (x + y < 20.0)].all()
    assert not found[(x < -1.0) | (y < -1.0) | (x + y > 23.0)].any()
    part = StoredVoxels(np.zeros((10, 8, 6), bool), 2.0, (-9.0, -5.0, 1.0), "part.npz")
    found = within_data(part, GRID)
    assert found.sum() == 10 * 8
    assert found[15:25, 12:20].all()


def test_a_map_tells_what_lies_within(tmp_path: Path) -> None:
    ring = [[8.0, 47.0], [8.001, 47.0], [8.001, 47.0005], [8.0, 47.0005], [8.0, 47.0]]
    house = {"type": "Feature", "properties": {"height": 9}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    file = tmp_path / "a.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [house]}))
    found = maxjax.load_map(file)
    assert found.file.within.shape == found.grid.shape[:2]
    obstacle = (found.occupied & ~found.ground).any(axis=2)
    assert found.file.within[obstacle].all()
    assert 0.1 < found.file.within.mean() < 0.7  # by default there is room around a map
