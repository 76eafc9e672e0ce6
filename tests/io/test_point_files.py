"""Points in text and E57, rasters of other kinds than GeoTIFF, glTF with buffers beside it, and packed files."""

from __future__ import annotations

import base64
import gzip
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

import maxjax
from maxjax.io.kinds.contents import facts
from maxjax.io.kinds.heights import Heights
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import PointCloud
from maxjax.io.reader import read_map

POINTS = np.array([[1.5, 2.0, 0.25], [4.0, -3.0, 1.0], [-2.5, 7.0, 6.5], [30.0, 20.0, 9.0]])


def cloud(path: Path) -> np.ndarray:
    found = read_map(path)
    assert isinstance(found, PointCloud)
    return np.asarray(found.points, np.float64) + found.offset


@pytest.mark.parametrize(
    ("name", "head", "between"),
    [
        ("a.xyz", "", " "),
        ("a.xyz", "# x y z intensity\n", " "),
        ("a.txt", "//X,Y,Z,R\n", ","),
        ("a.txt", '"x";"y";"z";"i"\n', ";"),
        ("a.asc", "# by a scanner\n\n", "\t"),
        ("a.pts", "4\n", " "),
    ],
)
def test_points_in_text(tmp_path: Path, name: str, head: str, between: str) -> None:
    rows = [between.join(map(str, (*point, 17))) for point in POINTS.tolist()]
    (tmp_path / name).write_text(head + "\n".join(rows) + "\n")
    np.testing.assert_allclose(cloud(tmp_path / name), POINTS, atol=1e-6)


def test_names_say_which_columns_are_read(tmp_path: Path) -> None:
    rows = [f"{z} 5 {y} {x}" for x, y, z in POINTS.tolist()]
    (tmp_path / "a.xyz").write_text("height id northing easting\n" + "\n".join(rows))
    np.testing.assert_allclose(cloud(tmp_path / "a.xyz"), POINTS, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("5\n1 2 3\n4 5 6\n", "claims 5 points in its first line, found 2"),
        ("1 2\n3 4\n", "line 1: expected numbers x y z, or names"),
        ("1 2 3\n4 5\n", "expected lines of numbers x y z"),
        ("1 2 3\n4 five 6\n", "expected lines of numbers x y z"),
        ("hello\n", "line 1: expected numbers x y z"),
        ("# nothing\n", "expected lines of numbers x y z, found none"),
    ],
)
def test_text_that_holds_no_points_says_where(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "a.xyz").write_text(text)
    with pytest.raises(ValueError, match=sentence):
        read_map(tmp_path / "a.xyz")


def test_scans_of_an_e57_file_stand_where_their_poses_put_them(tmp_path: Path) -> None:
    """Two scans, the second turned by a right angle and moved; one point of it is marked as invalid."""
    pye57 = pytest.importorskip("pye57")
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        x, y, z = POINTS.T.copy()
        file.write_scan_raw({"cartesianX": x, "cartesianY": y, "cartesianZ": z})
        flags = np.array([0, 0, 1, 0], np.int8)
        turn = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
        data = {"cartesianX": x, "cartesianY": y, "cartesianZ": z, "cartesianInvalidState": flags}
        file.write_scan_raw(data, rotation=turn, translation=np.array([100.0, 0.0, 5.0]))
    turned = np.column_stack([100.0 - POINTS[:, 1], POINTS[:, 0], POINTS[:, 2] + 5.0])[flags == 0]
    np.testing.assert_allclose(cloud(path), np.concatenate([POINTS, turned]), atol=1e-5)
    assert facts(read_map(path)).dropped == {"marked as invalid": 1}
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(ValueError, match="expected an intact E57 file"):
        read_map(path)
    path.write_bytes(b"nothing of it")
    with pytest.raises(ValueError, match="which starts with ASTM-E57"):
        read_map(path)


