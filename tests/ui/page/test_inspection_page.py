"""Inspections of a page without a browser: what is drawn is what was inspected, told and written."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax.inspection.target_surface import city_faces
from maxjax.inspection.targets import choose
from maxjax.io.airspace.airspace import Area
from maxjax.io.geo.earth import TangentPlane
from maxjax.ui.page.building_inspector import BuildingInspector
from maxjax.ui.page.colors import FAILED, NO_SURFACE
from maxjax.ui.page.download import inspection_files
from maxjax.ui.page.inspection_answer import (
    InspectionAnswer,
    InspectionRequest,
    describe_inspection,
    inspect_building,
)
from maxjax.ui.page.inspection_controls import add_answer, add_inspection
from maxjax.ui.page.inspection_scene import PhotographedFaces, inspection_scene, photo_colors, without_building
from maxjax.ui.page.nodes import Dots, Lines, Surface
from maxjax.ui.page.page_map import City, building_at
from maxjax.ui.request import Request
from tests.inspection.towns import rectangle, town
from tests.ui.page.test_surface import area_vectors

IMAGE_START_CAPTURE = 2000  # of MAVLink
HOUSE, HEIGHT = (0.0, 0.0, 12.0, 9.0), 14.0
RULES = Request(map="town", radius=1.5)
ASKED = InspectionRequest((6.0, 4.0), None, "DJI M3E", maxjax.Capture(8.0, (0.3, 0.3)), RULES)


@functools.cache
def city() -> City:
    """A house of 12 x 9 x 14 m with a lower one 8 m beside it."""
    return City("town", town((rectangle(*HOUSE), HEIGHT), (rectangle(20.0, 0.0, 26.0, 9.0), 6.0)))


@functools.cache
def found() -> InspectionAnswer:
    """The inspection of the house."""
    return inspect_building(city(), ASKED)


@functools.cache
def faces() -> PhotographedFaces:
    """Its faces."""
    return PhotographedFaces.of(city().voxels, ASKED.place, found().verified.coverage)


def test_a_click_on_a_wall_or_a_roof_names_the_building() -> None:
    """A ray ends within the voxels that it meets, not before them, where another building may be nearer."""
    built = (city().occupied & ~city().ground).any(axis=2)
    for origin, direction in (((-20.0, 4.0, 5.0), (1.0, 0.0, 0.0)), ((6.0, -20.0, 40.0), (0.0, 0.6, -0.7))):
        place = building_at(city(), origin, direction)
        assert place is not None
        i, j = np.floor((np.array(place) - city().grid.lower[:2]) / city().grid.spacing).astype(int)
        assert built[i, j]
        assert choose(city_faces(city().voxels), place).name == "house 0"
    assert building_at(city(), (0.0, 0.0, 50.0), (0.0, 0.0, 1.0)) is None


def test_the_inspection_is_that_of_the_library() -> None:
    same = maxjax.inspect(
        city().voxels, "house 0", "DJI M3E", capture=ASKED.capture, distances=maxjax.Distances(radius=1.5)
    )
    np.testing.assert_array_equal(found().verified.photos.position, same.photos.position)
    np.testing.assert_array_equal(found().verified.mission.path, same.mission.path)
    flight = maxjax.trajectory(same.mission, RULES.limits)
    assert found().duration == pytest.approx(flight.duration)
    words = describe_inspection(found())
    for said in (f"{len(same.photos)} photos", f"{flight.duration:.0f} s", f"{100 * same.coverage.share():.1f} %"):
        assert said in words


def test_the_faces_drawn_are_the_house_once_each_with_the_photos_that_show_it() -> None:
    """Walls, roof and floor as the outline has them; a count is that of a point on the same side, close by."""
    x0, y0, x1, y1 = HOUSE
    scene = inspection_scene(faces(), found().verified, city().frame)
    drawn = scene["/inspection/surface"]
    assert isinstance(drawn, Surface)
    vectors = area_vectors(drawn)
    level = (x1 - x0) * (y1 - y0)
    assert vectors[:, 2].clip(min=0.0).sum() == pytest.approx(level, rel=1e-4)
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(
        2.0 * level + HEIGHT * 2.0 * (x1 - x0 + y1 - y0), rel=1e-4
    )
    middle, coverage = faces().pieces.mean(axis=1), found().verified.coverage
    outward = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    inside = middle - 0.1 * outward
    assert ((inside > (x0, y0, -0.1)) & (inside < (x1, y1, HEIGHT))).all()
    floor = outward[:, 2] < -0.5
    assert np.isnan(faces().photos[floor]).all()
    assert not np.isnan(faces().photos[~floor]).any()
    for k in np.flatnonzero(~floor)[::97]:
        same = coverage.surface.normals @ outward[k] > 0.99
        near = np.linalg.norm(coverage.surface.points - middle[k], axis=1) < 2.5
        assert faces().photos[k] in coverage.counts[same & near]


def test_viewpoints_and_flights_are_drawn_where_they_are() -> None:
    scene, photos = inspection_scene(faces(), found().verified, city().frame), found().verified.photos
    places, sights, line = (scene[f"/inspection/{name}"] for name in ("places", "sights", "flight_1"))
    assert isinstance(places, Dots)
    assert isinstance(sights, Lines)
    assert isinstance(line, Lines)
    np.testing.assert_allclose(city().frame.map(places.points), photos.position)
    way = sights.points[:, 1] - sights.points[:, 0]
    level = np.cos(photos.pitch)
    looks = np.stack([level * np.cos(photos.yaw), level * np.sin(photos.yaw), np.sin(photos.pitch)], axis=1)
    np.testing.assert_allclose(way / np.linalg.norm(way, axis=1, keepdims=True), looks, atol=1e-9)
    np.testing.assert_allclose(city().frame.map(line.points[:, 0]), found().verified.mission.path[:-1], atol=1e-9)


def test_colours_tell_none_few_many_and_no_surface_apart() -> None:
    colors = photo_colors(np.array([np.nan, 0.0, 1.0, 2.0, 4.0, 9.0]), 4)
    assert tuple(colors[0]) == NO_SURFACE
    assert tuple(colors[1]) == FAILED
    assert len(np.unique(colors, axis=0)) == 5
    np.testing.assert_array_equal(colors[4], colors[5])


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_the_map_is_drawn_without_the_voxels_of_the_house_alone(shift: float) -> None:
    """All that touch it, nothing of the lower one, and no ground; its walls lie in voxels or between two of them."""
    outline = rectangle(*(edge + shift for edge in HOUSE))
    whole = City("town", town((outline, HEIGHT), (rectangle(20.0, 0.0, 26.0, 9.0), 6.0)))
    coverage, grid = found().verified.coverage, whole.grid
    left = without_building(whole, PhotographedFaces.of(whole.voxels, "house 0", coverage))
    gone, rest = (
        np.array(grid.lower[:2]) + grid.spacing * np.argwhere(volume)[:, :2]
        for volume in (whole.occupied & ~left.occupied, left.occupied & ~left.ground)
    )
    assert (gone + grid.spacing >= outline[0]).all()
    assert (gone <= outline[2]).all()
    touches = (rest + grid.spacing >= outline[0]).all(axis=1) & (rest <= outline[2]).all(axis=1)
    assert len(rest)
    assert not touches.any()
    np.testing.assert_array_equal(left.ground, whole.ground)


def test_rules_of_the_air_hold_and_a_refusal_is_told() -> None:
    """No viewpoint above the band; where nothing is open, or no building stands, a sentence says so."""
    low = dataclasses.replace(ASKED, rules=dataclasses.replace(RULES, ceiling=12.0))
    assert inspect_building(city(), low).verified.photos.position[:, 2].max() <= 12.0
    everywhere = Area("all", (rectangle(-30.0, -30.0, 60.0, 40.0),))
    closed = inspect_building(dataclasses.replace(city(), areas=(everywhere,)), ASKED)
    assert "closed by the rules of the air" in describe_inspection(closed)
    with pytest.raises(ValueError, match="closed by the rules"):
        closed.verified  # noqa: B018 (raises)
    nothing = inspect_building(city(), dataclasses.replace(ASKED, place=(-20.0, 30.0)))
    assert "### Cannot be inspected\ntarget: expected a building at x -20, y 30" in describe_inspection(nothing)
    alone = dataclasses.replace(ASKED, home=(-14.0, 4.0, 6.0))
    assert inspect_building(city(), alone).verified.mission.waypoints[0].position == (-14.0, 4.0, 6.0)


def test_what_is_downloaded_is_the_flight_with_its_photos() -> None:
    """Set-points as long as the flight; a mission's file holds a shutter command for each photo."""
    ((name, content),), said = inspection_files(city(), None, ".csv", found(), RULES)
    assert name == "inspection.csv"
    assert float(content.decode().splitlines()[-1].split(",")[0]) == pytest.approx(found().duration, abs=0.1)
    assert "holds no photos" in said
    (plan,), said = inspection_files(city(), TangentPlane(51.0, 4.0, 10.0), ".plan", found(), RULES)
    count = len(found().verified.photos)
    shutters = [item for item in json.loads(plan[1])["mission"]["items"] if item["command"] == IMAGE_START_CAPTURE]
    assert len(shutters) == count
    assert f"as flown {count} photos: " in said
    with pytest.raises(ValueError, match="no building was inspected"):
        inspection_files(city(), None, ".csv", None, RULES)


