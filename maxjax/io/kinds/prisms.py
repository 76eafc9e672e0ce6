"""City models on a grid: prisms over footprints, shells of faces, and the ground.

    prism    columns whose square touches the footprint × heights from base to top
    inside   a shell that closes: voxels that its faces touch, and those within
    below    a shell that does not: columns that a face is above × heights from the building's lowest point to the face,
             or to the shell's highest point where walls stand about a floor that no roof is above
    surface  voxels that a face touches
    ground   voxels up to the terrain

The terrain is the file's; where it has none, it is level with the lowest floor in the column or, between buildings, in
the nearest one. Buildings reach down to it: a closed one where its lowest face in the column belongs to a floor, which
may lie up to 4 m above the building's lowest point, since floors step and slope; what hangs higher has air below it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64

from maxjax.core.grid import Grid
from maxjax.io.geo.columns import columns_of
from maxjax.io.geo.triangles import Triangles, Volume, area_normals, column_spans, fill_columns, voxels_touched, wound
from maxjax.io.kinds.airborne import NONE, from_nearest
from maxjax.io.kinds.footprints import Fill, Footprints, Shells

_TOUCH = 1e-6  # [voxels]; of heights: overlaps thinner than that do not count
_FLOOR = 4.0  # floors of a building lie within so much of its lowest point [m]
_ROOFLESS = 0.5  # a column is open above if its highest face lies within so much of the shell's lowest point [m]
_UPRIGHT = 1e-3  # of a face's normal, the vertical share below which it is a wall

Levels = Int64[np.ndarray, " n"]


def prism_voxels(found: Footprints, grid: Grid) -> tuple[Volume, Volume]:
    """Everything solid, and the ground.

    Args:
        found: in a file.
        grid: in the map's coordinates [m].

    Returns:
        (solid, ground), of grid.shape each.
    """
    nz = grid.shape[2]
    columns, bottom, top = _prisms(found, grid)
    feet, lowest, highest, floor = _standing(found.shells, grid)
    terrain = _terrain(found, grid, (np.concatenate([columns, feet]), np.concatenate([bottom, floor])))
    columns = np.concatenate([columns, feet])
    bottom, top = np.concatenate([bottom, lowest]), np.concatenate([top, highest])
    first = np.minimum(np.maximum(bottom, 0), np.clip(terrain.ravel()[columns] + 1, 0, nz))
    solid = fill_columns(columns, first, top, grid.shape)
    solid |= _bodies(found.shells, grid)
    return solid, np.arange(nz) <= terrain[:, :, None]


def footprint_columns(found: Footprints, grid: Grid) -> tuple[Levels, Levels]:
    """Columns whose square touches a footprint, and the building that it is of; a pair may occur twice."""
    rings = [ring for building in found.buildings for ring in building.rings]
    owner = np.array([k for k, building in enumerate(found.buildings) for _ in building.rings], np.int64)
    column, building = (np.concatenate(pair) for pair in zip(*columns_of(rings, owner, grid), strict=True))
    return column, building


def _prisms(found: Footprints, grid: Grid) -> tuple[Levels, Levels, Levels]:
    """Columns of footprints, and the voxels of their floors and roofs."""
    column, building = footprint_columns(found, grid)
    heights = np.array([[b.base, b.top] for b in found.buildings]).reshape(-1, 2)
    levels = (heights - grid.lower[2]) / grid.spacing
    return column, _floor(levels[building, 0], grid), _roof(levels[building, 1], grid)


def _standing(shells: Shells, grid: Grid) -> tuple[Levels, Levels, Levels, Levels]:
    """Columns of shells that reach down, the lowest and highest voxel of any there, and the lowest of a building.

    The last is above the grid where there is no building, since a crown or a bridge does not tell where the ground is.
    """
    nx, ny, nz = grid.shape
    base = (shells.base - grid.lower[2]) / grid.spacing
    reaches = (shells.fill == Fill.BELOW) | ((shells.fill == Fill.INSIDE) & shells.grounded)
    chosen = np.flatnonzero(reaches[shells.of_face])
    bottom, top, floor = np.full(nx * ny, np.inf), np.full(nx * ny, -np.inf), np.full(nx * ny, np.inf)
    pairs = []
    for column, one, low, high in column_spans(shells.faces[chosen], grid):
        shell = shells.of_face[chosen[one]]
        below = shells.fill[shell] == Fill.BELOW
        pairs.append((shell[below] * (nx * ny) + column[below], high[below]))
        held = below | (low <= base[shell] + _FLOOR / grid.spacing + _TOUCH)
        np.minimum.at(bottom, column[held], base[shell[held]])
        np.maximum.at(top, column[held], np.where(below, high, low)[held])
        held &= shells.grounded[shell]
        np.minimum.at(floor, column[held], base[shell[held]])
    if pairs:
        column, level = _roofless(shells, pairs, grid)
        np.maximum.at(top, column, level)
    column = np.flatnonzero(bottom < np.inf)
    # A flat roof on its own lies in one voxel at least.
    highest = np.maximum(_roof(top[column], grid), np.minimum(_floor(top[column], grid), nz - 1))
    told = floor[column] < np.inf
    ground = np.where(told, _floor(np.where(told, floor[column], 0.0), grid), nz + 1)
    return column, _floor(bottom[column], grid), highest, ground


def _roofless(
    shells: Shells, pairs: list[tuple[Levels, Float[np.ndarray, " n"]]], grid: Grid
) -> tuple[Int64[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Columns where a shell with walls has no more than a floor, and its highest point [voxels].

    Args:
        shells: of a file.
        pairs: shell · columns + column, and the highest point of a face there [voxels].
        grid: whose columns.
    """
    columns = grid.shape[0] * grid.shape[1]
    key, level = (np.concatenate(part) for part in zip(*pairs, strict=True))
    order = np.argsort(key, kind="stable")
    key, level = key[order], level[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])[: len(key)]
    shell, column = np.divmod(key[first], columns)
    level = np.maximum.reduceat(level, first) if len(first) else level
    height = (shells.faces[:, :, 2] - grid.lower[2]) / grid.spacing
    low, high = np.full(len(shells.fill), np.inf), np.full(len(shells.fill), -np.inf)
    np.minimum.at(low, shells.of_face, height.min(axis=1))
    np.maximum.at(high, shells.of_face, height.max(axis=1))
    normal = area_normals(shells.faces)
    size = np.linalg.norm(normal, axis=1)
    walled = np.zeros(len(shells.fill), bool)
    walled[shells.of_face[(size > 0.0) & (np.abs(normal[:, 2]) <= _UPRIGHT * size)]] = True
    open_above = walled[shell] & (level <= low[shell] + _ROOFLESS / grid.spacing)
    return column[open_above], high[shell[open_above]]


