"""CityJSON: made-up prisms in every version exactly, Delft and The Hague as oracles and the files' attributes say."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cityjson import column_heights
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from maxjax.core.files import FileError
from maxjax.maps.footprints import Footprint, chain
from maxjax.maps.readers.cityjson import load_cityjson

# An L of 12 m², and a square hole in a square of 16.
L = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]
SQUARE, HOLE = [(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (1, 3), (3, 3), (3, 1)]
BASE, TOP = 3.0, 10.5
AT = np.array([85_000.0, 447_000.0])


def area(footprint: Footprint) -> float:
    """Outline less holes, by the shoelace formula."""
    parts = [abs(np.sum(r[:, 0] * np.roll(r[:, 1], -1) - r[:, 1] * np.roll(r[:, 0], -1))) / 2 for r in footprint.rings]
    return 2 * max(parts) - sum(parts)


def contains(footprint: Footprint, points: np.ndarray) -> np.ndarray:
    """Even-odd by Matplotlib's test of each ring."""
    return np.logical_xor.reduce([Outline(np.vstack([r, r[:1]])).contains_points(points) for r in footprint.rings])


def prism(rings: list[list[tuple[int, int]]], *, triangles: bool = False) -> tuple[np.ndarray, list[Any], list[int]]:
    """Vertices, faces and their semantics (0 ground, 1 roof, 2 wall); floor first."""
    flat = np.array([p for ring in rings for p in ring], float) + AT
    n = len(flat)
    vertices = np.concatenate([np.c_[flat, np.full(n, BASE)], np.c_[flat, np.full(n, TOP)]])
    starts = np.cumsum([0, *map(len, rings)])
    index = [list(range(a, b)) for a, b in itertools.pairwise(starts.tolist())]
    floor, roof = [ring[::-1] for ring in index], [[i + n for i in ring] for ring in index]
    walls = [[[i, j, j + n, i + n]] for ring in index for i, j in zip(ring, ring[1:] + ring[:1], strict=True)]
    floors = [[[0, i + 1, i]] for i in range(1, n - 1)] if triangles else [floor]
    return vertices, [*floors, roof, *walls], [0] * len(floors) + [1] + [2] * len(walls)


def document(version: str, rings: list[list[tuple[int, int]]], **change: Any) -> dict[str, Any]:
    vertices, faces, values = prism(rings)
    surfaces = [{"type": kind} for kind in ("GroundSurface", "RoofSurface", "WallSurface")]
    geometry = {
        "type": "Solid",
        "lod": "2.2" if version > "1" else 2,
        "boundaries": [faces],
        "semantics": {"values": [values], "surfaces": surfaces},
    }
    city: dict[str, Any] = {"type": "CityJSON", "version": version}
    city["CityObjects"] = {"house": {"type": "Building", "geometry": [geometry | change]}}
    city["vertices"] = vertices.tolist()
    if version != "1.0":
        low = vertices.min(0)
        city["transform"] = {"scale": [0.001] * 3, "translate": low.tolist()}
        city["vertices"] = np.round((vertices - low) * 1000).astype(int).tolist()
    return city


@pytest.fixture
def save(tmp_path: Path) -> Callable[[object], Path]:
    def write(content: object) -> Path:
        path = tmp_path / "a.city.json"
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return path

    return write


@pytest.mark.parametrize("version", ["0.8", "1.0", "1.1", "2.0"])
@pytest.mark.parametrize(("rings", "size"), [([L], 12.0), ([SQUARE, HOLE], 12.0)], ids=["L", "hole"])
def test_every_version_gives_the_same_footprint(
    save: Callable[[object], Path], version: str, rings: list[list[tuple[int, int]]], size: float
) -> None:
    found = load_cityjson(save(document(version, rings)))
    (house,) = found.buildings
    assert area(house) == pytest.approx(size, abs=1e-6)
    assert (house.base, house.top, house.name) == (pytest.approx(BASE), pytest.approx(TOP), "house")
    np.testing.assert_allclose(found.origin, [*(AT + 2), 0.0])
    np.testing.assert_allclose(
        sorted(map(tuple, house.rings[0])), sorted((x - 2, y - 2) for x, y in rings[0]), atol=1e-6
    )


def test_without_semantics_the_lowest_level_faces_are_the_floor(save: Callable[[object], Path]) -> None:
    _, faces, _ = prism([SQUARE], triangles=True)
    for geometry in ({"boundaries": [faces]}, {"boundaries": faces, "type": "MultiSurface", "lod": 1}):
        (house,) = load_cityjson(save(document("1.0", [SQUARE], semantics=None, **geometry))).buildings
        assert area(house) == pytest.approx(16.0)
        assert len(house.rings) == 1
        assert len(house.rings[0]) == 4  # the diagonal is gone


