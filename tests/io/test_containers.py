"""Other containers of what a reader knows hold the same map: lines of features, Overpass, packed and binary files."""

from __future__ import annotations

import gzip
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import maxjax
from maxjax.io.kinds.contents import facts
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.reader import read_map
from tests.io.test_looked_past import block, features
from tests.io.test_standing import Town, square


def town(folder: Path) -> Path:
    """A house with a yard, a wall, a tree, a viaduct and a bench."""
    made = Town()
    outer = made.way(square(0.0, 0.0, 20.0))
    inner = made.way(square(0.0, 0.0, 8.0))
    made.relation([(outer, "outer"), (inner, "inner")], type="multipolygon", building="yes", height="24")
    made.way([(-60, 30), (60, 30)], closed=False, barrier="wall", height="3")
    made.way([(-60, -60), (60, -60)], closed=False, highway="motorway", bridge="viaduct", layer="2")
    made.node(40.0, 10.0, natural="tree", height="12")
    made.node(45.0, 10.0, amenity="bench")
    return made.save(folder)


def same(path: Path, other: Path, **how: Any) -> None:
    """Whether two files hold the same things: counts, remarks and prisms to a millimetre."""
    one, two = read_map(path), read_map(other)
    assert isinstance(one, Footprints)
    assert isinstance(two, Footprints)
    assert (facts(one).read, facts(one).dropped, facts(one).remarks) == (
        facts(two).read,
        facts(two).dropped,
        facts(two).remarks,
    )
    assert facts(one).zero == facts(two).zero
    for a, b in zip(one.buildings, two.buildings, strict=True):
        assert (a.base, a.top) == pytest.approx((b.base, b.top), abs=1e-3)
        for ring, copy in zip(a.rings, b.rings, strict=True):
            np.testing.assert_allclose(ring, copy, atol=1e-2)


def elements(path: Path) -> Iterator[tuple[ElementTree.Element, dict[str, str]]]:
    for element in ElementTree.parse(path).getroot():
        yield element, {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}


def places(path: Path) -> dict[str, dict[str, float]]:
    nodes = (element for element, _ in elements(path) if element.tag == "node")
    return {node.get("id", ""): {"lat": float(node.get("lat", 0)), "lon": float(node.get("lon", 0))} for node in nodes}


def overpass(path: Path, *, geometry: bool) -> dict[str, Any]:
    """What Overpass would write of a file of OSM, with `out geom` or without."""
    where = places(path)
    ways = {e.get("id"): [nd.get("ref", "") for nd in e.iterfind("nd")] for e, _ in elements(path) if e.tag == "way"}
    found: list[dict[str, Any]] = []
    for element, tags in elements(path):
        if element.tag == "node" and geometry and not tags:
            continue
        one: dict[str, Any] = {"type": element.tag, "id": int(element.get("id", "")), "tags": tags}
        if element.tag == "node":
            one |= where[element.get("id", "")]
        elif element.tag == "way":
            one["nodes"] = [int(name) for name in ways[element.get("id")]]
            if geometry:
                one["geometry"] = [where[name] for name in ways[element.get("id")]]
        else:
            members = [dict(member.attrib) for member in element.iterfind("member")]
            one["members"] = [{**member, "ref": int(member["ref"])} for member in members]
        found.append(one)
    return {"version": 0.6, "generator": "Overpass API", "elements": found}


@pytest.mark.parametrize("geometry", [False, True])
def test_overpass_writes_json(tmp_path: Path, geometry: bool) -> None:
    path = town(tmp_path)
    (tmp_path / "b.json").write_text(json.dumps(overpass(path, geometry=geometry)))
    same(path, tmp_path / "b.json")


