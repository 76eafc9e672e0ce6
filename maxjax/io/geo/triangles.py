"""Triangles on a grid: every voxel that one touches, and every voxel inside closed bodies.

    touched:  triangle ∩ voxel ≠ ∅, the voxel's cube closed
    inside:   the line along z through the voxel's centre crosses the body an odd number of times below it

*Touched* is found by cutting, not by sampling. A triangle cut to a slab of voxels is convex, so what it covers of the
next axis is an interval, its ends among the ends of the cut edges. Slab by slab (first axis), column by column (second)
the interval on the third remains, and it meets exactly the voxels between its ends. The third axis is the one that the
normal leans to most: the interval is then short, and work is linear in triangles and touched voxels.

*Inside* is even-odd along columns, each body by itself, so that it holds whatever way its faces are turned and where
bodies overlap. Shared edges are computed from the same numbers in the same order: a column meets one of the two faces.
A voxel that nothing touches lies inside or outside as a whole, so its centre speaks for it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from maxjax.core.grid import Grid

Triangles = Float[np.ndarray, "t 3 3"]
Volume = Bool[np.ndarray, "nx ny nz"]

_TOUCH = 1e-6  # a cube grown by so much counts as touched [voxels]; rounding stays far below
_CHUNK = 2**16  # cells at a time: some 50 MB
_SLAB = 2**24  # voxels filled at a time
_EDGES = ((0, 1), (1, 2), (2, 0))


def area_normals(triangles: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3"]:
    """Twice the areas of triangles, as vectors along their normals."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def voxels_touched(triangles: Triangles, grid: Grid) -> Volume:
    """Voxels whose closed cube a triangle meets, exactly up to a millionth of a voxel outwards.

    Args:
        triangles: corners [m], finite; flat ones (segments, points) count as what they are.
        grid: any.
    """
    occupied = np.zeros(grid.shape, bool)
    corners = _indexed(triangles, grid)
    low, high = np.floor(corners.min(axis=1) - _TOUCH), np.floor(corners.max(axis=1) + _TOUCH)
    small = np.all((low == high) & (low >= 0) & (low < grid.shape), axis=1)
    occupied[tuple(low[small].astype(np.int64).T)] = True
    corners = corners[~small]
    normal = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    leaning = normal.argmax(axis=1) if len(normal) else np.zeros(0, int)
    with np.errstate(over="ignore"):  # of edges almost along a slab
        for depth in range(3):
            order = [axis for axis in range(3) if axis != depth] + [depth]
            _mark(corners[leaning == depth][:, :, order], occupied.transpose(order))
    return occupied


def voxels_enclosed(triangles: Triangles, body: Int[np.ndarray, " t"], grid: Grid) -> Volume:
    """Voxels whose centre lies inside a body.

    Args:
        triangles: corners [m], finite; corners of neighbours are equal bit by bit.
        body: number of the body that each triangle belongs to. Each is closed: every edge in an even number of faces.
        grid: any.
    """
    corners = (triangles - np.array(grid.lower)) / grid.spacing
    nx, ny, nz = grid.shape
    column, height, owner = _crossings(corners, body, (nx, ny))
    order = np.lexsort((height, owner, column))
    column, height, owner = column[order], height[order], owner[order]
    starts = np.flatnonzero(np.r_[True, (column[1:] != column[:-1]) | (owner[1:] != owner[:-1])])[: len(column)]
    counts = np.diff(np.r_[starts, len(column)])
    within = np.arange(len(column)) - np.repeat(starts, counts)
    low = np.flatnonzero((within % 2 == 0) & (within + 1 < np.repeat(counts, counts)))
    first = np.clip(np.ceil(height[low] - 0.5), 0, nz).astype(np.int64)
    last = np.clip(np.floor(height[low + 1] - 0.5), -1, nz - 1).astype(np.int64)
    return fill_columns(column[low], first, last, grid.shape)


