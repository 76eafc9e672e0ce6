"""Rasterised triangles: touched voxels against separating axes, insides against the solid angle of the surface."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from maxjax.core.grid import Grid
from maxjax.io.geo.triangles import voxels_enclosed, voxels_touched

GRID = Grid((12, 13, 11), 0.7, (-3.0, -4.0, -2.0))


def centres(grid: Grid) -> np.ndarray:
    axes = [grid.origin[i] + grid.spacing * np.arange(grid.shape[i]) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def overlaps(triangle: np.ndarray, grid: Grid) -> np.ndarray:
    """Separating axes of a triangle and each cube: three face normals, the triangle's, nine products of edges."""
    edges = np.roll(triangle, -1, axis=0) - triangle
    axes = [*np.eye(3), np.cross(edges[0], edges[1]), *np.cross(np.eye(3)[:, None], edges).reshape(9, 3)]
    if np.linalg.norm(axes[3]) < 1e-9:  # a segment: its own plane is any that holds it
        axes += [*np.cross(axes[4:], edges[0])]
    found = np.ones(grid.shape, bool)
    middle = centres(grid)
    for axis in axes:
        corners, cubes, reach = triangle @ axis, middle @ axis, 0.5 * grid.spacing * np.abs(axis).sum() + 1e-9
        found &= (corners.min() <= cubes + reach) & (corners.max() >= cubes - reach)
    return found


def triangles() -> list[np.ndarray]:
    """Large and small ones, level and upright ones, segments, points, and some through lattice planes."""
    rng = np.random.default_rng(0)
    found = []
    for kind in range(300):
        size = (3.0, 0.5, 0.1, 30.0)[kind % 4]
        triangle = rng.normal(0, 2, 3) + rng.normal(0, size, (3, 3))
        if kind % 5 == 0:
            triangle[:, kind % 3] = rng.normal()
        if kind % 7 == 0:
            triangle[2] = triangle[1]
        if kind % 21 == 0:
            triangle[:] = triangle[0]
        if kind % 11 == 0:
            triangle = np.round(triangle / 0.35) * 0.35 + np.array(GRID.origin)
        found.append(triangle)
    return found


def test_exactly_the_voxels_are_marked_that_a_triangle_touches() -> None:
    marked = 0
    for number, triangle in enumerate(triangles()):
        found = voxels_touched(triangle[None], GRID)
        np.testing.assert_array_equal(found, overlaps(triangle, GRID), str((number, triangle)))
        marked += found.sum()
    assert marked > 4000


def test_many_triangles_are_the_union_of_each() -> None:
    found = voxels_touched(np.array(triangles()), GRID)
    np.testing.assert_array_equal(found, np.any([voxels_touched(one[None], GRID) for one in triangles()], axis=0))
    assert not voxels_touched(np.zeros((0, 3, 3)), GRID).any()


def winding(surface: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How often a closed surface winds around points: its solid angle over 4π (van Oosterom and Strackee 1983)."""
    a, b, c = (surface[None, :, i] - points[:, None] for i in range(3))
    p, q, r = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    volume = np.einsum("...i,...i", a, np.cross(b, c))
    rest = p * q * r + np.sum(a * b, -1) * r + np.sum(b * c, -1) * p + np.sum(c * a, -1) * q
    return np.arctan2(volume, rest).sum(axis=1) / (2 * np.pi)


def hull(rng: np.random.Generator, middle: np.ndarray, size: float) -> np.ndarray:
    """A closed convex body of random corners, its faces turned outwards."""
    from scipy.spatial import ConvexHull

    shape = ConvexHull(middle + rng.normal(0, size, (20, 3)))
    faces = shape.points[shape.simplices]
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    inwards = np.sum(normal * shape.equations[:, :3], axis=1) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return faces


@pytest.mark.parametrize("seed", range(4))
def test_what_closed_bodies_surround_is_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Overlapping bodies, some of them partly or wholly outside of the grid.
    bodies = [hull(rng, rng.normal(0, 2, 3), size) for size in (0.5, 1.0, 2.0, 3.0)]
    surface = np.concatenate(bodies)
    body = np.repeat(np.arange(4), [len(one) for one in bodies])
    turned = np.where((np.arange(len(surface)) % 3 == 0)[:, None, None], surface[:, ::-1], surface)
    expected = (winding(surface, centres(GRID).reshape(-1, 3)) > 0.5).reshape(GRID.shape)
    assert expected.any()
    np.testing.assert_array_equal(voxels_enclosed(turned, body, GRID), expected)


def test_walls_through_the_centres_of_columns_leave_no_column_out() -> None:
    corners = np.array(list(itertools.product((0, 1), repeat=3)), float)
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = np.array([quad[:3] for quad in quads] + [(quad[0], *quad[2:]) for quad in quads])
    grid = Grid((8, 8, 8), 1.0, (0.0, 0.0, 0.0))
    box = 1.0 + 4.0 * corners[faces]  # its walls lie in the planes of voxel centres
    solid = voxels_touched(box, grid) | voxels_enclosed(box, np.zeros(12, int), grid)
    expected = np.zeros(grid.shape, bool)
    expected[1:6, 1:6, 1:6] = True
    np.testing.assert_array_equal(solid, expected)
