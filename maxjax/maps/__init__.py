"""Map files: one reader a format, and what makes voxels of all of them."""

from maxjax.core.files import FileError
from maxjax.maps.airborne import ground_mask, solidify
from maxjax.maps.contents import Contents
from maxjax.maps.load import LoadedMap, load_map, map_of
from maxjax.maps.mesh import Mesh
from maxjax.maps.model import PointCloud, StoredVoxels
from maxjax.maps.reader import read_map
from maxjax.maps.reading import Reading
from maxjax.maps.window import Window

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
