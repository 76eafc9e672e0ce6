"""Trilinear interpolation.

    f(x) = Σ over the 8 voxels around x of f_v Π_a (1 − |x_a − v_a|)

in index coordinates (whole numbers at voxel centres). With weights, voxels of weight zero (walls) drop out and the rest
are renormalised.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

CORNERS = tuple((i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1))


def corner_weights(fraction: Float[Array, " 3"]) -> Float[Array, "2 2 2"]:
    """The eight trilinear weights of a point at `fraction` (0 to 1 along each axis) of a cell."""
    x, y, z = (jnp.stack([1 - f, f]) for f in fraction)
    return x[:, None, None] * y[None, :, None] * z[None, None, :]


def trilinear(
    values: Float[Array, "nx ny nz"], position: Float[Array, " 3"], weights: Float[Array, "nx ny nz"] | None = None
) -> Float[Array, ""]:
    """Interpolate a volume at one point; use `vmap` for many.

    Args:
        values: values at voxel centres.
        position: index coordinates; outside the grid, the nearest face's value.
        weights: non-negative weight of each voxel, e.g. 1 in free space and 0 in walls; where all eight weights vanish,
            0.
    """
    shape = jnp.asarray(values.shape)
    position = jnp.clip(position, 0, (shape - 1).astype(position.dtype))
    base = jnp.clip(jnp.floor(position).astype(jnp.int32), 0, jnp.maximum(shape - 2, 0))
    share = corner_weights(position - base).reshape(8)
    corner = jnp.minimum(base + jnp.asarray(CORNERS), shape - 1)
    index = (corner[:, 0], corner[:, 1], corner[:, 2])
    if weights is None:
        return jnp.sum(share * values[index])
    share = share * weights[index]
    total = jnp.sum(share)
    return jnp.sum(share * jnp.where(share > 0, values[index], 0)) / jnp.where(total > 0, total, 1)
