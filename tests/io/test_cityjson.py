"""CityJSON: made-up prisms in every version exactly, Delft and The Hague as oracles and the files' attributes say."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

import maxjax
from maxjax.core.files import FileError
from maxjax.io.geo.rings import chain
from maxjax.io.kinds.footprints import Fill, Footprint, Footprints
from maxjax.io.readers.cityjson import load_cityjson
from tests.io.cityjson import column_heights

# An L of 12 m², and a square hole in a square of 16.
L = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]
SQUARE, HOLE = [(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (1, 3), (3, 3), (3, 1)]
BASE, TOP = 3.0, 10.5
AT = np.array([85_000.0, 447_000.0])


def level_area(found: Footprints) -> float:
    """Area of the faces that look down or up."""
    normal = np.cross(*(found.shells.faces[:, k] - found.shells.faces[:, 0] for k in (1, 2)))
    return float(0.5 * np.abs(normal[:, 2]).sum())


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
def test_every_version_gives_the_same_solid(
    save: Callable[[object], Path], version: str, rings: list[list[tuple[int, int]]], size: float
) -> None:
    found = load_cityjson(save(document(version, rings)))
    assert (found.shells.names, found.shells.fill.tolist()) == (("house",), [Fill.INSIDE])
    assert level_area(found) == pytest.approx(2 * size, abs=1e-6)
    corners = found.shells.faces.reshape(-1, 3)
    np.testing.assert_allclose(corners.min(0), [*AT, BASE], atol=1e-9)
    np.testing.assert_allclose(corners.max(0), [*(AT + 4), TOP], atol=1e-9)


def test_what_faces_are_called_does_not_count(save: Callable[[object], Path]) -> None:
    _, faces, _ = prism([SQUARE], triangles=True)
    for geometry in ({"boundaries": [faces]}, {"boundaries": faces, "type": "MultiSurface", "lod": 1}):
        found = load_cityjson(save(document("1.0", [SQUARE], semantics=None, **geometry)))
        assert found.shells.fill.tolist() == [Fill.INSIDE]
        assert level_area(found) == pytest.approx(32.0)


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
    assert found.shells.names == ("part", "tree")
    assert found.dropped == {"buildings without a height": 1}  # the sum of nothing
    assert found.terrain.shape == (2, 3, 3)
    corners = np.add([[0, 0, 3], [4, 0, 3], [4, 2, 3]], [*AT, 0.0])
    np.testing.assert_allclose(found.terrain[0], corners, atol=1e-6)


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
        shells = load_cityjson(save(city)).shells
        assert shells.names == ("roof", "hall")
        np.testing.assert_allclose(shells.base, BASE)
        tops = [shells.faces[shells.of_face == k, :, 2].max() for k in (0, 1)]
        np.testing.assert_allclose(tops, [2 * TOP - BASE, TOP])


def test_delft_is_where_its_faces_are(data: Path) -> None:
    path = data / "ahn3_delft" / "testarea.city.json"
    town = maxjax.load_map(path, spacing=1.0, bounds=(84_850, 447_450, -5, 84_950, 447_550, 40))
    x, y, _ = (town.grid.origin[k] + np.arange(town.grid.shape[k]) for k in range(3))
    base, roof, _ = column_heights(path, x, y)
    solid = town.occupied & ~town.ground
    covered = ~np.isnan(base) & (roof - base > 2.0)
    assert covered.sum() > 500
    top = town.grid.lower[2] + np.where(solid.any(axis=2), solid.shape[2] - solid[:, :, ::-1].argmax(axis=2), np.nan)
    # Whatever touches a voxel fills it: up to a voxel above the roof, or what is beside it in the column.
    assert (top[covered] >= roof[covered] - 1e-6).all()
    assert np.median(top[covered] - roof[covered]) <= 1.0
    middle = np.floor((0.5 * (base + roof) - town.grid.lower[2])[covered]).astype(int)
    assert solid[covered, middle].all()


def test_the_hague_has_the_heights_of_its_attributes(data: Path) -> None:
    path = data / "the_hague" / "DenHaag_01.city.json"
    found = load_cityjson(path)
    things = json.loads(path.read_text())["CityObjects"]
    shells = found.shells
    assert len(set(shells.names)) == 1990
    assert found.dropped == {}
    assert found.terrain.shape == (5595, 3, 3)
    tops = np.full(len(shells.names), -np.inf)
    np.maximum.at(tops, shells.of_face, shells.faces[:, :, 2].max(axis=1))
    highest = {name: max(tops[k] for k in range(len(tops)) if shells.names[k] == name) for name in shells.names[:200]}
    ridge = [things[name]["attributes"]["AbsoluteRidgeHeight"] for name in highest]
    np.testing.assert_allclose(list(highest.values()), ridge, atol=0.01)


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
