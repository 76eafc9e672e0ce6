"""Meshes: what trimesh writes is read and filled; damaged files are refused; no plan leads through a wall."""

from __future__ import annotations

import itertools
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from maxjax.core.files import FileError
from maxjax.core.grid import Grid
from maxjax.io import Mesh, read_map
from maxjax.io.kinds.mesh import fans, mesh_of
from maxjax.ui.cli import main

GRID = Grid((40, 40, 30), 2.0, (-40.0, -40.0, -10.0))
FORMATS = ["a.ply", "ascii.ply", "a.obj", "a.stl", "ascii.stl", "a.glb"]


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def save(mesh: trimesh.Trimesh, path: Path) -> Path:
    kinds = {"ascii.ply": {"file_type": "ply", "encoding": "ascii"}, "ascii.stl": {"file_type": "stl_ascii"}}
    if path.suffix == ".glb":  # whose y axis is up
        mesh = mesh.copy()
        mesh.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    mesh.export(path, **kinds.get(path.name, {}))
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_filled_bodies(tmp_path: Path, name: str) -> None:
    ball = trimesh.creation.icosphere(3, radius=12.3)
    house = box((20.5, 20.5, 0.5), (30.5, 30.5, 20.5))
    mesh = read_map(save(trimesh.util.concatenate([ball, house]), tmp_path / name))
    assert isinstance(mesh, Mesh)
    assert (mesh.closed_bodies, mesh.bodies.open_bodies, mesh.remarks, len(mesh.points)) == (2, 0, (), 0)
    solid, _ = mesh.voxels(GRID)
    centre = np.stack(
        np.meshgrid(*[GRID.origin[i] + 2.0 * np.arange(GRID.shape[i]) for i in range(3)], indexing="ij"), -1
    )
    from_ball = np.linalg.norm(centre, axis=-1)
    in_house = np.all((centre > (19.5, 19.5, -0.5)) & (centre < (31.5, 31.5, 21.5)), axis=-1)
    # A cube reaches √3 m from its middle; the ball's facets lie up to 0.2 m below the sphere.
    assert solid[(from_ball < 12.1) | in_house].all()
    assert not solid[(from_ball > 12.3 + 3**0.5) & ~in_house].any()


def test_a_building_is_not_the_points_of_its_corners(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    # Three walls and a roof, without a floor, 120 m long: their vertices are up to 120 m apart.
    house = box((-60.0, -10.0, 0.0), (60.0, 10.0, 50.0))
    walls = house.submesh(
        [np.flatnonzero((house.face_normals[:, 2] > -0.5) & (house.face_normals[:, 0] < 0.5))], append=True
    )
    path = save(walls, tmp_path / "house.ply")
    assert "not closed" in read_map(path).remarks[0]
    ends = ["--start", "5", "-40", "10", "--goal", "-5", "40", "12"]
    assert main(["plan", str(path), *ends, "--ground", "0", "--spacing", "4", "--json", "--method", "astar"]) == 0
    shown, told = capfd.readouterr()
    assert "not closed" in told
    plan = json.loads(shown)
    assert plan["clearance"] >= 1.0
    points = np.array(plan["path"])
    assert not crossings(points, walls.triangles)
    assert crossings(points[[0, -1]], walls.triangles) == 2  # the straight line, by the same test


def crossings(path: np.ndarray, triangles: np.ndarray) -> int:
    """How many triangles the segments of a path cross (Möller and Trumbore 1997)."""
    count = 0
    for start, end in itertools.pairwise(path):
        a, b, c = triangles.transpose(1, 0, 2)
        normal = np.cross(end - start, c - a)
        scale = np.sum((b - a) * normal, -1)
        parallel = np.abs(scale) < 1e-12
        scale = np.where(parallel, 1.0, scale)
        u = np.sum((start - a) * normal, -1) / scale
        other = np.cross(start - a, b - a)
        v, t = other @ (end - start) / scale, np.sum((c - a) * other, -1) / scale
        count += int((~parallel & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)).sum())
    return count


def test_an_open_body_is_named_and_a_closed_one_beside_it_filled() -> None:
    lid = trimesh.Trimesh([[0, 0, 30], [9, 0, 30], [0, 9, 30]], [[0, 1, 2]])
    whole = trimesh.util.concatenate([box((-9, -9, 0), (9, 9, 20)), lid])
    mesh = mesh_of(np.array(whole.vertices), np.array(whole.faces), Path("a.obj"))
    assert (mesh.closed_bodies, mesh.bodies.open_bodies) == (1, 1)
    assert "1 of 2 bodies" in mesh.remarks[0]
    assert mesh.voxels(GRID)[0][20, 20, 5:15].all()
    assert not mesh.voxels(GRID)[0][20, 20, 16:20].any()


