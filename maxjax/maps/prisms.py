"""Footprints on a grid: upright prisms over the ground.

    solid  = columns whose square touches the footprint × heights from base to top
    ground = { voxels up to the terrain }

Which columns a footprint covers is told by `core.geometry.columns`. The terrain is the file's; where it has none, it is
level with the lowest floor in the column or, between buildings, in the nearest one. Buildings reach down to it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax.core.geometry.columns import columns_of
from maxjax.core.geometry.triangles import Volume, fill_columns, touched
from maxjax.core.grid import Grid
from maxjax.maps.airborne import NONE, from_nearest
from maxjax.maps.footprints import Footprints

_TOUCH = 1e-6  # [voxels]; of heights: overlaps thinner than that do not count


def prism_voxels(footprints: Footprints, grid: Grid) -> tuple[Volume, Volume]:
    """Buildings and ground.

    Args:
        footprints: of a file.
        grid: in the file's coordinates (`Footprints.shift`) [m].

    Returns:
        (solid, ground), of grid.shape each.
    """
    nx, ny, nz = grid.shape
    lower = np.array(grid.lower) - footprints.shift
    rings = [ring for b in footprints.buildings for ring in b.rings]
    owner = np.array([k for k, b in enumerate(footprints.buildings) for _ in b.rings], np.int64)
    local = dataclasses.replace(grid, origin=tuple((np.array(grid.origin) - footprints.shift).tolist()))
    column, building = (np.concatenate(pair) for pair in zip(*columns_of(rings, owner, local), strict=True))
    heights = (np.array([[b.base, b.top] for b in footprints.buildings]) - lower[2]) / grid.spacing
    floor = np.clip(np.floor(heights[:, 0] + _TOUCH), -1, nz).astype(np.int64)
    roof = np.clip(np.ceil(heights[:, 1] - _TOUCH) - 1, -1, nz - 1).astype(np.int64)
    terrain = np.full(nx * ny, nz + 1)
    if len(footprints.terrain):
        surface = touched(footprints.terrain + footprints.shift, grid)
        top = nz - 1 - surface[:, :, ::-1].argmax(axis=2)
        terrain = np.where(surface.any(axis=2), top, NONE).ravel()
    else:
        np.minimum.at(terrain, column, floor[building])
        terrain = np.where(terrain > nz, NONE, terrain)
    terrain = from_nearest(terrain.reshape(nx, ny)).ravel()
    first = np.minimum(np.maximum(floor[building], 0), np.clip(terrain[column] + 1, 0, nz))
    solid = fill_columns(column, first, roof[building], grid.shape)
    return solid, np.arange(nz) <= terrain.reshape(nx, ny, 1)
