"""Which columns of a grid lie within a file's data: beyond it nothing is known, whatever the voxels say.

within = inside the convex hull of everything that has a place, seen from above; of surface models where a cell has a
height, of voxel maps in their box; of surveys no farther from a return than two columns, or than four times the
distance that returns have in the mean

What a survey or a surface model does not cover is closed, unless a user calls the unknown free. A single scan sees as
far as its beams reach, and its map is what it saw: that stays free.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.geo.rings import signed_area
from maxjax.io.kinds.boxes import Boxes
from maxjax.io.kinds.contents import Contents
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.kinds.heights import Heights
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import PointCloud, StoredVoxels
from maxjax.io.reading import Unknown

_CHUNK = 2**20  # points at a time
_REACH = 0.5 - 1e-6  # half a column; one that only shares a face with the data lies outside
_COLUMNS, _TIMES = 2, 4  # how far from a return a survey still covers: columns, or mean distances of returns
Places = Float[np.ndarray, "_ 2"]


def within_data(contents: Contents, grid: Grid) -> Bool[np.ndarray, "nx ny"]:
    """Columns of a grid that touch what a file's data cover."""
    if isinstance(contents, Heights):
        _, blank = contents.voxels(Grid((*grid.shape[:2], 1), grid.spacing, grid.origin))
        return ~blank
    if isinstance(contents, PointCloud) and _is_survey(contents):
        return _seen(contents, grid)
    return _inside(_outline(_places(contents)), grid)


def closing_unknown(
    found: VoxelMap, within: Bool[np.ndarray, "nx ny"], contents: Contents, unknown: Unknown | None
) -> tuple[VoxelMap, tuple[str, ...]]:
    """The map with what a survey does not cover closed, and what a user should know of it.

    Args:
        found: of the contents.
        within: its columns that lie within the data.
        contents: of a file.
        unknown: what the user calls it.
    """
    if not isinstance(contents, PointCloud):
        return found, ()
    if not _is_survey(contents):
        return found, ("what the scan did not see is taken as free",)
    count = int((~within).sum())
    if unknown == "free" or not count:
        said = f"{count} of {within.size} columns are not covered by the survey, and are taken as free"
        return found, (said,) if count else ()
    occupied = np.asarray(found.occupied) | ~within[:, :, None]
    said = f"{count} of {within.size} columns are not covered by the survey, and are closed; --unknown free opens them"
    return VoxelMap.on(found.grid, occupied, found.ground), (said,)


def _is_survey(cloud: PointCloud) -> bool:
    """Whether points are those of a survey from the air, which has classes."""
    return cloud.classes is not None


def _seen(cloud: PointCloud, grid: Grid) -> Bool[np.ndarray, "nx ny"]:
    """Columns that are near a return; columns beyond the grid count for those within."""
    from scipy import ndimage  # a quarter of a second that most commands can do without

    places = cloud.points[np.isfinite(cloud.points).all(axis=1), :2].astype(np.float64) + cloud.offset[:2]
    outline = _outline(places)
    area = abs(signed_area(outline))
    reach = max(_COLUMNS * grid.spacing, _TIMES * math.sqrt(area / max(len(places), 1)))
    around = math.ceil(reach / grid.spacing)
    index = np.floor((places - np.array(grid.lower[:2])) / grid.spacing).astype(np.int64) + around
    nx, ny = (n + 2 * around for n in grid.shape[:2])
    index = index[((index >= 0) & (index < (nx, ny))).all(axis=1)]
    empty = np.ones((nx, ny), bool)
    empty[tuple(index.T)] = False
    if empty.all():
        return np.zeros(grid.shape[:2], bool)
    distance = grid.spacing * ndimage.distance_transform_edt(empty)
    found: Bool[np.ndarray, "nx ny"] = distance[around : nx - around, around : ny - around] <= reach
    return found


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
            return np.concatenate([contents.solids, contents.terrain.reshape(-1, 3)])[:, :2].astype(np.float64)
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