def shell(*bodies: trimesh.Trimesh, without: float = -0.5) -> trimesh.Trimesh:
    """Houses without the faces that look down."""
    kept = [np.flatnonzero(body.face_normals[:, 2] > without) for body in bodies]
    return trimesh.util.concatenate([b.submesh([k], append=True) for b, k in zip(bodies, kept, strict=True)])


def angled_hall() -> trimesh.Trimesh:
    """A house with an inner corner, 9 m high."""
    outline = np.array([(-16, 2), (-4, 2), (-4, 8), (-10, 8), (-10, 16), (-16, 16)], float)
    corners = np.concatenate([np.c_[outline, np.zeros(6)], np.c_[outline, np.full(6, 9.0)]])
    roof = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)])
    k = np.arange(6)
    wall = np.concatenate([np.c_[k, (k + 1) % 6, (k + 1) % 6 + 6], np.c_[k, (k + 1) % 6 + 6, k + 6]])
    return trimesh.Trimesh(corners, np.concatenate([roof[:, ::-1], roof + 6, wall]), process=False)


def test_a_house_without_a_floor_is_filled_like_one_with_a_floor() -> None:
    rng = np.random.default_rng(0)
    towers = [box((-15, -15, 0), (-5, -7, 12)), box((4, 2, 0.2), (16, 14, 18))]
    hall = angled_hall()
    whole, bare = trimesh.util.concatenate([*towers, hall]), shell(*towers, hall)
    order = rng.permutation(len(bare.faces))
    mesh = mesh_of(np.array(bare.vertices), np.array(bare.faces)[order], Path("a"))
    assert (mesh.bodies.open_below, mesh.bodies.open_bodies, mesh.closed_bodies) == (3, 0, 3)
    found, _ = mesh.voxels(GRID)
    expected, _ = mesh_of(np.array(whole.vertices), np.array(whole.faces), Path("a")).voxels(GRID)
    lowest = int(np.floor((0.0 - GRID.lower[2]) / GRID.spacing))  # where the floor itself is touched
    np.testing.assert_array_equal(found[:, :, lowest + 1 :], expected[:, :, lowest + 1 :])
    assert "3 bodies are open below" in mesh.remarks[0]


def test_a_level_sheet_under_everything_is_the_ground() -> None:
    x, y = np.meshgrid(np.linspace(-19, 19, 20), np.linspace(-19, 19, 20), indexing="ij")
    height = 0.08 * x
    index = np.arange(400).reshape(20, 20)
    a, b, c, d = (index[i : i + 19, j : j + 19].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    land = trimesh.Trimesh(
        np.column_stack([v.ravel() for v in (x, y, height)]), np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])
    )
    town = trimesh.util.concatenate([land, shell(box((2, 2, 3), (10, 10, 18)))])
    mesh = mesh_of(np.array(town.vertices), np.array(town.faces), Path("a"))
    assert any("taken as the ground" in remark for remark in mesh.remarks)
    solid, ground = mesh.voxels(GRID)
    centre = [GRID.origin[axis] + GRID.spacing * np.arange(GRID.shape[axis]) for axis in range(3)]
    inside = (np.abs(centre[0]) < 18)[:, None] & (np.abs(centre[1]) < 18)
    top = GRID.lower[2] + GRID.spacing * ground.sum(axis=2)
    assert (np.abs(top - 0.08 * centre[0][:, None])[inside] <= GRID.spacing + 0.08 * GRID.spacing).all()
    house = ((centre[0] > 3) & (centre[0] < 9))[:, None] & ((centre[1] > 3) & (centre[1] < 9))
    level = (centre[2] > 2.0) & (centre[2] < 17.0)
    assert (solid | ground)[house][:, level].all()  # down to the ground, below its lowest wall too
    assert not solid[~house & (np.abs(centre[0]) > 12)[:, None]].any()


def test_faces_given_twice_neither_close_nor_empty_a_body() -> None:
    house = box((-9, -9, 0), (9, 9, 20))
    twice = np.concatenate([house.faces, house.faces[:, ::-1]])
    assert mesh_of(np.array(house.vertices), twice, Path("a")).voxels(GRID)[0][20, 20, 10]
    flap = np.array([[0, 1, 2], [0, 2, 1]])
    assert mesh_of(np.eye(3), flap, Path("a")).bodies.open_bodies == 1


