"""Outlines on a grid: the columns of voxels that they touch, and those inside.

A column is touched if an edge of the outline touches its closed square; it is inner if its centre lies inside, by the
even-odd rule over all rings of an owner.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int, Int64

from maxjax.core.grid import Grid
from maxjax.io.geo.triangles import spread, whole

# An outline or a hole, last point not repeated [m].
Ring = Float[np.ndarray, "_ 2"]
# Columns, x · ny + y, and what each belongs to.
Columns = tuple[Int64[np.ndarray, " _"], Int64[np.ndarray, " _"]]

_MOST = 50_000_000  # pairs of a column and an owner: ten times the columns of the largest map; 2 GB


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
    low, high = lower - grid.spacing, np.array(grid.upper)[:2] + grid.spacing
    meets = [bool((ring.max(axis=0) >= low).all() and (ring.min(axis=0) <= high).all()) for ring in rings]
    near = [k for k, met in enumerate(meets) if met]
    edges = [np.stack([rings[k], np.concatenate([rings[k][1:], rings[k][:1]])], axis=1) for k in near]
    of_edge = np.repeat(owner[near], [len(edge) for edge in edges]).astype(np.int64)
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
