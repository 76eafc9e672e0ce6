"""The judge of every path: exact, in float64 NumPy, and independent of every planner and solver.

A path is the closed polyline through its points. In index coordinates u = (x − origin) / spacing + 1/2, voxel
i is the closed cube [i, i + 1]; a segment u(t) = a + t d, t ∈ [0, 1], touches it if the intervals of t in
which its coordinates lie in the cube's three slabs share a point. Faces, edges and corners count: a segment
along a face touches both sides, a diagonal through an edge or a corner touches all voxels around it, so no
corner is ever cut.

**Tolerance.** Paths arrive as float32 metres, often as the rounding of a voxel's centre. Every cube is
therefore grown by 4 · 2⁻²⁴ c, c being the largest coordinate of the map (2.4e-5 m at 101 m): a conversion
from index coordinates rounds at most three times, by 2⁻²⁴ c each. Doubt counts against the path; only across
the outer faces of the map is it allowed that much.

**Clearance.** The squared distance from u(t) to a cube, Σ max(lo − u, 0, u − hi)² over the axes, is convex in
t, and quadratic between the at most six t at which a coordinate meets lo or hi. Its derivative rises linearly
between these, so that its root is found without iteration.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Integer
from numpy.lib.stride_tricks import as_strided

from maxjax.core.grid import Grid, Index3

_PIECE = 4.0  # longest piece of a segment [voxels]: its bounding box tells what is near it
_REACHES = (2.0, 4.0, 8.0)  # how far around a path its nearest voxel is looked for [voxels], before it is anywhere
_BLOCK = 4  # edge of the blocks in which a whole map is searched: the bytes of one 32-bit number
_CELLS = np.stack(np.unravel_index(np.arange(_BLOCK**3), (_BLOCK,) * 3), axis=-1)
_SLACK = 1e-6  # more than rounding adds to a squared distance [voxels²]


@dataclasses.dataclass(frozen=True)
class Verification:
    """Verdict on a path.

    Attributes:
        ok: finite, inside, and no blocked voxel touched. Nothing else makes a path safe.
        inside: the whole path lies in the volume of the grid.
        finite: no coordinate is NaN or infinite.
        first_hit: index of the first blocked voxel that the path touches; None if there is none, or if the
            path is not inside.
        length: length of the path [m]; NaN unless finite.
        clearance: least distance from the path to the cube of an occupied voxel [m]: 0 on contact, infinite
            if no voxel is occupied, NaN unless inside.
    """

    ok: bool
    inside: bool
    finite: bool
    first_hit: Index3 | None
    length: float
    clearance: float


def verify(
    path: Float[np.ndarray, "t 3"],
    blocked: Bool[np.ndarray, "nx ny nz"],
    occupied: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    *,
    ground: Bool[np.ndarray, "nx ny nz"] | None = None,
) -> Verification:
    """Judge a path against the voxels that it must not touch, and measure its length and clearance.

    Args:
        path: points in the world frame [m], ENU; one point, or the same point twice, is a legal path.
        blocked: voxels that the path must not touch (obstacles with their margin).
        occupied: voxels from which the clearance is measured (obstacles as seen).
        grid: where the voxels lie in the world.
        ground: voxels of `occupied` from which it is not. None: there are none.

    Raises:
        ValueError: for a path that is not (t, 3) with t ≥ 1, for volumes that are not bool of the grid's
            shape, or for a grid so far from the world's origin that float32 cannot tell its voxels apart.
    """
    _check([path], grid, 3, blocked=blocked, occupied=occupied, ground=ground)
    below = None if ground is None else ground[None]
    return verify_batch([path], np.zeros(1, np.int64), blocked[None], occupied[None], grid, ground=below)[0]


def verify_batch(
    paths: Sequence[Float[np.ndarray, "_ 3"]],
    which: Integer[np.ndarray, " p"],
    blocked: Bool[np.ndarray, "m nx ny nz"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    grid: Grid,
    *,
    ground: Bool[np.ndarray, "m nx ny nz"] | None = None,
) -> list[Verification]:
    """`verify` for many paths at once: most of what one costs is the same for a hundred.

    Args:
        paths: points in the world frame [m], ENU.
        which: map of each path.
        blocked, occupied, grid, ground: as in `verify`, for each map.

    Raises:
        ValueError: as `verify`, and unless every path has a map.
    """
    _check(paths, grid, 4, blocked=blocked, occupied=occupied, ground=ground)
    if which.shape != (len(paths),) or (which.size and not 0 <= which.min() <= which.max() < len(blocked)):
        raise ValueError(f"which: expected the map, 0 to {len(blocked) - 1}, of {len(paths)} paths, given {which}")

    tolerance = _tolerance(grid)
    if len(paths) == 0:
        return []

    # All points of all paths in a row, each with the one that follows it; the last of a path is followed by itself.
    world = np.concatenate(paths, dtype=np.float64)
    sizes = np.array([len(path) for path in paths])
    end = np.cumsum(sizes)
    first = end - sizes
    path_of = np.repeat(np.arange(len(paths)), sizes)
    after = np.arange(1, len(world) + 1)
    after[end - 1] = end - 1
    with np.errstate(over="ignore", invalid="ignore"):  # infinite coordinates and lengths are verdicts, not errors
        points = _index_coordinates(world, grid)
        d = points[after] - points
        lengths = _norm(world[after] - world)
    finite = np.logical_and.reduceat(np.isfinite(world).all(axis=1), first)
    within = ((points >= -tolerance) & (points <= np.array(grid.shape) + tolerance)).all(axis=1)
    inside = np.logical_and.reduceat(within, first)
    moves = d.any(axis=1)
    moves[first] |= ~np.logical_or.reduceat(moves, first)  # a path that stays where it is has one segment
    moves &= inside[path_of]

    a, d, path_of = points[moves], d[moves], path_of[moves]
    pieces = _pieces(a, d, path_of, which[path_of])
    segment, voxels = _contacts(a, d, pieces, blocked, tolerance)
    backwards = zip(path_of[segment[::-1]].tolist(), voxels[::-1].tolist(), strict=True)  # so that the first remains
    first_hit: dict[int, Index3] = {k: (x, y, z) for k, (x, y, z) in backwards}
    clearance = grid.spacing * _clearance(pieces, occupied, ground, len(paths))
    return [
        Verification(
            ok=bool(inside[k]) and k not in first_hit,
            inside=bool(inside[k]),
            finite=bool(finite[k]),
            first_hit=first_hit.get(k),
            length=float(lengths[first[k] : end[k] - 1].sum()) if finite[k] else math.nan,
            clearance=float(clearance[k]) if inside[k] else math.nan,
        )
        for k in range(len(paths))
    ]


def _check(paths: Sequence[np.ndarray], grid: Grid, axes: int, **volumes: np.ndarray | None) -> None:
    """Raise a `ValueError` unless the paths are (t, 3) and the volumes bool of the grid's shape."""
    for path in paths:
        if path.ndim != 2 or path.shape[1] != 3 or len(path) == 0:
            raise ValueError(f"path: expected shape (t, 3) with t of at least 1, given {path.shape}")
    for name, volume in volumes.items():
        if volume is None:
            continue
        grid.check_volume(name, volume)
        if volume.ndim != axes or volume.dtype != np.bool_:
            raise ValueError(f"{name}: expected bool of shape {grid.shape}, given {volume.dtype} {volume.shape}")


