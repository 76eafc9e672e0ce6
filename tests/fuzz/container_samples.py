"""Small valid files of formats that hold what another format holds, and of those that libraries read."""

from __future__ import annotations

import base64
import gzip
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

CORNERS = [(x, y, z) for z in (0.0, 8.0) for y in (0.0, 12.0) for x in (0.0, 10.0)]
FACES = [(0, 1, 3), (0, 3, 2), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 3, 7), (2, 7, 6)]
RING = [[4.3, 52.0], [4.301, 52.0], [4.301, 52.001], [4.3, 52.001], [4.3, 52.0]]


def text_points() -> bytes:
    return "\n".join(["# x y z i", *(f"{x} {y} {z} 7" for x, y, z in CORNERS)]).encode()


def grid() -> bytes:
    head = "ncols 4\nnrows 3\nxllcorner 85000\nyllcorner 447000\ncellsize 2\nNODATA_value -9999\n"
    return (head + "\n".join("1 2.5 3 -9999" for _ in range(3))).encode()


def gltf() -> bytes:
    points = np.array([(x, z, -y) for x, y, z in CORNERS], "<f4").tobytes()
    faces = np.array(FACES, "<u2").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(points + faces).decode()
    views = [{"buffer": 0, "byteLength": len(points)}]
    views.append({"buffer": 0, "byteOffset": len(points), "byteLength": len(faces)})
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(points) + len(faces)}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(CORNERS), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3 * len(FACES), "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
    }
    return json.dumps(document).encode()


def feature_lines() -> bytes:
    shape = {"type": "Polygon", "coordinates": [RING]}
    lines = [{"type": "Feature", "geometry": shape, "properties": {"height": h, "ele": 1}} for h in (12.5, 3)]
    return "\n".join(map(json.dumps, lines)).encode()


def city_lines() -> bytes:
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]]
    solid = {"type": "Solid", "lod": "1", "boundaries": [[[face] for face in faces]]}
    transform = {"scale": [0.01] * 3, "translate": [85_000.0, 447_000.0, 0.0]}
    first = {"type": "CityJSON", "version": "2.0", "transform": transform, "CityObjects": {}, "vertices": []}
    first |= {"metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"}}
    vertices = [[int(100 * c) for c in corner] for corner in CORNERS]
    lines = [first]
    for name in ("one", "two"):
        things = {name: {"type": "Building", "geometry": [solid]}}
        lines.append({"type": "CityJSONFeature", "id": name, "CityObjects": things, "vertices": vertices})
    return "\n".join(map(json.dumps, lines)).encode()


def overpass() -> bytes:
    places = [{"lat": y, "lon": x} for x, y in RING]
    way = {"type": "way", "id": 7, "nodes": [1, 2, 3, 4, 1], "geometry": places}
    way |= {"tags": {"building": "yes", "height": "8.5", "ele": "2"}}
    member = {"type": "way", "ref": 9, "role": "outer", "geometry": places}
    house = {"type": "relation", "id": 8, "members": [member], "tags": {"type": "multipolygon", "building": "yes"}}
    house["tags"] = {"type": "multipolygon", "building": "yes", "height": "12"}
    return json.dumps({"version": 0.6, "generator": "Overpass API", "elements": [way, house]}).encode()


def of_library(name: str, write: Callable[[Path], None]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def pbf() -> bytes:
    osmium = pytest.importorskip("osmium", reason="needs the extra gis")

    def write(path: Path) -> None:
        from osmium.osm.mutable import Node, Way

        with osmium.SimpleWriter(str(path)) as writer:
            for k, (x, y) in enumerate(RING[:4], 1):
                writer.add_node(Node(id=k, location=(x, y)))
            writer.add_way(Way(id=7, nodes=[1, 2, 3, 4, 1], tags={"building": "yes", "height": "8.5", "ele": "2"}))

    return of_library("a.osm.pbf", write)


def vector(name: str) -> bytes:
    pyogrio = pytest.importorskip("pyogrio", reason="needs the extra gis")
    import shapely

    def write(path: Path) -> None:
        shapes = np.array([shapely.box(85_000, 447_000, 85_010, 447_012).wkb], object)
        fields = [np.array([12.5])]
        pyogrio.raw.write(path, shapes, fields, ["height"], geometry_type="Polygon", crs="EPSG:28992")

    return of_library(name, write)


def e57() -> bytes:
    pye57 = pytest.importorskip("pye57", reason="needs the extra e57")

    def write(path: Path) -> None:
        x, y, z = np.array(CORNERS).T.copy()
        with pye57.E57(str(path), mode="w") as file:
            file.write_scan_raw({"cartesianX": x, "cartesianY": y, "cartesianZ": z})

    return of_library("a.e57", write)


SAMPLES: dict[str, Callable[[], bytes]] = {
    "a.xyz": text_points,
    "a.asc": grid,
    "a.gltf": gltf,
    "a.geojsonl": feature_lines,
    "a.jsonl": city_lines,
    "overpass.json": overpass,
    "a.xyz.gz": lambda: gzip.compress(text_points(), mtime=0),
    "a.osm.pbf": pbf,
    "a.fgb": lambda: vector("a.fgb"),
    "a.gpkg": lambda: vector("a.gpkg"),
    "a.e57": e57,
}
