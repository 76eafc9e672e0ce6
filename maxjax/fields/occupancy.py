"""Points to voxels, and their dilation.

    occupied = voxels that hold a point;   blocked = { x : min over occupied y of |x − y| ≤ margin }

Distances run between voxel centres, in metres. The ground is dilated by one voxel only: with the full margin, a flight
at 3 to 15 m would start inside it.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Integer

from maxjax.compile.forked import refuse_after_fork
from maxjax.compile.lowering import materialise, shift_axis
from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap

# Keeps 8 m / 2 m = 4 voxels inclusive under rounding [voxels²]; squared lattice distances are whole numbers.
_INCLUSIVE = 1e-4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Occupancy:
    """Voxels of a cloud of points, and counts of its points.

    Attributes:
        occupied: voxels that hold at least one point.
        kept: points that fell into the grid.
        outside: valid points outside the grid, dropped.
        missing: points without a return, dropped: not finite, or exactly (0, 0, 0) as Cosys-AirSim writes a miss.
    """

    occupied: Bool[Array, "*batch nx ny nz"]
    kept: Int32[Array, "*batch"]
    outside: Int32[Array, "*batch"]
    missing: Int32[Array, "*batch"]


def voxelize(points: Float[Array | np.ndarray, "n 3"], grid: Grid) -> Occupancy:
    """Voxels that hold a point; compiled once for all grids of a shape and spacing, wherever they lie.

    Args:
        points: world positions [m], ENU; may hold misses. NumPy's are taken relative to the grid in float64, so that at
            national coordinates nothing is lost; those of JAX in their own precision.
        grid: the grid.

    Raises:
        ValueError: when `points` is not (n, 3).
        RuntimeError: in a process that was forked after JAX had run.
    """
    refuse_after_fork()
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points: expected shape (n, 3) [m], given {points.shape}")
    if isinstance(points, jax.Array):
        valid = jnp.all(jnp.isfinite(points), axis=1) & jnp.any(points != 0, axis=1)
        local = points - jnp.asarray(grid.origin, points.dtype)
    else:
        valid = jnp.asarray(np.isfinite(points).all(axis=1) & (points != 0).any(axis=1))
        with np.errstate(over="ignore"):  # what float32 cannot hold is outside
            local = jnp.asarray((points.astype(np.float64) - np.array(grid.origin)).astype(np.float32))
    found: Occupancy = _voxelize(local, valid, grid.local)
    return found


def add_scan(known: VoxelMap, points: Float[np.ndarray, "n 3"]) -> tuple[VoxelMap, Occupancy]:
    """A map with what a scan shows occupied, on the host, and the scan's voxels.

    Args:
        known: what is known before.
        points: of `voxelize`.
    """
    scan = voxelize(pad_cloud(points), known.grid)
    occupied = np.asarray(known.occupied) | np.asarray(scan.occupied)
    return dataclasses.replace(known.on_host(), occupied=occupied), scan


def pad_cloud(points: Float[np.ndarray, "n 3"], count: int | None = None) -> Float[np.ndarray, "m 3"]:
    """A cloud filled up with misses (NaN), so that clouds of any size share few programs.

    Args:
        points: [m].
        count: of points; None: the next power of two.
    """
    count = 1 << max(len(points) - 1, 0).bit_length() if count is None else count
    return np.pad(points, ((0, count - len(points)), (0, 0)), constant_values=np.nan)


@functools.partial(jax.jit, static_argnames="grid")
def _voxelize(points: Float[Array, "n 3"], valid: Bool[Array, " n"], grid: Grid) -> Occupancy:
    kept = valid & grid.contains(points)
    index = jnp.where(kept[:, None], grid.index_of(jnp.where(valid[:, None], points, 0)), -1)
    nx, ny, nz = grid.shape
    flat = (index[:, 0] * ny + index[:, 1]) * nz + index[:, 2]
    # A dropped point writes past the end, which the scatter ignores.
    flat = jnp.where(kept, flat, nx * ny * nz)
    occupied = jnp.zeros(nx * ny * nz, bool).at[flat].set(True, mode="drop").reshape(grid.shape)
    count = functools.partial(jnp.sum, dtype=jnp.int32)
    return Occupancy(occupied, count(kept), count(valid & ~kept), count(~valid))


def squared_distance(occupied: Bool[Array, "nx ny nz"], reach: int) -> Integer[Array, "nx ny nz"]:
    """Squared distance to the nearest occupied voxel, exact up to `reach` [voxels²]; `far(reach)` beyond.

    Separable: min over |k| ≤ reach of d²(x + k) + k², one axis after the other, is exact for squared Euclidean
        distance.

    Args:
        occupied: voxels at distance zero.
        reach: largest distance of interest [voxels]. Static.
    """
    far = 3 * reach**2 + 1
    # The narrowest type that holds far + reach²: the passes below are bound by memory traffic.
    dtype = jnp.uint8 if far + reach**2 < 2**8 else jnp.uint16 if far + reach**2 < 2**16 else jnp.int32
    squared = jnp.where(materialise(occupied), 0, far).astype(dtype)
    for axis in range(3):
        best = squared
        for k in range(1, min(reach, occupied.shape[axis] - 1) + 1):
            for step in (k, -k):
                best = jnp.minimum(best, shift_axis(squared, axis, step, far) + jnp.asarray(k * k, dtype))
        squared = best
    return materialise(jnp.minimum(squared, jnp.asarray(far, dtype)))


def dilate(
    occupied: Bool[Array | np.ndarray, "nx ny nz"],
    margin: float,
    grid: Grid,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
) -> Bool[Array, "nx ny nz"]:
    """Voxels whose centre lies within `margin` of the centre of an occupied voxel.

    Args:
        occupied: occupied voxels, ground included.
        margin: [m]. Static.
        grid: the grid.
        ground: the voxels of `occupied` that are ground: dilated by one voxel at most. None: no voxel is.

    Raises:
        ValueError: when a volume does not cover `grid`, or for a negative margin.
        RuntimeError: in a process that was forked after JAX had run.
    """
    refuse_after_fork()
    if not 0 <= margin <= grid.spacing * max(grid.shape):
        raise ValueError(f"margin: expected 0 to {grid.spacing * max(grid.shape):g} m, the map's edge, given {margin}")
    grid.check_volume("occupied", occupied)
    ground = jnp.zeros(occupied.shape, bool) if ground is None else ground
    grid.check_volume("ground", ground)
    blocked: Bool[Array, "nx ny nz"] = _dilate(occupied, ground, margin, grid.local)
    return blocked


@functools.partial(jax.jit, static_argnames=("margin", "grid"))
def _dilate(
    occupied: Bool[Array, "nx ny nz"], ground: Bool[Array, "nx ny nz"], margin: float, grid: Grid
) -> Bool[Array, "nx ny nz"]:
    radius = margin / grid.spacing
    reach = max(1, math.isqrt(math.floor(radius**2 + _INCLUSIVE)))
    near = squared_distance(occupied & ~ground, reach) <= radius**2 + _INCLUSIVE
    return near | ground | (squared_distance(ground, 1) <= min(radius, 1.0) ** 2 + _INCLUSIVE)
