"""The certificate: no local maximum but the goal.

Let C be the goal's component of free voxels. If every voxel of C except the goal has a face neighbour in C whose φ is
strictly higher, then the walk "step to the highest neighbour" visits strictly increasing values, so it never repeats a
voxel; C is finite, hence the walk ends, and it can end only where there is no higher neighbour: at the goal. The check
is one comparison per face on the very float32 numbers that the ascent reads, so it holds with rounding and all.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.fields.stencil import ahead, behind


def best_neighbour(phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"]) -> Float[Array, "nx ny nz"]:
    """The highest φ among the free face neighbours of each voxel; −1 where there is none (φ is never negative)."""
    best = jnp.full_like(phi, -1)
    for axis in range(3):
        for shift in (ahead, behind):
            open_there = shift(free.astype(phi.dtype), axis) > 0
            best = jnp.maximum(best, jnp.where(open_there, shift(phi, axis), -1))
    return best


@jax.named_scope("certify")
def uncertified(
    phi: Float[Array, "nx ny nz"], component: Bool[Array, "nx ny nz"], goal_index: Int32[Array, " 3"]
) -> Int32[Array, ""]:
    """Number of voxels of the goal's component, goal aside, without a strictly higher face neighbour: zero certifies φ.

    Args:
        phi: potential.
        component: the goal's component (`connectivity.flood` from the goal).
        goal_index: voxel of the goal.
    """
    stuck = component & ~(best_neighbour(phi, component) > phi)
    x, y, z = goal_index
    return jnp.sum(stuck.at[x, y, z].set(False), dtype=jnp.int32)