def test_relations_of_overpass_may_hold_their_outlines_themselves(tmp_path: Path) -> None:
    """`out geom` of relations alone: no way and no node stands in the file, as JSON and as XML."""
    path, made = town(tmp_path), Town()
    made.text = []
    where = places(path)
    ways = {e.get("id"): [nd.get("ref", "") for nd in e.iterfind("nd")] for e, _ in elements(path) if e.tag == "way"}
    document = overpass(path, geometry=True)
    relations = [one for one in document["elements"] if one["type"] == "relation"]
    for member in (member for one in relations for member in one["members"]):
        member["geometry"] = [where[name] for name in ways[str(member["ref"])]]
    (tmp_path / "b.json").write_text(json.dumps({"elements": relations}))
    (house,) = read_map(tmp_path / "b.json").buildings  # type: ignore[union-attr]
    yard = shapely.Polygon(house.rings[0], [house.rings[1]])
    assert yard.area == pytest.approx(40.0**2 - 16.0**2, rel=1e-3)
    text = ""
    for one in relations:
        inside = "".join(
            f'<member type="way" ref="{m["ref"]}" role="{m["role"]}">'
            + "".join(f'<nd lat="{p["lat"]}" lon="{p["lon"]}"/>' for p in m["geometry"])
            + "</member>"
            for m in one["members"]
        )
        tags = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in one["tags"].items())
        text += f'<relation id="{one["id"]}">{inside}{tags}</relation>'
    (tmp_path / "b.osm").write_text(f'<osm version="0.6">{text}</osm>')
    same(tmp_path / "b.json", tmp_path / "b.osm")


def test_corners_may_have_places_and_no_numbers(tmp_path: Path) -> None:
    path = town(tmp_path)
    where = places(path)
    text = path.read_text()
    for name, place in where.items():
        text = text.replace(f'<nd ref="{name}"/>', f'<nd ref="{name}" lat="{place["lat"]}" lon="{place["lon"]}"/>')
    (tmp_path / "b.osm").write_text(text)
    same(path, tmp_path / "b.osm")


def test_protocol_buffers_hold_the_same(tmp_path: Path) -> None:
    osmium = pytest.importorskip("osmium")
    path = town(tmp_path)
    with osmium.SimpleWriter(str(tmp_path / "b.osm.pbf")) as writer:
        for thing in osmium.FileProcessor(str(path)):
            writer.add(thing)
    same(path, tmp_path / "b.osm.pbf")
    whole = (tmp_path / "b.osm.pbf").read_bytes()
    for content in (whole[:-5], b"no buffers at all"):
        (tmp_path / "b.osm.pbf").write_bytes(content)
        with pytest.raises(ValueError, match=r"expected an intact \.osm\.pbf file"):
            read_map(tmp_path / "b.osm.pbf")


def test_a_packed_file_of_osm(tmp_path: Path) -> None:
    path = town(tmp_path)
    (tmp_path / "b.osm.gz").write_bytes(gzip.compress(path.read_bytes()))
    same(path, tmp_path / "b.osm.gz")


@pytest.mark.parametrize(("name", "mark"), [("b.geojsonl", ""), ("b.geojsons", "\x1e"), ("b.json", "")])
def test_geojson_of_a_feature_a_line(tmp_path: Path, name: str, mark: str) -> None:
    path = features(tmp_path, (block(0, 0), {"height": 10, "ele": 3}), (block(50, 0), {"height": 20, "name": "é"}))
    lines = [mark + json.dumps(one) for one in json.loads(path.read_text())["features"]]
    (tmp_path / name).write_text("\n".join(lines) + "\n\n")
    same(path, tmp_path / name)
    (tmp_path / name).write_text("\n".join([*lines, mark + "{no json}"]))
    with pytest.raises(ValueError, match="line 3: expected JSON"):
        read_map(tmp_path / name)
    (tmp_path / name).write_text("\n".join([*lines, mark + json.dumps({"type": "Topology"})]))
    with pytest.raises(ValueError, match="line 3: expected type Feature, found 'Topology'"):
        read_map(tmp_path / name)


def city(folder: Path) -> Path:
    """Two buildings of CityJSON as boxes, the second above the first's roof's height."""

    def solid(begin: int) -> list[list[list[list[int]]]]:
        faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        return [[[[begin + corner for corner in face]] for face in faces]]

    corners = [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    vertices = [[1000 * c for c in corner] for corner in corners]
    vertices += [[50_000 + 2000 * x, 1000 * y, 30_000 * z] for x, y, z in corners]
    objects = {
        name: {"type": "Building", "geometry": [{"type": "Solid", "lod": "1", "boundaries": solid(begin)}]}
        for name, begin in (("one", 0), ("two", 8))
    }
    document = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [0.01, 0.01, 0.001], "translate": [85_000.0, 446_000.0, 2.0]},
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"},
        "CityObjects": objects,
        "vertices": vertices,
    }
    path = folder / "a.city.json"
    path.write_text(json.dumps(document))
    return path


