"""Viewpoints: what they promise, judged by C MuJoCo's rays and by the verifier; what cannot be seen is named."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.core.status import Closure
from maxjax.inspection.candidates import Aim, spread
from maxjax.inspection.capture import Capture
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import TOUCH, Scenery
from maxjax.inspection.target_surface import city_faces, surface_of
from maxjax.inspection.viewpoints import Viewpoints, find_viewpoints
from tests.inspection.towns import hits, ray_model, rectangle, town

CAMERA = Camera.named("DJI M3E")
SPARE = Capture(distance=8.0, overlap=(0.5, 0.0))


def viewpoints(
    where: maxjax.VoxelMap, target: object, capture: Capture = SPARE, camera: Camera = CAMERA, radius: float = 1.5
) -> Viewpoints:
    """Those of a target in a town."""
    faces = city_faces(where)
    scenery = Scenery.of(where, faces, by_voxels=False)
    surface = surface_of(where, faces, scenery, target, 1.0)  # type: ignore[arg-type]
    return find_viewpoints(Aim(surface, FreeSpace.of(where, radius), camera, capture), scenery)


@pytest.fixture(scope="module")
def tower() -> tuple[maxjax.LoadedMap, Viewpoints]:
    """A tower with a lower house beside it."""
    where = town((rectangle(0.0, 0.0, 16.0, 12.0), 20.0), (rectangle(19.0, 0.0, 30.0, 12.0), 9.0))
    return where, viewpoints(where, "house 0")


def test_each_place_keeps_the_radius_and_looks_where_the_gimbal_can(
    tower: tuple[maxjax.LoadedMap, Viewpoints],
) -> None:
    """By the verifier, place by place."""
    where, found = tower
    for place in found.views.position:
        assert maxjax.verify(place[None], where, radius=1.5).ok
    low, high = np.radians(CAMERA.gimbal)
    assert (found.views.pitch >= low).all()
    assert (found.views.pitch <= high).all()


def test_coverage_by_c_mujoco(tower: tuple[maxjax.LoadedMap, Viewpoints]) -> None:
    """Counted again with other rays and another projection: the same photos of each point, but for borders."""
    where, found = tower
    faces = city_faces(where)
    model, surface = ray_model(faces.triangles), found.coverage.surface
    tall, limit = np.array(CAMERA.half_tangents), found.coverage.limit
    counts = np.zeros(len(surface), int)
    for place, axes in zip(found.views.position, found.views.axes, strict=True):
        way = surface.points - place
        x, y, depth = axes @ way.T
        with np.errstate(divide="ignore", invalid="ignore"):
            inside = (depth > 0) & (np.abs(x / depth) <= tall[0]) & (np.abs(y / depth) <= tall[1])
            cosine = -np.einsum("nk,nk->n", way, surface.normals) / np.linalg.norm(way, axis=1)
        # A bound from above on the side of a pixel: at 8 m the limit is met by all within 60 degrees.
        inside &= (cosine >= 0.5) & (depth * CAMERA.pixel_angle <= limit)
        asked = np.flatnonzero(inside)
        counts[asked[hits(model, place, surface.points[asked]) <= TOUCH]] += 1
    assert (found.coverage.counts <= counts).mean() > 0.99
    assert surface.areas[counts == 0].sum() <= found.coverage.surface.areas[found.coverage.counts == 0].sum() + 1e-9
    assert found.coverage.share() > 0.97


def test_as_many_views_as_the_overlap_asks_for(tower: tuple[maxjax.LoadedMap, Viewpoints]) -> None:
    """Half of the next photo forward: two views of nearly all; never fewer photos than the bound."""
    _, found = tower
    assert found.coverage.wanted == 2
    assert found.coverage.share(2) > 0.95
    assert found.least <= len(found.views) <= 1.15 * found.least + 2


def test_what_cannot_be_seen_is_named_with_its_area(tower: tuple[maxjax.LoadedMap, Viewpoints]) -> None:
    """In the gap of 3 m, below the neighbour's roof: all that no photo shows is told, and nothing else."""
    _, found = tower
    coverage = found.coverage
    lost = coverage.surface.areas[coverage.counts == 0].sum()
    assert lost > 1.0
    assert sum(one.area for one in coverage.unseen) == pytest.approx(lost)
    largest = coverage.unseen[0]
    assert largest.place[0] == pytest.approx(16.0, abs=0.1)
    assert largest.place[2] < 9.0
    assert "m² of façade of house 0" in str(largest)


