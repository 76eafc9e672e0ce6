"""Maps small enough to draw: a larger one is drawn in larger voxels, occupied where any of theirs is."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool

from maxjax.core.voxel_map import VoxelMap

MOST_DRAWN = 2**24  # voxels

Columns = Bool[np.ndarray, "nx ny"]


def drawable(where: VoxelMap, within: Columns | None = None) -> tuple[VoxelMap, Columns | None, str]:
    """A map that can be drawn, its columns within the data, and a remark for the title where it is coarser.

    Args:
        where: one map.
        within: columns that lie within its data; None: all do.
    """
    factor = 1
    while math.prod(-(-n // factor) for n in where.grid.shape) > MOST_DRAWN:
        factor += 1
    if factor == 1:
        return where, within, ""
    coarse = where.coarser(factor)
    if within is not None:
        nx, ny = (np.arange(0, n, factor) for n in within.shape)
        within = np.logical_or.reduceat(np.logical_or.reduceat(within, nx, axis=0), ny, axis=1)
    return coarse, within, f"drawn in voxels of {coarse.grid.spacing:g} m"


def voxels_to_draw(where: VoxelMap, within: Columns | None) -> VoxelMap:
    """Voxels of a map to draw: without those closed because nothing is known of their column."""
    if within is None:
        return where
    occupied, ground = (np.asarray(volume) & within[:, :, None] for volume in (where.occupied, where.ground))
    return VoxelMap.on(where.grid, occupied, ground)


def title_with_remark(title: str | None, remark: str) -> str | None:
    """A headline with its remark."""
    return ", ".join(filter(None, (title, remark))) or None
