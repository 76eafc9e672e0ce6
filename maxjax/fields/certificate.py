"""The certificate: no local maximum but the goal.

Let C be the goal's component of free voxels. If every voxel of C except the goal has a face neighbour in C whose φ is
strictly higher, then the walk "step to the highest neighbour" visits strictly increasing values, so it never repeats a
voxel; C is finite, hence the walk ends, and it can end only where there is no higher neighbour: at the goal. The check
is one comparison per face on the very float32 numbers that the ascent reads, so it holds with rounding and all.
"""

from __future__ import annotations

import functools
import itertools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import neighbours


def best_neighbour(phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"]) -> Float[Array, "nx ny nz"]:
    """The highest φ (or log φ) among the free face neighbours of each voxel; −∞ where there is none."""
    pairs = neighbours(jnp.where(free, phi, -jnp.inf), beyond=-jnp.inf)
    return functools.reduce(jnp.maximum, itertools.chain(*pairs))


@jax.named_scope("certify")
def count_uncertified(
    phi: Float[Array, "nx ny nz"], component: Bool[Array, "nx ny nz"], goal_index: Int32[Array, " 3"]
) -> Int32[Array, ""]:
    """Number of voxels of the goal's component, goal aside, without a strictly higher face neighbour: zero certifies φ.

    Args:
        phi: potential, or any monotone function of it, such as its logarithm.
        component: the goal's component (`connectivity.flood` from the goal).
        goal_index: voxel of the goal.
    """
    stuck = component & ~(best_neighbour(phi, component) > phi)
    x, y, z = goal_index
    return jnp.sum(stuck.at[x, y, z].set(False), dtype=jnp.int32)