def test_a_grid_of_esri(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    head = "ncols 3\nnrows 2\nxllcorner 1000\nyllcorner 2000\ncellsize 2\nNODATA_value -9999\n"
    (tmp_path / "a.asc").write_text(head + "10 11 12\n20 -9999 22\n")
    found = read_map(tmp_path / "a.asc")
    assert isinstance(found, Heights)
    np.testing.assert_array_equal(found.height, np.array([[20, 10], [np.nan, 11], [22, 12]], np.float32))
    assert (found.west, found.south, found.cell) == (1000.0, 2000.0, (2.0, 2.0))


def test_a_tile_of_srtm_counts_from_the_geoid(tmp_path: Path) -> None:
    """1201 x 1201 heights of N47 E008, the highest in the south-west."""
    pytest.importorskip("rasterio")
    heights = np.full((1201, 1201), 400, ">i2")
    heights[-1, 0] = 450
    (tmp_path / "N47E008.hgt").write_bytes(heights.tobytes())
    known = facts(read_map(tmp_path / "N47E008.hgt"))
    assert known.zero == maxjax.VerticalZero(0.0, "EGM96 height")
    assert known.origin == pytest.approx((8.5, 47.5))
    assert known.extent[:, 2].tolist() == [400.0, 450.0]


def box_as_gltf(uri: str, folder: Path) -> Path:
    """A box of 4 x 6 x 10 m, z up once read, its buffer where the address says."""
    mesh = trimesh.creation.box(extents=(4.0, 10.0, 6.0))
    points, faces = mesh.vertices.astype("<f4").tobytes(), mesh.faces.astype("<u2").tobytes()
    if uri == "data:":
        uri = "data:application/octet-stream;base64," + base64.b64encode(points + faces).decode()
    else:
        (folder / "a b.bin").write_bytes(points + faces)
    views = [
        {"buffer": 0, "byteLength": len(points)},
        {"buffer": 0, "byteOffset": len(points), "byteLength": len(faces)},
    ]
    kinds = [(0, 5126, len(mesh.vertices), "VEC3"), (1, 5123, mesh.faces.size, "SCALAR")]
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(points) + len(faces)}],
        "bufferViews": views,
        "accessors": [{"bufferView": v, "componentType": c, "count": n, "type": t} for v, c, n, t in kinds],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    path = folder / "a.gltf"
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("uri", ["data:", "a%20b.bin"])
def test_gltf_with_its_buffer_in_it_or_beside_it(tmp_path: Path, uri: str) -> None:
    found = read_map(box_as_gltf(uri, tmp_path))
    assert isinstance(found, Mesh)
    np.testing.assert_allclose(np.ptp(found.triangles.reshape(-1, 3), axis=0), [4.0, 6.0, 10.0], atol=1e-6)


@pytest.mark.parametrize("uri", ["../a.bin", "/etc/passwd", "sub/a.bin", "missing.bin", "data:text,abc"])
def test_gltf_opens_no_other_file(tmp_path: Path, uri: str) -> None:
    path = box_as_gltf("data:", tmp_path)
    document = json.loads(path.read_text())
    document["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(document))
    with pytest.raises(ValueError, match=r"expected a file of the same folder|No such file|expected base64"):
        read_map(path)


def test_packed_files_are_those_within(tmp_path: Path) -> None:
    text = "\n".join(" ".join(map(str, point)) for point in POINTS.tolist()).encode()
    (tmp_path / "a.xyz.gz").write_bytes(gzip.compress(text))
    np.testing.assert_allclose(cloud(tmp_path / "a.xyz.gz"), POINTS, atol=1e-6)
    for content, sentence in (
        (gzip.compress(text)[:-9], "expected an intact gzip file"),
        (text, "expected an intact gzip file"),
        (gzip.compress(b"no points"), r"a\.xyz\.gz: line 1: expected numbers"),
        (struct.pack("<H", 0x8B1F), "expected an intact gzip file"),
    ):
        (tmp_path / "a.xyz.gz").write_bytes(content)
        with pytest.raises(ValueError, match=sentence):
            read_map(tmp_path / "a.xyz.gz")


def test_a_packed_file_takes_no_more_than_a_map_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maxjax.io.reader.MAX_FILE_BYTES", 10_000)
    (tmp_path / "a.xyz.gz").write_bytes(gzip.compress(b"0 0 0\n" * 2000))
    with pytest.raises(ValueError, match="unpacks to more than 10000 bytes"):
        read_map(tmp_path / "a.xyz.gz")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("a.ifc", r"\.ifc is a model of building design, which is not read: export it as \.glb or \.obj"),
        ("a.mcap", r"\.mcap is a recording of ROS, which is not read: export its clouds"),
        ("a.tar", "an archive, which is not read: unpack it first"),
        ("a.what", r"expected a suffix among .*, found \.what"),
        ("a", r"expected a suffix among .*, found none"),
    ],
)
def test_a_format_that_is_not_read_is_named_with_what_to_do(tmp_path: Path, name: str, sentence: str) -> None:
    (tmp_path / name).write_bytes(b"something")
    with pytest.raises(ValueError, match=sentence):
        read_map(tmp_path / name)
