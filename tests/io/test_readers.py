"""Every reader gives the file's points back, and answers any damaged file with a FileError alone."""

from __future__ import annotations

import builtins
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxjax.core.files import FileError
from maxjax.io import Mesh, PointCloud, StoredVoxels, read_map

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
TYPES |= {"double": "f8", "int16": "i2", "float32": "f4", "float64": "f8"}
POINTS = np.random.default_rng(0).uniform(-90, 90, (200, 3))


def write_ply(path: Path, points: np.ndarray, order: str = "<", kind: str = "float", faces: bool = False) -> None:
    """A PLY file with an element before the vertices, a property between coordinates, and on request a face behind."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    lines = [
        "ply",
        f"format {name} 1.0",
        "comment a test",
        "element camera 2",
        "property list uchar short views",
    ]
    lines += [
        "property float focal",
        f"element vertex {len(points)}",
        f"property {kind} x",
        "property uchar red",
    ]
    lines += [f"property {kind} z", f"property {kind} y"]
    lines += ["element face 1", "property list uchar int vertex_indices"] * faces
    header = "\n".join([*lines, "end_header", ""]).encode()
    cameras = [([1, 2, 3], 0.5), ([], 1.5)]
    if order:
        body = b"".join(struct.pack(f"{order}B{len(views)}hf", len(views), *views, focal) for views, focal in cameras)
        code = order + TYPES[kind]
        rows = np.zeros(len(points), [("x", code), ("red", "u1"), ("z", code), ("y", code)])
        rows["x"], rows["y"], rows["z"] = points.T
        body += rows.tobytes() + struct.pack(f"{order}B3i", 3, 0, 1, 2) * faces
    else:
        text = [f"{len(views)} {' '.join(map(str, views))} {focal}" for views, focal in cameras]
        text += [f"{x!r} 7 {z!r} {y!r}" for x, y, z in points.astype(TYPES[kind]).tolist()]
        body = "\n".join([*text, *["3 0 1 2"] * faces, ""]).encode()
    path.write_bytes(header + body)


def write_las(path: Path, points: np.ndarray, classes: np.ndarray | int = 0, format: int = 3) -> None:
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=format, version="1.4" if format > 5 else "1.2")
    header.scales, header.offsets = [0.001] * 3, np.floor(points.min(0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.classification = np.broadcast_to(classes, len(points))
    las.write(path)


@pytest.mark.parametrize("order", ["<", ">", ""])
@pytest.mark.parametrize("kind", list(TYPES))
def test_ply_of_every_type_and_byte_order(tmp_path: Path, order: str, kind: str) -> None:
    points = np.abs(POINTS) if kind.startswith("u") else POINTS
    write_ply(tmp_path / "a.ply", points, order, kind)
    cloud = read_map(tmp_path / "a.ply")
    assert isinstance(cloud, PointCloud)
    np.testing.assert_array_equal(cloud.points, points.astype(TYPES[kind]).astype(np.float32))
    assert cloud.source == "a.ply"
    assert not cloud.ground.any()
    assert not cloud.solid.any()
    np.testing.assert_array_equal(cloud.offset, 0)


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_ply_with_a_face_is_a_mesh_whose_other_vertices_stay_obstacles(tmp_path: Path, order: str) -> None:
    write_ply(tmp_path / "a.ply", POINTS, order, "double", faces=True)
    mesh = read_map(tmp_path / "a.ply")
    assert isinstance(mesh, Mesh)
    np.testing.assert_array_equal(mesh.triangles, POINTS[None, :3])
    np.testing.assert_array_equal(mesh.points[np.lexsort(mesh.points.T)], POINTS[3:][np.lexsort(POINTS[3:].T)])


def test_ply_with_windows_line_ends_and_not_a_number(tmp_path: Path) -> None:
    header = "ply\r\nformat ascii 1.0\r\nelement vertex 2\r\n"
    header += "".join(f"property float {axis}\r\n" for axis in "xyz")
    (tmp_path / "a.ply").write_bytes(f"{header}end_header\r\n1 2 3\r\nnan nan nan".encode())
    np.testing.assert_array_equal(read_map(tmp_path / "a.ply").points, [[1, 2, 3], [np.nan] * 3])


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("element vertex 1000000000000\nproperty float x\nproperty float y\nproperty float z\n", "at most"),
        ("element vertex 40000000\nproperty float x\nproperty float y\nproperty float z\n", "truncated"),
        ("element vertex 1\nproperty float x\nproperty float y\n", "x, y, z once each"),
        ("element vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z\n", "list"),
        ("element vertex 0\nproperty float x\nproperty float y\nproperty float z\n", "no point"),
        ("element face 0\nproperty list uchar int i\n", "element vertex, found face"),
        ("element a 1\nproperty list float int i\n", "not understood"),
        ("element tristrips 1\nproperty list int int vertex_indices\n", "export triangles"),
        ("element vertex -1\n", "not understood"),
        ("element vertex 1\nproperty quad x\n", "not understood"),
        ("property float x\n", "not understood"),
        ("comment " + 70_000 * "x" + "\n", "within 65536 bytes"),
        (
            "format binary_little_endian 1.0\nelement list 9999999999999\nproperty list int int i\n",
            "truncated",
        ),
        ("format binary_little_endian 1.0\nelement a 99999999999999999999\nproperty int i\n", "truncated"),
    ],
)
def test_ply_headers_that_lie(tmp_path: Path, header: str, message: str) -> None:
    path = tmp_path / "a.ply"
    path.write_text(f"ply\nformat ascii 1.0\n{header}end_header\n" + 20 * "\xff")
    with pytest.raises(FileError, match=rf"a\.ply: .*{message}"):
        read_map(path)


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_truncated_ply_is_refused_or_lacks_no_point(tmp_path: Path, order: str) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, POINTS[:20], order, "double")
    whole = path.read_bytes()
    expected = read_map(path).points
    refused = 0
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        try:
            given = read_map(path).points
        except FileError:
            refused += 1
        else:  # digits of the very last number are missing
            assert given.shape == expected.shape
            np.testing.assert_array_equal(given.ravel()[:-2], expected.ravel()[:-2])
    assert refused > len(whole) - 20


@pytest.mark.parametrize(("suffix", "format"), [("las", 1), ("las", 7), ("laz", 3), ("laz", 6)])
def test_las_classes_noise_and_projected_coordinates(tmp_path: Path, suffix: str, format: int) -> None:
    laspy = pytest.importorskip("laspy")
    classes = np.resize([1, 2, 6, 9, 11, 7, 18, 17, 26], len(POINTS))
    projected = POINTS + np.array([84_904.0, 447_527.0, 100.0])
    write_las(tmp_path / f"a.{suffix}", projected, classes, format)
    las = laspy.read(tmp_path / f"a.{suffix}")
    las.withheld[:9] = 1
    las.write(tmp_path / f"a.{suffix}")
    cloud = read_map(tmp_path / f"a.{suffix}")
    kept = ~np.isin(classes, (7, 18)) & (np.arange(len(POINTS)) >= 9)
    np.testing.assert_array_equal(cloud.offset, [84_900, 447_500, 0])
    np.testing.assert_allclose(cloud.points + cloud.offset, projected[kept], atol=6e-4, rtol=0)
    np.testing.assert_array_equal(cloud.ground, np.isin(classes[kept], (2, 9, 11)))
    np.testing.assert_array_equal(cloud.solid, classes[kept] == 6)


@pytest.mark.parametrize(("suffix", "format"), [("las", 3), ("laz", 3), ("laz", 6)])
def test_truncated_las_is_refused(tmp_path: Path, suffix: str, format: int) -> None:
    path = tmp_path / f"a.{suffix}"
    write_las(path, POINTS, format=format)
    whole = path.read_bytes()
    for cut in range(0, len(whole), 13):
        path.write_bytes(whole[:cut])
        with pytest.raises(FileError, match=rf"a\.{suffix}"):
            read_map(path)


@pytest.mark.parametrize(("suffix", "format"), [("las", 3), ("laz", 3)])
def test_altered_las_raises_map_errors_alone(tmp_path: Path, suffix: str, format: int) -> None:
    path = tmp_path / f"a.{suffix}"
    write_las(path, POINTS, format=format)
    whole = path.read_bytes()
    for place in [*range(0, 420), *range(420, len(whole), 31)]:
        altered = bytearray(whole)
        altered[place] ^= 0xFF
        path.write_bytes(altered)
        try:
            cloud = read_map(path)
        except FileError:
            continue
        assert 0 < len(cloud.points) <= len(POINTS)


def write_returns(path: Path, returns: list[int]) -> bytearray:
    """A .laz file whose points have these return numbers, in turn."""
    laspy = pytest.importorskip("laspy")
    write_las(path, POINTS)
    las = laspy.read(path)
    las.return_number[:] = np.resize(returns, len(POINTS))
    las.write(path)
    assert len(read_map(path).points) == len(POINTS)
    return bytearray(path.read_bytes())


@pytest.mark.parametrize("more", [1, 2])
@pytest.mark.parametrize("returns", [[1], [1, 2, 1, 3, 1]])
def test_a_laz_header_that_counts_points_too_many_is_refused(tmp_path: Path, returns: list[int], more: int) -> None:
    path = tmp_path / "a.laz"
    altered = write_returns(path, returns)
    struct.pack_into("<I", altered, 107, len(POINTS) + more)
    path.write_bytes(altered)
    with pytest.raises(FileError, match=rf"returns of its first {len(POINTS)} alone|damaged"):
        read_map(path)


def test_a_laz_header_whose_returns_are_miscounted_is_read(tmp_path: Path) -> None:
    """Programs that cut, join or write files leave such counts: PDAL issue 470, pylas issue 40."""
    path = tmp_path / "a.laz"
    whole = write_returns(path, [1, 2, 1, 3, 1])
    count = len(POINTS)
    right = (3 * count // 5, count // 5, count // 5, 0, 0)
    assert struct.unpack_from("<5I", whole, 111) == right
    for wrong in ((0, 0, 0, 0, 0), (right[0] - 5, *right[1:]), (0, *right[:4]), (2 * count, 0, 0, 0, 0)):
        struct.pack_into("<5I", whole, 111, *wrong)
        path.write_bytes(whole)
        assert len(read_map(path).points) == count


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_las_headers_that_lie(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    write_las(path, POINTS)
    whole = path.read_bytes()
    for place, code, value, message in (
        (107, "<I", 2**32 - 1, "at most"),
        (107, "<I", 49_000_000, "truncated|damaged"),
        (107, "<I", 0, "no point"),
        (105, "<H", 65_535, "bytes a point"),
        (100, "<I", 2**32 - 1, "variable records"),
        (131, "<d", float("nan"), "finite"),
        (96, "<I", 2**32 - 1, "truncated"),
    ):
        altered = bytearray(whole)
        struct.pack_into(code, altered, place, value)
        path.write_bytes(altered)
        with pytest.raises(FileError, match=message):
            read_map(path)


@pytest.mark.parametrize("key", ["occupied", "occupancy"])
@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64])
def test_npz_voxels(tmp_path: Path, key: str, kind: type) -> None:
    occupied = np.random.default_rng(1).random((3, 4, 5)) < 0.5
    np.savez_compressed(tmp_path / "a.npz", **{key: occupied.astype(kind)})
    plain = read_map(tmp_path / "a.npz")
    assert isinstance(plain, StoredVoxels)
    np.testing.assert_array_equal(plain.occupied, occupied)
    assert (plain.grid.shape, plain.grid.spacing, plain.grid.origin) == ((3, 4, 5), 1.0, (0.0, 0.0, 0.0))
    np.savez(tmp_path / "b.npz", **{key: occupied.astype(kind)}, spacing=2, origin=np.array([1, 2, 3]))
    placed = read_map(tmp_path / "b.npz")
    assert (placed.spacing, placed.origin, placed.source) == (2.0, (1.0, 2.0, 3.0), "b.npz")


def test_npz_points(tmp_path: Path) -> None:
    ground = np.arange(len(POINTS)) % 3 == 0
    np.savez(tmp_path / "a.npz", points=POINTS + np.array([0, -2e6, 0]), ground=ground)
    cloud = read_map(tmp_path / "a.npz")
    np.testing.assert_array_equal(cloud.offset, [0, -2e6, 0])
    np.testing.assert_allclose(cloud.points, POINTS, atol=1e-5)
    np.testing.assert_array_equal(cloud.ground, ground)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"other": np.ones(3)}, "found other"),
        ({"occupied": np.ones((3, 3), bool)}, r"\(nx, ny, nz\)"),
        ({"occupied": np.ones((3, 0, 3), bool)}, "without a zero"),
        ({"occupied": np.full((2, 2, 2), 0.5)}, "found float64"),
        ({"occupied": np.full((2, 2, 2), 2)}, "0 or 1"),
        ({"occupied": np.ones((2, 2, 2), bool), "spacing": 0.0}, "positive"),
        ({"occupied": np.ones((2, 2, 2), bool), "spacing": "2"}, "positive"),
        ({"occupied": np.ones((2, 2, 2), bool), "origin": np.array([0, 0, np.inf])}, "finite"),
        ({"points": np.ones((4, 2))}, r"\(n, 3\)"),
        ({"points": np.array([["a", "b", "c"]])}, "numbers"),
        ({"points": np.ones((0, 3))}, "no point"),
        ({"points": np.ones((4, 3)), "ground": np.ones(3, bool)}, r"\(4,\)"),
        ({"points": np.array([[object()] * 3])}, "pickled"),
    ],
)
def test_npz_with_other_contents(tmp_path: Path, arrays: dict[str, object], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(FileError, match=rf"a\.npz: .*{message}"):
        read_map(tmp_path / "a.npz")


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_truncated_and_altered_npz_is_refused_or_equal(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("npz") / "a.npz"
    occupied = np.random.default_rng(2).random((5, 5, 5)) < 0.5
    np.savez_compressed(path, occupied=occupied, spacing=2.0)
    whole = path.read_bytes()
    if data.draw(st.booleans()):
        path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
        with pytest.raises(FileError):
            read_map(path)
    else:
        altered = bytearray(whole)
        for place in data.draw(st.lists(st.integers(0, len(whole) - 1), min_size=1, max_size=3)):
            altered[place] = data.draw(st.integers(0, 255))
        path.write_bytes(altered)
        try:
            voxels = read_map(path)
        except FileError:
            return
        np.testing.assert_array_equal(voxels.occupied, occupied)


def test_npz_that_unpacks_beyond_the_cap_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maxjax.io.readers.npz.MAX_FILE_BYTES", 2**20)
    np.savez_compressed(tmp_path / "bomb.npz", occupied=np.zeros((128, 128, 128), bool))
    assert (tmp_path / "bomb.npz").stat().st_size < 10_000
    with pytest.raises(FileError, match="unpacks to 2097"):
        read_map(tmp_path / "bomb.npz")


def test_missing_empty_foreign_and_huge_files(tmp_path: Path) -> None:
    (tmp_path / "folder.ply").mkdir()
    with open(tmp_path / "huge.ply", "wb") as file:
        file.truncate(2**31 + 1)  # sparse: takes no space
    for suffix in ("ply", "npz", "las", "laz"):
        (tmp_path / f"empty.{suffix}").touch()
        (tmp_path / f"text.{suffix}").write_text("this is not a map\n" * 40)
    cases = {"absent.ply": "cannot be read", "folder.ply": "expected meshes", "huge.ply": "expected at most"}
    cases |= {
        "map.what": "expected a suffix among .npz, .ply, .pcd",
        "map": "found none",
        "a\0.ply": "cannot be read",
    }
    cases |= {f"empty.{suffix}": "empty" for suffix in ("ply", "npz", "las", "laz")}
    cases |= {f"text.{suffix}": "expected" for suffix in ("ply", "npz", "las", "laz")}
    for name, message in cases.items():
        with pytest.raises(FileError, match=message):
            read_map(tmp_path / name)
    with pytest.raises(FileError, match="cannot be read"):
        read_map(tmp_path / ("x" * 300 + ".ply"))


def test_more_points_than_the_cap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for reader in ("ply", "npz", "las"):
        monkeypatch.setattr(f"maxjax.io.readers.{reader}.MAX_POINTS", 199)
    write_ply(tmp_path / "a.ply", POINTS)
    write_las(tmp_path / "a.las", POINTS)
    np.savez(tmp_path / "a.npz", points=POINTS)
    for suffix in ("ply", "las", "npz"):
        with pytest.raises(FileError, match=r"200 .*at most 199"):
            read_map(tmp_path / f"a.{suffix}")


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_las(tmp_path / "a.las", POINTS)
    importer = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "laspy":
            raise ImportError(name)
        return importer(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(FileError, match=r"pip install 'maxjax\[las\]'"):
        read_map(tmp_path / "a.las")


def test_suffixes_ignore_case_and_paths_may_be_strings(tmp_path: Path) -> None:
    write_ply(tmp_path / "A.PLY", POINTS)
    assert len(read_map(os.fspath(tmp_path / "A.PLY")).points) == len(POINTS)


def test_infinite_and_enormous_coordinates_stay_out_of_the_offset(tmp_path: Path) -> None:
    points = np.array([[84_900.0, 0.0, 0.0], [84_950.0, np.inf, np.nan], [84_960.0, 1e300, -np.inf]])
    np.savez(tmp_path / "a.npz", points=points)
    cloud = read_map(tmp_path / "a.npz")
    np.testing.assert_array_equal(cloud.points[:, 0], [0.0, 50.0, 60.0])
    np.savez(tmp_path / "b.npz", points=np.full((2, 3), np.nan))
    np.testing.assert_array_equal(read_map(tmp_path / "b.npz").offset, 0)


def test_the_real_inputs(data: Path) -> None:
    for name, count in (("source", 69_792), ("target", 69_088)):
        cloud = read_map(data / "lidar_pair" / f"{name}.ply")
        assert cloud.points.shape == (count, 3)
        assert np.abs(cloud.points).max() < 100
    for name in ("Complex", "Simple"):
        voxels = read_map(data / "warframe" / f"crop101_{name}.npz")
        with np.load(data / "warframe" / f"crop101_{name}.npz") as archive:
            np.testing.assert_array_equal(voxels.occupied, archive["occupancy"])
            assert voxels.grid.shape == (101, 101, 101)
