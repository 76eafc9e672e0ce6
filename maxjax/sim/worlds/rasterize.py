"""Exact occupancy of a scene on a grid.

    occupied[i, j, k]  iff  the open cube of voxel (i, j, k) meets the interior of a geom

- box: separating axes of two boxes (3 + 3 face normals, 9 edge products);
- ellipsoid: least value of the quadratic form (x - p)' A (x - p) over the cube, below 1;
- capsule, sphere: least distance between segment and cube, below the radius;
- plane: the cube dips below z = 0; these voxels are `ground` as well.

Contact is no overlap: overlaps thinner than a nanometre do not count. NumPy in float64, on the host; each geom
is tested against the voxels of its bounding box.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, Geoms

_TOUCH = 1e-9  # [m]; rounding of float64 coordinates, far below any size in a city

Vector = Float[np.ndarray, "3"]
Matrix = Float[np.ndarray, "3 3"]
Centers = tuple[Float[np.ndarray, "nx 1 1"], Float[np.ndarray, "1 ny 1"], Float[np.ndarray, "1 1 nz"]]
Occupied = Bool[np.ndarray, "nx ny nz"]


def occupancy(geoms: Geoms, grid: Grid) -> tuple[Occupied, Occupied]:
    """Voxels that geoms fill, at least in part.

    Args:
        geoms: one scene, world frame [m]; a plane must be level (the ground).
        grid: any maxjax grid.

    Returns:
        (occupied, ground), bool arrays of grid.shape: all solids with the ground, and the ground alone
        (voxels that dip below its plane).

    Raises:
        ValueError: for batched geoms.
    """
    if geoms.position.ndim != 2:
        raise ValueError(f"geoms.position: expected shape (g, 3), given {geoms.position.shape}; index the batch first")
    positions, rotations, sizes = (np.asarray(a, np.float64) for a in (geoms.position, geoms.rotation, geoms.size))
    occupied = np.zeros(grid.shape, bool)
    ground = np.zeros(grid.shape, bool)
    origin = np.asarray(grid.origin)
    half = 0.5 * grid.spacing
    for geom_type, position, rotation, size in zip(geoms.type, positions, rotations, sizes, strict=True):
        if geom_type == PLANE:
            bottom = origin[2] + grid.spacing * np.arange(grid.shape[2]) - half
            ground |= bottom < position[2] - _TOUCH
            continue
        extent = _EXTENT[geom_type](rotation, size)
        lower = np.ceil((position - extent - origin) / grid.spacing - 0.5).astype(int)
        upper = np.floor((position + extent - origin) / grid.spacing + 0.5).astype(int) + 1
        lower, upper = np.clip(lower, 0, grid.shape), np.clip(upper, 0, grid.shape)
        if np.any(lower >= upper):
            continue
        # Cube middles relative to the geom's, one axis each: they broadcast to the voxels of the bounding
        # box.
        x, y, z = (origin[i] + grid.spacing * np.arange(lower[i], upper[i]) - position[i] for i in range(3))
        centers = (x[:, None, None], y[None, :, None], z[None, None, :])
        window = tuple(slice(low, high) for low, high in zip(lower, upper, strict=True))
        occupied[window] |= _MEETS[geom_type](centers, half, rotation, size)
    return occupied | ground, ground


def _box_meets(centers: Centers, half: float, rotation: Matrix, size: Vector) -> Occupied:
    """Separating axes: two boxes overlap iff their projections overlap on all face normals and edge products."""
    axes = [*np.eye(3), *rotation.T, *np.cross(np.eye(3)[:, None], rotation.T[None]).reshape(9, 3)]
    meets: Occupied = np.ones(np.broadcast_shapes(*(c.shape for c in centers)), bool)
    for axis in axes:
        length = np.linalg.norm(axis)
        if length < 1e-6:
            continue  # the product of parallel edges is no axis
        n = axis / length
        reach = half * np.sum(np.abs(n)) + np.sum(size * np.abs(rotation.T @ n))
        meets &= np.abs(n[0] * centers[0] + n[1] * centers[1] + n[2] * centers[2]) < reach - _TOUCH
    return meets


def _ellipsoid_meets(centers: Centers, half: float, rotation: Matrix, size: Vector) -> Occupied:
    """Least value of x' A x over each cube, exactly: each coordinate is free or at one of two bounds.

    All 27 active sets are solved; those whose solution lies in the cube are candidates, and the least of them
    is the minimum, because A is positive definite and the true active set is among them.
    """
    A = (rotation / size**2) @ rotation.T
    shape = np.broadcast_shapes(*(c.shape for c in centers))
    c = np.stack([np.broadcast_to(axis, shape) for axis in centers], -1)
    least = np.full(shape, np.inf)
    for active in itertools.product((-1, 0, 1), repeat=3):
        side = np.array(active)
        free, fixed = np.flatnonzero(side == 0), np.flatnonzero(side)
        x = c + half * side
        if free.size:
            # Stationary in the free coordinates: A_ff x_f = -A_fb x_b.
            x[..., free] = -x[..., fixed] @ np.linalg.solve(A[np.ix_(free, free)], A[np.ix_(free, fixed)]).T
        inside = np.all(np.abs(x - c) <= half * (1.0 + 1e-12), axis=-1)
        value = np.einsum("...i,ij,...j->...", x, A, x)
        least = np.minimum(least, np.where(inside, value, np.inf))
    meets: Occupied = least < 1.0 - _TOUCH / np.min(size)
    return meets


def _capsule_meets(centers: Centers, half: float, rotation: Matrix, size: Vector) -> Occupied:
    """Least distance of the capsule's segment to each cube, exactly.

    Squared distance along the segment is convex and quadratic between the parameters where the segment
    crosses the planes of the cube's faces; each piece is minimised in closed form.
    """
    axis = rotation[:, 2] * size[1]
    shape = np.broadcast_shapes(*(c.shape for c in centers))
    c = np.stack([np.broadcast_to(a, shape) for a in centers], -1)
    safe = np.where(np.abs(axis) > 0, axis, 1.0)
    crossings = np.concatenate([(c - half) / safe, (c + half) / safe], -1)
    crossings = np.where(np.abs(np.tile(axis, 2)) > 0, crossings, 0.0)
    ends = np.ones((*shape, 1))
    t = np.sort(np.concatenate([np.clip(crossings, -1.0, 1.0), -ends, ends], -1), -1)
    least = np.full(shape, np.inf)
    for low, high in zip(np.moveaxis(t, -1, 0)[:-1], np.moveaxis(t, -1, 0)[1:], strict=True):
        # On this piece the nearest face of each coordinate is fixed: face = c + s half where s = -1, 0
        # (inside), 1.
        offset = 0.5 * (low + high)[..., None] * axis - c
        side = np.where(np.abs(offset) > half, np.sign(offset), 0.0)
        outside = side != 0.0
        face = c + half * side
        curvature = np.sum(np.where(outside, axis**2, 0.0), -1)
        slope = np.sum(np.where(outside, axis * face, 0.0), -1)
        best = np.clip(np.where(curvature > 0, slope / np.where(curvature > 0, curvature, 1.0), low), low, high)
        gap = np.maximum(np.abs(best[..., None] * axis - c) - half, 0.0)
        least = np.minimum(least, np.sum(gap**2, -1))
    meets: Occupied = least < (size[0] - _TOUCH) ** 2
    return meets


def _sphere_meets(centers: Centers, half: float, rotation: Matrix, size: Vector) -> Occupied:
    return _capsule_meets(centers, half, rotation, np.array([size[0], 0.0, 0.0]))


# Half extents of each type's bounding box in the world frame [m].
_EXTENT: dict[int, Callable[[Matrix, Vector], Vector]] = {
    BOX: lambda rotation, size: np.abs(rotation) @ size,
    ELLIPSOID: lambda rotation, size: np.sqrt((rotation**2) @ size**2),
    CAPSULE: lambda rotation, size: np.abs(rotation[:, 2]) * size[1] + size[0],
    SPHERE: lambda rotation, size: np.full(3, size[0]),
}
_MEETS: dict[int, Callable[[Centers, float, Matrix, Vector], Occupied]] = {
    BOX: _box_meets,
    ELLIPSOID: _ellipsoid_meets,
    CAPSULE: _capsule_meets,
    SPHERE: _sphere_meets,
}
