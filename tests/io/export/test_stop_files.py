"""Files for DJI's aircraft, WPML and Litchi's CSV: read with other readers, judged as flown, refused where they err."""

from __future__ import annotations

import csv
import dataclasses
import functools
import io
import itertools
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import numpy as np
import pyproj
import pytest
from shapely.geometry import LineString, Point

import maxjax
from maxjax.io.airspace.airspace import Airspace, Area
from maxjax.io.export.as_flown import judge_lines
from maxjax.io.export.read_back import Standing, lines_in
from maxjax.io.geo.earth import Earth, Projected, TangentPlane
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.planning.mission import Mission
from tests.io.export.test_as_flown import planned

NAMES = ("a.kmz", "a_litchi.csv")
KML, WPML = "{http://www.opengis.net/kml/2.2}", "{http://www.dji.com/wpmz/1.0.6}"
STOPS = "toPointAndStopWithDiscontinuityCurvature"
GROUND = 1.5


def empty(x: float = 0.0, y: float = 0.0) -> maxjax.VoxelMap:
    return maxjax.VoxelMap.of(np.zeros((130, 60, 60), bool), spacing=2.0, origin=(x + 1.0, y + 1.0, 1.0))


def mission(path: np.ndarray, where: maxjax.VoxelMap, hover: float = 4.0) -> maxjax.Mission:
    """Of two legs that meet at the third point, where it hovers; the second is flown at 2.5 m/s."""
    places = [maxjax.Waypoint((x, y, z)) for x, y, z in path[[0, 2, -1]].tolist()]
    places[1:] = [dataclasses.replace(places[1], hover=hover), dataclasses.replace(places[2], speed=2.5)]
    legs = planned(where, path[:3]), planned(where, path[2:])
    at = np.array([0, 2, len(path) - 1])
    return Mission(maxjax.Status.OK, tuple(places), legs, path, at, 120.0, 5.0, {}, where)


PATH = np.array([[40.0, 20.0, 12.0], [70.0, 45.0, 18.5], [100.0, 45.0, 15.0], [115.0, 10.0, 26.0], [115.0, 10.0, 40.0]])


@functools.cache
def flight() -> maxjax.Trajectory:
    return maxjax.trajectory(mission(PATH, empty()), maxjax.FlightLimits(speed=7.0))


@dataclasses.dataclass(frozen=True)
class Row:
    """A waypoint as another reader has it."""

    latitude: float
    longitude: float
    height: float
    speed: float
    hover: float


def text_of(point: ElementTree.Element, *names: str) -> str:
    found = point.findtext("/".join(names))
    assert found is not None
    return found


def kmz_rows(file: Path, part: str = "waylines.wpml", height: str = "executeHeight") -> list[Row]:
    with zipfile.ZipFile(file) as archive:
        root = ElementTree.fromstring(archive.read(f"wpmz/{part}"))
    found = []
    for mark in root.iter(f"{KML}Placemark"):
        east, north = text_of(mark, f"{KML}Point", f"{KML}coordinates").split(",")
        hover = sum(float(one.text or "") for one in mark.iter(f"{WPML}hoverTime"))
        up, speed = (float(text_of(mark, f"{WPML}{name}")) for name in (height, "waypointSpeed"))
        found.append(Row(float(north), float(east), up, speed, hover))
    return found


def litchi_rows(file: Path) -> list[Row]:
    found = []
    for row in csv.DictReader(io.StringIO(file.read_text())):
        stays = [float(row[f"actionparam{k}"]) for k in range(1, 16) if row[f"actiontype{k}"] == "0"]
        assert all(0.0 < stay <= 32767.0 for stay in stays)
        north, east, up, speed = (float(row[name]) for name in ("latitude", "longitude", "altitude(m)", "speed(m/s)"))
        found.append(Row(north, east, up, speed, 1e-3 * sum(stays)))
    return found


def rows_of(file: Path) -> list[Row]:
    return kmz_rows(file) if file.suffix == ".kmz" else litchi_rows(file)


