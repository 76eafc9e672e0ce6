"""Footprints on a grid: upright prisms over the ground.

    solid  = columns whose square touches the footprint × heights from base to top
    ground = { voxels up to the terrain }

A square touches a footprint if an edge of its outline touches the square, or if its centre lies inside (even-odd over
all rings). The terrain is the file's; where it has none, it is level with the lowest floor in the column or, between
buildings, in the nearest one. Buildings reach down to it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int, Int64

from maxjax.core.grid import Grid
from maxjax.maps.airborne import NONE, from_nearest
from maxjax.maps.footprints import Footprints
from maxjax.maps.triangles import Volume, fill_columns, spread, touched, whole

# Columns, x · ny + y, and what each belongs to.
Columns = tuple[Int64[np.ndarray, " _"], Int64[np.ndarray, " _"]]

_MOST = 50_000_000  # pairs of a column and an owner: ten times the columns of the largest map; 2 GB

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


def columns_of(
    rings: Sequence[Float[np.ndarray, "_ 2"]], owner: Int64[np.ndarray, " r"], grid: Grid
) -> tuple[Columns, Columns]:
    """Columns whose closed square an edge of some outlines touches, and those whose centre lies inside.

    Args:
        rings: outlines and holes [m], last point not repeated; inside is where an odd number of an owner's surround.
        owner: of each.
        grid: whose columns.

    Returns:
        (touched, inner), pairs of a column, x · ny + y, and an owner; a pair may occur twice.

    Raises:
        ValueError: for outlines that overlap so often that there are more than 50 million pairs.
    """
    lower, shape = np.array(grid.lower)[:2], grid.shape[:2]
    edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
    of_edge = np.repeat(owner, [len(edge) for edge in edges]).astype(np.int64)
    ends = (np.concatenate([np.zeros((0, 2, 2)), *edges]) - lower) / grid.spacing
    return _collected(_touched(ends, of_edge, shape)), _collected(_inner(ends, of_edge, shape))


def _collected(parts: Iterator[Columns]) -> Columns:
    """All parts as one; raises a `ValueError` before they are too many."""
    found, count = [(np.zeros(0, np.int64), np.zeros(0, np.int64))], 0
    for part in parts:
        found.append(part)
        count += len(part[0])
        if count > _MOST:
            raise ValueError(
                f"outlines: expected at most {_MOST} columns in all of them, found more; they overlap very often: "
                "crop the map, or give a larger spacing"
            )
    columns, owners = zip(*found, strict=True)
    return np.concatenate(columns), np.concatenate(owners)


def _touched(
    ends: Float[np.ndarray, "e 2 2"], owner: Int64[np.ndarray, " e"], shape: tuple[int, int]
) -> Iterator[Columns]:
    """As `columns_of`, of edges [columns] and the owner of each."""
    nx, ny = shape
    west, east = ends[:, :, 0].min(axis=1, initial=np.inf), ends[:, :, 0].max(axis=1, initial=-np.inf)
    for edge, row in spread(*whole(west, east, nx)):
        a, b = ends[edge, 0], ends[edge, 1]
        level = a[:, 0] == b[:, 0]
        run = np.where(level, 1.0, b[:, 0] - a[:, 0])
        at = [np.where(level, t, np.clip((row + t - a[:, 0]) / run, 0.0, 1.0)) for t in (0, 1)]
        y = [a[:, 1] + t * (b[:, 1] - a[:, 1]) for t in at]
        for pair, column in spread(*whole(np.minimum(*y), np.maximum(*y), ny)):
            yield row[pair] * ny + column, owner[edge[pair]]


def _inner(
    ends: Float[np.ndarray, "e 2 2"], owner: Int64[np.ndarray, " e"], shape: tuple[int, int]
) -> Iterator[Columns]:
    """As `columns_of`, of edges [columns] and the owner of each."""
    nx, ny = shape
    line, place, of = _crossings(ends, owner, nx)
    order = np.lexsort((place, of, line))
    line, place, of = line[order][::2], place[order], of[order][::2]
    first = np.clip(np.ceil(place[::2] - 0.5), 0, ny).astype(np.int64)
    last = np.clip(np.floor(place[1::2] - 0.5), -1, ny - 1).astype(np.int64)
    for pair, column in spread(first, last):
        yield line[pair] * ny + column, of[pair]


def _crossings(
    ends: Float[np.ndarray, "e 2 2"], owner: Int64[np.ndarray, " e"], count: int
) -> tuple[Int64[np.ndarray, " n"], Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Where lines through the centres of columns cross edges: the line, the place along it, the footprint."""
    lines, places, owners = [np.zeros(0, np.int64)], [np.zeros(0)], [owner[:0]]
    west, east = ends[:, :, 0].min(axis=1, initial=np.inf), ends[:, :, 0].max(axis=1, initial=-np.inf)
    # A line meets the western end of an edge, and not its eastern one: every outline an even number of times.
    first = np.clip(np.ceil(west - 0.5), 0, count).astype(np.int64)
    last = np.clip(np.ceil(east - 0.5) - 1, -1, count - 1).astype(np.int64)
    for edge, line in spread(first, last):
        a, b = ends[edge, 0], ends[edge, 1]
        lines.append(line)
        places.append(a[:, 1] + (line + 0.5 - a[:, 0]) / (b[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]))
        owners.append(owner[edge])
    return np.concatenate(lines), np.concatenate(places), np.concatenate(owners)
