"""From questions to scenes, without a browser: what is drawn is what was planned, in the page's own frame."""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import maxjax
from maxjax.core.terrain import Terrain
from maxjax.io.airspace.airspace import Area
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.page import download
from maxjax.ui.page.air import air_scene
from maxjax.ui.page.answer import answer, describe_answer
from maxjax.ui.page.colors import CLEARANCES, ramp
from maxjax.ui.page.controls import add_controls, place_text, text_place
from maxjax.ui.page.download import file_of, page_of
from maxjax.ui.page.draw import answer_scene, city_scene, ends_scene
from maxjax.ui.page.nodes import Lines, Surface
from maxjax.ui.page.page_map import City, first_ends, hit
from maxjax.ui.page.slices import Field, Slice, picture
from maxjax.ui.page.waypoint_editor import Ground, WaypointEditor
from maxjax.ui.page.worker import Worker
from maxjax.ui.request import Request
from tests.ui.page.test_surface import area_vectors

if TYPE_CHECKING:
    from viser import GuiApi

FAR = (233_000.0, 581_000.0, 0.0)  # national coordinates


asked = functools.partial(Request.between, "town")


def town(origin: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> City:
    """A street of 60 m between two blocks, on a floor of one voxel."""
    occupied = np.zeros((33, 33, 25), bool)
    occupied[:, :, 0] = True
    occupied[8:14, 8:25, 1:14] = True
    occupied[20:26, 8:25, 1:9] = True
    ground = np.zeros_like(occupied)
    ground[:, :, 0] = True
    return City("town", maxjax.VoxelMap.of(occupied, spacing=2.0, origin=origin, ground=ground))


def listed(request: Request) -> Callable[[GuiApi], WaypointEditor]:
    """Fields of a request's waypoints on a page of their own."""
    ground = Ground(None, town().terrain)
    return lambda gui: WaypointEditor(gui, request.stops, ground, lambda _: None, lambda _: None)


def test_the_path_drawn_is_the_plan_and_its_colours_are_its_clearances() -> None:
    city = town(FAR)
    ends = tuple((FAR[0] + x, FAR[1] + y, FAR[2] + z) for x, y, z in ((8.0, 10.0, 10.0), (58.0, 50.0, 12.0)))
    found = answer(city, asked(*ends))  # type: ignore[arg-type]
    plan = maxjax.plan(city.voxels, *ends)
    assert found.ok
    assert found.mission is not None
    np.testing.assert_array_equal(found.mission.path, plan.path)
    line = answer_scene(found, city.frame)["/plan/path"]
    assert isinstance(line, Lines)
    drawn = np.concatenate([line.points[:, 0], line.points[-1:, 1]]) + city.frame.anchor
    np.testing.assert_allclose(drawn, found.dense, atol=1e-6)
    assert np.abs(line.points).max() < 100.0  # small numbers, whatever the map's coordinates are
    step = np.linalg.norm(np.diff(found.dense, axis=0), axis=1)
    assert step.max() <= 0.5 * city.grid.spacing + 1e-9
    assert step.sum() == pytest.approx(plan.length)
    np.testing.assert_array_equal(line.colors[:, 0], ramp(CLEARANCES, found.clearance[:-1] / 8.0))
    assert "Verified path, certified" in describe_answer(found)
    assert f"{plan.length:.1f} m" in describe_answer(found)


def test_a_waypoint_is_on_the_path_and_astar_beside_it() -> None:
    city = town()
    found = answer(city, asked((8.0, 10.0, 10.0), (34.0, 40.0, 20.0), (58.0, 50.0, 12.0), beside=True))
    assert found.ok
    assert np.abs(found.dense - (34.0, 40.0, 20.0)).sum(axis=1).min() < 1e-9
    assert {"/plan/path", "/plan/astar"} == set(answer_scene(found, city.frame))
    assert "A\\* beside it" in describe_answer(found)
    assert found.beside is not None
    assert f"Blue: A*, {found.beside.length:.1f} m" in page_of(city, found)


def test_the_ground_that_a_file_counts_from_is_measured_or_left_to_its_judge(monkeypatch: pytest.MonkeyPatch) -> None:
    """Voxels tell the ground to two metres: nothing is said of it then."""
    told = []

    def written(file: Path, *_: object, ground: float | None, **__: object) -> None:
        told.append(ground)
        file.write_text("")

    monkeypatch.setattr(download, "export", written)
    city = town()
    found = answer(city, asked((8.0, 10.0, 10.0), (58.0, 50.0, 12.0)))
    for measured in (None, Terrain.flat(1.75, city.grid)):
        file_of(dataclasses.replace(city, measured=measured), None, ".csv", found)
    assert told == [None, 1.75]


def test_of_a_gap_that_is_too_narrow_the_widest_radius_is_told() -> None:
    """Between the blocks the street is 12 m wide; a wall across it leaves a gap of one voxel."""
    occupied = np.array(town().occupied)
    occupied[:, 16, :] = True
    occupied[16, 16, 1:] = False
    gap = City("gap", maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(1.0, 1.0, 1.0)))
    found = answer(gap, asked((34.0, 20.0, 10.0), (34.0, 50.0, 10.0), radius=2.0, method="astar"))
    assert "**NO_SAFE_PATH**" in describe_answer(found)
    assert "At most a radius of 1 m joins them." in describe_answer(found)


