"""What photos show: hidden by C MuJoCo's rays, framed by a plain projection, pixels by their corners on the wall."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import TOUCH, Scenery
from maxjax.inspection.target_surface import Surface, city_faces, surface_of
from maxjax.inspection.views import Views
from maxjax.inspection.visibility import SightLimits, find_sights
from tests.inspection.towns import hits, ray_model, rectangle, town

CAMERA = Camera("of 4:3", (4000, 3000), sensor=(17.3, 13.0), focal_length=12.29)
LIMITS = SightLimits(60.0, 2.0 * CAMERA.ground_sample_distance(8.0))


def houses() -> maxjax.LoadedMap:
    """A house in the shape of an L, with a wall 5 m before one of its sides, and a lower one beside it."""
    shape = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 8.0], [8.0, 8.0], [8.0, 16.0], [0.0, 16.0]])
    return town((shape, 12.0), (rectangle(2.0, -6.0, 18.0, -5.0), 6.0), (rectangle(22.0, 0.0, 30.0, 8.0), 7.0))


def framed(views: Views, surface: Surface, limits: SightLimits) -> tuple[np.ndarray, np.ndarray]:
    """Whether each point is within each photo and the limits, and its pixel's longer side, by plain geometry."""
    tall, wide = (math.tan(math.atan(half)) for half in CAMERA.half_tangents[::-1])
    kept = np.zeros((len(views), len(surface)), bool)
    side = np.full(kept.shape, np.inf)
    for k, (place, yaw, pitch) in enumerate(zip(views.position, views.yaw, views.pitch, strict=True)):
        forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
        right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        up = np.cross(right, forward)
        way = surface.points - place
        depth = way @ forward
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = way @ right / depth, way @ up / depth
            cosine = -np.einsum("nk,nk->n", way, surface.normals) / np.linalg.norm(way, axis=1)
        for n in np.flatnonzero((depth > 0) & (cosine >= np.cos(np.radians(limits.incidence)))):
            corners = []
            for du, dv in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
                ray = forward + (u[n] + du * 2 * wide / 4000) * right + (v[n] + dv * 2 * tall / 3000) * up
                corners.append(place + ray * (way[n] @ surface.normals[n]) / (ray @ surface.normals[n]))
            side[k, n] = max(np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[2] - corners[0]))
            kept[k, n] = abs(u[n]) <= wide and abs(v[n]) <= tall and side[k, n] <= limits.resolution
    return kept, side


def some_views(surface: Surface, rng: np.random.Generator, count: int) -> Views:
    """Views of the surface from 4 to 12 m, some of them aslant."""
    chosen = rng.integers(0, len(surface), count)
    direction = surface.normals[chosen] + 0.5 * rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    places = surface.points[chosen] + rng.uniform(4.0, 12.0, (count, 1)) * direction
    kept = places[:, 2] > 0.5
    return Views.towards(places[kept], -direction[kept])


@pytest.mark.parametrize("by_voxels", [False, True])
def test_photos_against_plain_geometry_and_c_mujoco(by_voxels: bool) -> None:
    """The same pairs, but for points on the border of a photo or a millimetre from an edge that hides."""
    where = houses()
    if by_voxels:
        where = maxjax.VoxelMap.on(where.grid, where.occupied, where.ground)  # type: ignore[assignment]
    faces = city_faces(where)
    scenery = Scenery.of(where, faces, by_voxels=by_voxels)
    surface = surface_of(where, faces, scenery, (4.0, 4.0), 1.0)
    views = some_views(surface, np.random.default_rng(0), 60)
    found = find_sights(views, surface, scenery, CAMERA, LIMITS)
    given = found.matrix.toarray().astype(bool)
    within, side = framed(views, surface, LIMITS)
    model = ray_model(np.concatenate([faces.triangles, faces.terrain]))
    expected = np.zeros_like(given)
    hidden = 0
    for k, place in enumerate(views.position):
        asked = np.flatnonzero(within[k])
        short = hits(model, place, surface.points[asked])
        expected[k, asked] = short <= TOUCH
        hidden += int((short > TOUCH).sum())
    assert expected.sum() > 1000
    assert hidden > 100
    assert (given != expected).sum() <= 0.003 * within.sum()
    pairs = found.photo, found.point
    np.testing.assert_allclose(found.resolution, side[pairs], rtol=1e-3)


