"""OSM and GeoJSON: whatever stands is solid, at the height that is stated, or counted by its kind."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely.geometry import Point, Polygon
from shapely.ops import unary_union

import maxjax
from maxjax.core.files import FileError
from maxjax.io.geo.earth import unproject
from maxjax.io.readers.geojson import load_geojson
from maxjax.io.readers.osm import load_osm
from maxjax.io.readers.tag_heights import length, metres, tall

ORIGIN = np.array([8.0, 47.0])
Corners = list[tuple[float, float]]


def degrees(x: float, y: float) -> list[float]:
    found: list[float] = unproject(np.array([[x, y]], np.float64), ORIGIN)[0].tolist()
    return found


def square(x: float, y: float, half: float) -> Corners:
    return [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]


# Two houses at ±55 m, so that the middle of everything is (0, 0).
REFERENCE = (square(-55, -55, 3), square(55, 55, 3))


class Town:
    """A file of OSM, written piece by piece, in metres around the origin."""

    def __init__(self) -> None:
        self.text: list[str] = []
        self.count = 0
        for corners in REFERENCE:
            self.way(corners, building="yes", height="5")

    def node(self, x: float, y: float, **tags: str) -> int:
        self.count += 1
        longitude, latitude = degrees(x, y)
        place = f'id="{self.count}" lon="{longitude:.10f}" lat="{latitude:.10f}"'
        self.text.append(f"<node {place}>{marks(tags)}</node>")
        return self.count

    def way(self, corners: Corners, *, closed: bool = True, **tags: str) -> int:
        nodes = [self.node(x, y) for x, y in corners]
        nodes += nodes[:1] * closed
        self.count += 1
        inside = "".join(f'<nd ref="{node}"/>' for node in nodes)
        self.text.append(f'<way id="{self.count}">{inside}{marks(tags)}</way>')
        return self.count

    def relation(self, members: list[tuple[int, str]], **tags: str) -> None:
        self.count += 1
        inside = "".join(f'<member type="way" ref="{way}" role="{role}"/>' for way, role in members)
        self.text.append(f'<relation id="{self.count}">{inside}{marks(tags)}</relation>')

    def save(self, folder: Path) -> Path:
        path = folder / "a.osm"
        path.write_text(f'<osm version="0.6">{"".join(self.text)}</osm>')
        return path


def marks(tags: dict[str, str]) -> str:
    quoted = {k.replace("__", ":"): v.replace("&", "&amp;").replace('"', "&quot;") for k, v in tags.items()}
    return "".join(f'<tag k="{key}" v="{value}"/>' for key, value in quoted.items())


def solid(path: Path, *points: tuple[float, float, float]) -> list[bool]:
    """Whether voxels of 1 m hold something there."""
    city = maxjax.load_map(path, spacing=1.0)
    index = [np.floor((np.array(p) - city.grid.lower) / 1.0).astype(int) for p in points]
    return [bool(city.occupied[tuple(i)]) for i in index]


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ({"height": "574'", "building:levels": "49"}, 174.96),
        ({"height": "40 ft", "building:levels": "2"}, 12.19),
        ({"height": "7'4\""}, 2.24),
        ({"height": "7 ft 4 in"}, 2.24),
        ({"height": "40ft6in"}, 12.344),
        ({"height": "12,5"}, 12.5),
        ({"height": "12m50"}, 12.5),
        ({"height": "1e2"}, 100.0),
        ({"height": "3 storeys"}, 9.0),
        ({"building:levels": "0", "roof:levels": "2"}, 6.0),
        ({"building:levels": "3+1"}, 12.0),
        ({"building:levels": "G+4"}, 15.0),
        ({"height:hub": "100", "rotor:diameter": "90"}, 145.0),
        ({"height": "100", "height:hub": "100", "rotor:diameter": "90"}, 145.0),
        ({"height": "12.5m"}, 12.5),
        ({"height": "10-12"}, 12.0),
        ({"height": "10;14 m"}, 14.0),
        ({"height": "~15"}, 15.0),
        ({"height": "about 30 metres"}, 30.0),
        ({"height": "1250 cm"}, 12.5),
        ({"est_height": "20"}, 20.0),
        ({"height": "6 storeys"}, 18.0),
        ({"building:levels": "3½"}, 10.5),
        ({"building:levels": "3 1/2"}, 10.5),
        ({"building:levels": "3", "roof:levels": "2"}, 15.0),
        ({"building:levels": "3", "roof:height": "6"}, 15.0),
        ({"building:levels": "3-4"}, 12.0),
        ({"building:levels": "2;5"}, 15.0),
        ({"height": "tall", "building:levels": "2"}, 6.0),
        ({"height": "9", "roof:height": "3", "building:levels": "2"}, 9.0),
    ],
)
def test_a_stated_height_is_never_replaced_by_a_lower_one(tags: dict[str, str], height: float) -> None:
    assert tall(tags).metres == pytest.approx(height, abs=0.005)


@pytest.mark.parametrize(
    ("text", "height"),
    [
        ("1,608", 1608.0),
        ("1608.4 m", 1608.4),
        ("5280 ft", 1609.34),
        ("1,608.5", 1608.5),
        ("-3,5", -3.5),
        ("350", 350.0),
    ],
)
def test_ground_may_be_higher_than_anything_that_stands(text: str, height: float) -> None:
    assert metres(text) == pytest.approx(height, abs=0.005)


def test_texts_without_a_length_tell_none() -> None:
    for text in ("", "tall", "yes", "x" * 100, "m", "-"):
        assert length(text) is None
    rng = np.random.default_rng(0)
    for _ in range(3000):
        text = "".join(chr(c) for c in rng.choice([*range(32, 127), 0x2032, 0x2033], int(rng.integers(1, 12))))
        read = length(text)
        assert read is None or np.isfinite(read[0])


def test_polygons_of_one_feature_are_a_union(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    outlines = [square(*rng.uniform(-20, 20, 2), rng.uniform(3, 12)) for _ in range(6)]
    outlines += [outlines[0], square(0, 0, 20), square(0, 0, 6)]  # doubled, and nested
    rings = [[degrees(x, y) for x, y in [*o, o[0]]] for o in (*outlines, *REFERENCE)]
    feature = {"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "Feature", "properties": {"height": 30}, "geometry": feature}))
    union = unary_union([Polygon(outline) for outline in outlines])
    places = [(float(x), float(y)) for x, y in rng.uniform(-30, 30, (300, 2))]
    clear = [p for p in places if union.boundary.distance(Point(p)) > 1.5]
    found = solid(path, *[(x, y, 15.0) for x, y in clear])
    assert found == [union.contains(Point(p)) for p in clear]
    assert sum(found) > 50


def test_collections_points_and_lines_stand_or_are_counted(tmp_path: Path) -> None:
    def feature(geometry: dict[str, Any], **properties: Any) -> dict[str, Any]:
        return {"type": "Feature", "geometry": geometry, "properties": properties}

    house = {"type": "Polygon", "coordinates": [[degrees(x, y) for x, y in [*square(0, 0, 5), (-5, -5)]]]}
    point = {"type": "Point", "coordinates": degrees(20, 0)}
    line = {"type": "LineString", "coordinates": [degrees(-20, -20), degrees(-20, 20)]}
    features = [
        feature(
            {"type": "GeometryCollection", "geometries": [house, {"type": "Point", "coordinates": degrees(30, 9)}]},
            height=30,
        ),
        feature(point, height=25, width=4),
        feature(line, height=8),
        feature({"type": "MultiPoint", "coordinates": [degrees(1, 1)]}),
        *(
            feature({"type": "Polygon", "coordinates": [[degrees(x, y) for x, y in [*c, c[0]]]]}, height=5)
            for c in REFERENCE
        ),
    ]
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    where = [(0, 0, 15), (20, 0, 20), (-20, 0, 5), (30, 9, 20), (10, 0, 15), (0, 0, 40)]
    assert solid(path, *where) == [True, True, True, True, False, False]
    assert load_geojson(path).dropped == {"shapes without a height": 1}


@pytest.mark.parametrize("closed", [False, True])
def test_rings_that_do_not_repeat_their_first_corner_and_holes_as_large_as_all_lose_nothing(
    tmp_path: Path, closed: bool
) -> None:
    corners = [degrees(x, y) for x, y in square(0, 0, 10)]
    ring = corners + corners[:1] * closed
    around = [[degrees(x, y) for x, y in c] for c in REFERENCE]
    polygons = [[ring, ring[::-1]], *([c] for c in around)]
    shape = {"type": "MultiPolygon", "coordinates": polygons}
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "Feature", "properties": {"height": 30}, "geometry": shape}))
    assert solid(path, *[(x, y, 15.0) for x in (-8, 0, 8) for y in (-8, 0, 8)]) == [True] * 9
    # An outline without an area is counted; its hole does not become one.
    polygons.append([[corners[0], corners[1], corners[0]], ring])
    path.write_text(json.dumps({"type": "Feature", "properties": {"height": 30}, "geometry": shape}))
    assert load_geojson(path).dropped == {"polygons without a closed outline": 1}


def test_whatever_has_a_height_stands_and_what_may_stand_is_counted(tmp_path: Path) -> None:
    town = Town()
    town.way(square(0, 0, 5), natural="wood", height="20")
    town.node(20, 0, historic="monument", height="30")
    town.way([(-20, -20), (-20, 20)], closed=False, barrier="noise_barrier", height="5")
    town.way(square(30, 30, 3), power="transformer")
    town.node(0, 30, barrier="bollard")
    town.node(40, -40, highway="street_lamp")
    town.way(square(30, -30, 3), building="no", layer="-1")
    bridge = town.way(square(0, -30, 4))
    town.relation([(bridge, "outer")], type="bridge", man_made="bridge", height="9")
    town.node(40, 0, natural="tree", diameter="0.5")
    path = town.save(tmp_path)
    where = [(0, 0, 15), (20, 0, 25), (-20, 0, 4), (40, 0, 20), (44, 0, 20), (40, -40, 8)]
    assert solid(path, *where) == [True] * len(where)
    assert load_osm(path).dropped == {
        "other power structures without a height": 1,
        "other barriers without a height": 1,
        "bridges in relations of type bridge": 1,
        "other shapes without a height": 1,
    }


def test_chimneys_masts_trees_and_walls_stand(tmp_path: Path) -> None:
    town = Town()
    town.way(square(0, 0, 3), man_made="chimney", height="120")
    town.node(20, 0, man_made="mast", height="60")
    town.node(-20, 0, natural="tree")
    town.way([(-30, 20), (30, 20)], closed=False, natural="tree_row")
    town.way(square(0, -30, 10), barrier="wall", height="3")
    town.node(30, -10, power="tower")
    town.way([(30, -10), (30, -50)], closed=False, power="line")
    town.node(10, 10, man_made="mast")  # of any height
    path = town.save(tmp_path)
    where = [(0, 0, 100), (20, 0, 50), (-20, 0, 10), (0, 20, 10), (10, -30, 2), (30, -10, 30), (30, -40, 30)]
    assert solid(path, *where) == [True] * len(where)
    assert solid(path, (0, -30, 2), (10, 10, 5)) == [False, False]  # within the wall; what is counted
    found = load_osm(path)
    assert found.dropped == {"masts without a height": 1}
    assert any("12 m wide" in remark for remark in found.remarks)
    assert any("30 m tall" in remark for remark in found.remarks)
    only = load_osm(path, maxjax.Reading(only=("building",)))
    assert {b.name.split()[0] for b in only.buildings} == {"way"}
    assert sum(only.dropped.values()) == 8


def test_relations_are_the_union_of_their_outer_rings(tmp_path: Path) -> None:
    town = Town()
    first, second = town.way(square(-4, 0, 10)), town.way(square(4, 0, 10))
    hole = town.way(square(-11, 0, 2))
    town.relation(
        [(first, "outer"), (second, "outer"), (hole, "inner")], type="multipolygon", building="yes", height="20"
    )
    tower = town.way(square(30, 0, 4))
    town.relation([(tower, "outer")], type="multipolygon", man_made="tower", height="40")
    path = town.save(tmp_path)
    assert solid(path, (0, 0, 10), (10, 0, 10), (30, 0, 35)) == [True, True, True]
    assert solid(path, (-11, 0, 10)) == [False]


def test_houses_without_ele_stand_on_the_ground_of_their_neighbours(tmp_path: Path) -> None:
    town = Town()
    town.way(square(0, 0, 5), building="yes", height="20", ele="350")
    town.way(square(20, 0, 5), building="yes", height="20")
    path = town.save(tmp_path)
    city = maxjax.load_map(path, spacing=1.0)
    assert city.grid.lower[2] > 300.0
    assert solid(path, (20, 0, 360)) == [True]
    assert any("no ele" in remark for remark in city.file.remarks)


@pytest.mark.parametrize("roofs", [False, True])
def test_ele_is_that_of_the_ground_or_of_roofs_whichever_is_smoother(tmp_path: Path, roofs: bool) -> None:
    rng = np.random.default_rng(0)
    town = Town()
    expected = {}
    for x in range(-30, 31, 20):
        for y in range(-30, 31, 20):
            ground, height = 45.0 + 0.05 * x, float(rng.choice([8.0, 30.0, 90.0]))
            name = town.way(square(x, y, 4), building="yes", height=f"{height}", ele=f"{ground + height * roofs:.2f}")
            expected[f"way {name}"] = ground
    found = load_osm(town.save(tmp_path))
    for building in found.buildings:
        if building.name in expected:
            assert building.base == pytest.approx(expected[building.name], abs=0.02)
    assert any("that of roofs" in remark for remark in found.remarks) == roofs


def test_ground_that_steps_between_neighbours_is_said(tmp_path: Path) -> None:
    town = Town()
    town.text.clear()
    for k in range(6):  # the ele of one alone is its roof's
        town.way(square(20 * k, 0, 5), building="yes", height="90", ele=f"{45 + 90 * (k == 3)}")
    assert any("steps by up to 90 m" in remark for remark in load_osm(town.save(tmp_path)).remarks)


def test_a_pair_with_the_ele_of_roofs(tmp_path: Path) -> None:
    town = Town()
    town.text.clear()
    names = [
        town.way(square(x, 0, 5), building="yes", height=height, ele=ele)
        for x, height, ele in ((0, "102.5", "145.3"), (30, "11.6", "56.7"))
    ]
    bases = {b.name: b.base for b in load_osm(town.save(tmp_path)).buildings}
    np.testing.assert_allclose([bases[f"way {name}"] for name in names], [42.8, 45.1], atol=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_every_shape_is_in_voxels_or_counted(tmp_path: Path, seed: int) -> None:
    """Conservation: shapes written = shapes read + shapes dropped, and each that was read is solid in its middle."""
    rng = np.random.default_rng(seed)
    town, written, middles = Town(), Counter({"buildings": 2}), []
    kinds = [("building", "yes", "buildings"), ("man_made", "tower", "towers"), ("natural", "tree", "trees")]
    for k in range(30):
        key, value, name = kinds[rng.integers(3)]
        x, y = 15.0 * (k % 6) - 37.5, 15.0 * (k // 6) - 30.0
        tags = {key: value} | ({"height": f"{rng.integers(6, 40)}"} if rng.random() < 0.7 else {})
        written[name] += 1
        cut = name != "trees" and rng.random() < 0.2
        if name == "trees":
            town.node(x, y, **tags)
        else:
            town.way(square(x, y, 4), closed=not cut or name != "buildings", **tags)
        if "height" in tags and not (cut and name == "buildings"):
            middles.append((x, y, 3.0))
    path = town.save(tmp_path)
    found = load_osm(path)
    counted = Counter(found.read)
    for reason, count in found.dropped.items():
        counted[reason.split(" w")[0]] += count
    assert counted == written
    assert all(solid(path, *middles))


def test_systems_and_units_of_geojson(tmp_path: Path) -> None:
    import pyproj

    for code in ("EPSG:2263", "EPSG:3857", "EPSG:28992"):
        longitude, latitude = (4.38, 52.0) if code == "EPSG:28992" else (-73.98, 40.75)
        to_plane = pyproj.Transformer.from_crs("EPSG:4326", code, always_xy=True)
        to_degrees = pyproj.Transformer.from_crs(code, "EPSG:4326", always_xy=True)
        x, y = to_plane.transform(longitude, latitude)
        edge = 100.0
        ring = [[x, y], [x + edge, y], [x + edge, y + edge], [x, y + edge], [x, y]]
        crs = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{code[5:]}"}}
        feature = {
            "type": "Feature",
            "properties": {"height": 30},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        path = tmp_path / "a.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]}))
        (building,) = load_geojson(path).buildings
        geod = pyproj.Geod(ellps="WGS84")
        area, around = geod.polygon_area_perimeter(*to_degrees.transform(*np.array(ring).T))
        assert Polygon(building.rings[0]).area == pytest.approx(abs(area), rel=2e-3)
        assert Polygon(building.rings[0]).length == pytest.approx(around, rel=1e-3)
        assert building.top - building.base == 30.0  # heights are metres whatever the plane is in
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))  # no crs, and no degrees
    with pytest.raises(FileError, match="no degrees"):
        load_geojson(path)
    named = load_geojson(path, maxjax.Reading(crs="EPSG:28992"))
    assert named.reference.crs == "EPSG:28992"