def test_a_path_keeps_the_altitude_band() -> None:
    city = town()
    ends = ((8.0, 40.0, 12.0), (58.0, 40.0, 12.0))
    above = ((8.0, 40.0, 12.0), (22.0, 30.0, 36.0), (58.0, 40.0, 12.0))
    kept = answer(city, asked(*ends, floor=4.0, ceiling=14.0))
    assert kept.ok
    assert kept.dense[:, 2].min() >= 2.0 + 4.0
    assert kept.dense[:, 2].max() <= 2.0 + 14.0
    assert answer(city, asked(*above)).ok
    assert not answer(city, asked(*above, floor=4.0, ceiling=14.0)).ok
    bare = City("bare", maxjax.VoxelMap.on(city.grid, city.occupied))
    assert "ground" in describe_answer(answer(bare, kept.request))


def test_the_rules_drawn_are_those_that_were_planned_by() -> None:
    """An area to keep out of as a box, from the ground to its ceiling; sheets that end at the band; all see-through."""
    square = np.array([(29.0, 3.0), (37.0, 3.0), (37.0, 13.0), (29.0, 13.0)])
    all_of_it = np.array([(0.0, 0.0), (66.0, 0.0), (66.0, 66.0), (0.0, 66.0)])
    areas = (Area("'yard'", (square,), ceiling=20.0), Area("town", (all_of_it,), keep_in=True))
    city = dataclasses.replace(town(), areas=areas, above_start=10.0)
    assert not (air_scene(town(), asked((8.0, 10.0, 10.0), (58.0, 50.0, 12.0))))
    found = answer(city, asked((8.0, 8.0, 10.0), (58.0, 8.0, 12.0), method="astar", margin=2.0, floor=4.0))
    assert found.ok
    scene = air_scene(city, found.request)
    names = {"/air/area_0/volume", "/air/area_0/name", "/air/area_1/volume", "/air/area_1/name", "/air/floor"}
    assert set(scene) == {*names, "/air/ceiling"}
    yard = scene["/air/area_0/volume"]
    assert isinstance(yard, Surface)
    low, high = (city.frame.map(edge) for edge in (yard.points.min(axis=0), yard.points.max(axis=0)))
    # Whole voxels of 2 m that the area touches, above the ground's at z = 2; heights count from its lower face.
    np.testing.assert_allclose([low, high], [(28.0, 2.0, 2.0), (38.0, 14.0, 22.0)])
    assert scene["/air/area_0/name"].text == "yard: keep out"
    assert scene["/air/area_1/name"].text == "town: keep in"
    for name, level in (("/air/floor", 2.0 + 4.0), ("/air/ceiling", 10.0 + 10.0)):
        assert scene[name].points[:, 2].max() + city.frame.anchor[2] == level
    assert all(node.opacity < 0.5 for node in scene.values() if isinstance(node, Surface))
    inside = ((found.dense > low) & (found.dense < high)).all(axis=1)
    assert not inside.any()
    page = page_of(city, found)
    for words in ("Red: keep out of yard", "Green: keep in town", "from 4 m above ground, to 10 m above the start"):
        assert words in page


