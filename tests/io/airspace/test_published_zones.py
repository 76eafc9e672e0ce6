"""Zones in the formats in which they are published, each as voxels beside shapely and arithmetic, and as plans."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax import Airspace, Status, load_airspace
from maxjax.core.status import Closure
from maxjax.core.terrain import Terrain
from maxjax.io.airspace.zone_files import FORMATS, ZoneFormat, read_zones
from maxjax.io.geo.earth import Degrees, TangentPlane
from tests.fuzz import zone_samples as samples

shapely = pytest.importorskip("shapely", reason="needs shapely (extra dev)")

PLACE = TangentPlane(52.0, 4.3, 30.0)  # z = 0 lies 30 m above sea level
AIR = maxjax.Grid((24, 24, 16), 2.0, (1.0, 1.0, -3.0))
FLAT = Terrain.flat(0.0, AIR)
START, GOAL = (4.0, 24.0, 9.0), (44.0, 24.0, 9.0)
FOOT = 0.3048


def degrees(*corners: tuple[float, float]) -> list[list[float]]:
    """A closed ring of the map [m] as longitudes and latitudes."""
    places = PLACE.geodetic(np.column_stack([np.array([*corners, corners[0]], np.float64), np.zeros(len(corners) + 1)]))
    return [[float(x), float(y)] for y, x in places[:, :2]]


def box(west: float, south: float, east: float, north: float) -> list[list[float]]:
    return degrees((west, south), (east, south), (east, north), (west, north))


def place(x: float, y: float) -> tuple[float, float]:
    latitude, longitude = PLACE.geodetic(np.array([[x, y, 0.0]]))[0, :2].tolist()
    return longitude, latitude


def closed(folder: Path, name: str, content: bytes) -> tuple[np.ndarray, Airspace]:
    """Voxels that a file closes, and its airspace."""
    (folder / name).write_bytes(content)
    airspace = load_airspace(folder / name, PLACE, AIR)
    return airspace.closed_over(FLAT) != Closure.OPEN, airspace


def expected(shape: Any, low: float, high: float) -> np.ndarray:
    """Voxels that touch a shape of the plane between two heights [m]; the ground is at 0."""
    x0, y0, z0 = AIR.lower
    meets = [[shapely.box(x0 + 2 * i, y0 + 2 * j, x0 + 2 * i + 2, y0 + 2 * j + 2).intersects(shape) for j in range(24)]
             for i in range(24)]  # fmt: skip
    bottom = z0 + 2.0 * np.arange(16)
    level = (bottom + 2.0 > low + 1e-6) & (bottom < high - 1e-6)
    return np.array(meets)[:, :, None] & level


# A triangle that no format can take for a box, and a box in its hole or beside it.
TRIANGLE = ((10.3, 5.7), (40.9, 9.1), (21.7, 41.3))
SHAPE = shapely.Polygon(TRIANGLE)
RING = degrees(*TRIANGLE)
NO = -math.inf


def plain(ring: samples.Ring, limits: samples.Limits) -> bytes:
    return samples.collection(samples.ed318_feature(samples.polygon(ring, limits)))


def ed269(ring: samples.Ring, limits: samples.Limits) -> bytes:
    shape = {"type": "Polygon", "coordinates": [ring]}
    return samples.ed269(samples.ed269_feature(samples.ed269_volume(shape, limits)))


CASES: dict[str, tuple[Callable[[samples.Ring], bytes], float, float]] = {
    "ed318 in metres": (lambda ring: plain(ring, (5, "AGL", 14, "AGL", "m")), 5.0, 14.0),
    "ed318 in feet": (lambda ring: plain(ring, (10, "AGL", 45, "AGL", "FT")), 10 * FOOT, 45 * FOOT),
    "ed318 above sea level": (lambda ring: plain(ring, (0, "AGL", 41, "AMSL", "m")), NO, 11.0),
    "ed318 from sea level": (lambda ring: plain(ring, (35, "AMSL", 500, "AMSL", "m")), 5.0, math.inf),
    "ed318 with texts": (lambda ring: plain(ring, ("5", "agl", "14.0", "AGL", "M")), 5.0, 14.0),  # type: ignore[arg-type]
    "ed318 above the ellipsoid": (lambda ring: plain(ring, (120, "WGS84", 400, "WGS84", "m")), 4.0, math.inf),
    "ed318 below the ellipsoid": (lambda ring: plain(ring, (0, "AGL", -68, "W84", "m")), NO, 9.0),
    "ed269 in metres": (lambda ring: ed269(ring, (5, "AGL", 14, "AGL", "M")), 5.0, 14.0),
    "ed269 in feet above sea level": (lambda ring: ed269(ring, (0, "AGL", 130, "AMSL", "ft")), NO, 130 * FOOT - 30.0),
    "openaip above ground": (
        lambda ring: samples.encoded([samples.openaip_item(ring, (0, 1, 0), (45, 1, 0))]),
        NO,
        45 * FOOT,
    ),
    "openaip above sea level": (
        lambda ring: samples.encoded({"items": [samples.openaip_item(ring, (36, 0, 1), (42, 0, 1))], "page": 1}),
        6.0,
        12.0,
    ),
    "openaip flight levels": (
        lambda ring: samples.encoded([samples.openaip_item(ring, (67, 6, 2), (195, 6, 2))]),
        0.8 * 67 * 30.48 - 1630.0,
        math.inf,
    ),
    "openaip of geojson": (
        lambda ring: samples.collection(
            {
                "type": "Feature",
                "geometry": samples.polygon(ring),
                "properties": {
                    k: v for k, v in samples.openaip_item(ring, (5, 0, 0), (14, 0, 0)).items() if k != "geometry"
                },
            }
        ),
        5.0,
        14.0,
    ),
    "openaip of its parser": (
        lambda ring: samples.collection(
            {
                "type": "Feature",
                "geometry": samples.polygon(ring),
                "properties": {
                    "name": "R",
                    "lowerCeiling": {"value": 10, "unit": "FT", "referenceDatum": "GND"},
                    "upperCeiling": {"value": 45, "unit": "FT", "referenceDatum": "GND"},
                },
            }
        ),
        10 * FOOT,
        45 * FOOT,
    ),
    "uasfm": (lambda ring: samples.collection(samples.cell(ring, 20)), 20 * FOOT, math.inf),
    "uasfm closed": (lambda ring: samples.collection(samples.cell(ring, 0)), NO, math.inf),
    "uasfm without a number": (
        lambda ring: samples.collection(samples.cell(ring, None), samples.cell(box(0, 0, 1, 1), 900)),
        NO,
        math.inf,
    ),
    "kml on the ground": (lambda ring: samples.kml(samples.mark(samples.kml_polygon(ring))), NO, math.inf),
    "kml above ground": (
        lambda ring: samples.kml(samples.mark(samples.kml_polygon(ring, 11.0, "relativeToGround", 1))),
        NO,
        11.0,
    ),
    "kml above sea level": (
        lambda ring: samples.kml(samples.mark(samples.kml_polygon(ring, 41.0, "absolute", 1))),
        NO,
        11.0,
    ),
    "kml that hangs": (
        lambda ring: samples.kml(samples.mark(samples.kml_polygon(ring, 41.0, "absolute"))),
        NO,
        math.inf,
    ),
    "kml of a ring": (
        lambda ring: samples.kml(
            samples.mark(
                "<LinearRing><coordinates>"
                + " ".join(f"{x!r} , {y!r}" for x, y in ring)
                + "</coordinates></LinearRing>"
            )
        ),
        NO,
        math.inf,
    ),
    "kmz": (
        lambda ring: samples.kmz(samples.kml(samples.mark(samples.kml_polygon(ring, 11.0, "relativeToGround", 1)))),
        NO,
        11.0,
    ),
    "plan": (lambda ring: samples.fence((ring, False)), NO, math.inf),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("turned", [False, True])
def test_each_format_closes_what_it_says(tmp_path: Path, case: str, turned: bool) -> None:
    """Under a name that says nothing, as the content says what it is; and reversed, as that changes nothing."""
    write, low, high = CASES[case]
    found, airspace = closed(tmp_path, "zones.bin", write(RING[::-1] if turned else RING))
    np.testing.assert_array_equal(found, expected(SHAPE, low, high))
    assert not any(area.keep_in for area in airspace.areas)


def test_two_layers_are_two_zones_under_one_name(tmp_path: Path) -> None:
    inner = shapely.box(16.3, 12.3, 23.1, 19.9)
    feature = samples.ed318_feature(
        samples.polygon(RING, (9, "AGL", 150, "AGL", "m")),
        samples.polygon(box(16.3, 12.3, 23.1, 19.9), (0, "AGL", 9, "AGL", "m")),
        type="REQ_AUTHORIZATION",
        limitedApplicability=[{"startDateTime": "2018-12-31T15:59:59Z"}],
    )
    found, airspace = closed(tmp_path, "a.json", samples.collection(feature, title="zones"))
    np.testing.assert_array_equal(found, expected(SHAPE, 9.0, math.inf) | expected(inner, NO, 9.0))
    assert [area.name for area in airspace.areas] == ["'school'"] * 2
    assert airspace.remarks == ("times are not read: areas of a.json that name some hold always: 'school'",)


def test_a_limit_above_the_ellipsoid_is_a_number_where_heights_count_from_it(tmp_path: Path) -> None:
    ring = [[4.3, 52.0], [4.301, 52.0], [4.301, 52.001], [4.3, 52.0]]
    (tmp_path / "a.json").write_bytes(plain(ring, (6, "WGS84", 14, "WGS84", "m")))
    for known in (None, -43.0):
        zero = maxjax.VerticalZero(known, "the ellipsoid", ellipsoidal=True)
        airspace = load_airspace(tmp_path / "a.json", Degrees(4.3, 52.0, zero), AIR)
        (area,) = airspace.areas
        assert (area.floor, area.ceiling) == (6.0, 14.0)
        assert (area.floor_above_ground, area.ceiling_above_ground) == (False, False)
        assert airspace.remarks == ()


def test_a_second_limit_of_openaip_leaves_a_zone_none(tmp_path: Path) -> None:
    """It counts where it closes less or more, which depends on the ground."""
    second = {"value": 20, "unit": 0, "referenceDatum": 0}
    for more, low, high in (({"lowerLimitMin": second}, NO, 12.0), ({"upperLimitMax": second}, 6.0, math.inf)):
        item = samples.openaip_item(RING, (36, 0, 1), (42, 0, 1), **more)
        found, _ = closed(tmp_path, "a.json", samples.encoded([item]))
        np.testing.assert_array_equal(found, expected(SHAPE, low, high))


def test_lists_of_zones_of_ed269_are_read_whatever_their_name(tmp_path: Path) -> None:
    shape = {"type": "Polygon", "coordinates": [RING]}
    zone = samples.ed269_feature(samples.ed269_volume(shape, (5, "AGL", 999999, "AMSL", "M")))
    zone |= {"applicability": {"permanent": "YES", "schedule": [{"day": "MON"}]}}
    for document in ({"features": [zone]}, {"formatVersion": "1.0.0", "UASZoneList": [zone]}, [zone], zone):
        found, airspace = closed(tmp_path, "a.json", samples.encoded(document))
        np.testing.assert_array_equal(found, expected(SHAPE, 5.0, math.inf))
        assert airspace.remarks == ()


def test_a_zone_with_a_hole_is_open_in_it(tmp_path: Path) -> None:
    hole = box(20.3, 14.3, 25.9, 20.9)
    shape = SHAPE.difference(shapely.box(20.3, 14.3, 25.9, 20.9))
    for name, content in {
        "a.kml": samples.kml(samples.mark(samples.kml_polygon(RING, holes=[hole]))),
        "a.json": samples.ed269(samples.ed269_feature(samples.ed269_volume(
            {"type": "Polygon", "coordinates": [RING, hole]}, (0, "AGL", 900, "AGL", "M")))),
    }.items():  # fmt: skip
        found, _ = closed(tmp_path, name, content)
        np.testing.assert_array_equal(found, expected(shape, NO, math.inf))


def test_a_fence_to_stay_inside_of_opens_what_it_holds_whole(tmp_path: Path) -> None:
    content = samples.fence((RING, True), (box(20.3, 14.3, 25.9, 20.9), False))
    found, airspace = closed(tmp_path, "a.plan", content)
    opened = ~found[:, :, 5]
    x0, y0, _ = AIR.lower
    for i, j in np.ndindex(24, 24):
        square = shapely.box(x0 + 2 * i, y0 + 2 * j, x0 + 2 * i + 2, y0 + 2 * j + 2)
        assert opened[i, j] == (SHAPE.contains(square) and not square.intersects(shapely.box(20.3, 14.3, 25.9, 20.9)))
    assert not any("ArduPilot" in remark for remark in airspace.remarks)
    both = samples.fence((RING, True), (box(1, 30, 12, 44), True))
    _, airspace = closed(tmp_path, "a.plan", both)
    assert "2 fences of a.plan are to stay inside of" in airspace.remarks[-1]


def test_what_restricts_nothing_or_has_no_area_is_counted(tmp_path: Path) -> None:
    line = {"type": "LineString", "coordinates": RING}
    free = samples.ed318_feature(samples.polygon(RING), type="NO_RESTRICTION")
    zone = samples.ed318_feature(samples.polygon(RING))
    pin = {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": list(place(9, 9))}}
    cases = {
        "a.geojson": (
            samples.collection(zone, free, free, pin, samples.ed318_feature(line)),
            "2 zones that restrict nothing (NO_RESTRICTION), 1 Point features, which have no area, "
            "1 LineString features, which have no area",
        ),
        "a.json": (
            samples.ed269(
                samples.ed269_feature(
                    samples.ed269_volume({"type": "Polygon", "coordinates": [RING]}, (0, "AGL", 9, "AGL", "M"))
                ),
                samples.ed269_feature(restriction="NO_RESTRICTION"),
            ),
            "1 zones that restrict nothing (NO_RESTRICTION)",
        ),
        "b.json": (
            samples.encoded([samples.openaip_item(RING, (0, 0, 0), (9, 0, 0)),
                             samples.openaip_item(RING, (0, 0, 0), (9, 0, 0), type=10)]),
            "1 regions of information (FIR)",
        ),
        "a.kml": (
            samples.kml(samples.mark(samples.kml_polygon(RING)), samples.mark("<Point/>"), "<GroundOverlay/>",
                        samples.mark("<MultiGeometry><LineString/><Point/></MultiGeometry>"), "<NetworkLink/>"),
            "2 Point placemarks, which have no area, 1 LineString placemarks, which have no area, "
            "1 GroundOverlay elements, 1 NetworkLink elements",
        ),
    }  # fmt: skip
    for name, (content, sentence) in cases.items():
        found, airspace = closed(tmp_path, name, content)
        assert found.any()
        assert f"left out of {name}: {sentence}" in airspace.remarks


WALL = box(20.0, -9.0, 28.0, 99.0)
AROUND_GOAL = box(38.0, 18.0, 50.0, 30.0)
FROM_30_M = (40, "AMSL", 900, "AMSL", "m")  # z from 10 m
UNSAFE: dict[str, tuple[bytes, Status]] = {
    "two layers": (
        samples.collection(samples.ed318_feature(samples.polygon(WALL, (0, "AGL", 9, "AGL", "m")),
                                                 samples.polygon(WALL, (9, "AGL", 150, "AGL", "m")))),
        Status.NO_VALID_PATH,
    ),
    "a circle": (
        samples.collection(samples.ed318_feature(samples.point(place(44, 24), 6.0, (0, "AGL", 120, "AGL", "m")))),
        Status.GOAL_IN_CLOSED_AREA,
    ),
    "a circle of ed269 beside another far away": (
        samples.ed269(
            samples.ed269_feature(samples.ed269_volume(
                {"type": "Circle", "center": list(place(3000, 24)), "radius": 6.0}, (0, "AGL", 120, "AGL", "M"))),
            samples.ed269_feature(samples.ed269_volume(
                {"type": "Circle", "center": list(place(24, 24)), "radius": 60.0}, (0, "AGL", 120, "AGL", "M"))),
        ),
        Status.START_IN_CLOSED_AREA,
    ),
    "openaip": (samples.encoded([samples.openaip_item(AROUND_GOAL, (0, 1, 0), (2500, 1, 1))]),
                Status.GOAL_IN_CLOSED_AREA),
    "uasfm": (samples.collection(samples.cell(AROUND_GOAL, 10)), Status.GOAL_IN_CLOSED_AREA),
    "uasfm around": (samples.collection(samples.cell(box(-50, -50, 99, 99), 20)), Status.START_IN_CLOSED_AREA),
    "kml": (samples.kml(samples.mark(samples.kml_polygon(WALL, 500.0, "absolute", 1))), Status.NO_VALID_PATH),
    "a fence to stay inside of": (samples.fence((box(-9, -9, 30, 99), True)), Status.GOAL_IN_CLOSED_AREA),
    "a fence to stay inside of elsewhere, beside one in the map": (
        samples.fence((box(-9, -9, 30, 99), True), (box(9000, 0, 9050, 50), True)), Status.GOAL_IN_CLOSED_AREA,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", UNSAFE)
def test_no_plan_leads_into_a_published_zone(tmp_path: Path, case: str) -> None:
    content, status = UNSAFE[case]
    (tmp_path / "zones").write_bytes(content)
    ground = np.zeros(AIR.shape, bool)
    ground[:, :, :2] = True
    plan = maxjax.plan(
        maxjax.VoxelMap.on(AIR, ground, ground),
        START,
        GOAL,
        planner=maxjax.AStar(),
        distances=maxjax.Distances(margin=4.0),
        airspace=load_airspace(tmp_path / "zones", PLACE, AIR),
    )
    assert plan.status == status
    assert len(plan.path) == 0


def test_a_table_has_each_format_once_and_each_is_recognised_by_its_content(tmp_path: Path) -> None:
    assert len({one.title for one in FORMATS}) == len(FORMATS) == len(samples.SAMPLES)
    taken = set()
    for name, make in samples.SAMPLES.items():
        (tmp_path / "zones").write_bytes(make())
        readers: list[Callable[..., Any]] = []

        def spied(one: ZoneFormat, readers: list[Callable[..., Any]] = readers) -> Any:
            def read(file: Any) -> Any:
                readers.append(one.read)
                return one.read(file)

            return ZoneFormat(one.title, one.recognise, read)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("maxjax.io.airspace.zone_files.FORMATS", tuple(map(spied, FORMATS)))
            assert read_zones(tmp_path / "zones").zones, name
        taken.add(readers[0])
    assert taken == {one.read for one in FORMATS}


def test_a_file_of_something_else_is_told_what_it_is(tmp_path: Path) -> None:
    cases: dict[bytes, str] = {
        b'{"cells": 3, "rows": 2}': "found JSON with cells, rows",
        b"[1, 2]": "found JSON that is a list",
        b'{"type": "Topology"}': "found JSON of type 'Topology'",
        b"<osm version='0.6'/>": "found XML of <osm>; save it as KML",
        b"<?xml version='1.0'?><!DOCTYPE kml [<!ENTITY a 'b'>]><kml/>": "no document type and no entities",
        b"<kml>": "expected KML, which is XML",
        b"<kml>" + 70 * b"<Folder>": "within 64 levels",
        b"PK\x03\x04 and no more": "expected an intact ZIP archive",
        samples.kmz(b"<kml/>", "doc.txt"): "expected a .kml in the archive",
        b"AC R\nAN TEST": "expected JSON",
        b"": "expected JSON",
        b'{"fileType": "Plan"}': "expected a geoFence in the plan",
        samples.fence(): "expected a Polygon, a MultiPolygon or a circle",
        samples.encoded([]): "found JSON that is a list",
        b'{"type": "FeatureCollection", "features": 3}': "a list of features, found 3",
        b'{"type": "FeatureCollection", "features": []}': "expected a Polygon",
        samples.kml(samples.mark("<Point/>")): "found 1 Point placemarks",
    }
    for content, sentence in cases.items():
        (tmp_path / "zones").write_bytes(content)
        with pytest.raises(ValueError, match="zones: ") as caught:
            load_airspace(tmp_path / "zones", PLACE, AIR)
        assert sentence in str(caught.value)
        assert "\n" not in str(caught.value)


def test_an_archive_that_grows_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    bomb = samples.kmz(b"<kml>" + b" " * 2**27 + b"</kml>")
    assert len(bomb) < 2**18
    (tmp_path / "a.kmz").write_bytes(bomb)
    with pytest.raises(ValueError, match="67108864 bytes of KML in the archive"):
        load_airspace(tmp_path / "a.kmz", PLACE, AIR)
    # One that says it is small, and is not: 6 in place of its 134 million bytes, in both of its headers.
    lying = bomb.replace((2**27 + 11).to_bytes(4, "little"), (6).to_bytes(4, "little"))
    assert lying != bomb
    (tmp_path / "a.kmz").write_bytes(lying)
    with pytest.raises(ValueError, match=r"a\.kmz"):
        load_airspace(tmp_path / "a.kmz", PLACE, AIR)


def test_a_zone_whose_box_meets_the_map_and_whose_outline_does_not_lies_outside(tmp_path: Path) -> None:
    bent = degrees((-90e3, -90e3), (90e3, -90e3), (90e3, 90e3), (80e3, 90e3), (80e3, -80e3), (-90e3, -80e3))
    found, airspace = closed(
        tmp_path, "a.json", samples.collection(samples.ed318_feature(samples.polygon(bent)),
                                               samples.ed318_feature(samples.polygon(RING)))
    )  # fmt: skip
    np.testing.assert_array_equal(found, expected(SHAPE, NO, math.inf))
    assert airspace.remarks[0] == "areas of a.json that lie outside the map are left out: 1"


def test_json_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    content = b"\xef\xbb\xbf" + json.dumps(json.loads(plain(RING, (5, "AGL", 14, "AGL", "m"))), indent=1).encode()
    found, _ = closed(tmp_path, "a.json", content)
    np.testing.assert_array_equal(found, expected(SHAPE, 5.0, 14.0))