def wound(triangles: Triangles, body: Int[np.ndarray, " t"], grid: Grid) -> Volume:
    """Voxels whose centre lies inside a body, or that its faces surround more than once.

    As `voxels_enclosed`, but faces that overlap (a body listed twice, parts that cut each other) leave no hole: a line
    along z is free between two crossings only where both their number below and the sum of their directions say so.

    Args:
        triangles: corners [m], finite; corners of neighbours are equal bit by bit.
        body: number of the body that each triangle belongs to; closed.
        grid: any.
    """
    corners = (triangles - np.array(grid.lower)) / grid.spacing
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turn = np.sign(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]).astype(np.int64)
    nx, ny, nz = grid.shape
    column, height, face = _crossings(corners, np.arange(len(corners)), (nx, ny))
    order = np.lexsort((height, body[face], column))
    column, height, face = column[order], height[order], face[order]
    owner, direction = body[face], turn[face]
    starts = np.flatnonzero(np.r_[True, (column[1:] != column[:-1]) | (owner[1:] != owner[:-1])])[: len(column)]
    counts = np.diff(np.r_[starts, len(column)])
    within = np.arange(len(column)) - np.repeat(starts, counts)
    total = np.cumsum(direction)
    winding = total - np.repeat(total[starts] - direction[starts], counts)
    low = np.flatnonzero(((within % 2 == 0) | (winding != 0)) & (within + 1 < np.repeat(counts, counts)))
    first = np.clip(np.ceil(height[low] - 0.5), 0, nz).astype(np.int64)
    last = np.clip(np.floor(height[low + 1] - 0.5), -1, nz - 1).astype(np.int64)
    return fill_columns(column[low], first, last, grid.shape)


def column_spans(
    triangles: Triangles, grid: Grid
) -> Iterator[
    tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]
]:
    """Columns whose closed square a triangle meets, seen from above, however high it lies.

    Args:
        triangles: corners [m], finite; flat and upright ones count as what they are.
        grid: whose columns.

    Yields:
        Column, x · ny + y; triangle; and its lowest and highest point in the column [voxels from the grid's floor].
    """
    nx, ny, _ = grid.shape
    corners = (triangles - np.array(grid.lower)) / grid.spacing
    flat = corners[:, :, :2]
    near = np.flatnonzero(
        ((flat.max(axis=1) >= -_TOUCH) & (flat.min(axis=1) <= np.array((nx, ny)) + _TOUCH)).all(axis=1)
    )
    corners = corners[near]
    low, high = whole(corners[:, :, 0].min(axis=1, initial=np.inf), corners[:, :, 0].max(axis=1, initial=-np.inf), nx)
    for one, row in spread(low, high):
        across = _span(corners[one], *_cut(corners[one], ((0, row),)), 1)
        for pair, column in spread(*whole(*across, ny)):
            chosen = one[pair]
            bottom, top = _depth(corners[chosen], row[pair], column)
            held = bottom <= top
            yield row[pair][held] * ny + column[held], near[chosen[held]], bottom[held], top[held]


def crests(triangles: Triangles, grid: Grid) -> Float[np.ndarray, "nx ny"]:
    """Height of triangles over the centre of each column [m], of the highest there; NaN where none lies.

    Args:
        triangles: corners [m], finite; upright ones have no height.
        grid: any.
    """
    nx, ny, _ = grid.shape
    corners = (triangles - np.array(grid.lower)) / grid.spacing
    column, height, _owner = _crossings(corners, np.zeros(len(corners), np.int64), (nx, ny))
    highest = np.full(nx * ny, -np.inf)
    np.maximum.at(highest, column, height)
    found: Float[np.ndarray, "nx ny"] = np.where(np.isinf(highest), np.nan, grid.lower[2] + grid.spacing * highest)
    return found.reshape(nx, ny)


