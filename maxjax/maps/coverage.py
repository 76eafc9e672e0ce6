"""Which columns of a grid lie within a file's data: beyond it nothing is known, whatever the voxels say.

within = inside the convex hull of everything that has a place, seen from above; of surface models where a cell has a
height, of voxel maps in their box
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.maps.boxes import Boxes
from maxjax.maps.contents import Contents
from maxjax.maps.footprints import Footprints
from maxjax.maps.heights import Heights
from maxjax.maps.mesh import Mesh
from maxjax.maps.model import PointCloud, StoredVoxels

_CHUNK = 2**20  # points at a time
_REACH = 0.5 - 1e-6  # half a column; one that only shares a face with the data lies outside
Places = Float[np.ndarray, "_ 2"]


def within_data(contents: Contents, grid: Grid) -> Bool[np.ndarray, "nx ny"]:
    """Columns of a grid that touch what a file's data cover."""
    if isinstance(contents, Heights):
        _, blank = contents.voxels(Grid((*grid.shape[:2], 1), grid.spacing, grid.origin))
        return ~blank
    return _inside(_outline(_places(contents)), grid)


def _places(contents: PointCloud | StoredVoxels | Mesh | Footprints | Boxes) -> Places:
    """Of everything in a file [m]; of points the outlines of all parts."""
    match contents:
        case PointCloud():
            shift = contents.offset[:2]
            parts = []
            for begin in range(0, len(contents.points), _CHUNK):
                points = contents.points[begin : begin + _CHUNK].astype(np.float64)
                valid = np.isfinite(points).all(axis=1)
                if not contents.offset.any():
                    valid &= (points != 0).any(axis=1)  # a missed beam
                parts.append(_outline(points[valid, :2]) + shift)
            return np.concatenate(parts) if parts else np.zeros((0, 2))
        case StoredVoxels():
            (x0, y0, _), (x1, y1, _) = contents.grid.lower, contents.grid.upper
            return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        case Mesh():
            return np.concatenate([contents.triangles.reshape(-1, 3), contents.points])[:, :2].astype(np.float64)
        case Footprints():
            rings = [ring for building in contents.buildings for ring in building.rings]
            places = np.concatenate([*rings, contents.terrain.reshape(-1, 3)[:, :2]])
            return np.asarray(places + contents.shift[:2], np.float64)
        case Boxes():
            known = contents.corners if contents.free is None else np.concatenate([contents.corners, contents.free])
            low, high = known[:, 0, :2], known[:, 1, :2]
            aside = [np.column_stack([low[:, 0], high[:, 1]]), np.column_stack([high[:, 0], low[:, 1]])]
            return np.concatenate([low, high, *aside]).astype(np.float64)


def _outline(places: Places) -> Places:
    """Corners of the convex hull, anticlockwise; of places on one line themselves."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(places[ConvexHull(places).vertices])
    except (QhullError, ValueError):  # fewer than three, or on one line
        return places


def _inside(outline: Places, grid: Grid) -> Bool[np.ndarray, "nx ny"]:
    """Columns that touch a convex outline, or the box of one that has no area."""
    x, y = (grid.origin[axis] + grid.spacing * np.arange(grid.shape[axis]) for axis in (0, 1))
    if len(outline) == 0:
        return np.zeros(grid.shape[:2], bool)
    low, high, half = outline.min(axis=0), outline.max(axis=0), _REACH * grid.spacing
    found: Bool[np.ndarray, "nx ny"] = ((x >= low[0] - half) & (x <= high[0] + half))[:, None] & (
        (y >= low[1] - half) & (y <= high[1] + half)
    )
    edges = np.roll(outline, -1, axis=0) - outline
    if not (np.abs(edges) > 0.0).any(axis=1).all() or len(outline) < 3:
        return found
    for (a, b), (c, d) in zip(outline.tolist(), edges.tolist(), strict=True):
        # Left of the edge, by as much as half a column reaches across it.
        found &= c * (y - b) - (d * (x - a))[:, None] >= -half * (abs(c) + abs(d))
    return found
