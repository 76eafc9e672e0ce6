"""Faces of files: volumes and areas by shapely and trimesh, and which side is out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapely.geometry import Polygon

from maxjax.io.geo.polygons import covering, newell
from maxjax.io.kinds.faces import Faces, faces_of
from maxjax.io.kinds.footprints import Footprint, Footprints
from maxjax.io.kinds.mesh import mesh_of
from maxjax.io.reader import read_map

QUARTER = Path(__file__).parents[2] / "docs" / "samples" / "quarter.geojson"
OUTLINE = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [7.0, 8.0], [7.0, 3.0], [4.0, 3.0], [4.0, 8.0], [0.0, 8.0]])
HOLE = np.array([[1.0, 1.0], [1.0, 2.0], [11.0, 2.0], [11.0, 1.0]])


def volume(faces: Faces, part: int) -> float:
    """Of a closed part, by the divergence theorem, about its first corner."""
    corners = faces.triangles[faces.part == part]
    a, b, c = np.moveaxis(corners - corners[0, 0], 1, 0)
    return float(np.einsum("nk,nk->", a, np.cross(b, c)) / 6.0)


def windings(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How often triangles wind around points: solid angles, Van Oosterom and Strackee (1983)."""
    a, b, c = np.moveaxis(corners[None] - points[:, None, None], 2, 0)
    x, y, z = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    volume = np.einsum("pnk,pnk->pn", a, np.cross(b, c))
    dots = [np.einsum("pnk,pnk->pn", *pair) for pair in ((a, b), (b, c), (c, a))]
    angle = 2.0 * np.arctan2(volume, x * y * z + dots[0] * z + dots[1] * x + dots[2] * y)
    return angle.sum(axis=1) / (4.0 * np.pi)


@pytest.mark.parametrize("turned", [False, True])
def test_a_prism_encloses_what_its_outline_does(turned: bool) -> None:
    """Whichever way its rings go around, its faces are outward and close, holes too."""
    rings = tuple(ring[::-1] if turned else ring for ring in (OUTLINE, HOLE))
    faces = faces_of(Footprints((Footprint(rings, 2.0, 11.0, "court"),), np.zeros((0, 3, 3)), "a file"))
    expected = Polygon(OUTLINE, [HOLE])
    assert volume(faces, 0) == pytest.approx(9.0 * expected.area)
    assert faces.names == ("court",)
    size = 0.5 * np.linalg.norm(
        np.cross(faces.triangles[:, 1] - faces.triangles[:, 0], faces.triangles[:, 2] - faces.triangles[:, 0]), axis=1
    )
    assert size.sum() == pytest.approx(2.0 * expected.area + 9.0 * expected.length)


def test_a_sample_of_the_docs() -> None:
    """Each house as large as shapely has it."""
    found = read_map(QUARTER)
    assert isinstance(found, Footprints)
    faces = faces_of(found)
    assert faces.closed.all()
    for k, house in enumerate(found.buildings):
        expected = Polygon(house.rings[0]).area * (house.top - house.base)
        assert volume(faces, k) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("turned", [False, True])
def test_trapezoids_go_around_as_their_outline_does(axis: int, turned: bool) -> None:
    """In each plane: the sum of their normals is that of the rings, the hole's the other way round."""
    flat = [OUTLINE, HOLE]
    rings = [np.insert(ring[::-1] if turned else ring, axis, 3.0, axis=1) for ring in flat]
    found = covering(rings)
    normals = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    assert (normals @ newell(rings[0]) >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals.sum(axis=0)) / 2.0, Polygon(OUTLINE, [HOLE]).area)


def test_a_mesh_that_is_inside_out(tmp_path: Path) -> None:
    """A closed body is brought outward as a whole; its volume is trimesh's."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    mesh = mesh_of(np.asarray(ball.vertices), np.asarray(ball.faces)[:, ::-1], tmp_path / "ball.obj")
    faces = faces_of(mesh)
    assert faces.closed[0]
    assert volume(faces, 0) == pytest.approx(ball.volume, rel=1e-6)


def test_the_hague_is_outward(data: Path) -> None:
    """Of a city with 1,990 closed shells: from nearly all faces, the way out leaves the shell for good."""
    found = read_map(data / "the_hague" / "DenHaag_01.city.json")
    assert isinstance(found, Footprints)
    faces = faces_of(found)
    assert faces.closed.all()
    assert len(faces.terrain) == 5595
    assert len(set(faces.buildings)) <= 844 < len(faces.names)
    rng = np.random.default_rng(0)
    inside = total = 0
    for part in rng.choice(len(faces.names), 60, replace=False):
        corners = faces.triangles[faces.part == part]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(normal, axis=1)
        kept = size > 0.1
        outside = corners.mean(axis=1)[kept] + 0.01 * normal[kept] / size[kept, None]
        inside += int((windings(corners, outside) > 0.5).sum())
        total += len(outside)
    assert inside <= 0.005 * total