def touched_voxels(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"], grid: Grid) -> Int64[np.ndarray, "k 3"]:
    """Index of every voxel whose closed cube the segment from `a` to `b` [m] touches, in order of entry.

    The cubes are grown by the tolerance that the module states. Voxels outside the grid are left out. Ends
    more than 1e6 times the size of the map away lose that precision.

    Raises:
        ValueError: unless both points are three finite coordinates, or for a grid that `verify` refuses.
    """
    for name, point in (("a", a), ("b", b)):
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"{name}: expected three finite coordinates [m], given {point}")
    start, stop = _index_coordinates(np.stack([a, b]), grid)[:, None]
    lower, upper = np.full((1, 3), -1.0), np.array([grid.shape]) + 1.0
    times = _slab_times(start, stop - start, lower, upper)
    if times[0] > times[1]:
        return np.zeros((0, 3), np.int64)
    # What is far outside would be a great many pieces.
    start, stop = np.clip(start + np.array(times) * (stop - start), lower, upper)[:, None]
    d, only = stop - start, np.zeros(1, np.int64)
    everything = np.broadcast_to(True, (1, *grid.shape))
    _, voxels = _contacts(start, d, _pieces(start, d, only, only), everything, _tolerance(grid))
    again = (voxels[1:] == voxels[:-1]).all(axis=1)  # found around the next piece, too
    return np.concatenate([voxels[:1], voxels[1:][~again]])