def places_of(file: Path, earth: Earth, ground: float = GROUND) -> np.ndarray:
    """Points of the map, heights counted from the ground there."""
    rows = rows_of(file)
    home = earth.geodetic(earth.local(np.array([[rows[0].latitude, rows[0].longitude, 0.0]])) * [1.0, 1.0, 0.0])
    up = home[0, 2] + ground
    return earth.local(np.array([[row.latitude, row.longitude, row.height + up] for row in rows]))


@pytest.mark.parametrize("name", NAMES)
def test_other_readers_find_places_hovers_and_speeds(tmp_path: Path, name: str) -> None:
    """In UTM, where PROJ alone says what latitude and longitude are."""
    earth = Projected("EPSG:32632", VerticalZero(0.0))
    corner = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform(8.0, 47.0)
    path = PATH + np.array([*corner, 0.0])
    found = maxjax.export(tmp_path / name, mission(path, empty(*corner)), earth=earth, ground=GROUND)
    assert found.aside < 1e-3
    rows = rows_of(tmp_path / name)
    back = pyproj.Transformer.from_crs(4326, 32632, always_xy=True)
    x, y = back.transform([row.longitude for row in rows], [row.latitude for row in rows])
    np.testing.assert_allclose(np.column_stack([x, y]), path[:, :2], atol=1e-3)
    np.testing.assert_allclose([row.height for row in rows], path[:, 2] - GROUND, atol=1e-3)
    assert [row.hover for row in rows] == [0.0, 0.0, 4.0, 0.0, 0.0]
    # A waypoint has the speed of the way on.
    assert [row.speed for row in rows] == [5.0, 5.0, 2.5, 2.5, 2.5]


def test_a_kmz_stops_at_each_waypoint_and_shows_what_is_flown(tmp_path: Path) -> None:
    earth = TangentPlane(52.07, 4.3, 10.0)
    maxjax.export(tmp_path / "a.kmz", flight(), earth=earth, ground=GROUND)
    assert kmz_rows(tmp_path / "a.kmz") == kmz_rows(tmp_path / "a.kmz", "template.kml", "height")
    with zipfile.ZipFile(tmp_path / "a.kmz") as archive:
        assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
        roots = [ElementTree.fromstring(archive.read(name)) for name in archive.namelist()]
    for root in roots:
        marks = list(root.iter(f"{KML}Placemark"))
        assert [text_of(mark, f"{WPML}index") for mark in marks] == ["0", "1", "2", "3", "4"]
        assert {mode.text for mode in root.iter(f"{WPML}waypointTurnMode")} == {STOPS}
        config = root.find(f".//{WPML}missionConfig")
        assert config is not None
        said = {child.tag.removeprefix(WPML): child.text for child in config}
        assert (said["flyToWaylineMode"], said["finishAction"], said["exitOnRCLost"]) == (
            "safely", "noAction", "goContinue",
        )  # fmt: skip
        # It rises to the first waypoint, 10.5 m above the ground; nothing stands on the way back, 20 m are DJI's least.
        assert (float(said["takeOffSecurityHeight"] or ""), said["globalRTHHeight"]) == (10.5, "20")
    assert roots[1].findtext(f".//{WPML}executeHeightMode") == "relativeToStartPoint"
    assert roots[0].findtext(f".//{WPML}heightMode") == "relativeToStartPoint"