@pytest.fixture
def gui() -> Iterator[Any]:
    viser = pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")
    server = viser.ViserServer(port=0, verbose=False)
    yield server.gui
    server.stop()


def test_the_building_is_inspected_again_when_something_of_it_changes(gui: Any) -> None:
    """The camera does; where the path goes to does not."""
    controls = add_inspection(gui, add_answer(gui), (".csv",))
    shown = list[set[str]]()
    inspector = BuildingInspector(city(), controls, lambda scene, _: shown.append(set(scene)))
    start, goal, other = (-15.0, -15.0, 10.0), (40.0, 20.0, 10.0), (30.0, 25.0, 10.0)
    controls.distance.value, controls.forward.value, controls.sideways.value = 8.0, 30.0, 30.0

    def ask(goal: tuple[float, float, float]) -> None:
        inspector.ask(dataclasses.replace(RULES, waypoints=tuple(map(maxjax.Waypoint, (start, goal)))))
        assert inspector.worker.rest(120.0)

    ask(goal)
    assert shown == []
    inspector.choose(ASKED.place, Request.between("town", start, goal, radius=1.5))
    ask(goal)
    assert len(shown) == 1
    assert inspector.answer is not None
    assert inspector.answer.request == ASKED
    assert "Inspection of house 0" in controls.status.content
    ask(other)
    assert len(shown) == 1
    controls.from_start.value = True
    ask(other)
    assert len(shown) == 2
    assert inspector.answer.verified.mission.waypoints[0].position == start
    inspector.worker.close()