def _index_coordinates(points: Float[np.ndarray, "t 3"], grid: Grid) -> Float64[np.ndarray, "t 3"]:
    """World points [m] in units of voxels, voxel i being [i, i + 1]."""
    offset = points.astype(np.float64) - np.array(grid.origin)
    index: Float64[np.ndarray, "t 3"] = offset / grid.spacing + 0.5
    return index


def _tolerance(grid: Grid) -> float:
    """Growth of every cube [voxels]."""
    tolerance = 4 * 2.0**-24 * max(map(abs, grid.lower + grid.upper)) / grid.spacing
    if tolerance > 0.1:
        raise ValueError(
            f"grid: expected corners near enough to the origin that float32 resolves {grid.spacing} m, given "
            f"{grid.lower} and {grid.upper} [m]; use a world frame whose origin lies next to the map"
        )
    return tolerance


def _norm(d: Float64[np.ndarray, "k 3"]) -> Float64[np.ndarray, " k"]:
    """Lengths of vectors."""
    length: Float64[np.ndarray, " k"] = np.sqrt(np.add.reduce(d * d, axis=1))
    return length


class _Pieces(NamedTuple):
    """Segments in pieces start + t step, t ∈ [0, 1], that fill much of their boxes from `lower` to `upper`."""

    path: Int64[np.ndarray, " k"]
    map: Int64[np.ndarray, " k"]
    segment: Int64[np.ndarray, " k"]
    start: Float64[np.ndarray, "k 3"]
    step: Float64[np.ndarray, "k 3"]
    lower: Float64[np.ndarray, "k 3"]
    upper: Float64[np.ndarray, "k 3"]

    def of(self, some: Bool[np.ndarray, " k"]) -> _Pieces:
        """Some of the pieces."""
        return _Pieces(*(field[some] for field in self))


def _pieces(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    path_of: Int64[np.ndarray, " s"],
    map_of: Integer[np.ndarray, " s"],
) -> _Pieces:
    """Pieces of the segments a + t d (index coordinates)."""
    count = np.maximum(np.ceil(_norm(d) / _PIECE), 1).astype(np.int64)
    segment = np.repeat(np.arange(len(a)), count)
    k = np.arange(len(segment)) - (np.cumsum(count) - count)[segment]
    step = (d / count[:, None])[segment]
    start = a[segment] + k[:, None] * step
    stop = start + step
    lower, upper = np.minimum(start, stop), np.maximum(start, stop)
    return _Pieces(path_of[segment], map_of[segment], segment, start, step, lower, upper)


def _around(
    pieces: _Pieces,
    volume: Bool[np.ndarray, "m nx ny nz"],
    reach: float,
    without: Bool[np.ndarray, "m nx ny nz"] | None = None,
) -> tuple[Int64[np.ndarray, " c"], Int64[np.ndarray, "c 3"], Float64[np.ndarray, " c"]]:
    """Every pair of a piece and a voxel, True in its map, whose boxes are at most `reach` apart, with the gap squared.

    Voxels that are True in the map `without` are left out. All pieces look through windows of one size, pushed back
    into the map where they would leave it.
    """
    shape = np.array(volume.shape[1:])
    low = np.maximum(np.floor(pieces.lower - reach), 0).astype(np.int64)
    high = np.ceil(pieces.upper + reach).astype(np.int64)
    size = np.minimum(np.maximum.reduce(high - low, initial=1), shape)
    corner = np.minimum(low, shape - size)
    (x, y, z), places = size.tolist(), (shape - size + 1).tolist()

    strides = volume.strides + volume.strides[1:]
    windows = as_strided(volume, (len(volume), *places, x, y, z), strides, writeable=False)
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
    if without is None:
        return piece, voxels, gap
    counts = ~without[pieces.map[piece], voxels[:, 0], voxels[:, 1], voxels[:, 2]]
    return piece[counts], voxels[counts], gap[counts]


