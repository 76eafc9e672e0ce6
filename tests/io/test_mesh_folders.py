"""Folders, archives and scenes of meshes, and lists of colliders: the same solids as in one file."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

import maxjax
from maxjax.core.files import FileError
from maxjax.core.grid import Grid
from maxjax.io import Mesh, read_map

GRID = Grid((50, 40, 30), 1.0, (-24.5, -19.5, -4.5))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


HOUSES = {
    "a.ply": box((-20, -10, 0), (-8, 4, 12)),
    "b.obj": box((-8, -10, 0), (2, 4, 9)),  # shares a wall with the first
    "part/c.stl": box((8, -6, 0), (18, 12, 20)),
}


def town(folder: Path) -> Path:
    for name, house in HOUSES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        house.export(folder / name)
    (folder / "brick.png").write_bytes(b"\x89PNG")
    return folder


def voxels(mesh: object) -> np.ndarray:
    assert isinstance(mesh, Mesh)
    solid, ground = mesh.voxels(GRID)
    return np.asarray(solid | ground)


def expected() -> np.ndarray:
    """Voxels whose closed cube a house meets."""
    axes = [GRID.origin[k] + np.arange(GRID.shape[k]) for k in range(3)]
    found = np.zeros(GRID.shape, bool)
    for house in HOUSES.values():
        low, high = house.bounds
        x, y, z = ((a + 0.5 >= b - 1e-6) & (a - 0.5 <= c + 1e-6) for a, b, c in zip(axes, low, high, strict=True))
        found |= x[:, None, None] & y[:, None] & z
    return found


def test_a_folder_and_an_archive_are_all_of_their_meshes(tmp_path: Path) -> None:
    folder = town(tmp_path / "town")
    mesh = read_map(folder)
    np.testing.assert_array_equal(voxels(mesh), expected())
    assert (mesh.closed_bodies, mesh.bodies.open_bodies, mesh.dropped) == (3, 0, {".png files": 1})
    with zipfile.ZipFile(tmp_path / "town.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for file in folder.rglob("*"):
            if file.is_file():
                archive.write(file, file.relative_to(folder))
    packed = read_map(tmp_path / "town.zip")
    np.testing.assert_array_equal(voxels(packed), expected())
    assert (packed.source, packed.dropped) == ("town.zip", {".png files": 1})
    assert maxjax.load_map(folder).file.read["closed bodies"] == 3


SCENE = """<scene version="2.1.0">
  <default name="far" value="8"/>
  <bsdf type="diffuse" id="brick"/>
  <shape type="ply" id="one"><string name="filename" value="meshes/unit.ply"/>
    <transform name="to_world"><scale value="12 14 12"/><translate x="-20" y="-10"/></transform></shape>
  <shape type="obj" id="two"><string name="filename" value="meshes/unit.obj"/>
    <transform name="to_world"><matrix value="10 0 0 -8  0 14 0 -10  0 0 9 0  0 0 0 1"/></transform></shape>
  <shape type="cube" id="three">
    <transform name="to_world"><scale x="9" y="5" z="10"/><rotate z="1" angle="90"/>
      <translate value="13 3 10"/></transform>
  </shape>
  <shape type="sphere"><float name="radius" value="$far"/></shape>
</scene>
"""


def test_a_scene_puts_its_shapes_in_their_places(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    for name in ("unit.ply", "unit.obj"):
        box((0, 0, 0), (1, 1, 1)).export(tmp_path / "meshes" / name)
    (tmp_path / "scene.xml").write_text(SCENE)
    for path in (tmp_path / "scene.xml", tmp_path):
        mesh = read_map(path)
        np.testing.assert_array_equal(voxels(mesh), expected())
        assert mesh.dropped == {"shapes of type sphere": 1}
    assert read_map(tmp_path / "scene.xml", maxjax.Reading(unit="ft")).triangles.max() == pytest.approx(20 * 0.3048)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("meshes/unit.ply", "/etc/passwd"), "in the folder of its scene"),
        (("meshes/unit.ply", "../../x.ply"), "in the folder of its scene"),
        (('<scale value="12 14 12"/>', '<lookat origin="0 0 0"/>'), "<lookat> is not supported"),
        (('value="12 14 12"', 'value="12 nan 12"'), "no affine map"),
        (('<scene version="2.1.0">', '<!DOCTYPE scene><scene version="2.1.0">'), "no document type"),
        (("</scene>", ""), "expected XML"),
    ],
)
def test_scenes_that_are_none(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    (tmp_path / "meshes").mkdir()
    for name in ("unit.ply", "unit.obj"):
        box((0, 0, 0), (1, 1, 1)).export(tmp_path / "meshes" / name)
    (tmp_path / "scene.xml").write_text(SCENE.replace(*change))
    with pytest.raises(FileError, match=message):
        read_map(tmp_path / "scene.xml")


def test_folders_and_archives_without_meshes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    with pytest.raises(FileError, match="expected meshes"):
        read_map(tmp_path / "none")
    (tmp_path / "a.zip").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(FileError, match="expected an intact ZIP archive"):
        read_map(tmp_path / "a.zip")
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("../../out.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert isinstance(read_map(tmp_path / "b.zip"), Mesh)  # kept within its own folder
    assert not (tmp_path.parent / "out.obj").exists()


def test_colliders_lie_north_and_east_of_their_place(tmp_path: Path) -> None:
    path = tmp_path / "colliders.csv"
    path.write_text(
        "lat0 37.792480, lon0 -122.397450\nposX,posY,posZ,halfSizeX,halfSizeY,halfSizeZ\n"
        "-10.0,20.0,5.0,2.0,4.0,5.0\n30,0,10,1,1,10\n"
    )
    city = maxjax.load_map(path, spacing=1.0, bounds=(-30, -30, 0, 40, 40, 30))
    x, y, z = (city.grid.origin[k] + np.arange(city.grid.shape[k]) for k in range(3))
    solid = np.zeros(city.grid.shape, bool)
    for east, north, up in (((16, 24), (-12, -8), (0, 10)), ((-1, 1), (29, 31), (0, 20))):
        inside = [
            (a + 0.5 > low) & (a - 0.5 < high) for a, (low, high) in zip((x, y, z), (east, north, up), strict=True)
        ]
        solid |= inside[0][:, None, None] & inside[1][:, None] & inside[2]
    np.testing.assert_array_equal(city.occupied & ~city.ground, solid)
    assert city.earth is not None
    np.testing.assert_allclose(city.earth.geodetic(np.zeros((1, 3)))[0, :2], [37.79248, -122.39745], atol=1e-9)
    with pytest.raises(FileError, match="leave --crs"):
        read_map(path, maxjax.Reading(crs="EPSG:28992"))
    path.write_text("lat0 137, lon0 8\nposX,posY,posZ,halfSizeX,halfSizeY,halfSizeZ\n0,0,0,1,1,1\n")
    with pytest.raises(FileError, match="lat0 within 90"):
        read_map(path)


def test_lines_of_an_obj_end_and_go_on_as_on_any_system(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 \\\n 3 4\n"
    for ending in ("\n", "\r\n"):
        (tmp_path / "a.obj").write_bytes(text.replace("\n", ending).encode())
        assert len(read_map(tmp_path / "a.obj").triangles) == 2
