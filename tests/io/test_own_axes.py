"""Meshes and points without a reference system: recognised where they are no metres with z up, else read as told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest
import trimesh

import maxjax
from maxjax.io.reader import read_map

PLACE = (8.0, 47.0, 450.0)
SIZE = np.array([120.0, 90.0, 30.0])


def block(size: np.ndarray = SIZE) -> trimesh.Trimesh:
    """A block on a wide floor, z up, metres about (0, 0, 0)."""
    floor = trimesh.creation.box(extents=(2.0 * size[0], 2.0 * size[1], 1.0))
    house = trimesh.creation.box(extents=size)
    house.apply_translation([10.0, -5.0, 0.5 * size[2] + 0.5])
    return trimesh.util.concatenate([floor, house])


def written(mesh: trimesh.Trimesh, path: Path) -> Path:
    """The mesh as a file; as points of its surface where the file is to hold points."""
    if path.suffix == ".npz":
        points, _ = trimesh.sample.sample_surface(mesh, 4000, seed=0)
        np.savez(path, points=points)
    else:
        mesh.export(path)
    return path


def moved(mesh: trimesh.Trimesh, vertices: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def earth_centred(points: np.ndarray) -> np.ndarray:
    """Metres east, north and up of a place, as Earth-centred coordinates by pyproj."""
    longitude, latitude, height = PLACE
    there = (
        f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lon_0={longitude} +lat_0={latitude} +h_0={height}"
    )
    return np.column_stack(pyproj.Transformer.from_pipeline(there).transform(*points.T))


def in_degrees(points: np.ndarray) -> np.ndarray:
    back = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    return np.column_stack(back.transform(*earth_centred(points).T))


@pytest.mark.parametrize("name", ["a.ply", "a.obj", "a.npz"])
@pytest.mark.parametrize(
    ("change", "guess", "option"),
    [
        (earth_centred, "Earth-centred coordinates", "--crs EPSG:4978"),
        (in_degrees, "degrees", "--crs EPSG:4326"),
        (lambda points: 1000.0 * points, "millimetres or feet", "--unit mm"),
        (lambda points: points[:, [0, 2, 1]] * [1.0, 1.0, -1.0], "a scene with y up", "--up y"),
    ],
    ids=["earth-centred", "degrees", "millimetres", "y-up"],
)
def test_what_is_no_plane_in_metres_is_refused_with_what_settles_it(
    tmp_path: Path, name: str, change: object, guess: str, option: str
) -> None:
    mesh = block()
    path = written(moved(mesh, change(mesh.vertices)), tmp_path / name)  # type: ignore[operator]
    with pytest.raises(ValueError, match=rf"expected metres east, north and up, found .*{guess}\? Then {option}"):
        read_map(path)


def test_earth_centred_coordinates_of_glb_are_refused_as_well(tmp_path: Path) -> None:
    mesh = block()
    path = written(moved(mesh, earth_centred(mesh.vertices)), tmp_path / "a.glb")
    with pytest.raises(ValueError, match="Earth-centred coordinates"):
        read_map(path)


def extent(path: Path, **how: object) -> np.ndarray:
    return np.array(maxjax.io.kinds.contents.facts(read_map(path, maxjax.Reading(**how))).extent)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["a.ply", "a.npz"])
def test_earth_centred_coordinates_become_a_plane(tmp_path: Path, name: str) -> None:
    """The size of the scene to a millimetre a metre, and where it lies to a metre."""
    mesh = block()
    path = written(moved(mesh, earth_centred(mesh.vertices)), tmp_path / name)
    known = maxjax.io.kinds.contents.facts(read_map(path, maxjax.Reading(crs="EPSG:4978")))
    loose = 2.0 if name == "a.npz" else 0.6  # float32 of a file holds half a metre
    np.testing.assert_allclose(known.extent[1] - known.extent[0], [240.0, 180.0, 31.0], atol=loose)
    assert known.origin is not None
    np.testing.assert_allclose(known.origin, PLACE[:2], atol=1e-5)
    assert known.extent[0, 2] == pytest.approx(449.5, abs=loose)
    assert known.zero.ellipsoidal


def test_millimetres_and_axes_are_read_as_told(tmp_path: Path) -> None:
    mesh = block()
    whole = [[-120.0, -90.0, -0.5], [120.0, 90.0, 30.5]]
    path = written(moved(mesh, 1000.0 * mesh.vertices), tmp_path / "mm.stl")
    np.testing.assert_allclose(extent(path, unit="mm"), whole, atol=1e-3)
    for up, turn in (("y", [[1, 0, 0], [0, 0, 1], [0, -1, 0]]), ("-y", [[1, 0, 0], [0, 0, -1], [0, 1, 0]])):
        path = written(moved(mesh, mesh.vertices @ np.array(turn, float).T), tmp_path / "up.obj")
        np.testing.assert_allclose(extent(path, up=up), whole, atol=1e-4)
        np.testing.assert_allclose(np.ptp(extent(path, up="z"), axis=0), [240.0, 31.0, 180.0], atol=1e-4)


def test_glb_has_y_up_by_its_standard(tmp_path: Path) -> None:
    mesh = block()
    path = written(moved(mesh, mesh.vertices[:, [0, 2, 1]] * [1.0, 1.0, -1.0]), tmp_path / "a.glb")
    np.testing.assert_allclose(extent(path), [[-120.0, -90.0, -0.5], [120.0, 90.0, 30.5]], atol=1e-3)
    path = written(mesh, tmp_path / "z.glb")
    np.testing.assert_allclose(extent(path, up="z"), [[-120.0, -90.0, -0.5], [120.0, 90.0, 30.5]], atol=1e-3)


def test_an_offset_brings_a_mesh_to_where_its_system_has_it(tmp_path: Path) -> None:
    """A mesh beside the offset of its coordinates, 400 m aside: on Earth to a centimetre, by pyproj."""
    offset = (600000.0, 5300000.0, 0.0)
    path = written(block(), tmp_path / "a.obj")
    city = maxjax.load_map(path, reading=maxjax.Reading(crs="EPSG:25832", offset=offset))
    assert city.earth is not None
    point = np.array([[offset[0] + 400.0, offset[1] + 10.0, 5.0]])
    latitude, longitude, _ = city.earth.geodetic(point)[0].tolist()
    theirs = pyproj.Transformer.from_crs("EPSG:25832", "EPSG:4326").transform(point[0, 0], point[0, 1])
    np.testing.assert_allclose([latitude, longitude], theirs, atol=1e-7)
    i, j, k = np.round((np.array([10.0, -5.0, 20.0]) + offset - city.grid.origin) / city.grid.spacing).astype(int)
    assert city.occupied[i, j, k]


def test_a_room_is_free_inside_where_the_user_says_so(tmp_path: Path) -> None:
    path = written(trimesh.creation.box(extents=(40.0, 30.0, 20.0)), tmp_path / "room.ply")
    solid = maxjax.plan(maxjax.load_map(path, spacing=1.0), (-10.0, 0.0, 0.0), (10.0, 5.0, 0.0))
    assert solid.status == maxjax.Status.START_OCCUPIED
    room = maxjax.load_map(path, spacing=1.0, reading=maxjax.Reading(inside="free"))
    assert maxjax.plan(room, (-10.0, 0.0, 0.0), (10.0, 5.0, 0.0)).status == maxjax.Status.OK
    assert maxjax.plan(room, (-10.0, 0.0, 0.0), (30.0, 5.0, 0.0)).status != maxjax.Status.OK


def test_what_a_user_says_is_checked(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="offset: expected three finite numbers"):
        maxjax.Reading(offset=(np.nan, 0.0, 0.0))
    path = written(block(), tmp_path / "a.ply")
    with pytest.raises(ValueError, match="expected Earth-centred coordinates"):
        read_map(path, maxjax.Reading(crs="EPSG:4978"))
    assert extent(path, unit="m").shape == (2, 3)
