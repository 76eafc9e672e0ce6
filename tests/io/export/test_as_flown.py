"""What a file makes a vehicle fly, on the true ground: judged before it is written, refused where it is another way."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pyproj
import pytest
from shapely.geometry import Polygon

import maxjax
from maxjax.core.terrain import Terrain
from maxjax.io.airspace.airspace import Airspace, Area
from maxjax.io.export.as_flown import judge_lines
from maxjax.io.export.drawings import Drawing, geojson_text, kml_text
from maxjax.io.export.items import courses_of
from maxjax.io.export.read_back import Standing, lines_in
from maxjax.io.geo.earth import Degrees, Earth, Projected, TangentPlane
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.verification.verifier import verify
from tests.planners import bare_plan

QUARTER = Path("docs/samples/quarter.geojson")
FROM_THE_GROUND = ("a.plan", "a.waypoints", "a_ned.csv")
ALL = (*FROM_THE_GROUND, "a.csv", "a.tum", "a.geojson", "a.kml", "a.rosbag")


@functools.cache
def quarter() -> maxjax.LoadedMap:
    return maxjax.load_map(QUARTER)


def planned(where: maxjax.VoxelMap, path: np.ndarray, radius: float = 1.0) -> Plan:
    """A plan of a path that was verified."""
    verdict = verify(path, where, radius=radius)
    assert verdict.ok
    return bare_plan(
        where,
        path,
        maxjax.Distances(radius, radius),
        length=verdict.length,
        clearance=verdict.clearance,
        clearance_at=verdict.clearance_at,
    )


@functools.cache
def over_the_tower() -> maxjax.Trajectory:
    """1.1 m above the voxels of a tower of 41 m on ground at 0."""
    return maxjax.trajectory(planned(quarter(), np.array([[-48.0, 0.0, 42.1], [0.0, 0.0, 42.1]])))


def test_home_lies_on_the_true_ground(tmp_path: Path) -> None:
    for name in ALL:
        found = maxjax.export(tmp_path / name, over_the_tower(), takeoff_and_landing=False)
        assert found.clearance == pytest.approx(1.1, abs=1e-3)
        by = " by PX4 in 9 s, by ArduCopter in 13 s" if found.flights else ""
        assert str(found) == f"as flown{by}: least clearance 1.10 m"
        assert found.aside < 1e-3
    mission = json.loads((tmp_path / "a.plan").read_text())["mission"]
    assert mission["plannedHomePosition"][2] == pytest.approx(0.0, abs=1e-9)
    assert [item["Altitude"] for item in mission["items"][1:]] == pytest.approx([42.1, 42.1])


@pytest.mark.parametrize("name", FROM_THE_GROUND)
@pytest.mark.parametrize("wrong", [1.0, 30.0, -200.0, -0.5])
def test_a_wrong_home_is_refused(tmp_path: Path, name: str, wrong: float) -> None:
    (tmp_path / name).write_text("what was there")
    # Above home that is said to lie 1 m up, 41.1 m are flown 0.1 m over the roof.
    with pytest.raises(ValueError, match=r"as flown it.*nothing was written"):
        maxjax.export(tmp_path / name, over_the_tower(), ground=wrong)
    assert [one.read_text() for one in tmp_path.iterdir()] == ["what was there"]


def test_a_home_that_is_wrong_is_refused_with_room_to_spare(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"leads 0\.50 m aside from what was planned; its least clearance is 1\.60 m"):
        maxjax.export(tmp_path / "a.plan", over_the_tower(), ground=-0.5)
    assert maxjax.export(tmp_path / "a.plan", over_the_tower(), ground=0.04).aside == pytest.approx(0.04, abs=1e-3)


def test_home_may_lie_on_the_border_of_columns(tmp_path: Path) -> None:
    """The digits of a file move it into either; each says the ground."""
    steps = 0.5 * np.arange(quarter().grid.shape[0])[:, None] * np.ones(quarter().grid.shape[1])
    file = dataclasses.replace(quarter().file, terrain=Terrain(steps, quarter().grid))
    where = dataclasses.replace(quarter(), file=file)
    assert where.grid.lower[0] % where.grid.spacing == 1.0
    for x in np.arange(-49.0, -13.0, 4.0).tolist():
        plan = planned(where, np.array([[x, 0.0, 42.1], [x, 1.0, 42.1], [-12.0, 0.0, 42.1]]))
        for earth in (None, TangentPlane(47.0, 8.0, 400.0), TangentPlane(-33.3, -70.1, 0.0)):
            assert maxjax.export(tmp_path / "a.waypoints", plan, earth=earth).aside < 1e-3
    east, west = where.terrain.at(x, 0.0), where.terrain.at(x - 0.1, 0.0)
    assert east == west + 0.5
    for stated in (west - 0.1, 0.5 * (west + east), east + 0.1):
        with pytest.raises(ValueError, match="aside from what was planned"):
            maxjax.export(tmp_path / "a.plan", plan, ground=stated)


def test_ground_that_only_voxels_tell_may_be_stated_within_one(tmp_path: Path) -> None:
    occupied = np.zeros((30, 10, 20), bool)
    occupied[:, :, :2] = True
    ground = occupied.copy()
    occupied[12:16, :, :6] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(1.0, 1.0, 1.0), ground=ground)
    plan = planned(where, np.array([[5.0, 9.0, 13.5], [55.0, 9.0, 13.5]]))
    earth = TangentPlane(10.0, 20.0, 100.0)
    for stated in (4.0, 3.1, 2.0):
        found = maxjax.export(tmp_path / "a.plan", plan, earth=earth, ground=stated)
        assert found.clearance == pytest.approx(1.5, abs=1e-3)
    with pytest.raises(ValueError, match=r"leads 0\.10 m aside"):
        maxjax.export(tmp_path / "a.plan", plan, earth=earth, ground=1.9)
    with pytest.raises(ValueError, match=r"least clearance is 0\.90 m"):
        maxjax.export(tmp_path / "a.plan", plan, earth=earth, ground=4.6)
    # Home at 4 on ground that may be at 2: 1.5 m over the roof could be half a metre inside of it.
    for name in FROM_THE_GROUND:
        with pytest.raises(ValueError, match="state it where the map tells it by voxels only"):
            maxjax.export(tmp_path / name, maxjax.trajectory(plan), earth=earth)
    higher = planned(where, plan.path + np.array([0.0, 0.0, 2.0]))
    assert maxjax.export(tmp_path / "a.plan", higher, earth=earth).clearance == pytest.approx(1.5, abs=1e-3)
    assert maxjax.export(tmp_path / "a.kml", higher, earth=earth).clearance == pytest.approx(3.5, abs=1e-3)


def test_a_plan_that_was_never_verified_is_refused(tmp_path: Path) -> None:
    through, beyond = (
        bare_plan(quarter(), np.array([[-48.0, 0.0, z], [x, 0.0, z]]), length=48.0, clearance_at=np.full(2, 5.0))
        for x, z in ((0.0, 20.0), (9e3, 42.1))
    )
    for name in ("a.plan", "a.geojson", "a.kml"):
        with pytest.raises(ValueError, match="comes onto the ground or touches something"):
            maxjax.export(tmp_path / name, through)
    with pytest.raises(ValueError, match="leaves the map"):
        maxjax.export(tmp_path / "a.kml", beyond)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [name for name in ALL if name != "a.rosbag"])
def test_what_stands_in_the_text_is_judged(tmp_path: Path, name: str) -> None:
    """Numbers of the text are changed: 42.1 m become 41.1."""
    maxjax.export(tmp_path / name, over_the_tower())
    text = (tmp_path / name).read_text()
    flight, city = over_the_tower(), quarter()
    assert isinstance(flight.plan, Plan)
    standing = Standing(city.earth, city.terrain)
    timed = flight if name.endswith((".csv", ".tum")) else None
    mission = Mission.of_plan(flight.plan)
    judge_lines(tmp_path / name, lines_in(tmp_path / name, text, standing), mission, timed)
    lower = text.replace("42.1", "41.1").replace("42.09", "41.09")
    assert lower != text
    with pytest.raises(ValueError, match=r"least clearance is 0\.[01]\d m.*1 m are to be kept"):
        judge_lines(tmp_path / name, lines_in(tmp_path / name, lower, standing), mission, timed)


def test_legs_keep_their_own_radius(tmp_path: Path) -> None:
    occupied = np.zeros((40, 12, 12), bool)
    occupied[20, 4, :] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    earth = TangentPlane(-30.0, 60.0, 0.0)
    path = np.array([[5.0, 8.0, 5.5], [15.0, 8.0, 5.5], [35.0, 8.0, 5.5]])
    legs = (planned(where, path[:2], 4.0), planned(where, path[1:], 2.0))
    places = tuple(maxjax.Waypoint((x, y, z)) for x, y, z in path.tolist())
    mission = Mission(maxjax.Status.OK, places, legs, path, np.array([0, 1, 2]), 30.0, 3.0, {}, where)
    flight = maxjax.trajectory(mission)
    for name in ("a.plan", "a.geojson", "a_ned.csv"):
        found = maxjax.export(tmp_path / name, flight, earth=earth, ground=0.0)
        assert found.clearance == pytest.approx(3.0, abs=1e-3)
    greedy = dataclasses.replace(mission, legs=(legs[0], dataclasses.replace(legs[1], radius=3.5)))
    for name in ("a.plan", "a.kml", "a.csv"):
        with pytest.raises(ValueError, match=r"where 3\.5 m are to be kept"):
            maxjax.export(tmp_path / name, dataclasses.replace(flight, plan=greedy), earth=earth, ground=0.0)


def empty(earth: Earth, low: tuple[float, float, float]) -> maxjax.VoxelMap:
    del earth
    x, y, z = low
    return maxjax.VoxelMap.of(np.zeros((130, 30, 12), bool), spacing=2.0, origin=(x + 1.0, y + 1.0, z + 1.0))


def test_ned_is_true_north_about_an_origin_that_the_file_names(tmp_path: Path) -> None:
    earth = Projected("EPSG:32632", VerticalZero(0.0))
    ((x, y, _),) = earth.local(np.array([[60.0, 11.9, 0.0]])).tolist()
    where = empty(earth, (x - 20.0, y - 20.0, 0.0))
    path = np.array([[x, y, 12.0], [x + 200.0, y, 12.0]])
    flight = maxjax.trajectory(planned(where, path))
    for name in ("a_ned.csv", "a.plan"):
        maxjax.export(tmp_path / name, flight, earth=earth, ground=3.0, takeoff_and_landing=False)
    table = np.loadtxt(tmp_path / "a_ned.csv", delimiter=",", skiprows=1)
    said = (tmp_path / "a_ned.csv").read_text().splitlines()[1]
    place = "# origin: latitude 60.0000000000, longitude 11.9000000000, height 3.000000 m above sea level (as stated)"
    assert said.startswith(f"{place}, on the ground")
    azimuth, _, distance = pyproj.Geod(ellps="WGS84").inv(
        11.9, 60.0, *pyproj.Transformer.from_crs(32632, 4326, always_xy=True).transform(x + 200.0, y)
    )
    assert azimuth == pytest.approx(92.51, abs=0.005)
    north, east, down = (table[-1, 1:4] - table[0, 1:4]).tolist()
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(azimuth, abs=1e-3)
    assert np.hypot(east, north) == pytest.approx(distance, abs=1e-3)
    np.testing.assert_allclose(table[0, 1:4], [0.0, 0.0, -9.0], atol=1e-4)
    assert abs(down) < 0.01
    assert np.abs(table[:, 1:4]).max() < 300.0  # float32 holds it to 0.02 mm
    moving = np.linalg.norm(table[:, 4:6], axis=1) > 1.0
    courses = np.degrees(np.arctan2(table[moving, 5], table[moving, 4]))
    np.testing.assert_allclose(courses, azimuth, atol=0.01)
    np.testing.assert_allclose(np.degrees(table[moving, 10]), azimuth, atol=0.01)
    # Velocities are those of the positions.
    rate = np.gradient(table[:, 1:4], table[:, 0], axis=0)[1:-1]
    assert np.abs(rate - table[1:-1, 4:7])[:-1].max() < 0.02
    items = json.loads((tmp_path / "a.plan").read_text())["mission"]["items"]
    assert [item["params"][3] for item in items[1:]] == pytest.approx([azimuth] * 2, abs=1e-3)


def test_ned_stays_level_where_the_plane_leaves_the_earth(tmp_path: Path) -> None:
    """5 km away the plane at home is 2 m below a height that is kept."""
    where = maxjax.VoxelMap.of(np.zeros((110, 4, 6), bool), spacing=50.0, origin=(25.0, 25.0, 25.0))
    earth = Degrees(5.0, 50.0, VerticalZero(0.0))
    flight = maxjax.trajectory(planned(where, np.array([[20.0, 50.0, 120.0], [5020.0, 50.0, 120.0]])))
    assert maxjax.export(tmp_path / "a_ned.csv", flight, earth=earth, ground=0.0).aside < 0.01
    table = np.loadtxt(tmp_path / "a_ned.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 3], -120.0, atol=1e-5)
    np.testing.assert_allclose(table[:, 6], 0.0, atol=1e-5)


def test_ned_without_a_place_on_earth_says_so(tmp_path: Path) -> None:
    where = empty(TangentPlane(0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    flight = maxjax.trajectory(planned(where, np.array([[20.0, 20.0, 12.0], [100.0, 20.0, 12.0]])))
    maxjax.export(tmp_path / "a_ned.csv", flight, ground=2.0)
    said = (tmp_path / "a_ned.csv").read_text().splitlines()[1]
    assert "x 20.000000, y 20.000000, z 2.000000 m of the map, on the ground below the start" in said
    assert "taken for true north" in said
    table = np.loadtxt(tmp_path / "a_ned.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[-1, 1:4], [0.0, 80.0, -10.0], atol=1e-5)


def test_courses_are_those_of_the_geodesic() -> None:
    rng = np.random.default_rng(1)
    places = np.column_stack([51.0 + rng.uniform(0, 2e-3, 8), 179.999 + rng.uniform(0, 2e-3, 8), rng.uniform(0, 60, 8)])
    places[:, 1] -= 360.0 * (places[:, 1] > 180.0)
    places[1, :2] = places[0, :2]
    places[5, :2] = places[4, :2]
    found = courses_of(places)
    wanted = [pyproj.Geod(ellps="WGS84").inv(a[1], a[0], b[1], b[0])[0] % 360.0 for a, b in itertools.pairwise(places)]
    wanted[0], wanted[4] = wanted[1], wanted[3]
    np.testing.assert_allclose(found, [wanted[0], *wanted], atol=0.01)
    assert courses_of(places[:2]) == [0.0, 0.0]
    # A way of more than a millimetre has a course.
    metre = 1.0 / 111_320.0
    east = np.array([[0.0, 8.0, 10.0], [0.0, 8.0 + 1.2e-3 * metre, 10.0], [0.0, 8.0 + 2.0e-3 * metre, 10.0]])
    np.testing.assert_allclose(courses_of(east), [90.0, 90.0, 90.0], atol=0.1)
    assert courses_of(east[1:]) == [0.0, 0.0]


def test_waypoint_lists_carry_the_course(tmp_path: Path) -> None:
    maxjax.export(tmp_path / "a.waypoints", over_the_tower())
    rows = [row.split("\t") for row in (tmp_path / "a.waypoints").read_text().splitlines()[1:]]
    assert [float(row[7]) for row in rows if row[3] == "16" and row[2] == "3"] == pytest.approx([90.0, 90.0], abs=1e-3)


def square(x: float, y: float, half: float) -> np.ndarray:
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])


def test_areas_become_a_geofence(tmp_path: Path) -> None:
    city = quarter()
    areas = (
        Area("school", (square(30.0, 40.0, 10.0),)),
        Area("low", (square(-20.0, 0.0, 5.0),), ceiling=20.0),
        Area("between", (square(-20.0, 8.0, 8.5),), ceiling=20.0),
        Area("around", (square(0.0, 0.0, 90.0), square(60.0, 60.0, 5.0)), keep_in=True),
    )
    found = maxjax.export(tmp_path / "a.plan", over_the_tower(), airspace=Airspace(areas=areas))
    assert [name for name in ("school", "low", "between", "around") if any(name in one for one in found.remarks)] == [
        "low",
        "between",
    ]
    fence = json.loads((tmp_path / "a.plan").read_text())["geoFence"]
    assert fence["circles"] == []
    assert [polygon["inclusion"] for polygon in fence["polygons"]] == [False, True, False]
    assert city.earth is not None
    for polygon, ring in zip(fence["polygons"], (areas[0].rings[0], *areas[3].rings), strict=True):
        corners = np.array(polygon["polygon"])
        back = city.earth.local(np.column_stack([corners, np.full(len(corners), 42.1)]))[:, :2]
        assert Polygon(back).symmetric_difference(Polygon(ring)).area < 1e-3


def test_takeoff_and_landing_stand_upright(tmp_path: Path) -> None:
    for name in ("a.plan", "a.waypoints"):
        maxjax.export(tmp_path / name, over_the_tower(), takeoff_and_landing=True)
    items = json.loads((tmp_path / "a.plan").read_text())["mission"]["items"]
    rows = [row.split("\t") for row in (tmp_path / "a.waypoints").read_text().splitlines()[2:]]
    for found in (
        [(item["command"], *item["params"][4:]) for item in items],
        [(int(row[3]), *map(float, row[8:11])) for row in rows],
    ):
        assert [item[0] for item in found] == [22, 178, 16, 16, 21]
        assert found[0][1:] == pytest.approx(found[2][1:], abs=1e-9)
        assert found[4][1:3] == pytest.approx(found[3][1:3], abs=1e-9)
        assert found[4][3] == pytest.approx(0.0, abs=1e-6)
    roof = maxjax.trajectory(planned(quarter(), np.array([[-48.0, 0.0, 42.1], [-34.0, 0.0, 42.1]])))
    maxjax.export(tmp_path / "b.plan", roof)
    with pytest.raises(ValueError, match=r"as flown on landing it.*nothing was written: landing is straight"):
        maxjax.export(tmp_path / "c.plan", roof, takeoff_and_landing=True)
    assert not (tmp_path / "c.plan").exists()


def test_lines_across_180_degrees_are_cut_in_two(tmp_path: Path) -> None:
    for longitude in (179.9995, -179.9995):
        earth = TangentPlane(-17.0, longitude, 0.0)
        where = empty(earth, (-130.0, -20.0, 0.0))
        plan = planned(where, np.array([[-100.0, 0.0, 10.0], [-50.0, 3.0, 12.0], [100.0, 10.0, 14.0]]))
        for name in ("a.geojson", "a.kml", "a.plan", "a.waypoints"):
            found = maxjax.export(tmp_path / name, plan, earth=earth, ground=0.0)
            assert found.aside < 1e-3
        (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
        assert feature["geometry"]["type"] == "MultiLineString"
        lines = [np.array(line) for line in feature["geometry"]["coordinates"]]
        space = {"k": "http://www.opengis.net/kml/2.2"}
        texts = ElementTree.parse(tmp_path / "a.kml").getroot().findall(".//k:MultiGeometry/k:LineString", space)
        assert len(lines) == len(texts) == 2
        assert (lines[0][-1, 0], lines[1][0, 0]) == (180.0, -180.0)
        for line, one in zip(lines, texts, strict=True):
            assert np.abs(np.diff(line[:, 0])).max() < 0.01
            assert len(set(np.sign(line[:, 0]))) == 1
            rows = one.findtext("k:coordinates", "", space).split()
            np.testing.assert_allclose([[float(x) for x in row.split(",")] for row in rows], line, atol=1e-9)


def test_a_line_may_cross_180_degrees_there_and_back() -> None:
    places = np.array([[10.0, 179.9, 5.0], [10.0, -179.9, 7.0], [10.1, 179.8, 5.0]])
    drawing = Drawing("a", places, {})
    assert [piece[:, 1].tolist() for piece in drawing.pieces] == [
        [179.9, 180.0],
        [-180.0, -179.9, -180.0],
        [180.0, 179.8],
    ]
    assert drawing.pieces[1][0].tolist() == pytest.approx([10.0, -180.0, 6.0])
    assert geojson_text([drawing], "heights above sea level").count("MultiLineString") == 1
    assert kml_text([drawing], "a", "heights above sea level").count("<LineString>") == 3


def test_a_format_that_counts_from_unknown_ground_asks(tmp_path: Path) -> None:
    where = empty(TangentPlane(0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    plan = planned(where, np.array([[20.0, 20.0, 12.0], [100.0, 20.0, 12.0]]))
    for name in ("a.plan", "a.waypoints"):
        with pytest.raises(ValueError, match="expected a map with ground below the start"):
            maxjax.export(tmp_path / name, plan, earth=TangentPlane(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="expected a map with ground below the start"):
        maxjax.export(tmp_path / "a_ned.csv", maxjax.trajectory(plan), earth=TangentPlane(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="ground below the goal"):
        maxjax.export(
            tmp_path / "a.plan", plan, earth=TangentPlane(0.0, 0.0, 0.0), ground=0.0, takeoff_and_landing=True
        )
    assert not list(tmp_path.iterdir())


def judged_text(folder: Path, flight: maxjax.Trajectory, name: str, text: str) -> None:
    """What stands in a text, judged as the plan or the set-points of a flight over the quarter."""
    assert isinstance(flight.plan, Plan)
    standing = Standing(quarter().earth, quarter().terrain)
    timed = flight if name.endswith(".csv") else None
    judge_lines(folder / name, lines_in(folder / name, text, standing), Mission.of_plan(flight.plan), timed)


def test_three_centimetres_are_no_rounding(tmp_path: Path) -> None:
    """1.1 m over the tower where 1.09 are to be kept: of 3 cm less a text is refused, of 0.5 mm less it is not."""
    path = np.array([[-48.0, 0.0, 42.1], [0.0, 0.0, 42.1]])
    flight = maxjax.trajectory(planned(quarter(), path, 1.09))
    maxjax.export(tmp_path / "a.waypoints", flight, takeoff_and_landing=False)
    text = (tmp_path / "a.waypoints").read_text()
    assert text.count("\t42.100000\t") == 2
    judged_text(tmp_path, flight, "a.waypoints", text.replace("\t42.100000\t", "\t42.099500\t"))
    with pytest.raises(ValueError, match=r"least clearance is 1\.07 m.*where 1\.09 m are to be kept"):
        judged_text(tmp_path, flight, "a.waypoints", text.replace("\t42.100000\t", "\t42.070000\t"))


def test_set_points_may_sag_by_what_they_do(tmp_path: Path) -> None:
    """At 5 m/s², 0.05 s apart, straight lines lie 1.6 mm below a curve at most: a centimetre is not for them."""
    path = np.array([[-48.0, 0.0, 42.1], [0.0, 0.0, 42.1]])
    flight = maxjax.trajectory(planned(quarter(), path, 1.1))
    maxjax.export(tmp_path / "a.csv", flight)
    text = (tmp_path / "a.csv").read_text()
    judged_text(tmp_path, flight, "a.csv", text.replace(",42.100000,", ",42.098600,"))
    with pytest.raises(ValueError, match=r"least clearance is 1\.09 m.*where 1\.1 m are to be kept"):
        judged_text(tmp_path, flight, "a.csv", text.replace(",42.100000,", ",42.090000,"))


@pytest.mark.parametrize("end", [0, 1])
def test_take_off_and_landing_keep_the_radius(tmp_path: Path, end: int) -> None:
    """A beam 0.5 m beside the upright way between ground and end, 4 m below that end."""
    occupied = np.zeros((40, 12, 14), bool)
    occupied[:, :, 0] = True
    ground = occupied.copy()
    occupied[(6, 36)[end], 4:8, 3:5] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, -0.5), ground=ground)
    path = np.array([[5.5, 6.0, 8.0], [35.5, 6.0, 8.0]])
    earth = TangentPlane(-30.0, 60.0, 0.0)
    export = functools.partial(maxjax.export, tmp_path / "a.plan", earth=earth, ground=0.0, takeoff_and_landing=True)
    what = ("take-off", "landing")[end]
    with pytest.raises(ValueError, match=rf"on {what} its least clearance is 0\.50 m.*where 1 m are to be kept"):
        export(planned(where, path))
    assert export(planned(where, path, 0.4)).clearance == pytest.approx(0.5, abs=1e-3)
    # An end that stands nearer than the radius is exempt, and no more of the way than that.
    occupied[(6, 36)[end], 4:8, 3:9] = True
    near = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, -0.5), ground=ground)
    away = np.array([[5.5, 6.0, 8.0], [5.5, 2.0, 8.0], [35.5, 2.0, 8.0], [35.5, 6.0, 8.0]])
    exempt = [0.0, 0.0]
    exempt[end] = 3.0
    beside = dataclasses.replace(planned(near, away, 0.4), radius=1.0, exemptions=tuple(exempt))
    with pytest.raises(ValueError, match=rf"on {what} its least clearance is 0\.50 m.*where 1 m are to be kept"):
        export(beside)
