"""Octrees, PCD, lists, boxes, GeoJSON and surface models: made-up files exactly, real ones by their own counts."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from maxjax import Reading
from maxjax.core.files import FileError
from maxjax.core.grid import Grid
from maxjax.io import StoredVoxels, load_map, read_map
from maxjax.io.geo.earth import project
from maxjax.io.kinds.boxes import Boxes, fill_boxes
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.kinds.heights import Heights
from maxjax.io.kinds.point_cloud import PointCloud

# A tree as nested lists of eight: a number is a leaf's log-odds, None unknown.
Tree = list["Tree | float | None"]


def tree(rng: np.random.Generator, depth: int = 0) -> Tree:
    """A random octree; to the full depth of 16 along one branch, so that leaves are metres wide."""
    if depth < 13:
        child: Tree = [None] * 8
        child[7 if depth == 0 else 0] = tree(rng, depth + 1)
        return child
    kinds = rng.integers(0, 4 if depth < 15 else 3, 8)
    return [None if k == 0 else -1.0 if k == 1 else 1.0 if k == 2 else tree(rng, depth + 1) for k in kinds]


def walk(node: Tree, corner: np.ndarray, edge: int) -> list[tuple[float, list[int], int]]:
    """Every leaf: log-odds, lowest corner and edge, in leaves of the finest level; by recursion, unlike the reader."""
    found = []
    for i, child in enumerate(node):
        low = corner + edge // 2 * np.array([i & 1, i >> 1 & 1, i >> 2 & 1])
        if isinstance(child, list):
            found += walk(child, low, edge // 2)
        elif child is not None:
            found.append((child, low.tolist(), edge // 2))
    return found


def bt(node: Tree) -> bytes:
    codes = [0 if c is None else 3 if isinstance(c, list) else 2 if c > 0 else 1 for c in node]
    head = struct.pack("<H", sum(code << 2 * i for i, code in enumerate(codes)))
    return head + b"".join(bt(c) for c in node if isinstance(c, list))


def ot(node: Tree | float, colour: bytes) -> bytes:
    if not isinstance(node, list):
        return struct.pack("<f", node) + colour + b"\0"
    bits = sum((c is not None) << i for i, c in enumerate(node))
    return struct.pack("<f", 0.5) + colour + bytes([bits]) + b"".join(ot(c, colour) for c in node if c is not None)


def octree_file(path: Path, node: Tree, kind: str = "OcTree") -> Path:
    title = b"# Octomap OcTree binary file" if path.suffix == ".bt" else b"# Octomap OcTree file"
    body = bt(node) if path.suffix == ".bt" else ot(node, b"\1\2\3" if kind == "ColorOcTree" else b"")
    path.write_bytes(title + f"\n# any\nid {kind}\nsize 9\nres 0.5\ndata\n".encode() + body)
    return path


@pytest.mark.parametrize(("name", "kind"), [("a.bt", "OcTree"), ("a.ot", "OcTree"), ("a.ot", "ColorOcTree")])
def test_octrees_have_the_leaves_of_their_tree(tmp_path: Path, name: str, kind: str) -> None:
    node = tree(np.random.default_rng(0))
    found = read_map(octree_file(tmp_path / name, node, kind))
    assert isinstance(found, Boxes)
    leaves = walk(node, np.full(3, -(2**15)), 2**16)
    for cubes, sign in ((found.corners, 1), (found.free, -1)):
        assert cubes is not None
        expected = sorted([*(0.5 * np.array(low)), 0.5 * edge] for odds, low, edge in leaves if odds * sign > 0)
        given = sorted([*low, edge] for low, edge in zip(cubes[:, 0], np.ptp(cubes[:, :, 0], axis=1), strict=True))
        np.testing.assert_allclose(given, expected)
    whole = load_map(tmp_path / name)
    assert whole.grid.spacing == 0.5
    free = load_map(tmp_path / name, bounds=[whole.grid.lower, whole.grid.upper], reading=Reading(unknown="free"))
    # On the tree's own lattice, leaf by leaf.
    volume = sum(edge**3 for odds, _, edge in leaves if odds > 0)
    known = sum(edge**3 for _, _, edge in leaves)
    assert free.occupied.sum() == volume
    assert (~whole.occupied).sum() == known - volume


@pytest.mark.parametrize("suffix", ["bt", "ot"])
def test_truncated_octrees_are_refused(tmp_path: Path, suffix: str) -> None:
    path = octree_file(tmp_path / f"a.{suffix}", tree(np.random.default_rng(1)))
    whole = path.read_bytes()
    for cut in range(1, len(whole), 5):
        path.write_bytes(whole[:cut])
        with pytest.raises(FileError):
            read_map(path)
    path.write_bytes(whole + whole[-10:])
    with pytest.raises(FileError):
        read_map(path)


@pytest.mark.parametrize(("name", "count"), [("geb079", 532_566), ("upo_maze", 689_432)])
def test_real_octrees_have_the_nodes_that_their_header_counts(data: Path, name: str, count: int) -> None:
    path = data / "octomap" / f"{name}.bt"
    found = read_map(path)
    assert isinstance(found, Boxes)
    assert found.free is not None
    inner = len(path.read_bytes().partition(b"\ndata\n")[2]) // 2
    assert len(found.corners) + len(found.free) + inner == count


POINTS = np.random.default_rng(0).uniform(-50, 50, (300, 3))


def pcd(kind: str, body: bytes, points: int = 300) -> bytes:
    lines = ["# .PCD v0.7", "VERSION 0.7", "FIELDS x rgb y z", "SIZE 4 1 8 4", "TYPE F U F F", "COUNT 1 3 1 1"]
    lines += [f"WIDTH {points}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {points}", f"DATA {kind}", ""]
    return "\n".join(lines).encode() + body


def literal_lzf(raw: bytes) -> bytes:
    """LZF without repetitions, but for one of 20 bytes at the end."""
    return b"".join(bytes([len(raw[i : i + 32]) - 1]) + raw[i : i + 32] for i in range(0, len(raw), 32))


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_pcd_of_every_kind(tmp_path: Path, kind: str) -> None:
    rows = np.zeros(300, [("x", "<f4"), ("rgb", "u1", 3), ("y", "<f8"), ("z", "<f4")])
    rows["x"], rows["y"], rows["z"] = POINTS.T
    rows["z"][-1] = np.nan
    if kind == "ascii":
        body = "".join(f"{x!r} 1 2 3 {y!r} {z!r}\n" for x, _, y, z in rows.tolist()).encode()
    elif kind == "binary":
        body = rows.tobytes()
    else:
        columns = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names or ())
        packed = literal_lzf(columns)
        body = struct.pack("<II", len(packed), len(columns)) + packed
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd(kind, body))
    cloud = read_map(path)
    assert isinstance(cloud, PointCloud)
    np.testing.assert_array_equal(cloud.points, np.stack([rows["x"], rows["y"], rows["z"]], 1).astype(np.float32))
    for cut in range(1, len(path.read_bytes()) - 30, 97):
        path.write_bytes(pcd(kind, body)[:cut])
        with pytest.raises(FileError):
            read_map(path)


def test_lzf_repeats_what_was_there() -> None:
    from maxjax.io.readers.pcd import _unpacked

    # "ab" as it is, then 8 bytes from 2 back, then 200 from 1 back.
    packed = b"\1ab" + bytes([6 << 5, 1]) + bytes([7 << 5, 200 - 2 - 7, 0])
    assert _unpacked(packed, 210, Path("a")) == b"ab" * 5 + b"b" * 200
    for size in (209, 211):
        with pytest.raises(FileError, match="another size"):
            _unpacked(packed, size, Path("a"))
    with pytest.raises(FileError, match="damaged"):
        _unpacked(b"\1ab" + bytes([1 << 5, 7]), 5, Path("a"))


def test_a_pcd_that_lies_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd("binary_compressed", struct.pack("<II", 100, 2**32 - 1) + bytes(100), 2**31))
    with pytest.raises(FileError, match="claims 2147483648 points"):
        read_map(path)


def test_voxel_lists(tmp_path: Path, data: Path) -> None:
    (tmp_path / "a.3dmap").write_text("voxel 4 5 6\n0 0 0\n3 4 5\n")
    found = read_map(tmp_path / "a.3dmap")
    assert isinstance(found, StoredVoxels)
    assert np.argwhere(found.occupied).tolist() == [[0, 0, 0], [3, 4, 5]]
    for text in (
        "octile 4 5 6\n",
        "voxel 4 5\n",
        "voxel 4 5 6\n4 0 0\n",
        "voxel 4 5 6\n-1 0 0\n",
        "voxel 4 5 6\n1 1\n",
    ):
        (tmp_path / "a.3dmap").write_text(text)
        with pytest.raises(FileError, match=r"a\.3dmap: "):
            read_map(tmp_path / "a.3dmap")
    (tmp_path / "a.3dmap").write_text("voxel 99999 99999 99999\n")
    with pytest.raises(FileError, match="in all"):
        read_map(tmp_path / "a.3dmap")
    lines = (data / "warframe" / "Simple.3dmap").read_text().splitlines()[1:]
    whole = load_map(data / "warframe" / "Simple.3dmap")
    assert whole.occupied.sum() == len(set(lines))


def test_boxes_fill_the_voxels_that_they_share_volume_with(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    low = rng.uniform(-12, 10, (40, 3))
    corners = np.stack([low, low + rng.uniform(0.1, 6, (40, 3))], 1)
    corners[0] = [[-3, -3, -3], [-1, 1, 3]]  # along the faces of voxels: what only touches is left out
    lines = [",".join(map(str, box.ravel().tolist())) + ",tower" for box in corners]
    (tmp_path / "a.csv").write_text("\n".join(["x_min,y_min,z_min,x_max,y_max,z_max,name", *lines]))
    found = read_map(tmp_path / "a.csv")
    assert isinstance(found, Boxes)
    grid = Grid((10, 11, 12), 2.0, (-10.0, -10.0, -10.0))
    voxel = [grid.lower[i] + 2.0 * np.arange(n) for i, n in enumerate(grid.shape)]
    expected = np.zeros(grid.shape, bool)
    for a, b in corners:
        axes = [(x + 2.0 > a[i]) & (x < b[i]) for i, x in enumerate(voxel)]
        expected |= axes[0][:, None, None] & axes[1][:, None] & axes[2]
    np.testing.assert_array_equal(fill_boxes(found.corners, grid), expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,2,3\n", "expected the columns x_min"),
        ("x_min,y_min,z_min,x_max,y_max,z_max\n", "holds no box"),
        ("x_min,y_min,z_min,x_max,y_max,z_max\n0,0,0,1,1,0\n", "box 1"),
        ("x_min,y_min,z_min,x_max,y_max,z_max\n0,0,0,1,nan,1\n", "box 1"),
        ("x_min,y_min,z_min,x_max,y_max,z_max\n0,0,0,1\n", "a line of numbers"),
        ("x_min,y_min,z_min,x_max,y_max,z_max\n0,0,0,1,1,1e300\n", "within 1e"),
    ],
)
def test_boxes_that_are_none(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(FileError, match=message):
        read_map(tmp_path / "a.csv")


def geojson(*features: dict[str, object], **members: object) -> str:
    return json.dumps(
        {"type": "FeatureCollection", "features": [{"type": "Feature", **f} for f in features], **members}
    )


def square(x: float, y: float, edge: float) -> list[list[float]]:
    return [[x, y], [x + edge, y], [x + edge, y + edge], [x, y + edge], [x, y]]


def house(ring: list[list[float]], **properties: object) -> dict[str, object]:
    return {"geometry": {"type": "Polygon", "coordinates": [ring]}, "properties": properties}


def test_geojson_in_degrees_and_in_metres(tmp_path: Path) -> None:
    path = tmp_path / "a.geojson"
    ring = square(4.3, 52.0, 1e-3)
    path.write_text(geojson(house(ring, height=12.5, ele="2"), house(ring), {"geometry": None, "properties": {}}))
    found = read_map(path)
    assert isinstance(found, Footprints)
    (one,) = found.buildings
    assert (one.base, one.top) == (2.0, 14.5)
    assert found.dropped == {"buildings without a height": 1}
    assert found.reference.origin == (pytest.approx(4.3005), pytest.approx(52.0005))
    expected = project(np.array(ring[:4]), np.array([4.3005, 52.0005]))
    assert sorted(one.rings[0].round(6).tolist()) == sorted(expected.round(6).tolist())
    ring = square(85_000, 447_000, 40)
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    hole = {"type": "MultiPolygon", "coordinates": [[ring, square(85_010, 447_010, 20)]]}
    path.rename(tmp_path / "a.json").write_text(geojson({"geometry": hole, "properties": {"levels": 3}}, crs=crs))
    town = load_map(tmp_path / "a.json")
    assert (town.file.crs, town.file.origin) == ("EPSG:28992", None)
    solid = town.occupied & ~town.ground
    x, y = (town.grid.origin[i] + 2.0 * np.arange(town.grid.shape[i]) for i in (0, 1))
    inside = ((x >= 85_000) & (x <= 85_040))[:, None] & ((y >= 447_000) & (y <= 447_040))
    court = ((x > 85_011) & (x < 85_029))[:, None] & ((y > 447_011) & (y < 447_029))
    np.testing.assert_array_equal(solid.any(axis=2), inside & ~court)
    assert not load_map(tmp_path / "a.json", bounds=(85_013, 447_013, 0, 85_025, 447_025, 9)).occupied[:, :, 1:].any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (geojson(house(square(52.0, 95.0, 1e-3), height=3)), "swapped"),
        (geojson(house(square(400.0, 5.0, 1e-3), height=3)), "found 400"),
        (geojson(house(square(4.0, 5.0, 3.0), height=3)), "within 1 degree"),
        (geojson(house(square(4.0, 5.0, 1e-3))), "found none"),
        (geojson(house(square(4.0, 5.0, 1e-3), height=99_999)), "other units"),
        (geojson(house([["a", "b"]] * 4, height=3)), "malformed"),
        (geojson(house(square(4, 5, 1e-3), height=3), crs={"properties": {"name": "moon"}}), "given 'moon'"),
        ('{"type": "FeatureCollection", "features": [' + 99_999 * "[", "expected JSON"),
        ('{"type": "Feature", "geometry": NaN}', "NaN is no JSON number"),
    ],
)
def test_geojson_that_is_none(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(FileError, match=message):
        read_map(tmp_path / "a.geojson")


def test_a_town_across_the_antimeridian_is_as_wide_as_it_is(tmp_path: Path) -> None:
    ring = [[179.9995, 10], [-179.9995, 10], [-179.9995, 10.001], [179.9995, 10.001], [179.9995, 10]]
    (tmp_path / "a.geojson").write_text(geojson(house(ring, height=3)))
    found = read_map(tmp_path / "a.geojson")
    assert isinstance(found, Footprints)
    assert np.ptp(found.buildings[0].rings[0][:, 0]) == pytest.approx(109.6, abs=0.5)


def test_surface_models_fill_columns_up_to_their_highest_cell() -> None:
    rng = np.random.default_rng(0)
    height = rng.uniform(0, 9, (30, 24))
    height[3:9, 5:8] = np.nan
    model = Heights(height, 100.0, 50.0, (0.5, 0.7), "a.tif")
    grid = Grid((8, 9, 6), 2.0, (101.0, 51.0, 1.0))
    solid, unknown = model.voxels(grid)
    for i, j in np.ndindex(8, 9):
        x, y = grid.lower[0] + 2.0 * i, grid.lower[1] + 2.0 * j
        west, south = 100 + 0.5 * np.arange(30), 50 + 0.7 * np.arange(24)
        cells = height[np.ix_((west + 0.5 > x + 1e-9) & (west < x + 2 - 1e-9), (south + 0.7 > y) & (south < y + 2))]
        top = np.nanmax(cells) if np.isfinite(cells).any() else np.nan
        assert unknown[i, j] == np.isnan(top)
        np.testing.assert_array_equal(solid[i, j], grid.lower[2] + 2.0 * np.arange(6) < top)


def test_geotiff(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    from rasterio.transform import from_origin

    height = np.arange(12, dtype=np.float32).reshape(3, 4)
    height[0, 0] = -9999
    place = from_origin(85_000, 447_006, 2, 2)
    options = {"driver": "GTiff", "width": 4, "height": 3, "count": 1, "dtype": "float32", "nodata": -9999}
    with rasterio.open(tmp_path / "a.tif", "w", transform=place, crs="EPSG:28992", **options) as file:
        file.write(height, 1)
    found = read_map(tmp_path / "a.tif")
    assert isinstance(found, Heights)
    assert (found.reference.crs, found.west, found.south) == ("EPSG:28992", 85_000.0, 447_000.0)
    np.testing.assert_array_equal(found.height, [[8, 4, np.nan], [9, 5, 1], [10, 6, 2], [11, 7, 3]])
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileError):
        read_map(tmp_path / "a.tif")
