"""One door for all map formats: the suffix chooses the reader."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from maxjax.maps.glb import load_glb
from maxjax.maps.las import load_las
from maxjax.maps.mesh import Mesh
from maxjax.maps.model import MAX_FILE_BYTES, MapError, PointCloud, VoxelMap
from maxjax.maps.npz import load_npz
from maxjax.maps.obj import load_obj
from maxjax.maps.ply import load_ply
from maxjax.maps.stl import load_stl

_READERS: dict[str, Callable[[Path], PointCloud | VoxelMap | Mesh]] = {
    ".npz": load_npz,
    ".ply": load_ply,
    ".obj": load_obj,
    ".stl": load_stl,
    ".glb": load_glb,
    ".las": load_las,
    ".laz": load_las,
}


def load_map(path: str | os.PathLike[str]) -> PointCloud | VoxelMap | Mesh:
    """Read a map file (.npz, .ply, .obj, .stl, .glb, .las, .laz) into the local ENU frame [m].

    Raises:
        MapError: if the file is missing, of another suffix, unreadable, truncated, empty or too large. Sizes
            are checked before memory is taken, and no pickle is ever opened.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise MapError(f"{path}: expected a suffix among {', '.join(_READERS)}, found {path.suffix or 'none'}")
    try:
        size = path.stat().st_size
        regular = path.is_file()
    except (OSError, ValueError) as error:
        raise MapError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not regular:
        raise MapError(f"{path}: expected a file, found a folder or a device")
    if size == 0:
        raise MapError(f"{path}: the file is empty")
    if size > MAX_FILE_BYTES:
        raise MapError(f"{path}: {size} bytes, expected at most {MAX_FILE_BYTES}; crop or thin it")
    return reader(path)