def _contacts(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    pieces: _Pieces,
    blocked: Bool[np.ndarray, "m nx ny nz"],
    tolerance: float,
) -> tuple[Int64[np.ndarray, " k"], Int64[np.ndarray, "k 3"]]:
    """Segments and the blocked voxels that they touch, by segment and time of entry; some voxels more than once.

    Of voxels entered at once, the first is the lowest along the segment's longest axis, then along x, y and z.
    """
    piece, voxels, _ = _around(pieces, blocked, 2 * tolerance)
    segment = pieces.segment[piece]
    entry, leave = _slab_times(a[segment], d[segment], voxels - tolerance, voxels + (1 + tolerance))
    touched = np.flatnonzero(entry <= leave)
    if not touched.size:
        return touched, np.zeros((0, 3), np.int64)
    segment, voxels, entry = segment[touched], voxels[touched], entry[touched]
    layer = voxels[np.arange(len(voxels)), np.abs(d[segment]).argmax(axis=1)]
    order = np.lexsort((*voxels.T[::-1], layer, entry, segment))
    return segment[order], voxels[order]


def _slab_times(
    a: Float64[np.ndarray, "k 3"],
    d: Float64[np.ndarray, "k 3"],
    lower: Float64[np.ndarray, "k 3"],
    upper: Float64[np.ndarray, "k 3"],
) -> tuple[Float64[np.ndarray, " k"], Float64[np.ndarray, " k"]]:
    """Interval of t in [0, 1] for which a + t d lies in the closed box; entry > leave if there is none."""
    still = d == 0
    speed = np.where(still, 1.0, d)
    s, t = (lower - a) / speed, (upper - a) / speed
    within = (lower <= a) & (a <= upper)
    entry = np.where(still, np.where(within, 0.0, np.inf), np.minimum(s, t))
    leave = np.where(still, 1.0, np.maximum(s, t))
    return np.maximum(np.maximum.reduce(entry, axis=1), 0.0), np.minimum(np.minimum.reduce(leave, axis=1), 1.0)


def _clearance(
    pieces: _Pieces,
    occupied: Bool[np.ndarray, "m nx ny nz"],
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
    paths: int,
) -> Float64[np.ndarray, " {paths}"]:
    """Least distance [voxels] from each path's pieces to the cube of an occupied voxel; infinite without any.

    What a search leaves out is farther than its `reach`: where it found a nearer voxel, that is the nearest of all.
    """
    squared = np.full(paths, math.inf)
    for reach in _REACHES:
        _approach(squared, pieces, *_around(pieces, occupied, reach, ground))
        pieces = pieces.of(squared[pieces.path] > reach**2)
        if not pieces.path.size:
            break
    else:
        for path in np.unique(pieces.path).tolist():
            own = pieces.of(pieces.path == path)
            seen = own.map[0]
            _search(squared, own, occupied[seen] if ground is None else occupied[seen] & ~ground[seen])
    least: Float64[np.ndarray, " {paths}"] = np.sqrt(squared)
    return least


def _approach(
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
    """`_approach` all that is occupied in a map, for the pieces of one path.

    The nearest block to every piece is opened; after that, every block that might hold a nearer voxel still.
    """
    blocks = [-(-n // _BLOCK) for n in occupied.shape]
    padded = np.zeros([_BLOCK * n for n in blocks], bool)
    padded[tuple(map(slice, occupied.shape))] = occupied
    held = padded.view(np.uint32)
    held = held[0::4] | held[1::4] | held[2::4] | held[3::4]
    held = held[:, 0::4] | held[:, 1::4] | held[:, 2::4] | held[:, 3::4]
    x, y, z = np.nonzero(held)
    if not x.size:
        return
    cells = _BLOCK * np.arange(max(blocks))
    gaps = _squared_gaps(cells, _BLOCK, pieces.lower[..., None], pieces.upper[..., None])
    gap = gaps[:, 0, x] + gaps[:, 1, y] + gaps[:, 2, z]

    def open_blocks(piece: Int64[np.ndarray, " b"], block: Int64[np.ndarray, " b"]) -> None:
        corner = _BLOCK * np.array([x[block], y[block], z[block]]).T
        voxels = (corner[:, None] + _CELLS).reshape(-1, 3)
        there = padded[tuple(voxels.T)]
        piece, voxels = np.repeat(piece, len(_CELLS))[there], voxels[there]
        gaps = _squared_gaps(voxels, 1, pieces.lower[piece], pieces.upper[piece])
        _approach(squared, pieces, piece, voxels, np.add.reduce(gaps, axis=1))

    open_blocks(np.arange(len(gap)), gap.argmin(axis=1))
    open_blocks(*np.nonzero(gap <= squared[pieces.path[0]] + _SLACK))


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
