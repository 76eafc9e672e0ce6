"""The judge of every path: exact, in float64 NumPy, and independent of every planner and solver.

A path is the closed polyline through its points. In index coordinates u = (x − origin) / spacing + 1/2, voxel i is the
closed cube [i, i + 1]; a segment u(t) = a + t d, t ∈ [0, 1], touches it if the intervals of t in which its coordinates
lie in the cube's three slabs share a point. Faces, edges and corners count: a segment along a face touches both sides,
a diagonal through an edge or a corner touches all voxels around it, so no corner is ever cut.

**Which cubes are tested.** Voxels lie in layers across the segment's longest axis. While a segment passes one layer,
its two other coordinates change by no more than the layer is thick, so it touches at most 3 × 3 closed cubes there.
These nine, for every layer between the segment's ends, are all there is to test.

**Tolerance.** Doubt counts against the path: every cube is grown by the rounding that the path may carry, in voxels

    4 · 2⁻²⁴ max(shape)  +  4 · u · (largest world coordinate of the map) / spacing.

The first term is that of planning: paths are found in float32 index coordinates, whose conversions round at most four
times, by 2⁻²⁴ of an index each. The second is that of the world coordinates in which the path is given: u = 2⁻⁵³ for a
float64 path and u = 2⁻²⁴ for a float32 path. Everything is computed in the grid's local frame, x − origin in float64.
So a float64 path has the same verdict wherever its map lies (2.4e-5 voxel on 101 voxels, plus 4e-10 at a coordinate of
1,000 km and voxels of 1 m), while a float32 path is judged by what float32 can tell apart there. Only across the outer
faces of the map is a path allowed that much. The tolerance is that of contacts; length and clearance have none.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Integer

from maxjax.core.grid import Grid, Index3
from maxjax.planning.clearance import clearances

# The nine voxels of one layer, from the lowest, by the axis across which the layer lies.
_NINE = np.array([[np.insert(pair, axis, 0) for pair in itertools.product(range(3), repeat=2)] for axis in range(3)])
_COARSEST = 0.1  # largest tolerance [voxels]: beyond it a verdict says little, and three voxels a layer are not enough


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
            shape, or for a float32 path in a grid so far from the world's origin that float32 cannot tell its
            voxels apart.
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

    tolerance = np.array([_tolerance(path.dtype, grid) for path in paths])
    if len(paths) == 0:
        return []

    local = np.concatenate(paths, dtype=np.float64) - np.array(grid.origin)
    sizes = np.array([len(path) for path in paths])
    last, path_of = np.cumsum(sizes) - 1, np.repeat(np.arange(len(paths)), sizes)
    first = last - sizes + 1
    grown = tolerance[path_of, None]
    with np.errstate(over="ignore", invalid="ignore"):  # infinite coordinates and lengths are verdicts, not errors
        points = local / grid.spacing + 0.5
        d = _steps(points, path_of)
        lengths = grid.spacing * np.linalg.norm(d, axis=1)
    finite = np.logical_and.reduceat(np.isfinite(local).all(axis=1), first)
    within = ((points >= -grown) & (points <= np.array(grid.shape) + grown)).all(axis=1)
    inside = np.logical_and.reduceat(within, first)
    moves = (d != 0).any(axis=1)
    moves[first] |= ~np.logical_or.reduceat(moves, first)  # a path that stays where it is has one segment
    moves &= inside[path_of]

    a, d, path_of = points[moves], d[moves], path_of[moves]
    segment, voxels = _contacts(a, d, tolerance[path_of], which[path_of], blocked)
    backwards = zip(path_of[segment[::-1]].tolist(), voxels[::-1].tolist(), strict=True)  # so that the first remains
    first_hit: dict[int, Index3] = {k: (x, y, z) for k, (x, y, z) in backwards}
    clearance = grid.spacing * clearances(a, d, path_of, which, occupied, ground)
    return [
        Verification(
            ok=bool(inside[k]) and k not in first_hit,
            inside=bool(inside[k]),
            finite=bool(finite[k]),
            first_hit=first_hit.get(k),
            length=float(lengths[first[k] : last[k]].sum()) if finite[k] else math.nan,
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
    start, stop = ((np.stack([a, b]).astype(np.float64) - np.array(grid.origin)) / grid.spacing + 0.5)[:, None]
    lower, upper = np.full((1, 3), -1.0), np.array([grid.shape]) + 1.0
    times = _slab_times(start, stop - start, lower, upper)
    if times[0] > times[1]:
        return np.zeros((0, 3), np.int64)
    # What is far outside would be a great many layers.
    start, stop = np.clip(start + np.array(times) * (stop - start), lower, upper)[:, None]
    tolerance = np.array([_tolerance(np.result_type(a, b), grid)])
    everything = np.broadcast_to(True, (1, *grid.shape))
    return _contacts(start, stop - start, tolerance, np.zeros(1, np.int64), everything)[1]


def _steps(points: Float64[np.ndarray, "n 3"], path_of: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, "n 3"]:
    """From each point of all paths in a row to the next of its path; nothing from the last."""
    d = np.zeros_like(points)
    np.subtract(points[1:], points[:-1], out=d[:-1], where=(path_of[1:] == path_of[:-1])[:, None])
    return d


def _tolerance(dtype: np.dtype, grid: Grid) -> float:
    """Growth of every cube [voxels] for a path of this number format."""
    u = float(np.finfo(dtype).eps) / 2 if np.issubdtype(dtype, np.floating) else 2.0**-53
    farthest = max(map(abs, grid.lower + grid.upper))
    tolerance = 4 * 2.0**-24 * max(grid.shape) + 4 * u * farthest / grid.spacing
    if tolerance > _COARSEST:
        raise ValueError(
            f"grid: expected corners near enough to the world's origin that a path of {dtype} resolves "
            f"{grid.spacing} m, given {grid.lower} and {grid.upper} [m]; give the path as float64, or use a world "
            "frame whose origin lies next to the map"
        )
    return tolerance


def _contacts(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    tolerance: Float64[np.ndarray, " s"],
    map_of: Integer[np.ndarray, " s"],
    blocked: Bool[np.ndarray, "m nx ny nz"],
) -> tuple[Int64[np.ndarray, " k"], Int64[np.ndarray, "k 3"]]:
    """Segments and the blocked voxels that they touch, each pair once, by segment and time of entry.

    Of voxels entered at once, the first is the lowest along the segment's longest axis, then along x, y and z.
    """
    segment, voxels = _candidates(a, d, tolerance, blocked.shape[1:])
    held = blocked[map_of[segment], voxels[:, 0], voxels[:, 1], voxels[:, 2]]
    segment, voxels = segment[held], voxels[held]
    if not len(segment):
        return segment, voxels
    grown = tolerance[segment, None]
    entry, leave = _slab_times(a[segment], d[segment], voxels - grown, voxels + (1 + grown))
    touched = entry <= leave
    segment, voxels, entry = segment[touched], voxels[touched], entry[touched]
    layer = voxels[np.arange(len(voxels)), np.abs(d[segment]).argmax(axis=1)]
    order = np.lexsort((*voxels.T[::-1], layer, entry, segment))
    return segment[order], voxels[order]


def _candidates(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    tolerance: Float64[np.ndarray, " s"],
    shape: tuple[int, ...],
) -> tuple[Int64[np.ndarray, " c"], Int64[np.ndarray, "c 3"]]:
    """Segments and the voxels of the map that they may touch: nine in each layer across the longest axis.

    A grown cube v touches the interval [lower, upper] only if ⌊lower − 2 tolerance⌋ ≤ v ≤ ⌊upper + 2 tolerance⌋: once
    the tolerance by which it is grown, and once more for the rounding of the interval.
    """
    row, axis = np.arange(len(a)), np.abs(d).argmax(axis=1)
    begin, run = a[row, axis], d[row, axis]
    lowest = np.floor(np.minimum(begin, begin + run) - 2 * tolerance).astype(np.int64)
    highest = np.floor(np.maximum(begin, begin + run) + 2 * tolerance).astype(np.int64)
    count = highest - lowest + 1
    segment = np.repeat(row, count)
    layer = np.arange(len(segment)) + (lowest - np.cumsum(count) + count)[segment]

    # Where the segment is inside its layer, from t_0 to t_1; a segment that is a point is there at any t.
    a, d, axis, tolerance = a[segment], d[segment], axis[segment], tolerance[segment]
    begin, run = begin[segment], np.where(run == 0, 1.0, run)[segment]
    t_0 = np.clip((layer - tolerance - begin) / run, 0.0, 1.0)
    t_1 = np.clip((layer + 1 + tolerance - begin) / run, 0.0, 1.0)
    nearest = np.minimum(a + t_0[:, None] * d, a + t_1[:, None] * d)
    corner = np.floor(nearest - 2 * tolerance[:, None]).astype(np.int64)
    corner[np.arange(len(corner)), axis] = layer
    voxels = (corner[:, None] + _NINE[axis]).reshape(-1, 3)
    held = ((voxels >= 0) & (voxels < np.array(shape))).all(axis=1)
    return np.repeat(segment, 9)[held], voxels[held]


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
