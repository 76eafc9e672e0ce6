"""Which voxels a segment touches: exact, in float64 NumPy.

In index coordinates u = (x − origin) / spacing + 1/2, voxel i is the closed cube [i, i + 1]; a segment u(t) = a + t d,
t ∈ [0, 1], touches it if the intervals of t in which its coordinates lie in the cube's three slabs share a point.
Faces, edges and corners count: a segment along a face touches both sides, a diagonal through an edge or a corner
touches all voxels around it, so no corner is ever cut.

**Which cubes are tested.** Voxels lie in layers across the segment's longest axis. While a segment passes one layer,
its two other coordinates change by no more than the layer is thick, so it touches at most 3 × 3 closed cubes there.
These nine, for every layer between the segment's ends, are all there is to test.

**Tolerance.** Doubt counts against the path: every cube is grown by the rounding that the path may carry, in voxels

    4 · 2⁻²⁴ max(shape)  +  4 · u · (largest world coordinate of the map) / spacing.

The first term is that of planning: paths are found in float32 index coordinates, whose conversions round at most four
times, by 2⁻²⁴ of an index each. The second is that of the world coordinates in which the path is given: u = 2⁻⁵³ for a
float64 path and u = 2⁻²⁴ for a float32 path. Everything is computed in the grid's local frame, x − origin in float64.
So a float64 path has the same verdict wherever its map lies (2.4e-5 voxel on 101 voxels, plus 4e-10 at a coordinate of
1,000 km and voxels of 1 m), while a float32 path is checked to what float32 can tell apart there. Only across the outer
faces of the map is a path allowed that much.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from maxjax.core.grid import Grid

# The nine voxels of one layer, from the lowest, by the axis across which the layer lies.
_NINE = np.array([[np.insert(pair, axis, 0) for pair in itertools.product(range(3), repeat=2)] for axis in range(3)])
_COARSEST = 0.1  # largest tolerance [voxels]: beyond it a verdict says little, and three voxels a layer are not enough

# (segment, voxel) ↦ whether the segment must not touch the voxel, pair by pair.
Forbidden = Callable[[Int64[np.ndarray, " c"], Int64[np.ndarray, "c 3"]], Bool[np.ndarray, " c"]]


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
    tolerance = np.array([tolerance_of(np.result_type(a, b), grid)])
    return contacts(start, stop - start, tolerance, grid.shape, lambda segment, _: np.ones(len(segment), bool))[1]


def tolerance_of(dtype: np.dtype, grid: Grid) -> float:
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


def contacts(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    tolerance: Float64[np.ndarray, " s"],
    shape: tuple[int, ...],
    forbidden: Forbidden,
) -> tuple[Int64[np.ndarray, " k"], Int64[np.ndarray, "k 3"]]:
    """Segments and the forbidden voxels that they touch, each pair once, by segment and time of entry.

    Of voxels entered at once, the first is the lowest along the segment's longest axis, then along x, y and z.

    Args:
        a, d: segments a + t d, t ∈ [0, 1], in index coordinates, inside the map.
        tolerance: of each [voxels].
        shape: of the map.
        forbidden: which voxels count.
    """
    segment, voxels = _candidates(a, d, tolerance, shape)
    held = forbidden(segment, voxels)
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
