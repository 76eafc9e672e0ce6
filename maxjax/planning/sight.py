"""Line of sight: does a straight segment stay in free voxels, corners included?

The segment is cut into slabs half a voxel thick along its longest axis. Inside a slab the two other coordinates change
by at most half a voxel, so the segment touches a block of at most 2 x 2 voxels there; it is clear when every block is
free. The block covers the exact set of touched voxels (it may hold one more, where the segment crosses both coordinates
in the same slab), hence a clear segment is clear in exact arithmetic too, and no corner is ever cut. Every slab costs
one look-up: `blocks` precomputes, for each voxel and axis, whether the 1 x 1, 1 x 2, 2 x 1 and 2 x 2 blocks that start
there are free.

Positions are index coordinates (whole numbers at voxel centres). Voxels outside the grid count as blocked.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, UInt16

# A segment closer than this to a voxel's face touches the voxel on the other side as well [voxels]: far above the
# rounding of float32 coordinates of a few hundred, far below anything that matters in flight.
TOUCH = 2.5e-4

# The two other axes, in the order in which `blocks` stores their extents.
_OTHERS = ((1, 2), (0, 2), (0, 1))


def _ahead(array: Bool[Array, "nx ny nz"], axis: int) -> Bool[Array, "nx ny nz"]:
    """`array` one voxel further along `axis`; beyond the grid is blocked."""
    config = [(0, 0, 0)] * 3
    config[axis] = (-1, 1, 0)
    return lax.pad(array, jnp.array(True), config)


def blocks(blocked: Bool[Array, "nx ny nz"]) -> UInt16[Array, "nx ny nz"]:
    """Twelve bits a voxel: bit 4 a + 2 i + j is set when the (1+i) x (1+j) block across axis a is not free."""
    bits = jnp.zeros(blocked.shape, jnp.uint16)
    for axis, (first, second) in enumerate(_OTHERS):
        wide = blocked | _ahead(blocked, second)
        for shift, block in enumerate((blocked, wide, blocked | _ahead(blocked, first), wide | _ahead(wide, first))):
            bits |= block.astype(jnp.uint16) << (4 * axis + shift)
    return bits


def touched(
    shape: tuple[int, ...], x: Float[Array, " 3"]
) -> tuple[Bool[Array, ""], tuple[Int32[Array, "..."], Int32[Array, "..."], Int32[Array, "..."]]]:
    """The voxels that a point touches: whether all are inside the grid, and an index to a (2, 2, 2) block of them.

    Where the point touches one voxel along an axis, the block holds it twice.
    """
    limits = jnp.asarray(shape)
    low = jnp.floor(x + 0.5 - TOUCH).astype(jnp.int32)
    high = jnp.floor(x + 0.5 + TOUCH).astype(jnp.int32)
    inside = jnp.all(jnp.isfinite(x) & (low >= 0) & (high < limits))
    i, j, k = jnp.clip(jnp.stack([low, high], axis=1), 0, limits[:, None] - 1)
    return inside, (i[:, None, None], j[None, :, None], k[None, None, :])


def stands_free(blocked: Bool[Array, "nx ny nz"], x: Float[Array, " 3"]) -> Bool[Array, ""]:
    """Whether every voxel that the point touches is inside the grid and free."""
    inside, at = touched(blocked.shape, x)
    return inside & ~jnp.any(blocked[at])


def clear(
    bits: UInt16[Array, "nx ny nz"], a: Float[Array, " 3"], b: Float[Array, " 3"], slabs: int | None = None
) -> Bool[Array, ""]:
    """Whether the closed segment a-b touches free voxels only.

    Args:
        bits: from `blocks`.
        a, b: ends in index coordinates.
        slabs: voxels to cut at most along the longest axis; a longer segment is reported as not clear. Static.
    """
    shape = jnp.asarray(bits.shape)
    slabs = max(bits.shape) + 1 if slabs is None else slabs
    delta = b - a
    axis = jnp.argmax(jnp.abs(delta))
    order = jnp.stack([axis, jnp.where(axis == 0, 1, 0), jnp.where(axis == 2, 1, 2)])
    strides = jnp.asarray([bits.shape[1] * bits.shape[2], bits.shape[2], 1])[order]
    # From here on: coordinate 0 along the longest axis, pointing upwards.
    flip = delta[axis] < 0
    low, high = jnp.where(flip, b, a)[order], jnp.where(flip, a, b)[order]
    length = high[0] - low[0]
    slope = (high - low) / jnp.where(length > 0, length, 1.0)

    first = jnp.floor(low[0] + 0.5 - TOUCH).astype(jnp.int32)
    last = jnp.floor(high[0] + 0.5 + TOUCH).astype(jnp.int32)
    half = jnp.arange(2 * slabs)
    slab = first + half // 2
    middle = slab + 0.5 * (half % 2)
    enter = jnp.clip(middle - 0.5 - TOUCH, low[0], high[0]) - low[0]
    leave = jnp.clip(middle + TOUCH, low[0], high[0]) - low[0]

    flat, variant = slab * strides[0], 4 * axis
    inside = (first >= 0) & (last < shape[order[0]])
    for k, weight in ((1, 2), (2, 1)):
        u, v = low[k] + slope[k] * enter, low[k] + slope[k] * leave
        floor = jnp.floor(jnp.minimum(u, v) + 0.5 - TOUCH).astype(jnp.int32)
        ceil = jnp.floor(jnp.maximum(u, v) + 0.5 + TOUCH).astype(jnp.int32)
        inside &= jnp.all((slab > last) | ((floor >= 0) & (ceil < shape[order[k]])))
        flat, variant = flat + floor * strides[k], variant + weight * (ceil - floor)
    hit = (bits.reshape(-1)[jnp.clip(flat, 0, bits.size - 1)] >> variant.astype(jnp.uint16)) & 1
    return inside & (last - first < slabs) & ~jnp.any((slab <= last) & (hit > 0))


def visibility(
    bits: UInt16[Array, "nx ny nz"], points: Float[Array, "n 3"], slabs: int | None = None
) -> Bool[Array, "n n"]:
    """Pairwise `clear` between points, upper triangle; the rest is False."""
    n = points.shape[0]
    rows, columns = jnp.triu_indices(n, k=1)
    seen = jax.vmap(lambda i, j: clear(bits, points[i], points[j], slabs))(rows, columns)
    return jnp.zeros((n, n), bool).at[rows, columns].set(seen)