def test_closed_air_is_the_reason() -> None:
    """A house whose northern side looks into an area that is closed: its façade there is named so."""
    where = town((rectangle(0.0, 0.0, 10.0, 10.0), 10.0))
    reasons = np.zeros(where.grid.shape, np.uint8)
    reasons[:, int((11.0 - where.grid.lower[1]) / where.grid.spacing) :] = Closure.AREA
    found = viewpoints(where.closing(reasons), "house 0")
    closed = [one for one in found.coverage.unseen if one.reason == "closed"]
    assert sum(one.area for one in closed) > 60.0
    assert closed[0].place[1] == pytest.approx(10.0, abs=0.1)


def test_nothing_that_can_be_seen() -> None:
    """A court that is too narrow for the radius: a sentence with the area."""
    walls = (rectangle(-3.0, 0.0, 0.0, 10.0), rectangle(2.0, 0.0, 5.0, 10.0))
    where = town(*((wall, 30.0) for wall in walls), sky=0.5)
    with pytest.raises(ValueError, match=r"to be seen from where may be flown: \d+\.\d m² of façade"):
        viewpoints(where, ((-0.1, 4.0, 1.0), (0.1, 6.0, 8.0)))


def test_a_camera_that_cannot_look_down() -> None:
    """With a level gimbal the walls are seen and the roof is named."""
    level = Camera("level", (4000, 3000), field_of_view=60.0, gimbal=(0.0, 0.0))
    found = viewpoints(town((rectangle(0.0, 0.0, 10.0, 10.0), 10.0)), "house 0", camera=level)
    assert (found.views.pitch == 0.0).all()
    roof = found.coverage.surface.roof
    assert found.coverage.counts[roof].max() == 0
    assert found.coverage.surface.areas[~roof & (found.coverage.counts > 0)].sum() > 300.0


def test_points_that_are_aimed_at_lie_apart() -> None:
    """One a cell and direction: about the area over the square of the distance."""
    where = town((rectangle(0.0, 0.0, 20.0, 20.0), 10.0))
    faces = city_faces(where)
    surface = surface_of(where, faces, Scenery.of(where, faces, by_voxels=False), "house 0", 0.5)
    rows = spread(surface, 2.0)
    assert 1.0 <= len(rows) / (surface.area / 4.0) < 1.6


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"overlap": (1.0, 0.5)}, "below 1, given"),
        ({"overlap": (0.5, 1.5)}, "below 1, given"),
        ({"overlap": (-0.1, 0.5)}, "from 0 on"),
        ({"overlap": (0.5, float("nan"))}, "below 1"),
        ({"distance": 0.0}, "positive number of metres, given 0.0"),
        ({"incidence": 90.0}, "between 0 and 90"),
        ({"resolution": -1.0}, "positive"),
    ],
)
def test_captures_that_are_none(options: dict[str, object], said: str) -> None:
    """A sentence with the number."""
    with pytest.raises(ValueError, match=said):
        Capture(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("overlap", "views"),
    [((0.0, 0.0), 1), ((0.5, 0.0), 2), ((0.7, 0.6), 6), ((0.8, 0.8), 25), ((0.75, 0.5), 8), ((0.9, 0.6), 20)],
)
def test_views_of_rows_that_overlap(overlap: tuple[float, float], views: int) -> None:
    """Counted in a lattice of photos with these overlaps: each point away from the border is in so many at least."""
    steps = 1.0 - np.array(overlap)
    starts = [np.arange(-2.0, 2.0, step) for step in steps]
    rng = np.random.default_rng(0)
    counts = [
        np.prod([((start <= x) & (x < start + 1.0 - 1e-12)).sum() for start, x in zip(starts, point, strict=True)])
        for point in rng.uniform(0.0, 1.0, (400, 2))
    ]
    assert Capture(overlap=overlap).views == views
    assert min(counts) == views
