"""One door for all map formats, and one gate behind it.

The suffix chooses the reader; what a `.json` is, its content says. A file that ends in `.gz` is unpacked first.
Whatever a reader meets in a damaged file leaves as a `FileError`: readers check sizes before they take memory, and this
gate is for what they did not foresee.
"""

from __future__ import annotations

import contextlib
import gzip
import os
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from maxjax.core.files import MAX_FILE_BYTES, FileError, brief, open_regular
from maxjax.io.geo.own_axes import check_plane
from maxjax.io.kinds.contents import Contents, facts
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import FARTHEST, PointCloud
from maxjax.io.readers.box_list import load_boxes
from maxjax.io.readers.cityjson import load_cityjson
from maxjax.io.readers.e57 import load_e57
from maxjax.io.readers.geojson import load_geojson
from maxjax.io.readers.gltf_mesh import load_gltf
from maxjax.io.readers.las import load_las
from maxjax.io.readers.mesh_folder import load_folder, load_zip
from maxjax.io.readers.mitsuba import is_scene, load_mitsuba
from maxjax.io.readers.moving_ai import load_3dmap
from maxjax.io.readers.npz import load_npz
from maxjax.io.readers.obj import load_obj
from maxjax.io.readers.obstacle_file import is_obstacle_csv, load_obstacles
from maxjax.io.readers.octomap import load_octomap
from maxjax.io.readers.osm import load_osm
from maxjax.io.readers.overpass import load_overpass
from maxjax.io.readers.pbf import load_pbf
from maxjax.io.readers.pcd import load_pcd
from maxjax.io.readers.ply import load_ply
from maxjax.io.readers.raster import load_raster
from maxjax.io.readers.stl import load_stl
from maxjax.io.readers.text_points import is_grid, load_text_points
from maxjax.io.readers.vector import SUFFIXES, load_vector
from maxjax.io.reading import PLAIN, Reading

_PEEK, _PIECE = 65_536, 2**20


def _load_json(path: Path, reading: Reading) -> Contents:
    with open_regular(path) as file:
        start = file.read(_PEEK)
    if b'"elements"' in start and b"CityJSON" not in start and b"Feature" not in start:
        return load_overpass(path, reading)
    # A CityJSON may hold anything first, but names itself; GeoJSON has no CityObjects.
    city = b"CityJSON" in start or b"CityObjects" in start or b"Feature" not in start
    return load_cityjson(path, reading) if city else load_geojson(path, reading)


def _load_xml(path: Path, reading: Reading) -> Contents:
    return load_mitsuba(path, reading) if is_scene(path) else load_osm(path, reading)


def _load_csv(path: Path, reading: Reading) -> Contents:
    return load_obstacles(path, reading) if is_obstacle_csv(path) else load_boxes(path, reading)


def _load_asc(path: Path, reading: Reading) -> Contents:
    return load_raster(path, reading) if is_grid(path) else load_text_points(path, reading)


READERS: dict[str, Callable[[Path, Reading], Contents]] = {
    ".npz": load_npz,
    ".ply": load_ply,
    ".pcd": load_pcd,
    ".las": load_las,
    ".laz": load_las,
    ".obj": load_obj,
    ".stl": load_stl,
    ".glb": load_gltf,
    ".gltf": load_gltf,
    ".json": _load_json,
    ".osm": load_osm,
    ".xml": _load_xml,
    ".geojson": load_geojson,
    ".geojsonl": load_geojson,
    ".geojsons": load_geojson,
    ".jsonl": _load_json,
    ".ndjson": _load_json,
    ".pbf": load_pbf,
    **dict.fromkeys(SUFFIXES, load_vector),
    ".bt": load_octomap,
    ".ot": load_octomap,
    ".tif": load_raster,
    ".tiff": load_raster,
    ".hgt": load_raster,
    ".asc": _load_asc,
    ".xyz": load_text_points,
    ".pts": load_text_points,
    ".txt": load_text_points,
    ".e57": load_e57,
    ".3dmap": load_3dmap,
    ".csv": _load_csv,
    ".dat": load_obstacles,
    ".zip": load_zip,
}


