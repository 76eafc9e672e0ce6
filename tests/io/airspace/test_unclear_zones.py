"""Zones that are not clear: closed as far as they may reach, named, and no reason to refuse the others."""

from __future__ import annotations

import contextlib
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax import load_airspace
from maxjax.core.files import FileError
from maxjax.core.status import Closure
from maxjax.core.terrain import Terrain
from maxjax.io.airspace.zone import Limit
from maxjax.io.airspace.zone_heights import above_sea_level
from maxjax.io.geo.earth import TangentPlane
from tests.fuzz import zone_samples as samples
from tests.fuzz.mutations import altered

shapely = pytest.importorskip("shapely", reason="needs shapely (extra dev)")

PLACE = TangentPlane(52.0, 4.3, 30.0)
GRID = maxjax.Grid((24, 24, 10), 2.0, (1.0, 1.0, -3.0))
FLAT = Terrain.flat(0.0, GRID)


def degrees(*corners: tuple[float, float]) -> list[list[float]]:
    places = PLACE.geodetic(np.column_stack([np.array([*corners, corners[0]], np.float64), np.zeros(len(corners) + 1)]))
    return [[float(x), float(y)] for y, x in places[:, :2]]


def box(west: float, south: float, east: float, north: float) -> list[list[float]]:
    return degrees((west, south), (east, south), (east, north), (west, north))


RING = box(11.0, 13.0, 25.0, 21.0)
SHAPE = shapely.box(11.0, 13.0, 25.0, 21.0)
GOOD = box(1.0, 39.0, 7.0, 45.0)
GOOD_SHAPE = shapely.box(1.0, 39.0, 7.0, 45.0)
BOW = degrees((11.0, 13.0), (25.0, 21.0), (25.0, 13.0), (11.0, 21.0))
LAYER: samples.Limits = (5, "AGL", 9, "AGL", "m")
ALL = "all"


def columns(shape: Any) -> np.ndarray:
    """Columns whose square touches a shape."""
    return np.array(
        [[shapely.box(2 * i, 2 * j, 2 * i + 2, 2 * j + 2).intersects(shape) for j in range(24)] for i in range(24)]
    )


def changed(ring: Any = RING, **layer: Any) -> dict[str, Any]:
    """An ED-318 zone, its outline or its layer other than it should be."""
    found = samples.ed318_feature(samples.polygon(ring, LAYER))
    found["geometry"]["layer"].update(layer)
    return found


def circle(**extent: Any) -> dict[str, Any]:
    found = samples.ed318_feature(samples.point(RING[0], 5.0, LAYER))
    found["geometry"]["extent"].update(extent)
    return found


