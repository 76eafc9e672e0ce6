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

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Integer

from maxjax.core.grid import Grid, Index3

_REACH = 8  # voxels around a path that are searched first
_PIECE = 4.0  # longest piece [voxels] that one bounding box stands for in the search for the nearest voxel
_TOP = 512  # boxes of a window's top level, at most
_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)
_NEIGHBORS = np.stack(np.meshgrid(*[range(3)] * 3, indexing="ij"), axis=-1).reshape(27, 3)


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
) -> Verification:
    """Judge a path against the voxels that it must not touch, and measure its length and clearance.

    Args:
        path: points in the world frame [m], ENU; one point, or the same point twice, is a legal path.
        blocked: voxels that the path must not touch (obstacles with their margin).
        occupied: voxels from which the clearance is measured (obstacles as seen).
        grid: where the voxels lie in the world.

    Raises:
        ValueError: for a path that is not (t, 3) with t ≥ 1, for volumes that are not bool of the grid's
            shape, or for a grid so far from the world's origin that float32 cannot tell its voxels apart.
    """
    _check([path], blocked, occupied, grid, 3)
    return verify_batch([path], np.zeros(1, np.int64), blocked[None], occupied[None], grid)[0]


def verify_batch(
    paths: Sequence[Float[np.ndarray, "_ 3"]],
    which: Integer[np.ndarray, " p"],
    blocked: Bool[np.ndarray, "m nx ny nz"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    grid: Grid,
) -> list[Verification]:
    """`verify` for many paths at once: most of what one costs is the same for a hundred.

    Args:
        paths: points in the world frame [m], ENU.
        which: map of each path.
        blocked, occupied, grid: as in `verify`, for each map.

    Raises:
        ValueError: as `verify`, and unless every path has a map.
    """
    _check(paths, blocked, occupied, grid, 4)
    if which.shape != (len(paths),) or (which.size and not 0 <= which.min() <= which.max() < len(blocked)):
        raise ValueError(f"which: expected the map, 0 to {len(blocked) - 1}, of {len(paths)} paths, given {which}")

    tolerance = _tolerance(grid)
    verdicts: list[Verification] = []
    parts, owner = [], []  # segments of the paths that are inside
    for k, path in enumerate(paths):
        if not np.isfinite(path).all():
            verdicts.append(Verification(False, False, False, None, math.nan, math.nan))
            continue
        points = _index_coordinates(path, grid)
        with np.errstate(over="ignore"):  # coordinates near the largest float64: an infinite length says so
            length = float(np.linalg.norm(np.diff(path.astype(np.float64), axis=0), axis=1).sum())
        inside = bool(((points >= -tolerance) & (points <= np.array(grid.shape) + tolerance)).all())
        verdicts.append(Verification(inside, inside, True, None, length, math.nan))
        if inside:
            moves = (points[1:] != points[:-1]).any(axis=1)
            pair = (points[:-1][moves], points[1:][moves]) if moves.any() else (points[:1], points[:1])
            parts.append(pair)
            owner.append(np.full(len(pair[0]), k))
    if not parts:
        return verdicts
    a, b = (np.concatenate(ends) for ends in zip(*parts, strict=True))
    path_of = np.concatenate(owner)
    voxels, segment, entry = _supercover(a, b, grid)
    hits = np.flatnonzero(blocked[(which[path_of[segment]], *voxels.T)])
    hits = hits[np.lexsort((entry[hits], segment[hits]))]
    struck, first = np.unique(path_of[segment[hits]], return_index=True)
    first_hit = {int(k): voxels[hits[row]] for k, row in zip(struck, first, strict=True)}
    clearance = grid.spacing * _clearance(a, b, path_of, which, occupied)
    for k in np.unique(path_of).tolist():
        hit: Index3 | None = None
        if k in first_hit:
            x, y, z = first_hit[k]
            hit = (int(x), int(y), int(z))
        verdicts[k] = dataclasses.replace(verdicts[k], ok=hit is None, first_hit=hit, clearance=float(clearance[k]))
    return verdicts


def _check(paths: Sequence[np.ndarray], blocked: np.ndarray, occupied: np.ndarray, grid: Grid, axes: int) -> None:
    """Raise a `ValueError` unless the paths are (t, 3) and the volumes bool of the grid's shape."""
    for path in paths:
        if path.ndim != 2 or path.shape[1] != 3 or len(path) == 0:
            raise ValueError(f"path: expected shape (t, 3) with t of at least 1, given {path.shape}")
    for name, volume in (("blocked", blocked), ("occupied", occupied)):
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
    voxels, _, entry = _supercover(_index_coordinates(a[None], grid), _index_coordinates(b[None], grid), grid)
    return voxels[np.argsort(entry, kind="stable")]


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


def _supercover(
    a: Float64[np.ndarray, "s 3"], b: Float64[np.ndarray, "s 3"], grid: Grid
) -> tuple[Int64[np.ndarray, "k 3"], Int64[np.ndarray, " k"], Float64[np.ndarray, " k"]]:
    """Voxels of the grid that the segments (index coordinates) touch, with segment and t of entry."""
    tolerance, shape = _tolerance(grid), np.array(grid.shape)
    d = b - a
    # Along its longest axis a segment crosses layers of voxels. While it is in one layer it moves by at most
    # one voxel (and the tolerances) along each other axis, so that it touches at most three voxels there.
    axis = np.argmax(np.abs(d), axis=1)
    along = np.take_along_axis(np.stack([a, b]), axis[None, :, None], axis=2)[..., 0]
    first = np.clip(np.ceil(along.min(axis=0) - tolerance) - 1, 0, shape[axis]).astype(np.int64)
    last = np.clip(np.floor(along.max(axis=0) + tolerance), -1, shape[axis] - 1).astype(np.int64)
    count = np.maximum(last - first + 1, 0)
    segment = np.repeat(np.arange(len(a)), count)
    layer = first[segment] + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    axis, a, d = axis[segment], a[segment], d[segment]

    # t at both faces of the layer, then the lowest voxel along each axis that is touched between them.
    speed = np.take_along_axis(d, axis[:, None], axis=1)
    still = speed == 0
    faces = layer[:, None] + np.array([-tolerance, 1 + tolerance]) - np.take_along_axis(a, axis[:, None], axis=1)
    t = np.clip(np.where(still, [0.0, 1.0], faces / np.where(still, 1.0, speed)), 0.0, 1.0)
    lowest = np.ceil((a[:, None] + t[..., None] * d[:, None]).min(axis=1) - tolerance - 1)
    lowest = np.clip(lowest, -3, shape).astype(np.int64)  # beyond, all three lie outside the grid
    lowest[np.arange(len(lowest)), axis] = layer - 1  # the middle one of three is the layer itself

    voxels = lowest[:, None] + _NEIGHBORS
    keep = np.take_along_axis(voxels, axis[:, None, None], axis=2)[..., 0] == layer[:, None]
    keep &= ((voxels >= 0) & (voxels < shape)).all(axis=2)
    row, column = np.nonzero(keep)
    voxels, segment, a, d = voxels[row, column], segment[row], a[row], d[row]
    entry, leave = _slab_times(a, d, voxels - tolerance, voxels + (1 + tolerance))
    touched = entry <= leave
    return voxels[touched], segment[touched], entry[touched]


def _slab_times(
    a: Float64[np.ndarray, "k 3"],
    d: Float64[np.ndarray, "k 3"],
    lower: Float64[np.ndarray, "k 3"],
    upper: Float64[np.ndarray, "k 3"],
) -> tuple[Float64[np.ndarray, " k"], Float64[np.ndarray, " k"]]:
    """Interval of t in [0, 1] for which a + t d lies in the closed box; entry > leave if there is none."""
    still = d == 0
    speed = np.where(still, 1.0, d)
    t = np.stack([(lower - a) / speed, (upper - a) / speed])
    within = (lower <= a) & (a <= upper)
    entry = np.where(still, np.where(within, 0.0, np.inf), t.min(axis=0)).max(axis=1)
    leave = np.where(still, 1.0, t.max(axis=0)).min(axis=1)
    return np.maximum(entry, 0.0), np.minimum(leave, 1.0)


def _clearance(
    a: Float64[np.ndarray, "s 3"],
    b: Float64[np.ndarray, "s 3"],
    path_of: Int64[np.ndarray, " s"],
    which: Integer[np.ndarray, " p"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
) -> Float64[np.ndarray, " p"]:
    """Least distance [voxels] from each path's segments to the cube of an occupied voxel; infinite without any.

    A window around the path is searched first. What lies outside it is at least `_REACH` away: if the nearest voxel
    inside is nearer, it is the nearest of all; if not, the whole map is searched.
    """
    squared = np.full(len(which), math.inf)
    searched = 0
    for reach in (_REACH, max(occupied.shape[1:])):
        here = (squared > searched**2)[path_of]
        paths, place = np.unique(path_of[here], return_inverse=True)
        if not paths.size:
            break
        corner, windows = _windows(a[here], b[here], place, which[paths], occupied, reach)
        squared[paths] = _nearest(a[here], b[here], place, windows, corner)
        searched = reach
    least: Float64[np.ndarray, " p"] = np.sqrt(squared)
    return least


def _windows(
    a: Float64[np.ndarray, "s 3"],
    b: Float64[np.ndarray, "s 3"],
    path_of: Int64[np.ndarray, " s"],
    which: Integer[np.ndarray, " p"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    reach: int,
) -> tuple[Int64[np.ndarray, "p 3"], Bool[np.ndarray, "p wx wy wz"]]:
    """What is occupied around each path, `reach` voxels and more in every direction, and where each window begins."""
    low, high = np.full((2, len(which), 3), [[[math.inf]], [[-math.inf]]])
    for end in (a, b):
        np.minimum.at(low, path_of, end)
        np.maximum.at(high, path_of, end)
    shape = np.array(occupied.shape[1:])
    corner = np.clip(np.floor(low) - reach, 0, shape).astype(np.int64)
    size = np.minimum((np.ceil(high).astype(np.int64) + reach - corner).max(axis=0), shape)
    corner = np.minimum(corner, shape - size)
    boxes = [tuple(slice(k, k + n) for k, n in zip(start, size, strict=True)) for start in corner.tolist()]
    return corner, np.stack([occupied[(m, *box)] for m, box in zip(which.tolist(), boxes, strict=True)])


def _nearest(
    a: Float64[np.ndarray, "s 3"],
    b: Float64[np.ndarray, "s 3"],
    path_of: Int64[np.ndarray, " s"],
    occupied: Bool[np.ndarray, "p wx wy wz"],
    corner: Int64[np.ndarray, "p 3"],
) -> Float64[np.ndarray, " p"]:
    """Least squared distance [voxels²] from each path's segments to an occupied voxel of its own window.

    Branch and bound on a pyramid of boxes, each of 2×2×2 boxes of the level below. The gaps between every piece of
    a path and every box of the top are known at once. A plain descent from the nearest one, to the nearest child,
    finds an occupied voxel near every piece, hence an upper bound; then every box that might hold a nearer one is
    opened.
    """
    pyramid = _pyramid(occupied)
    top = len(pyramid) - 1
    squared = np.full(len(occupied), math.inf)
    inhabited = np.any(pyramid[top], axis=(1, 2, 3))[path_of]
    a, b, path_of = a[inhabited], b[inhabited], path_of[inhabited]
    count = np.maximum(np.ceil(np.linalg.norm(b - a, axis=1) / _PIECE), 1).astype(np.int64)
    segment = np.repeat(np.arange(len(a)), count)
    k = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    step = (b - a)[segment] / count[segment, None]
    start = a[segment] + k[:, None] * step
    lower, upper = np.minimum(start, start + step), np.maximum(start, start + step)
    path = path_of[segment]
    first = corner[path]

    gap = _squared_gaps(first, 2**top, pyramid[top].shape[1:], lower, upper)
    gap[~pyramid[top][path]] = math.inf
    piece = np.arange(len(start))
    nearest = gap.reshape(len(piece), math.prod(gap.shape[1:])).argmin(axis=1)
    box = np.stack(np.unravel_index(nearest, gap.shape[1:]), axis=-1)
    for level in reversed(range(top)):
        children = 2 * box[:, None] + _CORNERS
        nearby = _squared_gap(first[:, None] + 2**level * children, 2**level, lower[:, None], upper[:, None])
        there = pyramid[level][(path[:, None], *np.moveaxis(children, -1, 0))]
        box = children[piece, np.where(there, nearby, np.inf).argmin(axis=1)]
    np.minimum.at(squared, path, _squared_distance(start, step, first + box))
    bound = squared[path]

    piece, *at = np.nonzero(gap < bound[:, None, None, None])
    box = np.stack(at, axis=-1)
    for level in reversed(range(top)):
        children = (2 * box[:, None] + _CORNERS).reshape(-1, 3)
        piece = np.repeat(piece, 8)
        there = pyramid[level][(path[piece], *children.T)]
        piece, box = piece[there], children[there]
        nearer = _squared_gap(first[piece] + 2**level * box, 2**level, lower[piece], upper[piece]) < bound[piece]
        piece, box = piece[nearer], box[nearer]
    np.minimum.at(squared, path[piece], _squared_distance(start[piece], step[piece], first[piece] + box))
    return squared


def _pyramid(occupied: Bool[np.ndarray, "p wx wy wz"]) -> list[Bool[np.ndarray, "p _ _ _"]]:
    """Volumes that halve in size, each box True if one of its eight is; the last has few boxes a window."""
    levels = 0
    while math.prod(-(-n // 2**levels) for n in occupied.shape[1:]) > _TOP:
        levels += 1
    # Each level is padded to twice the size of the next, so that every box has eight children.
    top = [[-(-n // 2**level) for n in occupied.shape[1:]] for level in range(levels + 1)]
    pyramid, fine = [], occupied
    for level in range(levels):
        size = [2 * n for n in top[level + 1]]
        fine = np.pad(fine, [(0, 0), *((0, n - m) for n, m in zip(size, fine.shape[1:], strict=True))])
        pyramid.append(fine)
        fine = fine[:, ::2] | fine[:, 1::2]
        fine = fine[:, :, ::2] | fine[:, :, 1::2]
        # Two neighbours along the last axis are one 16-bit number.
        fine = np.ascontiguousarray(fine).view(np.uint16) != 0
    return [*pyramid, fine]


def _squared_gaps(
    first: Int64[np.ndarray, "k 3"],
    size: int,
    shape: tuple[int, ...],
    lower: Float64[np.ndarray, "k 3"],
    upper: Float64[np.ndarray, "k 3"],
) -> Float64[np.ndarray, "k bx by bz"]:
    """`_squared_gap` of every box of a lattice that begins at `first`."""
    x, y, z = (
        _squared_gap(
            (first[:, None, axis] + size * np.arange(n))[..., None],
            size,
            lower[:, None, [axis]],
            upper[:, None, [axis]],
        )
        for axis, n in enumerate(shape)
    )
    gaps: Float64[np.ndarray, "k bx by bz"] = x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :]
    return gaps


def _squared_gap(
    box: Int64[np.ndarray, "*k axes"],
    size: int,
    lower: Float64[np.ndarray, "*#k axes"],
    upper: Float64[np.ndarray, "*#k axes"],
) -> Float64[np.ndarray, "*k"]:
    """Squared distance from boxes that begin at a voxel and are `size` voxels wide to those from `lower` to `upper`."""
    gap = np.maximum(np.maximum(box - upper, lower - (box + size)), 0.0)
    squared: Float64[np.ndarray, "*k"] = np.einsum("...i,...i->...", gap, gap)
    return squared


def _squared_distance(
    a: Float64[np.ndarray, "k 3"], d: Float64[np.ndarray, "k 3"], voxel: Int64[np.ndarray, "k 3"]
) -> Float64[np.ndarray, " k"]:
    """Squared distance [voxels²] from the segment a + t d, t ∈ [0, 1], to the closed cube of the voxel."""
    still = d == 0
    faces = np.concatenate([voxel, voxel + 1], axis=1)
    kinks = (faces - np.tile(a, 2)) / np.tile(np.where(still, 1.0, d), 2)
    ends = np.broadcast_to([0.0, 1.0], (len(a), 2))
    t = np.sort(np.concatenate([np.clip(kinks, 0.0, 1.0), ends], axis=1), axis=1)

    def outside(t: Float64[np.ndarray, "k m"]) -> Float64[np.ndarray, "k m 3"]:
        """Vector from the cube to the points at `t`."""
        u = a[:, None] + t[..., None] * d[:, None]
        vector: Float64[np.ndarray, "k m 3"] = u - np.clip(u, voxel[:, None], voxel[:, None] + 1)
        return vector

    # Half the derivative rises with t, linearly between neighbours: find where it passes through zero.
    slope = np.einsum("kmi,ki->km", outside(t), d)
    right = np.clip((slope < 0).sum(axis=1), 1, t.shape[1] - 1)[:, None]
    t_0, t_1 = (np.take_along_axis(t, k, axis=1) for k in (right - 1, right))
    slope_0, slope_1 = (np.take_along_axis(slope, k, axis=1) for k in (right - 1, right))
    rise = slope_1 - slope_0
    weight = np.where(rise > 0, -slope_0 / np.where(rise > 0, rise, 1.0), 0.0)
    best = outside(t_0 + np.clip(weight, 0.0, 1.0) * (t_1 - t_0))[:, 0]
    squared: Float64[np.ndarray, " k"] = np.einsum("ki,ki->k", best, best)
    return squared
