"""Conductivity of the virtual conductor (Bong and Beltrame, arXiv 2605.10880, section III-A).

    σ = 0 in obstacles,   σ = σ_g at the goal,   σ = σ_i + σ_g / max(r, 1) elsewhere

with r the distance to the goal in voxels, σ_g = 10⁶ and σ_i = 10². The paper says that free space "combines" the
initial conductivity and σ_g / r; the sum is our reading. Current gathers towards the goal, as it would around an
electrode.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.forked import refuse_after_fork
from maxjax.core.grid import Grid

SIGMA_GOAL = 1e6
SIGMA_FREE = 1e2


@jax.named_scope("conductivity")
def conductivity(
    occupied: Bool[Array, "nx ny nz"], goal_index: Int32[Array, " 3"], grid: Grid
) -> Float[Array, "nx ny nz"]:
    """Conductivity field of a map and a goal.

    Args:
        occupied: voxels that conduct nothing (already dilated by the safety margin).
        goal_index: voxel of the goal; where it is occupied, nothing conducts there and no field reaches it.
        grid: the grid of `occupied`.

    Raises:
        ValueError: when `occupied` does not cover `grid`.
        RuntimeError: in a process that was forked after JAX had run.
    """
    refuse_after_fork()
    grid.check_volume("occupied", occupied)
    squared = jnp.zeros(grid.shape, jnp.float32)
    for axis in range(3):
        offset = lax.broadcasted_iota(jnp.int32, grid.shape, axis) - goal_index[axis]
        squared = squared + offset.astype(jnp.float32) ** 2
    sigma = jnp.where(squared > 0, SIGMA_FREE + SIGMA_GOAL * lax.rsqrt(jnp.maximum(squared, 1.0)), SIGMA_GOAL)
    return jnp.where(occupied, 0.0, sigma)
