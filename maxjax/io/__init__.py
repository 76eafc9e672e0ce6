"""Map files: one reader a format, and what makes voxels of all of them."""

from maxjax.core.files import FileError
from maxjax.io.kinds.airborne import ground_mask, solidify
from maxjax.io.kinds.contents import Contents
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import PointCloud, StoredVoxels
from maxjax.io.load import LoadedMap, load_map, map_of
from maxjax.io.reader import read_map
from maxjax.io.reading import Reading
from maxjax.io.window import Window

__all__ = [
    "Contents",
    "FileError",
    "LoadedMap",
    "Mesh",
    "PointCloud",
    "Reading",
    "StoredVoxels",
    "Window",
    "ground_mask",
    "load_map",
    "map_of",
    "read_map",
    "solidify",
]
