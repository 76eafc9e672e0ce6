"""The ground of a map file, one height a column, as numbers: voxels hold it only to a voxel.

    triangles of a terrain   their height at the column's centre, the highest where several lie there
    footprints without       the lowest floor of the buildings in the column
    points                   the mean of the column's ground returns
    none of these there      that of the nearest column that has one

Within a column the ground is taken as level.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from maxjax.core.grid import Grid
from maxjax.core.terrain import Terrain
from maxjax.io.geo.triangles import column_spans, crests
from maxjax.io.kinds.contents import Contents
from maxjax.io.kinds.footprints import Fill, Footprints
from maxjax.io.kinds.point_cloud import PointCloud
from maxjax.io.kinds.prisms import footprint_columns

_CHUNK = 2**20  # points at a time


def terrain_of(contents: Contents, grid: Grid) -> Terrain | None:
    """How high the ground of a file is.

    Args:
        contents: of any kind.
        grid: in the map's coordinates.

    Returns:
        The terrain; None where the file tells ground by voxels, or not at all.
    """
    match contents:
        case Footprints():
            known = crests(contents.terrain, grid) if len(contents.terrain) else _floors(contents, grid)
        case PointCloud() if contents.ground.any():
            known = _returns(contents, grid)
        case _:
            return None
    return Terrain(Terrain(known, grid).everywhere, grid)


def _floors(footprints: Footprints, grid: Grid) -> Float[np.ndarray, "nx ny"]:
    column, building = footprint_columns(footprints, grid)
    floors = np.full(grid.shape[0] * grid.shape[1], np.inf)
    np.minimum.at(floors, column, np.array([b.base for b in footprints.buildings], np.float64)[building])
    shells = footprints.shells
    # A crown or a bridge does not tell where the ground is.
    standing = np.flatnonzero((shells.grounded & (shells.fill != Fill.SURFACE))[shells.of_face])
    for column, face, _low, _high in column_spans(shells.faces[standing], grid):
        np.minimum.at(floors, column, shells.base[shells.of_face[standing[face]]])
    found: Float[np.ndarray, "nx ny"] = np.where(np.isinf(floors), np.nan, floors).reshape(grid.shape[:2])
    return found


def _returns(cloud: PointCloud, grid: Grid) -> Float[np.ndarray, "nx ny"]:
    nx, ny, _ = grid.shape
    total, count = np.zeros(nx * ny), np.zeros(nx * ny, np.int64)
    lower = np.array(grid.lower[:2]) - cloud.offset[:2]
    for begin in range(0, len(cloud.points), _CHUNK):
        points = cloud.points[begin : begin + _CHUNK][cloud.ground[begin : begin + _CHUNK]].astype(np.float64)
        points = points[np.isfinite(points).all(axis=1)]
        index = np.floor((points[:, :2] - lower) / grid.spacing)
        inside = ((index >= 0) & (index < (nx, ny))).all(axis=1)
        column = index[inside].astype(np.int64) @ np.array([ny, 1])
        total += np.bincount(column, points[inside, 2], nx * ny)
        count += np.bincount(column, minlength=nx * ny)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan) + cloud.offset[2]
    found: Float[np.ndarray, "nx ny"] = mean.reshape(nx, ny)
    return found
