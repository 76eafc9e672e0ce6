"""Mutated files of every format end in a finite map or in one `FileError`; so does what once ended otherwise.

MUTATIONS=100000 python -m pytest tests/maps/test_bad_input.py      # at length
"""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from maxjax import Grid, load_airspace
from maxjax.core.earth import TangentPlane
from maxjax.core.files import FileError
from maxjax.core.geometry.rings import chain
from maxjax.maps import read_map
from maxjax.maps.contents import facts

MUTATIONS = int(os.environ.get("MUTATIONS", "2000"))
SLOW = {"scene.xml": 10, "a.zip": 4}  # formats that take so many times as long as others
BOX = [[x, y, z] for x in (0.0, 9.0) for y in (0.0, 8.0) for z in (0.0, 7.0)]
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
# Where areas are looked at.
AIR = Grid((60, 60, 20), 4.0, (-118.0, -118.0, 2.0))
GROUND = np.broadcast_to(np.arange(20) < 1, AIR.shape)
# Values that numbers in text are replaced by.
VALUES = [b"NaN", b"Infinity", b"-1", b"1e308", b"1e999", b"0", b"2.5", b"", b'""', b"null", b"[]", b"{}", 500 * b"9"]
VALUES += [5000 * b"7", b"181", b"-91", b"4294967296", b"'", b"\xff\xfe", b"true"]


def lines(*rows: str) -> bytes:
    return "\n".join([*rows, ""]).encode()


def ply(order: str) -> bytes:
    kind = {"<": "binary_little_endian", "": "ascii"}[order]
    head = lines("ply", f"format {kind} 1.0", "element cell 2", "property list uchar int of", "element vertex 8")
    head += lines("property float x", "property float y", "property float z", "element face 6")
    head += lines("property list uchar int vertex_indices", "end_header")
    if not order:
        rows = ["1 5", "0", *(" ".join(map(str, p)) for p in BOX), *("4 " + " ".join(map(str, q)) for q in QUADS)]
        return head + lines(*rows)
    body = struct.pack("<BiB", 1, 5, 0) + np.array(BOX, "<f4").tobytes()
    return head + body + b"".join(struct.pack("<B4i", 4, *quad) for quad in QUADS)


def obj() -> bytes:
    return lines(*(f"v {x} {y} {z}" for x, y, z in BOX), *("f " + " ".join(str(i + 1) for i in q) for q in QUADS))


def stl() -> bytes:
    corners = np.array(BOX, "<f4")[np.array(QUADS)[:, :3]]
    return bytes(80) + struct.pack("<I", 6) + b"".join(bytes(12) + face.tobytes() + b"\0\0" for face in corners)