_MESHES = "export it as .glb or .obj"
# Formats that are not read, what they are, and what to do.
_FOREIGN = {
    **dict.fromkeys((".ifc", ".rvt", ".skp", ".dwg", ".dxf"), ("a model of building design", _MESHES)),
    **dict.fromkeys(
        (".fbx", ".dae", ".blend", ".3ds", ".usd", ".usda", ".usdc", ".usdz", ".wrl"), ("a scene", _MESHES)
    ),
    **dict.fromkeys(
        (".b3dm", ".i3dm", ".pnts", ".cmpt"), ("a tile of 3D Tiles", "convert its content to .glb or .laz")
    ),
    **dict.fromkeys((".bag", ".db3", ".mcap"), ("a recording of ROS", "export its clouds as .pcd or .ply")),
    **dict.fromkeys((".kmz", ".gpx"), ("a drawing", "unpack or convert it to .kml; zones are given to --airspace")),
    **dict.fromkeys((".dem", ".img", ".vrt", ".asc.zip"), ("a raster", "gdal_translate FILE heights.tif")),
    **dict.fromkeys((".gdb", ".mdb", ".tab", ".mif"), ("a vector data set", "ogr2ogr city.gpkg FILE")),
    **dict.fromkeys((".7z", ".rar", ".tar", ".tgz", ".bz2", ".xz"), ("an archive", "unpack it first")),
}


def _advice(path: Path) -> str:
    """What is wrong with a suffix that no reader has, and what to do."""
    suffix = path.suffix.lower()
    if suffix in _FOREIGN:
        what, how = _FOREIGN[suffix]
        return f"{suffix} is {what}, which is not read: {how}"
    return f"expected a suffix among {', '.join(READERS)}, found {path.suffix or 'none'}"


@contextlib.contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """The content of a gzip file, under its name without .gz; never more than a map may have."""
    with tempfile.TemporaryDirectory() as folder, open_regular(path) as packed:
        inner, size = Path(folder) / path.with_suffix("").name, 0
        try:
            with gzip.open(packed) as source, open(inner, "wb") as target:
                while piece := source.read(_PIECE):
                    size += len(piece)
                    if size > MAX_FILE_BYTES:
                        raise FileError(f"{path}: unpacks to more than {MAX_FILE_BYTES} bytes; crop it")
                    target.write(piece)
        except (EOFError, OSError, zlib.error) as error:
            raise FileError(f"{path}: expected an intact gzip file: {brief(error)}") from error
        yield inner


def read_map(path: str | os.PathLike[str], reading: Reading = PLAIN) -> Contents:
    """Read a map file, or a folder of meshes, as what it holds: points, voxels, a mesh, buildings, boxes or heights.

    Raises:
        FileError: if the file is missing, of another suffix, unreadable, truncated, empty or too large, or holds what
            is not finite. Sizes are checked before memory is taken, and no pickle is ever opened.
    """
    path = Path(path)
    if path.suffix.lower() == ".gz" and path.is_file():
        with _unpacked(path) as inner:
            try:
                return read_map(inner, reading)
            except FileError as error:
                raise FileError(str(error).replace(str(inner), str(path))) from error.__cause__
    try:
        folder = path.is_dir()
        reader = load_folder if folder else READERS.get(path.suffix.lower())
        if reader is None:
            raise FileError(f"{path}: {_advice(path)}")
        size = path.stat().st_size
        regular = folder or path.is_file()
    except FileError:
        raise
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not regular:
        raise FileError(f"{path}: expected a file or a folder, found a device")
    if size == 0 and not folder:
        raise FileError(f"{path}: the file is empty")
    if size > MAX_FILE_BYTES:
        raise FileError(f"{path}: {size} bytes, expected at most {MAX_FILE_BYTES}; crop or thin it")
    try:
        # Numbers too large for their type become infinite or NaN without a warning, and are refused as such.
        with np.errstate(all="ignore"):
            contents = reader(path, reading)
            extent = facts(contents).extent
            if contents.reference.system is None:
                check_plane(extent, reading, path, shaped=isinstance(contents, Mesh | PointCloud))
    except Exception as error:  # see the module
        if isinstance(error, FileError):
            raise FileError(brief(error)) from error.__cause__
        raise FileError(f"{path}: damaged: {type(error).__name__}: {brief(error)}") from error
    if not (np.abs(extent) <= FARTHEST).all():
        raise FileError(f"{path}: expected coordinates within {FARTHEST:.0e} m of 0, found {extent.tolist()}; damaged?")
    return contents
