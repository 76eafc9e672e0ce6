"""One door for all map formats, and one gate behind it.

The suffix chooses the reader; what a `.json` is, its content says. Whatever a reader meets in a damaged file leaves as
a `FileError`: readers check sizes before they take memory, and this gate is for what they did not foresee.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from maxjax.core.files import MAX_FILE_BYTES, FileError, brief, open_regular
from maxjax.io.geo.own_axes import check_plane
from maxjax.io.kinds.contents import Contents, facts
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import FARTHEST, PointCloud
from maxjax.io.readers.box_list import load_boxes
from maxjax.io.readers.cityjson import load_cityjson
from maxjax.io.readers.geojson import load_geojson
from maxjax.io.readers.geotiff import load_geotiff
from maxjax.io.readers.glb import load_glb
from maxjax.io.readers.las import load_las
from maxjax.io.readers.mesh_folder import load_folder, load_zip
from maxjax.io.readers.mitsuba import is_scene, load_mitsuba
from maxjax.io.readers.moving_ai import load_3dmap
from maxjax.io.readers.npz import load_npz
from maxjax.io.readers.obj import load_obj
from maxjax.io.readers.obstacle_file import is_obstacle_csv, load_obstacles
from maxjax.io.readers.octomap import load_octomap
from maxjax.io.readers.osm import load_osm
from maxjax.io.readers.pcd import load_pcd
from maxjax.io.readers.ply import load_ply
from maxjax.io.readers.stl import load_stl
from maxjax.io.reading import PLAIN, Reading

_PEEK = 65_536


def _load_json(path: Path, reading: Reading) -> Contents:
    with open_regular(path) as file:
        start = file.read(_PEEK)
    # A CityJSON may hold anything first, but names itself; GeoJSON has no CityObjects.
    city = b"CityJSON" in start or b"CityObjects" in start or b"Feature" not in start
    return load_cityjson(path, reading) if city else load_geojson(path, reading)


def _load_xml(path: Path, reading: Reading) -> Contents:
    return load_mitsuba(path, reading) if is_scene(path) else load_osm(path, reading)


def _load_csv(path: Path, reading: Reading) -> Contents:
    return load_obstacles(path, reading) if is_obstacle_csv(path) else load_boxes(path, reading)


READERS: dict[str, Callable[[Path, Reading], Contents]] = {
    ".npz": load_npz,
    ".ply": load_ply,
    ".pcd": load_pcd,
    ".las": load_las,
    ".laz": load_las,
    ".obj": load_obj,
    ".stl": load_stl,
    ".glb": load_glb,
    ".json": _load_json,
    ".osm": load_osm,
    ".xml": _load_xml,
    ".geojson": load_geojson,
    ".bt": load_octomap,
    ".ot": load_octomap,
    ".tif": load_geotiff,
    ".tiff": load_geotiff,
    ".3dmap": load_3dmap,
    ".csv": _load_csv,
    ".dat": load_obstacles,
    ".zip": load_zip,
}


def read_map(path: str | os.PathLike[str], reading: Reading = PLAIN) -> Contents:
    """Read a map file, or a folder of meshes, as what it holds: points, voxels, a mesh, buildings, boxes or heights.

    Raises:
        FileError: if the file is missing, of another suffix, unreadable, truncated, empty or too large, or holds what
            is not finite. Sizes are checked before memory is taken, and no pickle is ever opened.
    """
    path = Path(path)
    try:
        folder = path.is_dir()
        reader = load_folder if folder else READERS.get(path.suffix.lower())
        if reader is None:
            raise FileError(f"{path}: expected a suffix among {', '.join(READERS)}, found {path.suffix or 'none'}")
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
