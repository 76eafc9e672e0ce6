"""The exact least distance from paths to occupied voxels, and where it is least, in float64 NumPy.

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

from maxjax.verification.exempt_parts import ZONES, Parts, dot

_PIECE = 4.0  # longest piece of a segment [voxels]
_REACHES = (2.0, 4.0, 8.0, 16.0, 32.0)  # half widths of the windows that are tried, as long as they are small [voxels]
_TILE = 4  # edge of the tiles in which the whole map is searched: the bytes of one 32-bit number
_CELLS = np.stack(np.unravel_index(np.arange(_TILE**3), (_TILE,) * 3), axis=-1)
_SLACK = 1e-6  # more than rounding adds to a squared distance [voxels²]


class _Pieces(NamedTuple):
    """Parts in pieces start + t step, t ∈ [0, 1], with their bounding boxes from `lower` to `upper`.

    `zone` counts the zones of all paths, path after path.
    """

    zone: Int64[np.ndarray, " k"]
    map: Int64[np.ndarray, " k"]
    start: Float64[np.ndarray, "k 3"]
    step: Float64[np.ndarray, "k 3"]
    lower: Float64[np.ndarray, "k 3"]
    upper: Float64[np.ndarray, "k 3"]

    def of(self, some: Bool[np.ndarray, " k"]) -> _Pieces:
        """Some of the pieces."""
        return _Pieces(*(field[some] for field in self))


class _Nearest(NamedTuple):
    """Each zone of each path: its least squared distance so far [voxels²], and a point that has it.

    Zones stand in one row, path after path, as `_Pieces.zone` counts them.
    """

    squared: Float64[np.ndarray, " pz"]
    point: Float64[np.ndarray, "pz 3"]
    zones: int

    def lower(
        self, zone: Int64[np.ndarray, " c"], squared: Float64[np.ndarray, " c"], point: Float64[np.ndarray, "c 3"]
    ) -> None:
        """Take in further points."""
        np.minimum.at(self.squared, zone, squared)
        least = squared == self.squared[zone]
        self.point[zone[least]] = point[least]

    @property
    def bounds(self) -> Float64[np.ndarray, " pz"]:
        """The least of a zone and all above it: what has no smaller distance counts no longer."""
        ends = self.squared.reshape(-1, self.zones)[:, ::-1]
        bounds: Float64[np.ndarray, " pz"] = np.minimum.accumulate(ends, axis=1)[:, ::-1].reshape(-1)
        return bounds


def clearances(
    parts: Parts,
    path_of: Int64[np.ndarray, " k"],
    which: Integer[np.ndarray, " p"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
) -> tuple[Float64[np.ndarray, "p z"], Float64[np.ndarray, "p z 3"]]:
    """Least distance [voxels] to the cube of an occupied voxel from each path, each zone and all above it.

    Args:
        parts: of the paths, in index coordinates.
        path_of: path of each part.
        which: map of each path.
        occupied: voxels from which the distance is measured, for each map.
        ground: voxels of `occupied` from which it is not. None: there are none.

    Returns:
        The distances, 0 on contact, infinite where a map holds no such voxel, or a path no such part; and for each a
        point of the path that has it, NaN where it is infinite.
    """
    # What a search leaves out is farther than its reach: where it found a nearer voxel, that is the nearest of all.
    count = ZONES * len(which)
    nearest = _Nearest(np.full(count, math.inf), np.full((count, 3), math.nan), ZONES)
    pieces = _pieces(parts, path_of, which)
    for reach in _REACHES:
        if not _small(reach, pieces, occupied):
            continue
        _measure_nearest(nearest, pieces, *_around(pieces, occupied, reach, ground))
        pieces = pieces.of(nearest.bounds[pieces.zone] > reach**2)
        if not pieces.zone.size:
            break
    else:
        for seen in np.unique(pieces.map).tolist():
            held = occupied[seen] if ground is None else occupied[seen] & ~ground[seen]
            _search(nearest, pieces.of(pieces.map == seen), held)
    squared, point = nearest.squared.reshape(-1, ZONES), nearest.point.reshape(-1, ZONES, 3)
    for zone in range(ZONES - 1, 0, -1):
        above = squared[:, zone] < squared[:, zone - 1]
        squared[above, zone - 1], point[above, zone - 1] = squared[above, zone], point[above, zone]
    return np.sqrt(squared), point


def distances_at(
    points: Float64[np.ndarray, "n 3"],
    map_of: Integer[np.ndarray, " n"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
) -> Float64[np.ndarray, " n"]:
    """Distance [voxels] to the cube of an occupied voxel from each point, in index coordinates; else as `clearances`.

    The box around a point is the point: the gap is the distance.
    """
    nothing, row = np.zeros_like(points), np.arange(len(points))
    pieces = _Pieces(row, map_of.astype(np.int64), points, nothing, points, points)
    squared = np.full(len(points), math.inf)
    for reach in _REACHES[1:]:
        if not _small(reach, pieces, occupied):
            continue
        piece, _, gap = _around(pieces, occupied, reach, ground)
        np.minimum.at(squared, pieces.zone[piece], gap)
        pieces = pieces.of(squared[pieces.zone] > reach**2)
        if not pieces.zone.size:
            break
    else:
        nearest = _Nearest(squared, np.full(points.shape, math.nan), 1)
        for seen in np.unique(pieces.map).tolist():
            held = occupied[seen] if ground is None else occupied[seen] & ~ground[seen]
            _search(nearest, pieces.of(pieces.map == seen), held)
    least: Float64[np.ndarray, " n"] = np.sqrt(squared)
    return least


def _small(reach: float, pieces: _Pieces, occupied: Bool[np.ndarray, "m nx ny nz"]) -> bool:
    """Whether windows of this half width together are no larger than a map; narrow ones always count as small."""
    return reach <= 8 or len(pieces.zone) * (2 * reach + _PIECE) ** 3 <= occupied[0].size


def _pieces(parts: Parts, path_of: Int64[np.ndarray, " k"], which: Integer[np.ndarray, " p"]) -> _Pieces:
    """The parts of paths, cut into equal pieces no longer than `_PIECE`."""
    a, d = parts.start, parts.step
    length = np.sqrt(dot(d, d))
    count = np.maximum(np.ceil(length / _PIECE), 1).astype(np.int64)
    segment = np.repeat(np.arange(len(a)), count)
    k = np.arange(len(segment)) - (np.cumsum(count) - count)[segment]
    step = (d / count[:, None])[segment]
    start = a[segment] + k[:, None] * step
    stop = start + step
    lower, upper = np.minimum(start, stop), np.maximum(start, stop)
    path = path_of[segment]
    return _Pieces(ZONES * path + parts.zone[segment], which[path].astype(np.int64), start, step, lower, upper)


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

    def seen_in(volumes: Bool[np.ndarray, "m nx ny nz"]) -> Bool[np.ndarray, "k x y z"]:
        # Strided views of the map, one a possible corner: indexing them copies a window a piece in one call.
        strides = volumes.strides + volumes.strides[1:]
        windows = as_strided(volumes, (len(volumes), *places, x, y, z), strides, writeable=False)
        shown: Bool[np.ndarray, "k x y z"] = windows[pieces.map, corner[:, 0], corner[:, 1], corner[:, 2]]
        return shown

    held = seen_in(occupied)
    seen = np.flatnonzero(held if ground is None else held & ~seen_in(ground))

    # The squared gap is a sum over the axes, of few different numbers: the windows have few columns and layers.
    cells = corner[..., None] + np.arange(max(x, y, z))
    gaps = _squared_gaps(cells, 1, pieces.lower[..., None], pieces.upper[..., None])
    columns = (gaps[:, 0, :x, None] + gaps[:, 1, None, :y]).reshape(-1)
    column = seen // z
    gap = columns[column] + gaps[column // (x * y), 2, seen - z * column]
    near = np.flatnonzero(gap <= reach**2)
    piece, *at = np.unravel_index(seen[near], (len(corner), x, y, z))
    return piece, corner[piece] + np.array(at).T, gap[near]


def _measure_nearest(
    nearest: _Nearest,
    pieces: _Pieces,
    piece: Int64[np.ndarray, " c"],
    voxels: Int64[np.ndarray, "c 3"],
    gap: Float64[np.ndarray, " c"],
) -> None:
    """Lower what is known of the pieces' paths to their nearest pairs of a piece and a voxel.

    The pair of least gap is measured for every piece; after that, whatever might be nearer still.
    """
    least = np.full(len(pieces.zone), math.inf)
    np.minimum.at(least, piece, gap)
    best, zone = gap == least[piece], pieces.zone[piece]
    for pairs in (best, ~best):
        some = np.flatnonzero(pairs & (gap <= nearest.bounds[zone] + _SLACK))
        if some.size:
            ends = pieces.start[piece[some]], pieces.step[piece[some]]
            nearest.lower(zone[some], *_squared_distance(*ends, voxels[some]))


def _search(nearest: _Nearest, pieces: _Pieces, occupied: Bool[np.ndarray, "nx ny nz"]) -> None:
    """`_measure_nearest` in a whole map, for the pieces in it.

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
        _measure_nearest(nearest, pieces, piece, voxels, gaps[:, 0] + gaps[:, 1] + gaps[:, 2])

    open_tiles(np.arange(len(gap)), gap.argmin(axis=1))
    open_tiles(*np.nonzero(gap <= nearest.bounds[pieces.zone, None] + _SLACK))