def fill_columns(
    column: Int64[np.ndarray, " n"],
    first: Int64[np.ndarray, " n"],
    last: Int64[np.ndarray, " n"],
    shape: tuple[int, int, int],
) -> Volume:
    """Voxels from `first` to `last` of columns x · ny + y, both included; intervals with last < first are empty."""
    nx, ny, nz = shape
    inside = np.zeros((nx * ny, nz), bool)
    held = first <= last
    order = np.argsort(column[held], kind="stable")
    column, first, last = (one[held][order] for one in (column, first, last))
    step = max(1, _SLAB // nz)
    for begin in range(0, nx * ny, step):
        end = min(begin + step, nx * ny)
        part = slice(*np.searchsorted(column, (begin, end)))
        change = np.zeros((end - begin, nz + 1), np.int32)
        np.add.at(change, (column[part] - begin, first[part]), 1)
        np.add.at(change, (column[part] - begin, last[part] + 1), -1)
        inside[begin:end] = np.cumsum(change, axis=1)[:, :nz] > 0
    return inside.reshape(shape)


def _indexed(triangles: Triangles, grid: Grid) -> Float[np.ndarray, "near 3 3"]:
    """Triangles near the grid, in voxels from its lowest corner."""
    corners = (triangles - np.array(grid.lower)) / grid.spacing
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    near = np.all((high >= -_TOUCH) & (low <= np.array(grid.shape) + _TOUCH), axis=1)
    return np.asarray(corners[near])


def _mark(corners: Triangles, occupied: Volume) -> None:
    """Set the voxels that triangles touch; the third axis is that of their normals."""
    rows, columns, depths = occupied.shape
    low, high = whole(corners[:, :, 0].min(axis=1, initial=np.inf), corners[:, :, 0].max(axis=1, initial=-np.inf), rows)
    for one, row in spread(low, high):
        triangle = corners[one]
        start, stop = _cut(triangle, ((0, row),))
        across = _span(triangle, start, stop, 1)
        for pair, column in spread(*whole(*across, columns)):
            first, last = whole(*_depth(triangle[pair], row[pair], column), depths)
            for k in range(int((last - first).max(initial=-1)) + 1):
                reached = first + k <= last
                occupied[row[pair][reached], column[reached], first[reached] + k] = True


def _depth(
    triangle: Float[np.ndarray, "n 3 3"], row: Int64[np.ndarray, " n"], column: Int64[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The span of a triangle on the third axis above one cell of the first two: at its edges and the cell's corners."""
    low, high = _span(triangle, *_cut(triangle, ((0, row), (1, column))), 2)
    a, b, c = triangle[:, 0], triangle[:, 1], triangle[:, 2]
    normal = np.cross(b - a, c - a)
    flat = normal[:, 2] == 0
    scale = np.where(flat, 1.0, normal[:, 2])
    turn = np.sign(normal[:, 2])
    for i in (0, 1):
        for j in (0, 1):
            x, y = row + i, column + j
            inside = ~flat
            for p, q in ((a, b), (b, c), (c, a)):
                inside &= turn * ((q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])) >= 0
            z = a[:, 2] - (normal[:, 0] * (x - a[:, 0]) + normal[:, 1] * (y - a[:, 1])) / scale
            low, high = np.where(inside, np.minimum(low, z), low), np.where(inside, np.maximum(high, z), high)
    return low, high


def _cut(
    triangle: Float[np.ndarray, "n 3 3"], slabs: tuple[tuple[int, Int64[np.ndarray, " n"]], ...]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Between which parameters (0 to 1) each edge lies in slabs of voxels across axes; start > stop where nowhere."""
    start, stop = np.zeros((len(triangle), 3)), np.ones((len(triangle), 3))
    for axis, index in slabs:
        lower, upper = index - _TOUCH, index + 1 + _TOUCH
        for edge, (i, j) in enumerate(_EDGES):
            p, d = triangle[:, i, axis], triangle[:, j, axis] - triangle[:, i, axis]
            level = d == 0
            slope = np.where(level, 1.0, d)
            t, u = (lower - p) / slope, (upper - p) / slope
            outside = level & ((p < lower) | (p > upper))
            start[:, edge] = np.maximum(start[:, edge], np.where(level, np.where(outside, 2.0, 0.0), np.minimum(t, u)))
            stop[:, edge] = np.minimum(stop[:, edge], np.where(level, 1.0, np.maximum(t, u)))
    return start, stop


def _span(
    triangle: Float[np.ndarray, "n 3 3"], start: Float[np.ndarray, "n 3"], stop: Float[np.ndarray, "n 3"], axis: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Least and greatest coordinate of the edges between two parameters; (inf, -inf) where there is none."""
    low, high = np.full(len(triangle), np.inf), np.full(len(triangle), -np.inf)
    for edge, (i, j) in enumerate(_EDGES):
        p, d = triangle[:, i, axis], triangle[:, j, axis] - triangle[:, i, axis]
        held = start[:, edge] <= stop[:, edge]
        for t in (start[:, edge], stop[:, edge]):
            value = p + np.where(held, t, 0.0) * d
            low, high = np.where(held, np.minimum(low, value), low), np.where(held, np.maximum(high, value), high)
    return low, high


def whole(
    low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"], count: int
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """First and last voxel that intervals touch, within the grid; last < first for an empty one."""
    first = np.clip(np.floor(low - _TOUCH), 0, count).astype(np.int64)
    last = np.clip(np.floor(high + _TOUCH), -1, count - 1).astype(np.int64)
    return first, last


def spread(
    first: Int64[np.ndarray, " n"], last: Int64[np.ndarray, " n"]
) -> Iterator[tuple[Int64[np.ndarray, " m"], Int64[np.ndarray, " m"]]]:
    """Every whole number from first to last with the index of its interval, so many at a time."""
    total = np.r_[0, np.cumsum(np.maximum(last - first + 1, 0))]
    for begin in range(0, int(total[-1]), _CHUNK):
        number = np.arange(begin, min(begin + _CHUNK, int(total[-1])))
        one = np.searchsorted(total, number, side="right") - 1
        yield one, first[one] + number - total[one]


def _crossings(
    corners: Triangles, body: Int[np.ndarray, " t"], shape: tuple[int, int]
) -> tuple[Int64[np.ndarray, " n"], Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Where the lines along z through the centres of columns cross triangles: column, height and body."""
    columns: list[np.ndarray] = [np.zeros(0, np.int64)]
    heights: list[np.ndarray] = [np.zeros(0)]
    owners: list[np.ndarray] = [body[:0]]
    nx, ny = shape
    x = corners[:, :, 0]
    first = np.clip(np.ceil(x.min(axis=1, initial=np.inf) - 0.5), 0, nx).astype(np.int64)
    last = np.clip(np.floor(x.max(axis=1, initial=-np.inf) - 0.5), -1, nx - 1).astype(np.int64)
    for one, row in spread(first, last):
        near, far = _at(corners[one], row + 0.5)
        swapped = near[:, :1] > far[:, :1]
        near, far = np.where(swapped, far, near), np.where(swapped, near, far)
        # Centres beyond `near`, up to and with `far`; NaN where the line meets a corner only.
        low, high = np.floor(near[:, 0] - 0.5) + 1, np.floor(far[:, 0] - 0.5)
        low, high = np.where(np.isnan(low), 0, low), np.where(np.isnan(high), -1, high)
        for pair, column in spread(np.clip(low, 0, ny).astype(np.int64), np.clip(high, -1, ny - 1).astype(np.int64)):
            p, q = near[pair], far[pair]
            share = (column + 0.5 - p[:, 0]) / (q[:, 0] - p[:, 0])
            columns.append(row[pair] * ny + column)
            heights.append(p[:, 1] + share * (q[:, 1] - p[:, 1]))
            owners.append(body[one[pair]])
    return np.concatenate(columns), np.concatenate(heights), np.concatenate(owners)


def _at(
    triangle: Float[np.ndarray, "n 3 3"], x: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """Where the outline of each triangle crosses a plane across the first axis: two points (y, z), or NaN."""
    near, far = np.full((len(x), 2), np.nan), np.full((len(x), 2), np.nan)
    for i, j in _EDGES:
        a, b = triangle[:, i], triangle[:, j]
        # Always from west to east: the two faces of an edge get the same point, bit by bit.
        turned = a[:, :1] > b[:, :1]
        a, b = np.where(turned, b, a), np.where(turned, a, b)
        crossed = (a[:, 0] <= x) & (b[:, 0] > x)
        share = (x - a[:, 0]) / np.where(crossed, b[:, 0] - a[:, 0], 1.0)
        point = a[:, 1:] + share[:, None] * (b[:, 1:] - a[:, 1:])
        taken = ~np.isnan(near[:, 0])
        far = np.where((crossed & taken)[:, None], point, far)
        near = np.where((crossed & ~taken)[:, None], point, near)
    return near, far