def in_lines(path: Path) -> str:
    """A CityJSON as a sequence, each feature with its own vertices."""
    document = json.loads(path.read_text())
    first = {**document, "CityObjects": {}, "vertices": []}
    lines = [json.dumps(first)]
    for name, thing in document["CityObjects"].items():
        text = json.dumps(thing["geometry"])
        used = sorted({int(n) for geometry in thing["geometry"] for n in np.ravel(geometry["boundaries"])})
        geometry = json.loads(text)
        for one in geometry:
            one["boundaries"] = np.searchsorted(used, np.array(one["boundaries"])).tolist()
        feature = {"type": "CityJSONFeature", "id": name, "CityObjects": {name: {**thing, "geometry": geometry}}}
        lines.append(json.dumps({**feature, "vertices": [document["vertices"][n] for n in used]}))
    return "\n".join(lines)


def test_a_sequence_of_cityjson_is_the_city(tmp_path: Path) -> None:
    path = city(tmp_path)
    (tmp_path / "b.city.jsonl").write_text(in_lines(path))
    one, two = (maxjax.load_map(file, spacing=1.0) for file in (path, tmp_path / "b.city.jsonl"))
    np.testing.assert_array_equal(one.occupied, two.occupied)
    assert one.occupied.any()
    assert (one.file.read, one.earth) == (two.file.read, two.earth)
    lines = in_lines(path).splitlines()
    for content, sentence in (
        ([*lines, lines[1]], "expected each object once, found 'one' twice"),
        ([lines[0], lines[1].replace("CityJSONFeature", "Feature")], "line 2: expected type CityJSONFeature"),
        ([lines[0], lines[1][:-40]], "line 2: expected JSON"),
    ):
        (tmp_path / "b.city.jsonl").write_text("\n".join(content))
        with pytest.raises(ValueError, match=sentence):
            read_map(tmp_path / "b.city.jsonl")


# --- Vector files, by GDAL. ---


def shapes(folder: Path) -> Path:
    blocks = [(block(x, y), {"height": h, "ele": 2.0, "name": f"n{h}"}) for x, y, h in ((0, 0, 10.5), (50, 10, 31.0))]
    return features(folder, *blocks)


@pytest.mark.parametrize("name", ["b.gpkg", "b.shp", "b.fgb", "b.gml"])
def test_vector_files_hold_what_geojson_does(tmp_path: Path, name: str) -> None:
    """Our own reader of GeoJSON and GDAL's of the same shapes agree."""
    pyogrio = pytest.importorskip("pyogrio")
    path = shapes(tmp_path)
    meta, _, geometry, fields = pyogrio.raw.read(path)
    kept = [k for k, field in enumerate(meta["fields"]) if field in ("height", "ele", "name")]
    pyogrio.raw.write(
        tmp_path / name,
        geometry,
        [fields[k] for k in kept],
        [meta["fields"][k] for k in kept],
        geometry_type="Polygon",
        crs="EPSG:4326",
    )
    one, two = (maxjax.load_map(file, spacing=1.0) for file in (path, tmp_path / name))
    np.testing.assert_array_equal(one.occupied, two.occupied)
    assert (one.file.read, one.file.dropped) == (two.file.read, two.file.dropped)
    assert two.file.origin == pytest.approx(one.file.origin, abs=1e-9)


def test_a_geopackage_in_a_national_system_lies_where_its_system_says(tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    house = shapely.box(85_000.0, 446_000.0, 85_020.0, 446_010.0)
    pyogrio.raw.write(
        tmp_path / "a.gpkg", np.array([house.wkb], object), [np.array([12.0])], ["height"], geometry_type="Polygon",
        crs="EPSG:28992",
    )  # fmt: skip
    found = facts(read_map(tmp_path / "a.gpkg"))
    np.testing.assert_allclose(found.extent, [[85_000, 446_000, 0], [85_020, 446_010, 12]], atol=1e-6)
    assert found.crs == "EPSG:28992"


def test_vector_files_that_cannot_be_used_say_why(tmp_path: Path) -> None:
    pytest.importorskip("pyogrio")
    for name in ("a.gpkg", "a.fgb", "a.shp"):
        (tmp_path / name).write_bytes(b"nothing that GDAL knows")
        with pytest.raises(ValueError, match=f"expected an intact {Path(name).suffix} file"):
            read_map(tmp_path / name)
