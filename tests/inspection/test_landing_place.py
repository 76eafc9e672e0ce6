"""Places to land on roofs: by distances to the rectangles that the town is made of, and in files that land there."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax.inspection.landing_place import Landing, find_landing
from maxjax.inspection.upright_lines import find_topmost
from tests.inspection.towns import rectangle, town

ROOF = (0.0, 0.0, 24.0, 16.0)
HUT = (3.0, 3.0, 9.0, 9.0)
TOWER = (26.0, 0.0, 36.0, 16.0)  # 2 m beside the roof, and higher
CITY = town((rectangle(*ROOF), 10.0), (rectangle(*HUT), 13.0), (rectangle(*TOWER), 30.0))
EARTH = maxjax.TangentPlane(52.0, 4.0, 0.0)


def to_outline(x: float, y: float, box: tuple[float, float, float, float]) -> float:
    """Distance from a place within a rectangle to its sides."""
    return min(x - box[0], box[2] - x, y - box[1], box[3] - y)


def to_box(x: float, y: float, box: tuple[float, float, float, float]) -> float:
    """Distance from a place outside of a rectangle to it."""
    return math.hypot(max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3]))


def free(x: float, y: float) -> float:
    """Distance of a place on the roof to all that is not flat roof, exactly."""
    return min(to_outline(x, y, ROOF), to_box(x, y, HUT), to_box(x, y, TOWER))


def test_the_spot_is_the_freest_of_a_flat_roof() -> None:
    """No place of a fine grid is freer by more than the spacing of its samples, and what it tells is not too much."""
    place = find_landing(CITY, "house 0")
    x, y, z = place.position
    most = max(free(a, b) for a in np.arange(0.0, 24.0, 0.1) for b in np.arange(0.0, 16.0, 0.1))
    assert z == 10.0
    assert place.slope == 0.0
    assert place.clear <= free(x, y) + 1e-6
    assert free(x, y) >= most - 0.5
    assert place.clear >= most - 1.0
    assert place.edge <= to_outline(x, y, ROOF) + 1e-6
    by_place = find_landing(CITY, (20.0, 12.0))
    assert by_place.position == place.position


def test_what_is_asked_is_kept_or_refused_with_numbers() -> None:
    """Where no spot is as clear, or as far from the edge, the sentence names what was found and what was asked."""
    most = find_landing(CITY, "house 0").clear
    with pytest.raises(ValueError, match=rf"expected 9 m of clear roof .* found {most:.1f} m at most"):
        find_landing(CITY, "house 0", Landing(radius=9.0))
    with pytest.raises(ValueError, match="expected a place to land 9 m from the edge of its roof, found"):
        find_landing(CITY, "house 0", Landing(radius=1.5, edge=9.0))
    with pytest.raises(ValueError, match="expected a building of the map, given 'house 7'"):
        find_landing(CITY, "house 7")
    for wrong in ({"radius": 0.0}, {"slope": 50.0}, {"edge": -1.0}, {"height": math.nan}):
        with pytest.raises(ValueError, match=f"Landing.{next(iter(wrong))}: expected"):
            Landing(**wrong)


def test_sloping_roofs_are_refused_and_ridges_are_no_flat_places(tmp_path: Path) -> None:
    """A gable of 10 degrees: level on average at its ridge, and nowhere flatter than 10 degrees."""
    rise = 10.0 * math.tan(math.radians(10.0))
    corners = [(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0), (0, 0, 8), (20, 0, 8), (20, 20, 8), (0, 20, 8)]
    ridge = [(10, 0, 8 + rise), (10, 20, 8 + rise)]
    faces = [(1, 4, 3, 2), (1, 2, 6, 9, 5), (3, 4, 8, 10, 7), (2, 3, 7, 6), (4, 1, 5, 8), (5, 9, 10, 8), (9, 6, 7, 10)]
    text = [f"v {x} {y} {z}" for x, y, z in [*corners, *ridge]] + ["f " + " ".join(map(str, face)) for face in faces]
    (tmp_path / "gable.obj").write_text("\n".join(text) + "\n")
    house = maxjax.load_map(str(tmp_path / "gable.obj"), spacing=1.0, ground=0.0)
    with pytest.raises(ValueError, match=r"no steeper than 5 degrees, found no place flatter than 10\.0 degrees"):
        find_landing(house, (5.0, 10.0))
    place = find_landing(house, (5.0, 10.0), Landing(slope=12.0))
    assert place.slope == pytest.approx(10.0, abs=0.01)
    assert place.position[2] == pytest.approx(8.0 + rise - abs(place.position[0] - 10.0) * rise / 10.0, abs=1e-6)


def test_topmost_faces_are_those_of_the_highest_box() -> None:
    """By the heights of the boxes that stand at each place."""
    from maxjax.inspection.target_surface import city_faces

    faces, places = city_faces(CITY), np.random.default_rng(0).uniform((-5.0, -5.0), (40.0, 20.0), (500, 2))
    top, number = find_topmost(places, np.asarray(faces.triangles, np.float64))
    boxes = ((ROOF, 10.0), (HUT, 13.0), (TOWER, 30.0))
    for (x, y), height, k in zip(places.tolist(), top.tolist(), number.tolist(), strict=True):
        stands = [h for box, h in boxes if to_outline(x, y, box) > 0.0]
        assert math.isnan(height) if not stands else height == pytest.approx(max(stands))
        assert (k == -1) == (not stands)


@pytest.mark.parametrize("ending", [".plan", ".waypoints"])
def test_files_land_on_the_roof(tmp_path: Path, ending: str) -> None:
    """The landing item is the last one, at the spot, 10 m above home on the ground; without a word of take-off."""
    place = find_landing(CITY, "house 0")
    mission = maxjax.plan_mission(CITY, [(-15.0, -15.0, 6.0), place.waypoint])
    assert mission.status is maxjax.Status.OK
    assert mission.path[-1].tolist() == [*place.position[:2], place.position[2] + 5.0]
    file = tmp_path / f"roof{ending}"
    flown = maxjax.export(file, maxjax.trajectory(mission), earth=EARTH)
    assert flown.clearance > 0.0
    if ending == ".plan":
        last = json.loads(file.read_text())["mission"]["items"][-1]
        command, (north, east, height) = last["command"], last["params"][4:]
    else:
        words = file.read_text().splitlines()[-1].split("\t")
        command, (north, east, height) = int(words[3]), [float(word) for word in words[8:11]]
    x, y, _ = EARTH.local(np.array([[north, east, height]]))[0]
    assert command == 21  # NAV_LAND
    assert height == pytest.approx(10.0, abs=0.01)
    assert np.hypot(x - place.position[0], y - place.position[1]) < 0.05


def test_a_file_that_lands_elsewhere_is_refused(tmp_path: Path) -> None:
    """A roof that is said to be 3 m higher than it is, and one whose surroundings stand up beside the place."""
    place = find_landing(CITY, "house 0")
    x, y, z = place.position
    start = (-15.0, -15.0, 6.0)
    beside = (6.0, 10.5)  # 1.5 m from the hut, which is 3 m higher
    low = maxjax.Waypoint((*beside, z + 6.0), touchdown=maxjax.Touchdown(z, 2.0))
    mission = maxjax.plan_mission(CITY, [start, low], distances=maxjax.Distances(radius=1.8, margin=3.0))
    assert mission.status is maxjax.Status.OK
    with pytest.raises(ValueError, match="on landing its least clearance is"):
        maxjax.export(tmp_path / "beside.plan", mission, earth=EARTH)
    inside = maxjax.Waypoint((x, y, z + 5.0), touchdown=maxjax.Touchdown(z - 3.0, 1.5))
    with pytest.raises(ValueError, match="on landing"):
        maxjax.export(tmp_path / "inside.plan", maxjax.plan_mission(CITY, [start, inside]), earth=EARTH)
    with pytest.raises(ValueError, match="expected a landing on a roof at the last waypoint only"):
        maxjax.plan_mission(CITY, [start, place.waypoint], return_to_start=True)
    with pytest.raises(ValueError, match="expected a Touchdown below z"):
        maxjax.Waypoint((x, y, z - 1.0), touchdown=maxjax.Touchdown(z, 1.0))


def test_landing_on_a_roof_takes_less_than_on_the_ground() -> None:
    """The descent is 5 m in place of 15 m: by the power of a descent, and its speed."""
    place = find_landing(CITY, "house 0")
    airframe, start = maxjax.Airframe.mavic_3_enterprise(), (-15.0, -15.0, 6.0)
    taken = [
        maxjax.measure_consumption(maxjax.trajectory(maxjax.plan_mission(CITY, [start, end])), airframe).total
        for end in (place.waypoint, maxjax.Waypoint(place.waypoint.position))
    ]
    from maxjax.energy.power import power

    watts = float(power(airframe, np.array([[0.0, 0.0, -0.5]]), np.zeros((1, 3)))[0])
    assert taken[1] - taken[0] == pytest.approx(watts * 10.0 / 0.5 / 3600.0, rel=1e-6)