def test_the_same_flight_has_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.kmz", "b.kmz"):
        maxjax.export(tmp_path / name, flight(), earth=TangentPlane(52.07, 4.3, 10.0), ground=GROUND)
    assert (tmp_path / "a.kmz").read_bytes() == (tmp_path / "b.kmz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.kmz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_litchi_has_its_columns(tmp_path: Path) -> None:
    """No curves, heights above the take-off, and the course of the way on by PROJ's geodesics."""
    maxjax.export(tmp_path / "a_litchi.csv", flight(), earth=TangentPlane(52.07, 4.3, 10.0), ground=GROUND)
    rows = list(csv.DictReader(io.StringIO((tmp_path / "a_litchi.csv").read_text())))
    assert len(rows[0]) == 8 + 30 + 8
    assert {(row["curvesize(m)"], row["altitudemode"], row["gimbalmode"]) for row in rows} == {("0", "0", "0")}
    places = [(float(row["longitude"]), float(row["latitude"])) for row in rows]
    ways = itertools.pairwise(places[:4])
    wanted = [pyproj.Geod(ellps="WGS84").inv(*here, *there)[0] % 360.0 for here, there in ways]
    np.testing.assert_allclose([float(row["heading(deg)"]) for row in rows], [*wanted, *wanted[-1:] * 2], atol=0.02)


def test_long_hovers_are_several_stays(tmp_path: Path) -> None:
    earth = TangentPlane(52.07, 4.3, 10.0)
    for hover in (31.9995, 32.1, 480.0):
        maxjax.export(tmp_path / "a_litchi.csv", mission(PATH, empty(), hover), earth=earth, ground=GROUND)
        assert litchi_rows(tmp_path / "a_litchi.csv")[2].hover == pytest.approx(hover, abs=1e-3)
        maxjax.export(tmp_path / "a.kmz", mission(PATH, empty(), hover), earth=earth, ground=GROUND)
        assert kmz_rows(tmp_path / "a.kmz")[2].hover == pytest.approx(hover, abs=1e-3)
    with pytest.raises(ValueError, match="expected a hover of at most 480 s for Litchi, given 481"):
        maxjax.export(tmp_path / "b_litchi.csv", mission(PATH, empty(), 481.0), earth=earth, ground=GROUND)


@functools.cache
def over_the_tower() -> maxjax.Trajectory:
    """1.1 m above the voxels of a tower of 41 m on ground at 0."""
    city = maxjax.load_map("docs/samples/quarter.geojson")
    return maxjax.trajectory(planned(city, np.array([[-48.0, 0.0, 42.1], [0.0, 0.0, 42.1]])))


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_home_is_refused(tmp_path: Path, name: str) -> None:
    found = maxjax.export(tmp_path / name, over_the_tower())
    assert found.clearance == pytest.approx(1.1, abs=1e-3)
    before = (tmp_path / name).read_bytes()
    for wrong in (1.0, 30.0, -200.0, -0.5):
        # Above home that is said to lie 1 m up, 41.1 m are flown 0.1 m over the roof.
        with pytest.raises(ValueError, match=r"as flown .*nothing was written"):
            maxjax.export(tmp_path / name, over_the_tower(), ground=wrong)
    assert (tmp_path / name).read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == [name]


def changed(content: bytes, old: str, new: str, only: str = "wpmz/") -> bytes:
    """A KMZ in whose texts something stands for something else."""
    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as before, zipfile.ZipFile(found, "w") as after:
        for name in before.namelist():
            text = before.read(name).decode()
            after.writestr(name, text.replace(old, new) if name.startswith(only) else text)
    assert found.getvalue() != content
    return found.getvalue()


def judged(name: str, content: str | bytes, timed: maxjax.Trajectory) -> None:
    plan = timed.plan
    one = plan if isinstance(plan, Mission) else Mission.of_plan(plan)
    assert isinstance(one.map, maxjax.LoadedMap)
    judge_lines(Path(name), lines_in(Path(name), content, Standing(one.map.earth, one.map.terrain)), one, None)


def test_what_stands_in_the_file_is_judged(tmp_path: Path) -> None:
    """42.1 m become 41.1; a place is moved by 13 m; a waypoint is gone."""
    for name in NAMES:
        maxjax.export(tmp_path / name, over_the_tower())
    kmz, litchi = (tmp_path / "a.kmz").read_bytes(), (tmp_path / "a_litchi.csv").read_text()
    judged("a.kmz", kmz, over_the_tower())
    judged("a_litchi.csv", litchi, over_the_tower())
    for wrong in (changed(kmz, ">42.1", ">41.1"), litchi.replace(",42.1", ",41.1")):
        with pytest.raises(ValueError, match=r"least clearance is 0\.1\d m.*1 m are to be kept"):
            judged("a.kmz" if isinstance(wrong, bytes) else "a_litchi.csv", wrong, over_the_tower())
    last = kmz_rows(tmp_path / "a.kmz")[-1]
    place, there = f"{last.latitude:.10f}", f"{last.latitude + 1.2e-4:.10f}"
    for moved in (changed(kmz, place, there), litchi.replace(place, there, 2)):
        with pytest.raises(ValueError, match=r"m aside from what was planned|touches something"):
            judged("a.kmz" if isinstance(moved, bytes) else "a_litchi.csv", moved, over_the_tower())
    with pytest.raises(ValueError, match="aside from what was planned"):
        judged("a_litchi.csv", "\n".join(litchi.splitlines()[:2]) + "\n", over_the_tower())


@pytest.mark.parametrize(
    ("old", "new", "only", "said"),
    [
        (STOPS, "toPointAndPassWithContinuityCurvature", "wpmz/", "a stop at each waypoint"),
        ("relativeToStartPoint", "WGS84", "wpmz/", "heights above where it takes off"),
        ("relativeToStartPoint", "WGS84", "wpmz/waylines", "heights above where it takes off"),
        (">42.1", ">43.1", "wpmz/template", "the same waypoints in template.kml"),
        (">42.1", ">43.1", "wpmz/waylines", "the same waypoints in template.kml"),
        ("<wpml:index>1<", "<wpml:index>0<", "wpmz/", "waypoints in order"),
        ("safely", "pointToPoint", "wpmz/", "an upright take-off"),
        ("noAction", "gotoFirstWaypoint", "wpmz/", "nothing at the end"),
        ("noAction", "autoLand", "wpmz/template", "the same waypoints in template.kml"),
    ],
)
def test_a_kmz_that_flies_otherwise_is_refused(tmp_path: Path, old: str, new: str, only: str, said: str) -> None:
    maxjax.export(tmp_path / "a.kmz", over_the_tower())
    with pytest.raises(ValueError, match=said):
        judged("a.kmz", changed((tmp_path / "a.kmz").read_bytes(), old, new, only), over_the_tower())


def test_a_litchi_file_that_flies_otherwise_is_refused(tmp_path: Path) -> None:
    maxjax.export(tmp_path / "a_litchi.csv", over_the_tower())
    text = (tmp_path / "a_litchi.csv").read_text()
    for column, said in (("curvesize", "no curves"), ("altitudemode", "heights above where it takes off")):
        head, *rows = csv.reader(io.StringIO(text))
        at = next(k for k, name in enumerate(head) if name.startswith(column))
        rows[1][at] = "1"
        with pytest.raises(ValueError, match=said):
            judged("a_litchi.csv", "\n".join(map(",".join, [head, *rows])), over_the_tower())


def test_take_off_and_landing_of_a_kmz_are_judged(tmp_path: Path) -> None:
    city = maxjax.load_map("docs/samples/quarter.geojson")
    found = maxjax.export(tmp_path / "a.kmz", over_the_tower(), takeoff_and_landing=False)
    assert any("hovers there until the pilot takes over" in one for one in found.remarks)
    ways = {"there": [[-48.0, 0.0, 42.1], [-34.0, 0.0, 42.1]], "back": [[-34.0, 0.0, 42.1], [-48.0, 0.0, 42.1]]}
    roof, back = (maxjax.trajectory(planned(city, np.array(way))) for way in ways.values())
    maxjax.export(tmp_path / "b.kmz", roof)
    with pytest.raises(ValueError, match=r"as flown on landing it.*nothing was written: landing is straight"):
        maxjax.export(tmp_path / "c.kmz", roof, takeoff_and_landing=True)
    with pytest.raises(ValueError, match=r"as flown on take-off it.*choose another end$"):
        maxjax.export(tmp_path / "c.kmz", back)
    free = maxjax.trajectory(planned(city, np.array([[-48.0, 0.0, 42.1], [-48.0, 20.0, 42.1]])))
    maxjax.export(tmp_path / "d.kmz", free, takeoff_and_landing=True)
    with zipfile.ZipFile(tmp_path / "d.kmz") as archive:
        assert b">autoLand<" in archive.read("wpmz/waylines.wpml")


def test_a_take_off_above_a_low_start_is_judged(tmp_path: Path) -> None:
    """DJI rises to 2 m at least: below a roof at 2 m that touches it, from which a start at 1.2 m keeps 0.8 m."""
    where = maxjax.VoxelMap.of(np.zeros((30, 30, 30), bool), spacing=1.0, origin=(0.5, 0.5, 0.5))
    occupied = np.zeros((30, 30, 30), bool)
    occupied[:6, :6, 2] = True
    roofed = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path, earth = np.array([[3.5, 3.5, 1.2], [20.5, 3.5, 1.2]]), TangentPlane(10.0, 20.0, 100.0)
    maxjax.export(tmp_path / "a.kmz", planned(where, path, 0.5), earth=earth, ground=0.0)
    maxjax.export(tmp_path / "a_litchi.csv", planned(roofed, path, 0.5), earth=earth, ground=0.0)
    with pytest.raises(ValueError, match="as flown on take-off"):
        maxjax.export(tmp_path / "b.kmz", planned(roofed, path, 0.5), earth=earth, ground=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_lines_across_180_degrees(tmp_path: Path, name: str) -> None:
    for longitude in (179.9999, -179.9999):
        earth = TangentPlane(-17.0, longitude, 0.0)
        path = PATH - [75.0, 20.0, 0.0]
        found = maxjax.export(tmp_path / name, mission(path, empty(-90.0, -40.0)), earth=earth, ground=GROUND)
        assert found.aside < 1e-3
        rows = rows_of(tmp_path / name)
        assert {np.sign(row.longitude) for row in rows} == {-1.0, 1.0}
        assert max(abs(row.longitude) for row in rows) <= 180.0
        for row, (x, y, z) in zip(rows, path, strict=True):
            _, _, away = pyproj.Geod(ellps="WGS84").inv(longitude, -17.0, row.longitude, row.latitude)
            assert away == pytest.approx(np.hypot(x, y), abs=0.01)
            assert row.height == pytest.approx(z - GROUND, abs=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_the_accuracy_of_the_map_is_kept_as_well(tmp_path: Path, name: str) -> None:
    """10 m beside a wall a radius of 6 m leaves 3 m for what the places of the map may be off."""
    occupied = np.zeros((130, 60, 60), bool)
    occupied[:, 0, :] = True
    path = np.array([[20.0, 12.0, 20.0], [200.0, 12.0, 20.0]])
    assert LineString(path[:, :2]).distance(LineString([(0.0, 2.0), (260.0, 2.0)])) == 10.0
    corner = np.array([*pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform(8.0, 47.0), 0.0])
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(corner[0] + 1.0, corner[1] + 1.0, 1.0))
    plan = planned(where, path + corner, 6.0)
    for metres, fits in ((3.0, True), (4.5, False)):
        earth = Projected("EPSG:32632", VerticalZero(0.0), accuracy=metres)
        if fits:
            found = maxjax.export(tmp_path / name, plan, earth=earth, ground=0.0)
            assert any("true to 3 m" in one for one in found.remarks)
        else:
            with pytest.raises(ValueError, match=r"6 m are to be kept, and 4\.5 m more"):
                maxjax.export(tmp_path / name, plan, earth=earth, ground=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_points_too_near_to_one_another_are_left_out_where_the_line_is_the_same(tmp_path: Path, name: str) -> None:
    earth, ground = TangentPlane(52.07, 4.3, 10.0), GROUND
    near = np.insert(PATH, 1, PATH[0] + 0.01 * (PATH[1] - PATH[0]), axis=0)
    assert np.linalg.norm(near[1] - near[0]) < 0.5
    plan = planned(empty(), near)
    assert maxjax.export(tmp_path / name, plan, earth=earth, ground=ground).aside < 0.01
    found = places_of(tmp_path / name, earth)
    assert len(found) == len(PATH)
    line = LineString(found[:, :2])
    assert max(line.distance(Point(x, y)) for x, y, _ in near) < 0.01


@pytest.mark.parametrize("name", NAMES)
def test_bends_too_near_to_one_another_are_left_out_where_the_lines_are_as_clear(tmp_path: Path, name: str) -> None:
    """Of two bends 0.4 m apart one is left out far from everything; not around a post."""
    earth = TangentPlane(52.07, 4.3, 10.0)
    bent = np.array([[40.0, 20.0, 12.0], [50.0, 24.0, 12.0], [50.4, 24.0, 12.0], [60.0, 20.0, 12.0]])
    maps = []
    for column in ((18, 12), (25, 9)):  # from x 36, y 24 on, near the start; and from x 50, y 18 on
        post = np.zeros((130, 60, 60), bool)
        post[(*column, slice(0, 10))] = True
        maps.append(maxjax.VoxelMap.of(post, spacing=2.0, origin=(1.0, 1.0, 1.0)))
    far, beside = maps
    found = maxjax.export(tmp_path / name, planned(far, bent), earth=earth, ground=0.0)
    assert any("takes none nearer than 0.5 m" in one for one in found.remarks)
    places = places_of(tmp_path / name, earth)
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).min() >= 0.5
    line = LineString(places[:, :2])
    assert max(line.distance(Point(x, y)) for x, y, _ in bent) <= 1.0
    assert found.clearance >= maxjax.verify(bent, far).clearance - 0.01
    with pytest.raises(ValueError, match=r"expected waypoints 0\.5 m apart for .* at x 50\.\d, y 24\.0, z 12\.0"):
        maxjax.export(tmp_path / name, planned(beside, bent), earth=earth, ground=0.0)


def test_what_the_programs_do_not_take_is_refused_or_said(tmp_path: Path) -> None:
    earth = TangentPlane(52.07, 4.3, 10.0)
    x = np.linspace(10.0, 210.0, 120)
    many = np.column_stack([x, 20.0 + (np.arange(120) % 2), np.full(120, 20.0)])
    assert maxjax.export(tmp_path / "a.kmz", planned(empty(), many), earth=earth, ground=0.0).aside < 1e-3
    with pytest.raises(ValueError, match="expected at most 99 waypoints for Litchi, given 120"):
        maxjax.export(tmp_path / "a_litchi.csv", planned(empty(), many), earth=earth, ground=0.0)
    high = planned(
        maxjax.VoxelMap.of(np.zeros((9, 9, 90), bool), spacing=10.0, origin=(5.0, 5.0, 5.0)),
        PATH[:2] * [0.5, 0.5, 40.0],
    )
    with pytest.raises(ValueError, match=r"from -200 to 500 m above home for Litchi, given 740\.0 m"):
        maxjax.export(tmp_path / "a_litchi.csv", high, earth=earth, ground=0.0)
    fast = maxjax.trajectory(planned(empty(), PATH), maxjax.FlightLimits(speed=20.0))
    area = Area("school", (np.array([[200.0, 100.0], [210.0, 100.0], [210.0, 110.0]]),))
    for name in NAMES:
        found = maxjax.export(tmp_path / name, fast, earth=earth, ground=0.0, airspace=Airspace(areas=(area,)))
        assert {row.speed for row in rows_of(tmp_path / name)} == {15.0}
        for said in ("speeds up to 15 m/s, and 20 m/s", "it has no geofence", "take off on the ground below the start"):
            assert any(said in one for one in found.remarks)
        assert found.autopilots == ()
    assert any("Path Mode to Straight Lines" in one for one in found.remarks)


@pytest.mark.parametrize("name", NAMES)
def test_they_need_a_place_on_earth_and_ground(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="expected a place on Earth"):
        maxjax.export(tmp_path / name, flight())
    where = maxjax.VoxelMap.of(np.zeros((9, 9, 9), bool), spacing=10.0, origin=(5.0, 5.0, 5.0))
    assert np.isnan(where.terrain.at(20.0, 20.0))
    with pytest.raises(ValueError, match="expected a map with ground below the start"):
        maxjax.export(tmp_path / name, planned(where, PATH[:2] * 0.5), earth=TangentPlane(1.0, 2.0, 3.0))
    assert not list(tmp_path.iterdir())