def _bodies(shells: Shells, grid: Grid) -> Volume:
    """Shells where they are: their faces, and within those that close."""
    closed = np.flatnonzero(shells.fill[shells.of_bound] == Fill.INSIDE)
    return np.asarray(voxels_touched(shells.faces, grid) | wound(shells.bounds[closed], shells.of_bound[closed], grid))


def _terrain(found: Footprints, grid: Grid, floors: tuple[Levels, Levels]) -> Int64[np.ndarray, "nx ny"]:
    """Voxel of the terrain in each column: the file's, else the lowest floor's there, else that of the nearest."""
    nx, ny, nz = grid.shape
    if len(found.terrain):
        level = _highest(found.terrain, grid)
        known = np.where(np.isfinite(level), np.clip(np.floor(level + _TOUCH), -1, nz), NONE)
        return from_nearest(known.astype(np.int64).reshape(nx, ny))
    lowest = np.full(nx * ny, nz + 1)
    np.minimum.at(lowest, *floors)
    return from_nearest(np.where(lowest > nz, NONE, lowest).reshape(nx, ny))


def _highest(triangles: Triangles, grid: Grid) -> Float[np.ndarray, " n"]:
    """Highest point of triangles in each column [voxels]; -inf without."""
    top = np.full(grid.shape[0] * grid.shape[1], -np.inf)
    for column, _, _, high in column_spans(triangles, grid):
        np.maximum.at(top, column, high)
    return top


def _floor(level: Float[np.ndarray, " n"], grid: Grid) -> Levels:
    """The voxel that a floor lies in, -1 and nz beyond the grid."""
    found: Levels = np.clip(np.floor(level + _TOUCH), -1, grid.shape[2]).astype(np.int64)
    return found


def _roof(level: Float[np.ndarray, " n"], grid: Grid) -> Levels:
    """The highest voxel that is below a roof, -1 beyond the grid."""
    found: Levels = np.clip(np.ceil(level - _TOUCH) - 1, -1, grid.shape[2] - 1).astype(np.int64)
    return found
