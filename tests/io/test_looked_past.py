"""City files: nothing that stands is looked past, nothing below the ground stands, and what is left out is counted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax.io.readers.geojson import load_geojson
from maxjax.io.readers.osm import load_osm
from maxjax.planners import Field
from tests.io.test_standing import Town, degrees, solid, square

FOOT = 0.3048


def features(folder: Path, *given: tuple[list[list[float]], dict[str, Any]], **more: Any) -> Path:
    """Polygons by their corners, and their properties."""
    shapes = [
        {"type": "Feature", "properties": tags, "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}}
        for ring, tags in given
    ]
    path = folder / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": shapes, **more}))
    return path


def block(x: float, y: float, half: float = 10.0, *levels: float) -> list[list[float]]:
    """Corners of a square in degrees, with third coordinates if given."""
    corners = [degrees(*corner) for corner in square(x, y, half)]
    return [[*corner, z] for corner, z in zip(corners, levels, strict=True)] if levels else corners


# --- What stands. ---


def test_nobody_flies_along_a_viaduct_or_under_it(tmp_path: Path) -> None:
    """A motorway on the second layer and a railway on the first: solid from the ground to what drives on them."""
    town = Town()
    town.way([(-50, 0), (50, 0)], closed=False, highway="motorway", bridge="viaduct", layer="2", lanes="6")
    town.way([(-50, 40), (50, 40)], closed=False, railway="rail", bridge="yes")
    town.way([(-50, -40), (50, -40)], closed=False, highway="path", bridge="boardwalk")
    path = town.save(tmp_path)
    assert solid(path, (0, 0, 8), (0, 0, 23), (0, 11, 20), (0, 40, 11), (0, 40, 3)) == [True] * 5
    assert solid(path, (0, 13, 20), (0, 40, 13), (0, -40, 1)) == [False] * 3
    city = maxjax.load_map(path, spacing=2.0)
    along = maxjax.plan(city, (-40.0, 0.0, 8.0), (40.0, 0.0, 8.0), planner=Field())
    assert along.status == maxjax.Status.START_OCCUPIED
    found = load_osm(path)
    assert found.read == {"buildings": 2, "bridges": 2}
    assert found.dropped == {"highway shapes without a height": 1}
    assert any("1 bridges are 24 m tall" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ({"natural": "wood"}, 29.0),
        ({"landuse": "forest"}, 29.0),
        ({"advertising": "billboard"}, 19.0),
        ({"historic": "monument"}, 59.0),
        ({"leisure": "stadium"}, 59.0),
        ({"man_made": "bridge", "layer": "1"}, 11.0),
        ({"natural": "wood", "height": "8"}, 7.0),
    ],
)
def test_woods_billboards_monuments_and_stadiums_stand(tmp_path: Path, tags: dict[str, str], height: float) -> None:
    town = Town()
    town.way(square(0, 0, 10), **tags)
    path = town.save(tmp_path)
    assert solid(path, (0, 0, height - 1.0), (0, 0, height + 2.0)) == [True, False]
    beside = (block(90, 0), {"building": "yes", "height": 5})
    assert set(load_geojson(features(tmp_path, (block(0, 0), tags), beside)).read) == set(load_osm(path).read)


# --- What does not. ---


@pytest.mark.parametrize(
    "tags",
    [
        {"building": "train_station", "location": "underground", "layer": "-2", "building:levels": "2"},
        {"building": "yes", "layer": "-1", "height": "9"},
        {"man_made": "pipeline", "tunnel": "yes"},
        {"building": "yes", "is_underground": "true", "height": "12"},
    ],
)
def test_what_is_underground_does_not_stand_and_is_counted(tmp_path: Path, tags: dict[str, str]) -> None:
    town = Town()
    town.way(square(0, 0, 10), **tags)
    path = town.save(tmp_path)
    assert solid(path, (0, 0, 1), (0, 0, 5)) == [False, False]
    (reason,) = load_osm(path).dropped
    assert reason.endswith(" underground")
    beside = (block(60, 0), {"building": "yes", "height": 5})
    shapes = features(tmp_path, (block(0, 0), {**tags, "is_underground": True}), beside)
    assert load_geojson(shapes).dropped == {reason: 1}


@pytest.mark.parametrize("no", ["no", "F", "false", "0", ""])
def test_a_file_that_says_no_of_tunnels_and_bridges_has_none(tmp_path: Path, no: str) -> None:
    """As extracts in other formats write it: a house stands, and a road is not a bridge."""
    house = {"building": "yes", "height": 9, "tunnel": no, "bridge": no, "is_underground": no}
    road = (block(60, 0), {"highway": "primary", "height": 4, "bridge": no})
    found = load_geojson(features(tmp_path, (block(0, 0), house), road))
    assert [round(b.top - b.base, 6) for b in found.buildings] == [9.0, 4.0]
    assert found.read == {"buildings": 2}
    town = Town()
    town.way([(-20, 0), (20, 0)], closed=False, highway="primary", bridge=no)
    assert load_osm(town.save(tmp_path)).read == {"buildings": 2}


def test_what_was_deleted_is_gone(tmp_path: Path) -> None:
    """By an editor, or in a history; a deleted node may have no place."""
    town = Town()
    town.way(square(0, 0, 10), building="yes", height="50")
    path = town.save(tmp_path)
    text = path.read_text()
    (number,) = [line.split('"')[1] for line in text.replace("<way", "\n<way").splitlines() if 'v="50"' in line]
    assert solid(path, (0, 0, 5)) == [True]
    for gone in ('action="delete"', 'visible="false"'):
        path.write_text(
            text.replace(f'<way id="{number}"', f'<way id="{number}" {gone}').replace(
                "</osm>", f'<node id="900001" {gone}/></osm>'
            )
        )
        assert solid(path, (0, 0, 5)) == [False]


def test_every_element_with_tags_is_read_or_counted(tmp_path: Path) -> None:
    town = Town()
    for key, value in (("highway", "residential"), ("waterway", "river"), ("landuse", "grass"), ("amenity", "parking")):
        town.way(square(0, 0, 4), **{key: value})
    town.node(3, 3, highway="crossing")
    town.node(3, 5, addr__street="High Street")
    town.node(3, 7, note="here")
    found = load_osm(town.save(tmp_path))
    assert found.read == {"buildings": 2}
    assert found.dropped == {
        "highway shapes without a height": 2,
        "waterway shapes without a height": 1,
        "landuse shapes without a height": 1,
        "amenity shapes without a height": 1,
        "address shapes without a height": 1,
        "other shapes without a height": 1,
    }


# --- Third coordinates and units of heights. ---


def test_a_third_coordinate_is_what_a_shape_stands_on(tmp_path: Path) -> None:
    low, high = block(0, 0, 10, 400, 402, 403, 400), block(76, 0, 10, 440, 440, 440, 440)
    path = features(tmp_path, (low, {"height": 10}), (high, {"height": 10}))
    found = load_geojson(path)
    assert [(b.base, b.top) for b in found.buildings] == [(400.0, 413.0), (440.0, 450.0)]
    assert any("2 shapes stand on their third coordinate" in remark for remark in found.remarks)
    flat = features(tmp_path, (block(0, 0, 10, 0, 0, 0, 0), {"height": 10}), (block(76, 0), {"height": 10, "ele": 0}))
    assert [(b.base, b.top) for b in load_geojson(flat).buildings] == [(0.0, 10.0)] * 2
    assert not any("third" in remark for remark in load_geojson(flat).remarks)


@pytest.mark.parametrize(
    ("tags", "metres"),
    [({"height": 100}, 100 * FOOT), ({"height": "30 m"}, 30.0), ({"building:levels": 4}, 12.0)],
)
def test_the_unit_of_heights_that_is_named_reaches_plain_numbers(
    tmp_path: Path, tags: dict[str, Any], metres: float
) -> None:
    path = features(tmp_path, (block(0, 0, 10, 50, 50, 50, 50), tags), (block(80, 0), {"height": "20 m", "ele": 50}))
    first, second = load_geojson(path, maxjax.Reading(vertical_unit="ft")).buildings
    np.testing.assert_allclose([first.base, first.top], [50 * FOOT, 50 * FOOT + metres])
    np.testing.assert_allclose([second.base, second.top], [50 * FOOT, 50 * FOOT + 20.0])


@pytest.mark.parametrize(("system", "metres"), [("EPSG:2263+6360", 100 * 1200 / 3937), ("EPSG:2263", 100.0)])
def test_heights_are_in_the_unit_of_the_systems_heights_or_a_remark_says_in_which(
    tmp_path: Path, system: str, metres: float
) -> None:
    pyproj = pytest.importorskip("pyproj", reason="needs pyproj (extra geo)")
    x, y = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:2263", always_xy=True).transform(-73.98, 40.75)
    ring = [[x + a, y + b] for a, b in square(0, 0, 100)]
    crs = {"type": "name", "properties": {"name": system}}
    found = load_geojson(features(tmp_path, (ring, {"height": 100}), crs=crs))
    assert found.buildings[0].top - found.buildings[0].base == pytest.approx(metres)
    said = [remark for remark in (*found.remarks, *found.reference.remarks) if "heights are" in remark]
    assert len(said) == 1
    assert ("heights are read as metres, although its plane is in" in said[0]) == (system == "EPSG:2263")


# --- Heights under other names. ---


@pytest.mark.parametrize(
    ("tags", "metres"),
    [
        ({"HEIGHT": 12.5}, 12.5),
        ({"heightroof": 31}, 31.0),
        ({"render_height": 9}, 9.0),
        ({"measuredHeight": 17}, 17.0),
        ({"building_levels": 4}, 12.0),
        ({"num_floors": "5"}, 15.0),
        ({"other_tags": '"height"=>"22","building:levels"=>"3"'}, 22.0),
        ({"height": 8, "HEIGHT": 30, "num_floors": 9}, 8.0),
    ],
)
def test_heights_stand_under_names_that_people_use(tmp_path: Path, tags: dict[str, Any], metres: float) -> None:
    (building,) = load_geojson(features(tmp_path, (block(0, 0), tags))).buildings
    assert building.top - building.base == pytest.approx(metres)


@pytest.mark.parametrize(
    ("reading", "metres"),
    [({"height": "roof_ht:ft"}, 100 * FOOT), ({"height": "roof_ht"}, 100.0), ({"levels": "storeys_n"}, 21.0)],
)
def test_a_property_that_is_named_is_the_height(tmp_path: Path, reading: dict[str, str], metres: float) -> None:
    path = features(tmp_path, (block(0, 0), {"roof_ht": 100, "storeys_n": 7}), (block(80, 0), {"height": 5}))
    found = load_geojson(path, maxjax.Reading(**reading))  # type: ignore[arg-type]
    assert found.buildings[0].top == pytest.approx(metres)
    assert found.dropped == ({"shapes without a height": 1} if "height" in reading else {})


def test_who_has_no_height_is_told_what_may_be_one(tmp_path: Path) -> None:
    path = features(tmp_path, (block(0, 0), {"roof_ht": 40, "name": "A"}), (block(80, 0), {"roof_ht": 12.5, "pop": 3}))
    with pytest.raises(maxjax.FileError, match=r"name it .*as --height roof_ht:m: roof_ht \(12\.5 to 40\)$"):
        load_geojson(path)
    with pytest.raises(ValueError, match="unit: expected one of"):
        maxjax.Reading(height="roof_ht:parsec")