def test_the_finest_level_counts_parts_are_buildings_and_terrain_is_kept(save: Callable[[object], Path]) -> None:
    city = document("2.0", [L])
    house = city["CityObjects"]["house"]
    flat = {"type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2]]]}
    city["CityObjects"] = {
        "whole": {"type": "Building", "geometry": [flat], "children": ["part"]},
        "part": {"type": "BuildingPart", "geometry": [flat, *house["geometry"]], "parents": ["whole"]},
        "sum": {"type": "Building"},
        "ground": {
            "type": "TINRelief",
            "geometry": [{"type": "CompositeSurface", "lod": 2, "boundaries": [[[0, 1, 2]], [[0, 2, 3]]]}],
        },
        "tree": {"type": "SolitaryVegetationObject", "geometry": house["geometry"]},
    }
    found = load_cityjson(save(city))
    assert [b.name for b in found.buildings] == ["part"]
    assert found.skipped == 1  # LoD0 alone
    assert found.terrain.shape == (2, 3, 3)
    np.testing.assert_allclose(found.terrain[0], [[-2, -2, 3], [2, -2, 3], [2, 0, 3]], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.sets(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1))
def test_chained_edges_enclose_the_union_of_their_cells(cells: set[tuple[int, int]]) -> None:
    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = [[(x + dx, y + dy) for dx, dy in around] for x, y in cells]
    rings = chain([edge for c in corners for edge in zip(c, [*c[1:], c[0]], strict=True)])
    assert rings is not None
    middles = np.array([(x + 0.5, y + 0.5) for x in range(5) for y in range(5)])
    found = Footprint(tuple(np.array(ring, float) for ring in rings), 0.0, 1.0, "")
    assert contains(found, middles).tolist() == [(x, y) in cells for x in range(5) for y in range(5)]


def test_open_edges_are_no_ring() -> None:
    assert chain([(0, 1), (1, 2)]) is None
    assert chain([]) is None


def test_a_part_on_the_roof_of_another_stands_on_the_floor_of_both(save: Callable[[object], Path]) -> None:
    for key, version in (("parent", "0.8"), ("parents", "2.0")):
        city = document(version, [L])
        house = city["CityObjects"].pop("house")
        upper = [[x, y, z + (TOP - BASE) / (0.001 if "transform" in city else 1)] for x, y, z in city["vertices"]]
        lift = len(upper)
        city["vertices"] += upper
        (geometry,) = house["geometry"]
        raised = [[[[i + lift for i in ring] for ring in face] for face in shell] for shell in geometry["boundaries"]]
        owner = "house" if key == "parent" else ["house"]
        city["CityObjects"] = {
            "roof": {"type": "BuildingPart", "geometry": [geometry | {"boundaries": raised}], key: owner},
            "hall": {"type": "BuildingPart", "geometry": [geometry], key: owner},
        }
        roof, hall = load_cityjson(save(city)).buildings
        assert (roof.base, roof.top) == (pytest.approx(BASE), pytest.approx(2 * TOP - BASE))
        assert (hall.base, hall.top) == (pytest.approx(BASE), pytest.approx(TOP))


def test_delft_is_where_its_faces_are(data: Path) -> None:
    path = data / "ahn3_delft" / "testarea.city.json"
    found = load_cityjson(path)
    assert len(found.buildings) == 160
    x, y = np.arange(-60.25, 60, 1.5), np.arange(-60.25, 60, 1.5)
    base, roof, _ = column_heights(path, x + found.origin[0], y + found.origin[1])
    points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    low, high = np.full((2, len(points)), np.nan)
    for building in found.buildings:
        held = contains(building, points)
        low[held] = np.fmin(low[held], building.base)
        high[held] = np.fmax(high[held], building.top)
    np.testing.assert_array_equal(np.isnan(low), np.isnan(base.ravel()))
    covered = ~np.isnan(low)
    assert covered.sum() > 500
    # The lowest vertex of the whole floor, and the highest of the roof, against those of the faces above a column.
    np.testing.assert_allclose(low[covered], base.ravel()[covered], atol=0.05)
    np.testing.assert_allclose(high[covered], roof.ravel()[covered], atol=0.05)


def test_the_hague_has_the_heights_of_its_attributes(data: Path) -> None:
    path = data / "the_hague" / "DenHaag_01.city.json"
    found = load_cityjson(path)
    things = json.loads(path.read_text())["CityObjects"]
    assert len(found.buildings) == 1990
    assert found.skipped == 0
    assert found.terrain.shape == (5595, 3, 3)
    ridge = np.array([things[b.name]["attributes"]["AbsoluteRidgeHeight"] for b in found.buildings])
    tops = np.array([b.top for b in found.buildings])
    np.testing.assert_allclose(tops, ridge, atol=0.01)


def broken(**change: Any) -> dict[str, Any]:
    return {**document("1.0", [L]), **change}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "expected JSON"),
        ("[]", "expected an object of type CityJSON, found 'list'"),
        ({"type": "FeatureCollection"}, "found 'FeatureCollection'"),
        (broken(version="3.0"), "expected CityJSON version 0.8.*found '3.0'"),
        (broken(version="2.0"), "expected a transform"),
        (broken(CityObjects={}), "expected a building with an outline and a height, found none"),
        (broken(vertices=[[0, 0, 0]]), "expected the number of a vertex, 0 to 0, found 5"),
        (broken(vertices=[[0, 0]]), "malformed CityJSON: ValueError"),
        (broken(CityObjects=[1]), "malformed CityJSON: AttributeError"),
    ],
)
def test_an_error_names_what_is_wrong(save: Callable[[object], Path], content: object, message: str) -> None:
    with pytest.raises(FileError, match=message):
        load_cityjson(save(content))


def test_an_error_names_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be read"):
        load_cityjson(tmp_path / "none.json")
