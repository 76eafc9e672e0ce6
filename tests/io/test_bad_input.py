"""What once was taken, or ended in a traceback, is refused; tests/fuzz looks for more of it."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from maxjax.io import read_map
from maxjax.io.geo.rings import chain
from tests.fuzz.map_files import BOX, SAMPLES, cityjson, coordinates, lines, obj, osm, outcome, ply


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
        ("a.csv", "io.readers.box_list.MAX_BOXES", 1, "expected at most 1 boxes, found more"),
        ("a.bt", "io.readers.octomap._MAX_NODES", 2, "has 3 nodes, expected at most 2"),
        ("a.ot", "io.readers.octomap._MAX_NODES", 2, "has 3 nodes, expected at most 2"),
        ("a.glb", "io.readers.gltf_mesh.MAX_POINTS", 7, "expected at most 7 vertices, found more"),
        ("a.glb", "io.readers.gltf_mesh.MAX_TEXT_BYTES", 99, "its JSON has .* bytes, expected at most 99"),
        ("binary.ply", "io.readers.ply.MAX_FACES", 7, "its faces have 24 corners, expected at most 21"),
        ("areas.geojson", "io.airspace.outlines._MOST_PAIRS", 4, "expected a simpler outline"),
        ("areas.geojson", "io.geo.columns._MOST", 99, "expected at most 99 columns in all of them, found more"),
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
