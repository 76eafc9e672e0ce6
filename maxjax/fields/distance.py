"""Distance from the centre of a voxel to the nearest occupied cube.

    d(x) = min over occupied y of |g(x − y)|,     g_a(k) = max(|k_a| − 1/2, 0)  along each axis        [voxels]

Doubled and squared it is a whole number, (2 d)² = Σ over the axes of (2 |k| − 1)², or 0 where k = 0: one quarter of a
voxel² each. On a face it is 0, in the centre of a voxel beside an occupied one 1/2.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Integer

from maxjax.compile.lowering import materialise, shift_axis


@jax.named_scope("distance")
def cube_distance(occupied: Bool[Array, "nx ny nz"], reach: float) -> Integer[Array, "nx ny nz"]:
    """(2 d)², four times the squared distance to the nearest occupied cube [voxels²]; 0 inside.

    Separable, as every term depends on one axis: min over k of (2 d)²(x + k) + (2 |k| − 1)², one axis after the other.

    Args:
        occupied: voxels that are the cubes.
        reach: largest distance of interest [voxels]: up to it the result is exact, beyond it ⌊4 reach²⌋ + 1. Static.
    """
    far = math.floor(4 * reach**2) + 1
    steps = farthest(reach)
    # The narrowest type that holds the largest sum: the passes below are bound by memory traffic.
    most = far + (2 * steps - 1) ** 2
    dtype = jnp.uint8 if most < 2**8 else jnp.uint16 if most < 2**16 else jnp.int32
    quarters = jnp.where(materialise(occupied), 0, far).astype(dtype)
    for axis in range(3):
        best = quarters
        for k in range(1, min(steps, occupied.shape[axis] - 1) + 1):
            for step in (k, -k):
                best = jnp.minimum(best, shift_axis(quarters, axis, step, far) + jnp.asarray((2 * k - 1) ** 2, dtype))
        quarters = best
    return materialise(quarters)


def farthest(reach: float) -> int:
    """How many voxels away along an axis a cube may be that is within a reach [voxels]."""
    return (math.isqrt(math.floor(4 * reach**2)) + 1) // 2


def metres(quarters: Integer[Array, "*b"], spacing: float) -> Float[Array, "*b"]:
    """The distance d [m] of (2 d)² [voxels²]."""
    return (0.5 * spacing) * jnp.sqrt(quarters.astype(jnp.float32))