def of_geometry(geometry: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": {"name": "school"}, "geometry": geometry}


# A feature, the plane shape that it may cover, and what is said.
UNCLEAR: dict[str, tuple[Any, Any, str]] = {
    "a reference": (changed(upperReference="QFE"), SHAPE, "expected upperReference WGS84, AGL or AMSL, found 'QFE'"),
    "a unit": (changed(uom="km"), SHAPE, "expected uom m or ft, found 'km'"),
    "a text": (changed(lower="ground"), SHAPE, "expected lower as a height"),
    "a list": (changed(upper=[9]), SHAPE, r"expected upper as a height, at most 1e\+07, found \[9\]"),
    "a truth": (changed(upper=True), SHAPE, "expected upper as a height"),
    "not a number": (changed(upper="NaN"), SHAPE, "expected upper as a height"),
    "huge": (changed(upper=1e300), SHAPE, "expected upper as a height"),
    "a huge whole number": (changed(upper=10**400), SHAPE, "expected upper as a height"),
    "upside down": (changed(lower=20), SHAPE, "expected a ceiling above its floor of 20 m AGL, given 9 m AGL; swap"),
    "no height": (changed(lower=0, upper=0), SHAPE, "expected a ceiling above its floor of 0 m AGL, given 0 m AGL"),
    "no floor": (changed(lower=None, upper=0), SHAPE, "expected a ceiling above the ground, given 0 m AGL"),
    "a bow": (changed(BOW), SHAPE, "does not cross itself"),
    "a bow of no height": (changed(BOW, lower=20), SHAPE, "ceiling above its floor.*does not cross itself"),
    "not closed": (changed(RING[:-1]), SHAPE, "end where they begin"),
    "two points": (changed([RING[0], RING[2], RING[0]]), SHAPE, "4 or more points"),
    "a point of text": (changed([RING[0], ["x", 52.0], *RING[2:]]), ALL, "malformed"),
    "a point of nothing": (changed([RING[0], [None, None], *RING[2:]]), ALL, "malformed"),
    "swapped": (changed([[y, x] for x, y in RING]), None, ""),
    "off the Earth": (changed([RING[0], [4e5, 52.0], *RING[2:]]), ALL, "in degrees"),
    "metres": (changed([[x * 1e4, y * 1e4] for x, y in RING]), ALL, "in degrees"),
    "no outline": (changed([]), ALL, "4 or more points"),
    "no geometry": (of_geometry(None), ALL, "expected a Polygon.* found None"),
    "an empty collection": (of_geometry({"type": "GeometryCollection", "geometries": []}), ALL, "found none"),
    "a curve": (of_geometry({"type": "CurvePolygon", "coordinates": RING}), ALL, "found 'CurvePolygon'"),
    "nested": (of_geometry(json.loads(12 * '{"type": "GeometryCollection", "geometries": [' + "null" + 12 * "]}")),
               ALL, "expected a Polygon"),
    "no feature": ("school", ALL, "malformed"),
    "no radius": (circle(radius=None), ALL, "expected a radius"),
    "a radius of text": (circle(radius="wide"), ALL, "expected a radius"),
    "a radius below 0": (circle(radius=-5), ALL, "expected a radius"),
    "an ellipse": (circle(subType="Ellipse"), ALL, "subType Circle"),
    "inclusion": (changed() | {"properties": {"name": "school", "inclusion": "no"}}, ALL, "inclusion true or false"),
}  # fmt: skip


@pytest.mark.parametrize("case", UNCLEAR)
def test_what_is_not_clear_is_closed_at_all_heights_and_named(tmp_path: Path, case: str) -> None:
    """Beside a clear zone, which holds; alone, the file is refused with the same sentence."""
    feature, shape, sentence = UNCLEAR[case]
    file = tmp_path / "a.json"
    clear = samples.ed318_feature(samples.polygon(GOOD, LAYER), name="clear")
    file.write_bytes(samples.collection(feature, clear))
    airspace = load_airspace(file, PLACE, GRID)
    found = airspace.closed_over(FLAT) == Closure.AREA
    unclear = np.ones((24, 24), bool) if shape is ALL else np.zeros((24, 24), bool) if shape is None else columns(shape)
    level = -4.0 + 2.0 * np.arange(10)
    layer = (level + 2.0 > 5.0) & (level < 9.0)
    np.testing.assert_array_equal(found, unclear[:, :, None] | (columns(GOOD_SHAPE)[:, :, None] & layer))
    name = "'0'" if feature == "school" else "'school'"
    if shape is None:
        assert f"swapped: {name}" in airspace.remarks[1]
        sentence = "swapped, it lies in the map"
    else:
        does = "closes the whole map, as" if shape is ALL else "is closed as far as it may reach"
        (said,) = [remark for remark in airspace.remarks if remark.startswith(f"{name} of a.json {does}")]
        assert re.search(sentence, said)
    file.write_bytes(samples.collection(feature))
    with pytest.raises(ValueError, match=sentence) as caught:
        load_airspace(file, PLACE, GRID)
    assert "a.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def of_other_formats() -> dict[str, tuple[bytes, Any]]:
    """Files with a zone that is not clear and a clear one, and the plane shape that the former may cover."""
    clear_volume = samples.ed269_volume({"type": "Polygon", "coordinates": [GOOD]}, LAYER)
    volume = samples.ed269_volume({"type": "Polygon", "coordinates": [RING]}, LAYER)
    item, clear_item = (samples.openaip_item(ring, (5, 0, 0), (9, 0, 0)) for ring in (RING, GOOD))
    cell, mark = samples.cell(GOOD, 900), samples.mark(samples.kml_polygon(GOOD, 9.0, "relativeToGround", 1))
    ring = " ".join(f"{x!r},{y!r}" for x, y in RING)

    def ed269(volume: Any) -> bytes:
        return samples.ed269(samples.ed269_feature(volume), samples.ed269_feature(clear_volume))

    def openaip(item: Any) -> bytes:
        return samples.encoded([item, clear_item])

    return {
        "ed269 reference": (ed269(volume | {"upperVerticalReference": "QNE"}), SHAPE),
        "ed269 order": (ed269(volume | {"lowerLimit": 90}), SHAPE),
        "ed269 shape": (ed269(volume | {"horizontalProjection": {"type": "Ellipse"}}), ALL),
        "ed269 without shape": (ed269(volume | {"horizontalProjection": None}), ALL),
        "ed269 without volumes": (
            samples.ed269(samples.ed269_feature(geometry=None), samples.ed269_feature(clear_volume)), ALL,
        ),
        "ed269 without centre": (ed269(volume | {"horizontalProjection": {"type": "Circle", "radius": 5}}), ALL),
        "openaip unit": (openaip(item | {"upperLimit": {"value": 9, "unit": 5, "referenceDatum": 0}}), SHAPE),
        "openaip datum": (openaip(item | {"upperLimit": {"value": 9, "unit": 0, "referenceDatum": 7}}), SHAPE),
        "openaip feet STD": (openaip(item | {"upperLimit": {"value": 9, "unit": 1, "referenceDatum": 2}}), SHAPE),
        "openaip geometry": (openaip(item | {"geometry": None}), ALL),
        "openaip text": (openaip("CTR"), ALL),
        "uasfm unit": (samples.collection(samples.cell(RING, 100, UNIT="fathoms"), cell), SHAPE),
        "uasfm text": (samples.collection(samples.cell(RING, "LAANC"), cell), SHAPE),
        "uasfm point": (samples.collection(
            samples.cell(RING, 100) | {"geometry": {"type": "Point", "coordinates": RING[0]}}, cell), ALL),
        "kml order": (samples.kml(samples.mark(samples.kml_polygon(BOW)), mark), SHAPE),
        "kml without coordinates": (samples.kml(samples.mark("<Polygon/>"), mark), ALL),
        "kml text": (samples.kml(samples.mark(f"<LinearRing><coordinates>{ring} a,b</coordinates></LinearRing>"), mark),
                     ALL),
        "kml height": (samples.kml(samples.mark(samples.kml_polygon(RING, 1e300, "absolute", 1)), mark), SHAPE),
        "fence without inclusion": (samples.encoded({"fileType": "Plan", "geoFence": {"polygons": [
            {"polygon": [[y, x] for x, y in RING]}, {"inclusion": False, "polygon": [[y, x] for x, y in GOOD]},
        ]}}), ALL),
        "fence of two points": (samples.fence((RING[:2] + RING[:1], False), (GOOD, False)),
                                shapely.LineString([(11.0, 13.0), (25.0, 13.0)])),
        "fence of no radius": (samples.fence((GOOD, False), circles=[((4.3, 52.0), 0.0, False)]), ALL),
    }  # fmt: skip


OTHERS = of_other_formats()


@pytest.mark.parametrize("case", OTHERS)
def test_so_it_is_in_every_format(tmp_path: Path, case: str) -> None:
    content, shape = OTHERS[case]
    (tmp_path / "zones").write_bytes(content)
    airspace = load_airspace(tmp_path / "zones", PLACE, GRID)
    found = airspace.closed_over(FLAT) == Closure.AREA
    unclear = np.ones((24, 24), bool) if shape is ALL else columns(shape)
    assert found[unclear].all()
    if shape is not ALL:
        assert not found[~(unclear | columns(GOOD_SHAPE))].any()
    assert found[columns(GOOD_SHAPE)].any(axis=1).all() or case.startswith("uasfm")
    assert any(re.search(r"closes the whole map|is closed as far as it may reach", one) for one in airspace.remarks)


def test_a_zone_to_keep_in_that_is_not_clear_opens_nothing(tmp_path: Path) -> None:
    file = tmp_path / "a.plan"
    bow, field, out = (BOW, True), (GOOD, True), (RING, False)
    file.write_bytes(samples.fence(bow, field))
    airspace = load_airspace(file, PLACE, GRID)
    assert "'fence polygon 0' of a.plan opens nothing: expected an outline that does not cross" in " ".join(
        airspace.remarks
    )
    found = airspace.closed_over(FLAT) == Closure.AREA
    assert found[~columns(GOOD_SHAPE)].all()
    assert not found.all()
    # Where none is clear, or none lies in the map, none is forgotten.
    elsewhere = (box(9e3, 0.0, 9.1e3, 90.0), True)
    for fences, sentence in (
        ((bow, out), r"expected an area to keep in in the map, .* and 1 that are not clear \(expected an outline"),
        ((elsewhere, out), "expected an area to keep in in the map, .* found 1 outside"),
        ((elsewhere, bow, out), "found 1 outside and 1 that are not clear"),
        ((bow,), "does not cross itself"),
    ):
        file.write_bytes(samples.fence(*fences))
        with pytest.raises(ValueError, match=sentence):
            load_airspace(file, PLACE, GRID)
    # Limits that are a range open what lies within whatever they are.
    kept = samples.ed318_feature(
        samples.polygon(box(-9, -9, 99, 99), (-200, "AMSL", 129, "WGS84", "m")), inclusion=True
    )
    (tmp_path / "a.json").write_bytes(samples.collection(kept))
    found = load_airspace(tmp_path / "a.json", PLACE, GRID).closed_over(FLAT) == Closure.AREA
    open_below = 129.0 - 86.0 - 30.0
    np.testing.assert_array_equal(found[5, 5], -4.0 + 2.0 * np.arange(10) + 2.0 > open_below)


def test_an_outline_without_area_closes_what_it_touches_and_is_said(tmp_path: Path) -> None:
    (west, south), (east, _), *_ = box(9.0, 13.0, 25.0, 14.0)
    flat = [[west, south], [east, south], [0.5 * (west + east), south], [west, south]]
    (tmp_path / "a.json").write_bytes(samples.collection(changed(flat, lower=0)))
    airspace = load_airspace(tmp_path / "a.json", PLACE, GRID)
    assert "whose outline has no area close what it touches: 'school'" in airspace.remarks[0]
    touched = (airspace.closed_over(FLAT) == Closure.AREA).any(axis=2)
    np.testing.assert_array_equal(touched, columns(shapely.LineString([(9.0, 13.0), (25.0, 13.0)])))


@pytest.mark.parametrize("longitude", [180.0, -179.99995, 179.99995])
def test_formats_without_a_rule_lead_the_short_way_across_180_degrees(tmp_path: Path, longitude: float) -> None:
    fiji = TangentPlane(-17.0, longitude, 0.0)
    corners = np.array([[-9.0, 13.0, 0], [35.0, 13.0, 0], [35.0, 21.0, 0], [-9.0, 21.0, 0], [-9.0, 13.0, 0]])
    ring = [[float(x), float(y)] for y, x in fiji.geodetic(corners)[:, :2]]
    assert longitude != 180.0 or np.ptp(np.array(ring)[:, 0]) > 300.0
    files = {
        "a.plan": samples.fence((ring, False)),
        "a.kml": samples.kml(samples.mark(samples.kml_polygon(ring))),
        "b.json": samples.encoded([samples.openaip_item(ring, (0, 0, 0), (90, 0, 0))]),
        "c.json": samples.ed269(samples.ed269_feature(samples.ed269_volume(
            {"type": "Polygon", "coordinates": [ring]}, (0, "AGL", 90, "AGL", "M")))),
    }  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        touched = (load_airspace(tmp_path / name, fiji, GRID).closed_over(FLAT) == Closure.AREA).any(axis=2)
        np.testing.assert_array_equal(touched, columns(shapely.box(-9.0, 13.0, 35.0, 21.0)))


def test_an_edge_that_is_not_split_in_geojson_closes_both_ways_around(tmp_path: Path) -> None:
    fiji = TangentPlane(0.0, 180.0, 30.0)
    ring = [[179.9, -0.1], [-179.9, -0.1], [-179.9, 0.1], [179.9, 0.1], [179.9, -0.1]]
    clear = samples.ed318_feature(samples.point((0.0, 0.0), 9.0))
    (tmp_path / "a.json").write_bytes(samples.collection(changed(ring), clear))
    for longitude in (180.0, 0.0, 90.0):
        found = load_airspace(tmp_path / "a.json", TangentPlane(0.0, longitude, 30.0), GRID)
        assert (found.closed_over(FLAT) == Closure.AREA).all()
    assert fiji.height == 30.0


def test_many_names_are_cut(tmp_path: Path) -> None:
    zones = [changed(uom="km") | {"properties": {"name": f"zone {k}"}} for k in range(40)]
    plain = [samples.ed318_feature(samples.polygon(GOOD), name=f"free {k}") for k in range(40)]
    (tmp_path / "a.json").write_bytes(samples.collection(*zones, *plain))
    airspace = load_airspace(tmp_path / "a.json", PLACE, GRID)
    assert len(airspace.areas) == 80
    assert airspace.remarks[0].endswith("'free 7' and 32 more")
    assert airspace.remarks[-1] == "areas of a.json that are not clear, and are not named: 32"
    assert len(airspace.remarks) == 10


@pytest.mark.parametrize(
    ("limit", "low", "high"),
    [
        (Limit(100.0, "m", "AMSL"), 100.0, 100.0),
        (Limit(1000.0, "ft", "AMSL"), 304.8, 304.8),
        (Limit(100.0, "m", "WGS84"), 14.0, 207.0),
        (Limit(65.0, "FL", "STD"), 0.8 * 1981.2 - 1600.0, 1.2 * 1981.2 + 700.0),
        (Limit(-10.0, "FL", "STD"), 1.2 * -304.8 - 1600.0, 0.8 * -304.8 + 700.0),
    ],
)
def test_a_limit_above_sea_level_is_a_number_or_a_range(limit: Limit, low: float, high: float) -> None:
    np.testing.assert_allclose(above_sea_level(limit), (low, high), rtol=1e-12)


def test_flight_levels_hold_in_every_atmosphere() -> None:
    """Heights of pressures by the barometric equation, in cold and in warm air, at the extremes of pressure."""
    for level in (10, 55, 65, 100, 195, 300):
        pressure = 1013.25 * (1.0 - 0.0065 * level * 30.48 / 288.15) ** 5.25588
        low, high = above_sea_level(Limit(float(level), "FL", "STD"))
        for at_sea, warmer in ((870.0, -0.2), (870.0, 0.2), (1085.0, -0.2), (1085.0, 0.2), (1013.25, 0.0)):
            height, here = 0.0, at_sea
            step = 1.0 if pressure < at_sea else -1.0
            while (here > pressure) if step > 0 else (here < pressure):
                temperature = (1.0 + warmer) * max(288.15 - 0.0065 * height, 216.65)
                here *= math.exp(-9.80665 * step / (287.05 * temperature))
                height += step
            assert low - 1.0 <= height <= high + 1.0


def test_a_zone_holds_whatever_stands_beside_it(tmp_path: Path) -> None:
    """Files with one zone changed anyhow are refused, or close the other."""
    rng = np.random.default_rng(0)
    clear = samples.ed318_feature(samples.polygon(GOOD, LAYER), name="clear")
    file = tmp_path / "a.json"
    file.write_bytes(samples.collection(clear))
    held = load_airspace(file, PLACE, GRID).closed_over(FLAT) == Closure.AREA
    whole = samples.ed318_feature(samples.polygon(RING, LAYER), samples.point(RING[0], 5.0, LAYER))
    taken = 0
    for _ in range(300):
        file.write_bytes(samples.collection(altered(whole, rng), clear))
        with contextlib.suppress(FileError):
            airspace = load_airspace(file, PLACE, GRID)
            taken += 1
            assert (airspace.closed_over(FLAT) == Closure.AREA)[held].all()
    assert taken > 250
