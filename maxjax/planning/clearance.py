"""The exact least distance from paths to occupied voxels, in float64 NumPy.

Coordinates are index coordinates u, in which voxel i is the closed cube [i, i + 1]. A path is a set of segments
u(t) = a + t d, t ∈ [0, 1]; its clearance is the least distance from any of them to any occupied cube. The squared
distance from u(t) to a cube,

    Σ over the axes of max(lower − u, 0, u − upper)²,

is convex in t, and quadratic between the at most six t at which a coordinate meets lower or upper. Its derivative
rises linearly between these, so that its root is found without iteration.

Which cubes are measured: the distance from a segment's bounding box to a cube is a lower bound of its distance to the
cube. Segments are cut into short pieces, whose boxes they nearly fill, and windows around them are searched first. Only
where these hold nothing is the whole map searched, in tiles of 4 × 4 × 4 voxels, nearest first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64, Integer
from numpy.lib.stride_tricks import as_strided

_PIECE = 4.0  # longest piece of a segment [voxels]
_REACHES = (2.0, 4.0, 8.0)  # half widths of the windows that are tried before the whole map is searched [voxels]
_TILE = 4  # edge of the tiles in which the whole map is searched: the bytes of one 32-bit number
_CELLS = np.stack(np.unravel_index(np.arange(_TILE**3), (_TILE,) * 3), axis=-1)
_SLACK = 1e-6  # more than rounding adds to a squared distance [voxels²]


class _Pieces(NamedTuple):
    """Segments in pieces start + t step, t ∈ [0, 1], with their bounding boxes from `lower` to `upper`."""

    path: Int64[np.ndarray, " k"]
    map: Int64[np.ndarray, " k"]
    start: Float64[np.ndarray, "k 3"]
    step: Float64[np.ndarray, "k 3"]
    lower: Float64[np.ndarray, "k 3"]
    upper: Float64[np.ndarray, "k 3"]

    def of(self, some: Bool[np.ndarray, " k"]) -> _Pieces:
        """Some of the pieces."""
        return _Pieces(*(field[some] for field in self))


def clearances(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    path_of: Int64[np.ndarray, " s"],
    which: Integer[np.ndarray, " p"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
) -> Float64[np.ndarray, " p"]:
    """Least distance [voxels] from each path to the cube of an occupied voxel.

    Args:
        a, d: segments a + t d, t ∈ [0, 1], in index coordinates.
        path_of: path of each segment.
        which: map of each path.
        occupied: voxels from which the distance is measured, for each map.
        ground: voxels of `occupied` from which it is not. None: there are none.

    Returns:
        0 on contact, infinite where a map holds no such voxel, or a path no segment.
    """
    # What a search leaves out is farther than its reach: where it found a nearer voxel, that is the nearest of all.
    squared = np.full(len(which), math.inf)
    pieces = _pieces(a, d, path_of, which[path_of])
    for reach in _REACHES:
        _measure_nearest(squared, pieces, *_around(pieces, occupied, reach, ground))
        pieces = pieces.of(squared[pieces.path] > reach**2)
        if not pieces.path.size:
            break
    else:
        for path in np.unique(pieces.path).tolist():
            own = pieces.of(pieces.path == path)
            seen = own.map[0]
            _search(squared, own, occupied[seen] if ground is None else occupied[seen] & ~ground[seen])
    least: Float64[np.ndarray, " p"] = np.sqrt(squared)
    return least


def _pieces(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    path_of: Int64[np.ndarray, " s"],
    map_of: Integer[np.ndarray, " s"],
) -> _Pieces:
    """The segments a + t d, cut into equal pieces no longer than `_PIECE`."""
    length = np.sqrt(np.add.reduce(d * d, axis=1))
    count = np.maximum(np.ceil(length / _PIECE), 1).astype(np.int64)
    segment = np.repeat(np.arange(len(a)), count)
    k = np.arange(len(segment)) - (np.cumsum(count) - count)[segment]
    step = (d / count[:, None])[segment]
    start = a[segment] + k[:, None] * step
    stop = start + step
    lower, upper = np.minimum(start, stop), np.maximum(start, stop)
    return _Pieces(path_of[segment], map_of[segment], start, step, lower, upper)


def _around(
    pieces: _Pieces,
    occupied: Bool[np.ndarray, "m nx ny nz"],
    reach: float,
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
) -> tuple[Int64[np.ndarray, " c"], Int64[np.ndarray, "c 3"], Float64[np.ndarray, " c"]]:
    """Every pair of a piece and an occupied voxel whose boxes are at most `reach` apart, with the gap squared.

    All pieces look through windows of one size, pushed back into the map where they would leave it.
    """
    shape = np.array(occupied.shape[1:])
    low = np.maximum(np.floor(pieces.lower - reach), 0).astype(np.int64)
    high = np.ceil(pieces.upper + reach).astype(np.int64)
    size = np.minimum(np.maximum.reduce(high - low, initial=1), shape)
    corner = np.minimum(low, shape - size)
    (x, y, z), places = size.tolist(), (shape - size + 1).tolist()

    # Strided views of the map, one a possible corner: indexing them copies a window a piece in one call.
    strides = occupied.strides + occupied.strides[1:]
    windows = as_strided(occupied, (len(occupied), *places, x, y, z), strides, writeable=False)
    seen = np.flatnonzero(windows[pieces.map, corner[:, 0], corner[:, 1], corner[:, 2]])

    # The squared gap is a sum over the axes, of few different numbers: the windows have few columns and layers.
    cells = corner[..., None] + np.arange(max(x, y, z))
    gaps = _squared_gaps(cells, 1, pieces.lower[..., None], pieces.upper[..., None])
    columns = (gaps[:, 0, :x, None] + gaps[:, 1, None, :y]).reshape(-1)
    column = seen // z
    gap = columns[column] + gaps[column // (x * y), 2, seen - z * column]
    near = np.flatnonzero(gap <= reach**2)
    piece, *at = np.unravel_index(seen[near], (len(corner), x, y, z))
    voxels, gap = corner[piece] + np.array(at).T, gap[near]
    if ground is None:
        return piece, voxels, gap
    counts = ~ground[pieces.map[piece], voxels[:, 0], voxels[:, 1], voxels[:, 2]]
    return piece[counts], voxels[counts], gap[counts]


def _measure_nearest(
    squared: Float64[np.ndarray, " p"],
    pieces: _Pieces,
    piece: Int64[np.ndarray, " c"],
    voxels: Int64[np.ndarray, "c 3"],
    gap: Float64[np.ndarray, " c"],
) -> None:
    """Lower each path's least squared distance [voxels²] to that of its nearest pair of a piece and a voxel.

    The pair of least gap is measured for every piece; after that, whatever might be nearer still.
    """
    least = np.full(len(pieces.path), math.inf)
    np.minimum.at(least, piece, gap)
    best, path = gap == least[piece], pieces.path[piece]
    for pairs in (best, ~best):
        some = np.flatnonzero(pairs & (gap <= squared[path] + _SLACK))
        if some.size:
            ends = pieces.start[piece[some]], pieces.step[piece[some]]
            np.minimum.at(squared, path[some], _squared_distance(*ends, voxels[some]))


def _search(squared: Float64[np.ndarray, " p"], pieces: _Pieces, occupied: Bool[np.ndarray, "nx ny nz"]) -> None:
    """`_measure_nearest` in a whole map, for the pieces of one path.

    The tile nearest to every piece is opened; after that, every tile that might hold a nearer voxel still.
    """
    tiles = [-(-n // _TILE) for n in occupied.shape]
    padded = np.zeros([_TILE * n for n in tiles], bool)
    padded[tuple(map(slice, occupied.shape))] = occupied
    held = padded.view(np.uint32)
    held = held[0::4] | held[1::4] | held[2::4] | held[3::4]
    held = held[:, 0::4] | held[:, 1::4] | held[:, 2::4] | held[:, 3::4]
    x, y, z = np.nonzero(held)
    if not x.size:
        return
    cells = _TILE * np.arange(max(tiles))
    gaps = _squared_gaps(cells, _TILE, pieces.lower[..., None], pieces.upper[..., None])
    gap = gaps[:, 0, x] + gaps[:, 1, y] + gaps[:, 2, z]

    def open_tiles(piece: Int64[np.ndarray, " b"], tile: Int64[np.ndarray, " b"]) -> None:
        corner = _TILE * np.array([x[tile], y[tile], z[tile]]).T
        voxels = (corner[:, None] + _CELLS).reshape(-1, 3)
        filled = padded[tuple(voxels.T)]
        piece, voxels = np.repeat(piece, len(_CELLS))[filled], voxels[filled]
        gaps = _squared_gaps(voxels, 1, pieces.lower[piece], pieces.upper[piece])
        _measure_nearest(squared, pieces, piece, voxels, np.add.reduce(gaps, axis=1))

    open_tiles(np.arange(len(gap)), gap.argmin(axis=1))
    open_tiles(*np.nonzero(gap <= squared[pieces.path[0]] + _SLACK))


def _squared_gaps(
    box: Int64[np.ndarray, "*#k"], size: int, lower: Float64[np.ndarray, "*#k"], upper: Float64[np.ndarray, "*#k"]
) -> Float64[np.ndarray, "*k"]:
    """Squared gap, axis by axis, between boxes `size` voxels wide that begin at a voxel and those of pieces."""
    gap = np.maximum(np.maximum(box - upper, lower - (box + size)), 0.0)
    squared: Float64[np.ndarray, "*k"] = gap * gap
    return squared


def _squared_distance(
    a: Float64[np.ndarray, "k 3"], d: Float64[np.ndarray, "k 3"], voxel: Int64[np.ndarray, "k 3"]
) -> Float64[np.ndarray, " k"]:
    """Squared distance [voxels²] from the segment a + t d, t ∈ [0, 1], to the closed cube of the voxel."""
    faces = voxel[:, None] + np.array([[0.0], [1.0]])
    t = np.zeros((len(a), 8))
    t[:, 7] = 1.0
    kinks = (faces - a[:, None]) / np.where(d == 0, 1.0, d)[:, None]
    t[:, 1:7] = np.minimum(np.maximum(kinks, 0.0), 1.0).reshape(len(a), 6)
    t.sort(axis=1)

    def outside(t: Float64[np.ndarray, "k m"]) -> Float64[np.ndarray, "k m 3"]:
        """Vector from the cube to the points at `t`."""
        u = a[:, None] + t[..., None] * d[:, None]
        vector: Float64[np.ndarray, "k m 3"] = u - np.minimum(np.maximum(u, faces[:, :1]), faces[:, 1:])
        return vector

    # Half the derivative rises with t, linearly between neighbours: find where it passes through zero.
    slope = np.einsum("kmi,ki->km", outside(t), d)
    right = np.minimum(np.maximum(np.add.reduce(slope < 0, axis=1), 1), 7)
    row = np.arange(len(a))
    t_0, t_1, slope_0, slope_1 = t[row, right - 1], t[row, right], slope[row, right - 1], slope[row, right]
    rise = slope_1 - slope_0
    weight = np.where(rise > 0, -slope_0 / np.where(rise > 0, rise, 1.0), 0.0)
    best = outside((t_0 + np.minimum(np.maximum(weight, 0.0), 1.0) * (t_1 - t_0))[:, None])[:, 0]
    squared: Float64[np.ndarray, " k"] = np.einsum("ki,ki->k", best, best)
    return squared
