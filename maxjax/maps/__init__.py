"""Map files: readers by suffix, and what airborne scans need to become buildings."""

from maxjax.maps.airborne import ground_mask, solidify
from maxjax.maps.mesh import Mesh
from maxjax.maps.model import MapError, PointCloud, VoxelMap
from maxjax.maps.reader import load_map

__all__ = ["MapError", "Mesh", "PointCloud", "VoxelMap", "ground_mask", "load_map", "solidify"]
