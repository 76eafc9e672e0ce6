"""Gaps of airborne scans: the inside of buildings and of the earth, and the space under crowns.

Seen from above, a building is a roof without walls, a tree its crown and the terrain a thin sheet. All are closed
downwards, column by column, from the highest return in the column:

    solid  = { voxels from the terrain up to the highest return from a building, or from anything that hides }
    ground = { voxels up to the highest return from the ground }

The terrain under a building, where no beam reaches, is that of the nearest column with a ground return.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int

from maxjax.core.grid import Grid
from maxjax.io.kinds.point_cloud import PointCloud

NONE = -2  # below -1, which stands for a point under the grid


def solidify(cloud: PointCloud, grid: Grid, *, closed: bool = False) -> Bool[np.ndarray, "nx ny nz"]:
    """Voxels between the terrain and the roofs, both included: the buildings as solid bodies.

    Args:
        cloud: the survey.
        grid: in the cloud's frame.
        closed: whether everything that hides what is below it (`PointCloud.hiding`) is solid as well.

    Where the cloud has no ground return over this grid, buildings reach down to the grid's floor.
    """
    roof = _highest_voxel(cloud, cloud.solid | cloud.hiding if closed else cloud.solid, grid)[:, :, None]
    level = np.arange(grid.shape[2])
    return (level <= roof) & (level >= _terrain(cloud, grid)[:, :, None])


def ground_mask(cloud: PointCloud, grid: Grid) -> Bool[np.ndarray, "nx ny nz"]:
    """Voxels at or below the terrain, so that no path leads underground; none without ground returns."""
    return np.arange(grid.shape[2]) <= _terrain(cloud, grid)[:, :, None]


def _terrain(cloud: PointCloud, grid: Grid) -> Int[np.ndarray, "nx ny"]:
    """Index along z of the terrain in each column, taken from the nearest column that has a ground return."""
    return from_nearest(_highest_voxel(cloud, cloud.ground, grid))


def from_nearest(height: Int[np.ndarray, "nx ny"]) -> Int[np.ndarray, "nx ny"]:
    """Heights of columns [voxels], `NONE` replaced by that of the nearest column that has one."""
    unknown = height == NONE
    if unknown.all():
        return height
    from scipy import ndimage  # a quarter of a second that most commands can do without

    nearest = ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return np.asarray(height[tuple(nearest)])


def _highest_voxel(cloud: PointCloud, chosen: Bool[np.ndarray, " n"], grid: Grid) -> Int[np.ndarray, "nx ny"]:
    """Index along z of the highest chosen point in each column, -1 or nz beyond the grid; `NONE` without."""
    index = np.floor((cloud.points[chosen] - np.array(grid.origin)) / grid.spacing + 0.5)
    nx, ny, nz = grid.shape
    # NaN fails every comparison and so drops out here.
    inside = (index[:, 0] >= 0) & (index[:, 0] < nx) & (index[:, 1] >= 0) & (index[:, 1] < ny)
    inside &= np.isfinite(index[:, 2])
    index[:, 2] = np.clip(index[:, 2], -1, nz)
    x, y, z = index[inside].astype(np.int64).T
    highest = np.full((nx, ny), NONE)
    np.maximum.at(highest, (x, y), z)
    return highest