def test_straight_ahead_a_pixel_is_that_of_the_data_sheet() -> None:
    """A level photo of a wall 8 m away, and one straight down."""
    where = town((rectangle(0.0, 0.0, 20.0, 8.0), 12.0))
    faces = city_faces(where)
    scenery = Scenery.of(where, faces, by_voxels=False)
    surface = surface_of(where, faces, scenery, "house 0", 0.5)
    views = Views.towards(
        np.array([[10.0, -8.0, 6.0], [10.0, 4.0, 20.0]]), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    )
    found = find_sights(views, surface, scenery, CAMERA, LIMITS)
    np.testing.assert_allclose(found.resolution, CAMERA.ground_sample_distance(8.0), rtol=1e-4)
    width, height = CAMERA.footprint(8.0)
    areas = [surface.areas[found.point[found.photo == k]].sum() for k in range(2)]
    assert areas[0] == pytest.approx(width * height, rel=0.08)
    assert areas[1] == pytest.approx(8.0 * width, rel=0.08)


def test_no_order_or_number_of_views_matters() -> None:
    """Views one by one give what they give together."""
    where = houses()
    faces = city_faces(where)
    scenery = Scenery.of(where, faces, by_voxels=False)
    surface = surface_of(where, faces, scenery, "house 0", 1.5)
    views = some_views(surface, np.random.default_rng(1), 20)
    together = find_sights(views, surface, scenery, CAMERA, LIMITS).matrix.toarray()
    for k in (0, 3, len(views) - 1):
        alone = find_sights(views.some(np.array([k])), surface, scenery, CAMERA, LIMITS).matrix.toarray()
        assert (alone[0] != together[k]).sum() <= 1


@pytest.mark.parametrize(("incidence", "resolution"), [(0.0, 0.01), (90.0, 0.01), (60.0, 0.0), (math.nan, 0.01)])
def test_limits_that_are_none(incidence: float, resolution: float) -> None:
    """An angle from 0 to 90 degrees, and a positive side."""
    with pytest.raises(ValueError, match="expected"):
        SightLimits(incidence, resolution)


def test_a_building_of_the_hague_by_c_mujoco(data: Path) -> None:
    """Among 46,305 faces of other houses and the terrain."""
    where = maxjax.load_map(
        data / "the_hague" / "DenHaag_01.city.json", spacing=2.0, bounds=(78240, 457590, 0, 79030, 458270, 60)
    )
    faces = city_faces(where)
    scenery = Scenery.of(where, faces, by_voxels=False)
    surface = surface_of(where, faces, scenery, "GUID_16E64847-3529-4640-9C4A-8FF9EEBA3F0F", 2.0)
    views = some_views(surface, np.random.default_rng(2), 120)
    given = find_sights(views, surface, scenery, CAMERA, LIMITS).matrix.toarray().astype(bool)
    middle = surface.points.mean(axis=0)
    triangles = np.concatenate([faces.triangles, faces.terrain])
    near = (np.abs(triangles - middle).max(axis=2) < 150.0).any(axis=1)
    model = ray_model(triangles[near] - middle)
    within, _ = framed(views, surface, LIMITS)
    wrong = asked_of = 0
    for k, place in enumerate(views.position):
        asked = np.flatnonzero(within[k])
        expected = hits(model, place - middle, surface.points[asked] - middle) <= TOUCH
        wrong += int((given[k, asked] != expected).sum())
        asked_of += len(asked)
    assert asked_of > 1500
    assert wrong <= 0.01 * asked_of
