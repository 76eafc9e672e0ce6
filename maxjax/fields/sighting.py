"""What one scan shows of a grid: voxels seen occupied, and voxels seen free.

seen occupied   a return lies in the voxel
seen free       a beam passes its inside on the way to its return, and no return lies in it
unseen          all others; of beams without a return clouds do not tell the direction
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from maxjax.core.grid import Grid
from maxjax.fields.occupancy import voxelize


class Sighting(NamedTuple):
    """Voxels by what a scan shows of them.

    Attributes:
        occupied, free: seen so; no voxel is both.
    """

    occupied: Bool[Array, "nx ny nz"]
    free: Bool[Array, "nx ny nz"]


@functools.partial(jax.jit, static_argnames=("grid", "reach"))
def sight(sensor: Float[Array, " 3"], returns: Float[Array, "r 3"], grid: Grid, reach: float = 100.0) -> Sighting:
    """What a scan shows.

    Args:
        sensor: where its beams begin [m].
        returns: where they end [m]; those that are not finite are left out.
        grid: static.
        reach: nothing is seen free farther away [m]; static.
    """
    occupied = voxelize(returns, grid).occupied
    return Sighting(occupied, _passed(sensor, returns, grid, reach) & ~occupied)


def _passed(
    sensor: Float[Array, " 3"], returns: Float[Array, "r 3"], grid: Grid, reach: float
) -> Bool[Array, "nx ny nz"]:
    """Voxels that hold a point of a beam, taken every half voxel from the sensor to half a voxel before its return.

    Arguments as of `sight`.
    """
    valid = jnp.all(jnp.isfinite(returns), axis=1)
    way = jnp.where(valid[:, None], returns - sensor, 0.0)
    length = jnp.linalg.norm(way, axis=1)
    direction = way / jnp.maximum(length, 1e-6)[:, None]
    step = 0.5 * grid.spacing
    count = int(np.ceil(reach / step))

    def mark(k: Array, seen: Bool[Array, "nx ny nz"]) -> Bool[Array, "nx ny nz"]:
        along = step * k.astype(jnp.float32)
        point = sensor + along * direction
        there = valid & (along <= length - step) & grid.contains(point)
        at = jnp.where(there[:, None], grid.index_of(point), -1)
        return seen.at[at[:, 0], at[:, 1], at[:, 2]].max(there, mode="drop", wrap_negative_indices=False)

    seen: Bool[Array, "nx ny nz"] = jax.lax.fori_loop(0, count, mark, jnp.zeros(grid.shape, bool))
    return seen