def _squared_gaps(
    box: Int64[np.ndarray, "*#k"], size: int, lower: Float64[np.ndarray, "*#k"], upper: Float64[np.ndarray, "*#k"]
) -> Float64[np.ndarray, "*k"]:
    """Squared gap, axis by axis, between boxes `size` voxels wide that begin at a voxel and those of pieces."""
    gap = np.maximum(np.maximum(box - upper, lower - (box + size)), 0.0)
    squared: Float64[np.ndarray, "*k"] = gap * gap
    return squared


def _squared_distance(
    a: Float64[np.ndarray, "k 3"], d: Float64[np.ndarray, "k 3"], voxel: Int64[np.ndarray, "k 3"]
) -> tuple[Float64[np.ndarray, " k"], Float64[np.ndarray, "k 3"]]:
    """Squared distance [voxels²] from segments a + t d, t ∈ [0, 1], to closed cubes, and the points that have it."""
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
    slope = dot(outside(t), d[:, None])
    right = np.minimum(np.maximum(np.add.reduce(slope < 0, axis=1), 1), 7)
    row = np.arange(len(a))
    t_0, t_1, slope_0, slope_1 = t[row, right - 1], t[row, right], slope[row, right - 1], slope[row, right]
    rise = slope_1 - slope_0
    weight = np.where(rise > 0, -slope_0 / np.where(rise > 0, rise, 1.0), 0.0)
    t_best = t_0 + np.minimum(np.maximum(weight, 0.0), 1.0) * (t_1 - t_0)
    best = outside(t_best[:, None])[:, 0]
    squared: Float64[np.ndarray, " k"] = dot(best, best)
    return squared, a + t_best[:, None] * d
