"""Surfaces of voxels: every seen face once, turned outwards, with its light; and the file that a browser reads."""

from __future__ import annotations

import io

import numpy as np
import pytest
from jaxtyping import Bool, Float
from scipy.ndimage import label

from maxjax.core.grid import Grid
from maxjax.ui.page.colors import EARTH
from maxjax.ui.page.gltf import glb
from maxjax.ui.page.nodes import Frame, Surface
from maxjax.ui.page.surface import split_surface, surface

SHAPE = (7, 6, 5)
GRID = Grid(SHAPE, 2.0, (100.0, 200.0, 3.0))
FRAME = Frame.of(GRID)


def area_vectors(found: Surface) -> Float[np.ndarray, "m 3"]:
    """Of each triangle: as long as its area, along its normal."""
    a, b, c = (found.points[found.faces[:, k]].astype(np.float64) for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def volume(seed: int) -> Bool[np.ndarray, "nx ny nz"]:
    return np.asarray(np.random.default_rng(seed).random(SHAPE) < 0.4)


def seen(solid: Bool[np.ndarray, "nx ny nz"]) -> dict[tuple[int, int], int]:
    """How many faces are seen on each side, voxel by voxel; none from below the grid."""
    count = {(axis, side): 0 for axis in range(3) for side in (-1, 1)}
    for place in np.argwhere(solid):
        for axis, side in count:
            beside = place.copy()
            beside[axis] += side
            inside = ((beside >= 0) & (beside < SHAPE)).all()
            below = axis == 2 and beside[2] < 0
            count[axis, side] += not below and not (inside and solid[tuple(beside)])
    return count


@pytest.mark.parametrize("seed", range(3))
def test_every_seen_face_is_covered_once_and_turned_outwards(seed: int) -> None:
    solid = volume(seed)
    areas = area_vectors(surface(solid, GRID, FRAME))
    for (axis, side), count in seen(solid).items():
        along = side * areas[:, axis]
        assert along[along > 0.0].sum() == pytest.approx(4.0 * count)
    assert np.count_nonzero(areas) == len(areas)  # each along one axis


@pytest.mark.parametrize("seed", range(3))
def test_a_ray_from_above_meets_each_column_at_its_top(seed: int) -> None:
    solid = volume(seed)
    found = surface(solid, GRID, FRAME)
    up = area_vectors(found)[:, 2] > 0.0
    corners = found.points[found.faces[up]].astype(np.float64) + FRAME.anchor
    tops = np.full(SHAPE[:2], -np.inf)
    for i, j in np.ndindex(SHAPE[:2]):
        # Beside the diagonal of a quad.
        x, y = 100.0 + 2.0 * i + 0.3, 200.0 + 2.0 * j - 0.2
        for triangle in corners:
            (ax, ay), (bx, by), (cx, cy) = triangle[:, :2]
            parts = np.linalg.solve([[ax, bx, cx], [ay, by, cy], [1.0, 1.0, 1.0]], [x, y, 1.0])
            if (parts >= 0.0).all():
                tops[i, j] = max(tops[i, j], triangle[0, 2])
    highest = SHAPE[2] - np.argmax(solid[:, :, ::-1], axis=2)
    expected = np.where(solid.any(axis=2), 2.0 + 2.0 * highest, -np.inf)
    np.testing.assert_allclose(tops, expected)


def test_a_block_is_a_quad_a_side_and_its_top_is_the_brightest() -> None:
    solid = np.zeros(SHAPE, bool)
    solid[1:5, 2:4, 0:3] = True
    found = surface(solid, GRID, FRAME, EARTH)
    assert len(found.faces) == 2 * 5
    areas = area_vectors(found)
    light = found.colors[found.faces[:, 0]].sum(axis=1)
    assert (light[areas[:, 2] > 0.0] > light[areas[:, 2] == 0.0].max()).all()
    np.testing.assert_array_equal(found.colors[found.faces[areas[:, 2] > 0.0][0]], [EARTH] * 3)
    hidden = surface(solid, GRID, FRAME, hidden_by=np.ones(SHAPE, bool))
    assert (len(hidden.points), len(hidden.faces)) == (0, 0)


@pytest.mark.parametrize("opacity", [1.0, 0.25])
def test_the_file_holds_the_surface(opacity: float) -> None:
    trimesh = pytest.importorskip("trimesh", reason="viser needs trimesh")
    found = surface(volume(0), GRID, FRAME, opacity=opacity)
    (mesh,) = trimesh.load(io.BytesIO(glb(found)), file_type="glb", process=False).geometry.values()
    np.testing.assert_array_equal(mesh.vertices, found.points)
    np.testing.assert_array_equal(mesh.faces, found.faces)


@pytest.mark.parametrize("seed", range(3))
def test_a_surface_is_parted_between_buildings(seed: int) -> None:
    solid = volume(seed) & (np.random.default_rng(seed).random(SHAPE[:2]) < 0.5)[:, :, None]
    number, _ = label(solid.any(axis=2))
    columns = number % 2 == 1
    parts = split_surface(surface(solid, GRID, FRAME), GRID, FRAME, columns)
    for part, chosen in zip(parts, (columns, ~columns), strict=True):
        areas = area_vectors(part)
        for (axis, side), count in seen(solid & chosen[:, :, None]).items():
            along = side * areas[:, axis]
            assert along[along > 0.0].sum() == pytest.approx(4.0 * count)