def test_polygons_are_triangles_around_their_first_corner() -> None:
    found = fans(np.array([5, 6, 7, 8, 1, 2, 3, 9, 4, 4]), np.array([4, 3, 0, 1, 2]))
    assert found.tolist() == [[5, 6, 7], [5, 7, 8], [1, 2, 3], [9, 9, 9], [4, 4, 4]]


def test_obj_counts_backwards_and_keeps_lines(tmp_path: Path) -> None:
    text = "# a\nmtllib none.mtl\nv 0 0 0\nv 4 0 0 1.0\nv 4 4 0\nv 0 4 0\nvt 0 0\nf -4/1 -3/1 -2/1 \\\n -1/1\nl 1 3 2\n"
    (tmp_path / "a.obj").write_text(text)
    mesh = read_map(tmp_path / "a.obj")
    assert isinstance(mesh, Mesh)
    assert sorted(map(tuple, mesh.triangles.sum(axis=1).tolist()))[-1] == (12.0, 4.0, 0.0)
    assert len(mesh.triangles) == 4


def gltf(document: dict[str, object], binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 2, 0]], "<f4").tobytes()


def scene(**change: object) -> dict[str, object]:
    document: dict[str, object] = {
        "nodes": [{"children": [1], "translation": [10, 20, 30]}, {"mesh": 0, "rotation": [0, 0, 0.5**0.5, 0.5**0.5]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
        "buffers": [{"byteLength": 48}],
    }
    return document | change


def test_glb_places_its_nodes_and_turns_y_upwards(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(gltf(scene(), CORNERS))
    mesh = read_map(tmp_path / "a.glb")
    assert isinstance(mesh, Mesh)
    # (0, 2, 0) turned by 90° about z is (-2, 0, 0), then (8, 20, 30); y up becomes z up: (8, -30, 20).
    np.testing.assert_allclose(mesh.triangles[0], [[10, -30, 20], [10, -30, 21], [8, -30, 20]], atol=1e-6)
    np.testing.assert_allclose(mesh.triangles[1], [[10, -30, 21], [8, -30, 20], [8, -30, 21]], atol=1e-6)


BROKEN = {
    "points.obj": (b"v 0 0 0\nv 1 1 1\n", "found no face"),
    "far.obj": (b"v 0 0 0\nf 1 2 3\n", "names vertex 2, expected 0 to 0"),
    "zero.obj": (b"v 0 0 0\nf 0 0 0\n", "line 2.*numbered from 1"),
    "curve.obj": (b"v 0 0 0\nsurf 0 1 0 1 1\n", "line 2.*not supported"),
    "nan.obj": (b"v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "expected finite"),
    "digits.obj": (b"v 0 0 0\nf 1 1 " + 5000 * b"1" + b"\n", "line 2"),
    "count.stl": (bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(100), "claims 4294967295 triangles"),
    "cut.stl": (b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "three vertices a facet"),
    "short.glb": (gltf(scene(), CORNERS)[:-4], "expected glTF 2 of"),
    "lie.glb": (gltf(scene(), CORNERS[:-4]), "claims bytes 0 to 48 of 44"),
    "huge.glb": (gltf(scene(accessors=[{"componentType": 5126, "count": 10**12, "type": "VEC3"}])), "without data"),
    "ring.glb": (gltf(scene(nodes=[{"children": [0]}], scenes=[{"nodes": [0]}]), CORNERS), "expected a tree"),
    "uri.glb": (gltf(scene(buffers=[{"uri": "/etc/passwd"}]), CORNERS), "expected a file of the same folder"),
    "draco.glb": (gltf(scene(extensionsRequired=["KHR_draco_mesh_compression"]), CORNERS), "not supported"),
    "deep.glb": (
        b"glTF" + struct.pack("<IIII", 2, 200_020, 200_000, 0x4E4F534A) + 100_000 * b"[" + 100_000 * b"]",
        "expected JSON",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_damaged_meshes_are_refused(tmp_path: Path, name: str) -> None:
    content, message = BROKEN[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=rf"{name}: .*{message}"):
        read_map(tmp_path / name)


@pytest.mark.parametrize("name", ["a.ply", "ascii.ply", "a.stl", "ascii.stl", "a.glb"])
def test_a_truncated_mesh_is_never_read_as_less(tmp_path: Path, name: str) -> None:
    path = save(box((0, 0, 0), (9, 9, 9)), tmp_path / name)
    whole = path.read_bytes()
    for cut in range(1, len(whole) - 2, 7):
        path.write_bytes(whole[:cut])
        with pytest.raises(FileError):
            read_map(path)