def test_the_panel_asks_what_was_asked_first_until_it_is_moved() -> None:
    """Distances and heights beyond the sliders' usual ends stay what they are."""
    viser = pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")
    stops = (Waypoint((8.0, 10.0, 10.0)), Waypoint((58.0, 50.0, 90.0), hover=2.0, speed=3.0, radius=0.3))
    first = Request(
        map="town", waypoints=stops, method="astar", radius=40.1, margin=55.3, ceiling=200.5, speed=7.0, price="speed:2"
    )
    server = viser.ViserServer(port=0, verbose=False)
    try:
        controls = add_controls(server.gui, town(), first, listed(first), on_earth=False, dark=False)
        assert controls.request(first.stops) == first
        controls.band.value = (10.0, controls.band.max)
        assert controls.request(first.stops).altitudes == (10.0, None)
        controls.band.value = (0.0, 30.0)
        assert controls.request(first.stops).altitudes == (None, 30.0)
    finally:
        server.stop()


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (asked((20.0, 30.0, 10.0), (58.0, 50.0, 12.0)), "START_OCCUPIED"),
        (asked((8.0, 10.0, 10.0), (58.0, 50.0, 90.0)), "GOAL_OUTSIDE_MAP"),
        (asked((8.0, 10.0, 10.0), (58.0, 50.0, 12.0), radius=200.0, margin=200.0), "radius: expected at most"),
    ],
)
def test_where_there_is_no_path_nothing_is_drawn_and_words_say_why(wanted: Request, words: str) -> None:
    city = town()
    found = answer(city, wanted)
    assert not found.ok
    assert answer_scene(found, city.frame) == {}
    assert words in describe_answer(found)


def test_the_map_drawn_is_what_is_seen_of_it() -> None:
    city = town()
    scene = city_scene(city)
    assert set(scene) == {"/map/ground", "/map/obstacles"}
    obstacles = scene["/map/obstacles"]
    assert isinstance(obstacles, Surface)
    # Two blocks of 6 x 17 voxels, 13 and 8 high, on the ground: four walls and a roof each, a quad of two triangles.
    assert len(obstacles.faces) == 2 * 5 * 2
    walls = 2.0 * 2.0 * (2 * 6 * 17 + 2 * (6 + 17) * (13 + 8))
    assert np.linalg.norm(area_vectors(obstacles), axis=1).sum() == pytest.approx(walls)
    assert len(ends_scene(((0.0, 0.0, 0.0),) * 3, city.frame)) == 6


def test_first_ends_are_free_and_a_ray_meets_roofs_and_ground() -> None:
    city = town()
    start, goal = first_ends(city)
    assert (
        maxjax.plan(maxjax.VoxelMap.on(city.grid, city.occupied, city.ground), start, goal).status == maxjax.Status.OK
    )
    roof = hit(city, (22.0, 30.0, 200.0), (0.0, 0.0, -1.0))
    assert roof is not None
    assert roof[2] == pytest.approx(28.0, abs=0.5)
    floor = hit(city, (4.0, 4.0, 200.0), (0.0, 0.0, -2.0))
    assert floor is not None
    assert floor[2] == pytest.approx(2.0, abs=0.5)
    assert hit(city, (4.0, 4.0, 200.0), (0.0, 0.0, 1.0)) is None


@pytest.mark.parametrize(("axis", "number"), [("x", 0), ("y", 1), ("z", 2)])
def test_a_slice_stands_where_its_voxels_are(axis: str, number: int) -> None:
    """Its upper right pixels are those of the highest voxels along both axes."""
    city = town()
    cost = np.full(city.grid.shape, np.nan)
    corner = [-1, -1, -1]
    corner[number] = 5
    cost[tuple(corner)] = 3.0
    plane = picture(Field(cost, np.ones_like(cost)), Slice("cost", axis, 5), city.grid, city.frame)  # type: ignore[arg-type]
    shown = plane.pixels[..., 3] > 0
    rows, columns = np.nonzero(shown)
    assert rows.max() < 10
    assert columns.min() >= shown.shape[1] - 10
    assert plane.position[number] == pytest.approx(city.frame.page(city.grid.origin)[number] + 2.0 * 5)
    assert (plane.width, plane.height) == tuple(2.0 * np.delete(city.grid.shape, number))


@pytest.mark.parametrize("place", [(84123.456, 447020.0, 12.5), (-0.001, 1e-9, 3.0), (123456.789, -987654.321, 0.0)])
def test_a_place_is_shown_whole_and_read_as_it_is_shown(place: tuple[float, float, float]) -> None:
    shown = place_text(place)
    assert "e" not in shown
    np.testing.assert_allclose(text_place(shown), place, atol=5e-4, rtol=0.0)
    for unfinished in ("", "1, 2", "1, 2, x", "1 2 3 4", "nan 0 0"):
        assert text_place(unfinished) is None


def test_only_the_latest_question_is_answered() -> None:
    gate, done = threading.Event(), list[int]()

    def work(request: int) -> None:
        gate.wait(10.0)
        done.append(request)

    worker = Worker(work)
    worker.ask(0)
    while worker.stale:
        pass
    for request in range(1, 50):
        worker.ask(request)
    gate.set()
    assert worker.rest(10.0)
    assert done == [0, 49]
    worker.close()