def glb() -> bytes:
    document = {
        "nodes": [{"mesh": 0, "scale": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 18, "type": "SCALAR"},
        ],
        "bufferViews": [{"byteLength": 96}, {"byteOffset": 96, "byteLength": 36}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = np.array(BOX, "<f4").tobytes() + np.array(QUADS, "<u2")[:, :3].tobytes()
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def cityjson() -> bytes:
    tin = {"type": "TINRelief", "geometry": [{"type": "CompositeSurface", "lod": 1, "boundaries": [[[0, 2, 4]]]}]}
    solid = {"type": "Solid", "lod": 1, "boundaries": [[[quad] for quad in QUADS]]}
    house = {"type": "Building", "geometry": [solid]}
    return json.dumps(
        {
            "type": "CityJSON",
            "version": "1.1",
            "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"},
            "transform": {"scale": [0.5, 0.5, 0.5], "translate": [85000.0, 447000.0, 1.0]},
            "CityObjects": {"house": house, "ground": tin},
            "vertices": [[int(4 * x) for x in corner] for corner in BOX],
        }
    ).encode()


def geojson() -> bytes:
    ring = [[4.3, 52.0], [4.301, 52.0], [4.301, 52.001], [4.3, 52.001], [4.3, 52.0]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "geometry": geometry, "properties": {"height": 12.5, "ele": 1}}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()


def areas() -> bytes:
    """A prohibited area with a hole, and one to keep in of two parts."""
    outer = [[4.3, 52.0], [4.301, 52.0], [4.301, 52.001], [4.3, 52.001], [4.3, 52.0]]
    inner = [[4.3005, 52.0005], [4.3007, 52.0005], [4.3007, 52.0007], [4.3005, 52.0005]]
    layer = {"lower": 5, "lowerReference": "AGL", "upper": 120, "upperReference": "AMSL", "uom": "m"}
    school = {"type": "Polygon", "coordinates": [outer, inner], "layer": layer}
    field = {"type": "MultiPolygon", "coordinates": [[outer], [[[x + 0.002, y] for x, y in outer]]]}
    features = [
        {"type": "Feature", "properties": {"type": "PROHIBITED"}, "geometry": school},
        {"type": "Feature", "properties": {"name": "field", "inclusion": True}, "geometry": field},
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def osm() -> bytes:
    nodes = [f'<node id="{i}" lat="{52 + y}" lon="{4 + x}"/>' for i, (x, y) in enumerate(np.ndindex(2, 2))]
    nodes = [node.replace('"53"', '"52.001"').replace('"5"', '"4.001"') for node in nodes]
    way = "".join(f'<nd ref="{i}"/>' for i in (0, 1, 3, 2, 0))
    way += '<tag k="building" v="yes"/><tag k="height" v="8.5"/><tag k="ele" v="2"/>'
    return lines(
        '<?xml version="1.0" encoding="UTF-8"?>', '<osm version="0.6">', *nodes, f'<way id="7">{way}</way>', "</osm>"
    )


def archive(**arrays: object) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def las(suffix: str) -> bytes:
    """Ground, a roof and a tree, in national coordinates."""
    laspy = pytest.importorskip("laspy", reason="needs the extra las")
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [85_000.0, 447_000.0, 0.0]
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.array(BOX).T + np.array([[85_000.0], [447_000.0], [0.0]])
    points.classification = np.resize([2, 6, 5], len(BOX))
    points.return_number[:] = 1
    buffer = io.BytesIO()
    points.write(buffer, do_compress=suffix == "laz")
    return buffer.getvalue()


def geotiff() -> bytes:
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    height = np.arange(12, dtype=np.float32).reshape(3, 4)
    place = rasterio.transform.from_origin(85_000, 447_006, 2, 2)
    options = {"width": 4, "height": 3, "count": 1, "dtype": "float32", "nodata": -9999, "compress": "deflate"}
    with rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", transform=place, crs="EPSG:28992", **options) as file:
            file.write(height, 1)
        return bytes(memory.read())


def octree(title: str, body: bytes) -> bytes:
    return lines(title, "id OcTree", "size 1", "res 0.5", "data") + body


SCENE = """<scene version="3.0.0"><default name="far" value="8"/><shape type="cube"><transform name="to_world">
<scale x="9" y="5" z="$far"/><rotate z="1" angle="30"/><translate value="13 3 10"/></transform></shape>
<shape type="rectangle"><transform name="to_world"><matrix value="10 0 0 -8  0 14 0 -10  0 0 9 0  0 0 0 1"/></transform>
</shape><shape type="sphere"/></scene>"""


def packed() -> bytes:
    """A mesh and a scene's note in an archive."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("house.obj", obj())
        archive.writestr("notes.txt", "none")
    return buffer.getvalue()


PCD = lines("VERSION .7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1", "WIDTH 8", "HEIGHT 1", "POINTS 8")
SAMPLES: dict[str, Callable[[], bytes]] = {
    "binary.ply": lambda: ply("<"),
    "ascii.ply": lambda: ply(""),
    "a.obj": obj,
    "a.stl": stl,
    "a.glb": glb,
    "a.json": cityjson,
    "a.geojson": geojson,
    "a.osm": osm,
    "areas.geojson": areas,
    "voxels.npz": lambda: archive(occupied=np.eye(3, dtype=bool)[None], spacing=2.0, origin=np.zeros(3)),
    "points.npz": lambda: archive(points=np.array(BOX), ground=np.zeros(8, bool)),
    "a.bt": lambda: octree("# Octomap OcTree binary file", struct.pack("<3H", 3, 0b11_10_01, 0b10_01)),
    "a.ot": lambda: octree("# Octomap OcTree file", struct.pack("<fBfBfB", 1, 3, 1, 0, -1, 0)),
    "ascii.pcd": lambda: PCD + lines("DATA ascii", *(" ".join(map(str, p)) for p in BOX)),
    "binary.pcd": lambda: PCD + b"DATA binary\n" + np.array(BOX, "<f4").tobytes(),
    "packed.pcd": lambda: (
        PCD + b"DATA binary_compressed\n" + struct.pack("<II", 6, 96) + bytes([1, 0, 0, 7 << 5, 85, 1])
    ),
    "a.las": lambda: las("las"),
    "a.laz": lambda: las("laz"),
    "a.tif": geotiff,
    "a.3dmap": lambda: lines("voxel 5 6 7", "1 2 3", "4 5 6"),
    "a.csv": lambda: lines("x_min,y_min,z_min,x_max,y_max,z_max", "0,0,0,1,2,3", "5,5,5,9.5,7,8"),
    "colliders.csv": lambda: lines(
        "lat0 37.79, lon0 -122.39", "posX,posY,posZ,halfSizeX,halfSizeY,halfSizeZ", "-10,20,5,2,4,5", "30,0,10,1,1,10"
    ),
    "scene.xml": lambda: SCENE.encode(),
    "a.zip": packed,
}


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, cut, doubled or left out; in text also numbers replaced."""
    place = int(rng.integers(len(content)))
    size = int(rng.integers(1, 9))
    match rng.integers(6):
        case 0:
            return content[:place]
        case 1:
            return content[:place] + rng.bytes(size) + content[place + size :]
        case 2:
            return content[:place] + content[place + size :]
        case 3:
            return content[: place + size] + content[place:]
    begin = place
    while begin < len(content) and content[begin : begin + 1] not in b"0123456789-.":
        begin += 1
    end = begin
    while end < len(content) and content[end : end + 1] in b"0123456789-.eE+":
        end += 1
    return content[:begin] + VALUES[rng.integers(len(VALUES))] + content[end:]


def coordinates(path: Path) -> np.ndarray:
    """Of what a file holds."""
    if path.name != "areas.geojson":
        return np.asarray(facts(read_map(path)).extent)
    here = TangentPlane(52.0005, 4.3005)
    airspace = load_airspace(path, here, AIR)
    assert airspace.closed(GROUND, AIR).shape == AIR.shape
    return np.concatenate([ring for area in airspace.areas for ring in area.rings])


def outcome(path: Path) -> str:
    """ "map" or "refused"; anything else raises."""
    try:
        found = coordinates(path)
    except FileError as error:
        sentence = str(error)
        assert "\n" not in sentence
        assert path.name in sentence
        assert len(sentence) < 1000
        cause = error.__cause__
        assert type(cause).__name__ != "TypeCheckError", cause
        assert not isinstance(cause, Warning), cause  # which tests raise, and the command line prints
        return "refused"
    assert np.isfinite(found).all()
    return "map"


@pytest.mark.large
@pytest.mark.parametrize("name", SAMPLES)
def test_mutated_files_are_refused_or_finite(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    whole = SAMPLES[name]()
    path.write_bytes(whole)
    assert outcome(path) == "map"
    rng = np.random.default_rng(0)
    found = []
    count = MUTATIONS // SLOW.get(name, 1)
    for _ in range(count):
        path.write_bytes(mutated(whole, rng))
        found.append(outcome(path) if path.stat().st_size else "refused")
    assert found.count("refused") > 0.02 * count


def replaced(content: bytes, old: bytes, new: bytes) -> bytes:
    assert old in content
    return content.replace(old, new, 1)


def deep_header() -> bytes:
    header = b"(" * 5000 + b")" * 5000 + b"\n"
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("occupied.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header)
    return buffer.getvalue()


def shared_way() -> bytes:
    """A way that so many buildings name: 60 times as many corners as the file has."""
    house = '<relation id="{}"><member type="way" ref="7"/><tag k="type" v="multipolygon"/><tag k="building" v="yes"/>'
    houses = "".join(house.format(k) + '<tag k="height" v="5"/></relation>' for k in range(60))
    return replaced(osm(), b"</osm>", houses.encode() + b"</osm>")


def ascii_stl(number: bytes) -> bytes:
    facet = b"facet normal 0 0 0 outer loop vertex 0 0 0 vertex %s 0 0 vertex 0 1 0 endloop endfacet " % number
    return b"solid a\n" + facet + b"endsolid a\n"


BOMB = b'<!DOCTYPE osm [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><osm version="0.6">&b;</osm>'
ONCE = {
    "deep.npz": deep_header,
    "float.ply": lambda: replaced(ply("<"), b"property list uchar int vertex", b"property list float int vertex"),
    "idna.osm": lambda: replaced(osm(), b"UTF-8", b"idna"),
    "undefined.osm": lambda: replaced(osm(), b"UTF-8", b"undefined"),
    "klingon.osm": lambda: replaced(osm(), b"UTF-8", b"klingon"),
    "base64.osm": lambda: replaced(osm(), b"UTF-8", b"base64"),
    "utf7.osm": lambda: replaced(osm(), b"UTF-8", b"utf-7"),
    "bomb.osm": lambda: BOMB,
    "nan.osm": lambda: replaced(osm(), b'lon="4.001"', b'lon="nan"'),
    "east.osm": lambda: replaced(osm(), b'lon="4.001"', b'lon="500"'),
    "north.osm": lambda: replaced(osm(), b'lat="52.001"', b'lat="91"'),
    "tall.osm": lambda: replaced(osm(), b'"8.5"', b'"' + 400 * b"9" + b'"'),
    "high.json": lambda: replaced(cityjson(), b'"translate": [85000.0', b'"translate": [1e308'),
    "infinite.json": lambda: replaced(cityjson(), b'"translate": [85000.0', b'"translate": [Infinity'),
    "negative.json": lambda: replaced(cityjson(), b"[[0, 2, 4]]", b"[[0, 2, -1]]"),
    "half.json": lambda: replaced(cityjson(), b"[[0, 2, 4]]", b"[[0, 2, 1.5]]"),
    "digits.json": lambda: replaced(cityjson(), b"85000.0", 5000 * b"8"),
    "far.obj": lambda: replaced(obj(), b"v 9.0", b"v 1e308"),
    "signalling.ply": lambda: replaced(ply("<"), struct.pack("<f", 9.0), b"\1\0\x80\x7f"),
    "deep.osm": lambda: b'<osm version="0.6">' + 100 * b"<a>" + 100 * b"</a>" + b"</osm>",
    "shared.osm": shared_way,
    "line.ply": lambda: replaced(ply(""), b"end_header\n1 5", b"end_header\n1 5" + bytes(2**20)),
    "line.pcd": lambda: replaced(SAMPLES["ascii.pcd"](), b"DATA ascii\n", b"DATA ascii\n" + 2**20 * b" "),
    "long.stl": lambda: ascii_stl(200 * b"1"),
}


@pytest.mark.parametrize("name", ONCE)
def test_what_was_once_taken_or_ended_in_a_traceback_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(ONCE[name]())
    assert outcome(tmp_path / name) == "refused"


@pytest.mark.parametrize(
    ("name", "cap", "most", "sentence"),
    [
        ("a.csv", "maps.readers.box_list.MAX_BOXES", 1, "expected at most 1 boxes, found more"),
        ("a.bt", "maps.readers.octomap._MAX_NODES", 2, "has 3 nodes, expected at most 2"),
        ("a.ot", "maps.readers.octomap._MAX_NODES", 2, "has 3 nodes, expected at most 2"),
        ("a.glb", "maps.readers.glb.MAX_POINTS", 7, "expected at most 7 vertices, found more"),
        ("a.glb", "maps.readers.glb.MAX_TEXT_BYTES", 99, "its JSON has .* bytes, expected at most 99"),
        ("binary.ply", "maps.readers.ply.MAX_FACES", 7, "its faces have 24 corners, expected at most 21"),
        ("areas.geojson", "airspace.outlines._MOST_PAIRS", 4, "expected a simpler outline"),
        ("areas.geojson", "core.geometry.columns._MOST", 99, "expected at most 99 columns in all of them, found more"),
    ],
)
def test_what_takes_much_memory_or_time_has_a_cap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, cap: str, most: int, sentence: str
) -> None:
    (tmp_path / name).write_bytes(SAMPLES[name]())
    assert outcome(tmp_path / name) == "map"
    monkeypatch.setattr(f"maxjax.{cap}", most)
    with pytest.raises(ValueError, match=sentence):
        coordinates(tmp_path / name)


def test_a_corner_of_very_many_edges_is_chained() -> None:
    hub = [edge for k in range(20_000) for edge in (("hub", f"a{k}"), (f"a{k}", f"b{k}"), (f"b{k}", "hub"))]
    rings = chain(hub)
    assert rings is not None
    assert sum(map(len, rings)) == len(hub)


def test_lists_before_the_vertices_are_stepped_over(tmp_path: Path) -> None:
    count = 200_000
    rng = np.random.default_rng(0)
    rows = b"".join(bytes([n]) + bytes(4 * n) for n in rng.integers(0, 4, count).tolist())
    head = lines("ply", "format binary_little_endian 1.0", f"element cell {count}", "property list uchar int of")
    head += lines("element vertex 8", "property float x", "property float y", "property float z", "end_header")
    (tmp_path / "a.ply").write_bytes(head + rows + np.array(BOX, "<f4").tobytes())
    np.testing.assert_array_equal(read_map(tmp_path / "a.ply").points, BOX)
