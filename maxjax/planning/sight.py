"""Line of sight: does a straight segment stay in free voxels, corners included?

The segment is cut into slabs half a voxel thick along its longest axis. Inside a slab the two other coordinates change
by at most half a voxel, so the segment touches a span of at most 2 x 2 voxels there; it is clear when every span is
free. The span covers the exact set of touched voxels (it may hold one more, where the segment crosses both coordinates
in the same slab), hence a clear segment is clear in exact arithmetic too, and no corner is ever cut. Every slab costs
one look-up: `span_codes` holds, for each voxel and axis, whether the 1 x 1, 1 x 2, 2 x 1 and 2 x 2 spans that start
there are free.

Positions are index coordinates (whole numbers at voxel centres). Voxels outside the grid count as blocked.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Shaped, UInt16

from maxjax.core.lowering import every, shifted

# A segment closer than this to a voxel's face touches the voxel on the other side as well [voxels]: far above the
# rounding of float32 coordinates of a few hundred, far below anything that matters in flight.
TOUCH = 2.5e-4

# The two other axes, in the order in which `span_codes` stores their extents.
_OTHERS = ((1, 2), (0, 2), (0, 1))


def span_codes(blocked: Bool[Array, "nx ny nz"]) -> UInt16[Array, "nx ny nz"]:
    """Twelve bits a voxel: bit 4 a + 2 i + j is set when the (1+i) x (1+j) span across axis a is not free."""
    bits = jnp.zeros(blocked.shape, jnp.uint16)

    def ahead(mask: Bool[Array, "nx ny nz"], axis: int) -> Bool[Array, "nx ny nz"]:
        """Beyond the grid is blocked."""
        return shifted(mask, axis, 1, beyond=True)

    for axis, (first, second) in enumerate(_OTHERS):
        wide = blocked | ahead(blocked, second)
        for shift, span in enumerate((blocked, wide, blocked | ahead(blocked, first), wide | ahead(wide, first))):
            bits |= span.astype(jnp.uint16) << (4 * axis + shift)
    return bits


def touched(
    shape: tuple[int, ...], x: Float[Array, " 3"]
) -> tuple[Bool[Array, ""], tuple[Int32[Array, "..."], Int32[Array, "..."], Int32[Array, "..."]]]:
    """The voxels that a point touches: whether all are inside the grid, and an index to a (2, 2, 2) array of them.

    Where the point touches one voxel along an axis, the array holds it twice.
    """
    limits = jnp.asarray(shape, jnp.int32)
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
    bits: UInt16[Array, "nx ny nz"],
    a: Float[Array, "*#k 3"],
    b: Float[Array, "*#k 3"],
    slabs: int | None = None,
) -> Bool[Array, "*k"]:
    """Whether the closed segments a-b touch free voxels only.

    Args:
        bits: from `span_codes`.
        a, b: ends in index coordinates.
        slabs: voxels to cut at most along the longest axis; a longer segment is reported as not clear. Static.
    """
    _, ny, nz = bits.shape
    slabs = max(bits.shape) + 1 if slabs is None else slabs
    dx, dy, dz = jnp.moveaxis(jnp.abs(b - a), -1, 0)
    longest = jnp.where((dx >= dy) & (dx >= dz), 0, jnp.where(dy >= dz, 1, 2))
    order = jnp.asarray([(axis, *others) for axis, others in enumerate(_OTHERS)])[longest]
    rows = 3 * np.arange(longest.size).reshape(longest.shape)

    def ordered(values: Shaped[Array | np.ndarray, "*#k 3"]) -> list[Shaped[Array, "*k 1"]]:
        """The longest axis first, then the two others in the order of `span_codes`; with an axis for slabs."""
        flat = jnp.broadcast_to(values, (*longest.shape, 3)).reshape(-1)
        return [flat[(rows + order[..., k])[..., None]] for k in range(3)]

    # From here on: coordinate 0 along the longest axis, pointing upwards.
    start, end = ordered(a), ordered(b)
    flip = end[0] < start[0]
    low = [jnp.where(flip, v, u) for u, v in zip(start, end, strict=True)]
    high = [jnp.where(flip, u, v) for u, v in zip(start, end, strict=True)]
    strides, limits = ordered(np.array([ny * nz, nz, 1])), ordered(np.array(bits.shape))
    length = high[0] - low[0]
    run = jnp.where(length > 0, length, 1.0)

    first = jnp.floor(low[0] + 0.5 - TOUCH).astype(jnp.int32)
    last = jnp.floor(high[0] + 0.5 + TOUCH).astype(jnp.int32)

    def free_in(half: Int32[np.ndarray, " h"]) -> Bool[Array, "*k h"]:
        """Whether half slabs, counted from the first one, touch free voxels only."""
        slab = first + half // 2
        middle = slab + jnp.asarray(0.5 * (half % 2), a.dtype)
        enter = jnp.clip(middle - 0.5 - TOUCH, low[0], high[0]) - low[0]
        leave = jnp.clip(middle + TOUCH, low[0], high[0]) - low[0]
        flat, variant = slab * strides[0], 4 * longest[..., None]
        inside = (first >= 0) & (last < limits[0])
        for k, weight in ((1, 2), (2, 1)):
            slope = (high[k] - low[k]) / run
            u, v = low[k] + slope * enter, low[k] + slope * leave
            floor = jnp.floor(jnp.minimum(u, v) + 0.5 - TOUCH).astype(jnp.int32)
            ceil = jnp.floor(jnp.maximum(u, v) + 0.5 + TOUCH).astype(jnp.int32)
            inside &= (slab > last) | ((floor >= 0) & (ceil < limits[k]))
            flat, variant = flat + floor * strides[k], variant + weight * (ceil - floor)
        hit = (bits.reshape(-1)[jnp.clip(flat, 0, bits.size - 1)] >> variant.astype(jnp.uint16)) & 1
        return inside & (last - first < slabs) & ((slab > last) | (hit == 0))

    return every(free_in, 2 * slabs)


def visibility(
    bits: UInt16[Array, "nx ny nz"], points: Float[Array, "n 3"], slabs: int | None = None
) -> Bool[Array, "n n"]:
    """Pairwise `clear` between points, upper triangle; the rest is False."""
    # Constants of the program: computed on an accelerator, each step towards them would be a kernel.
    upper = np.triu(np.ones((points.shape[0],) * 2, bool), k=1)
    rows, columns = np.nonzero(upper)
    pair = np.cumsum(upper).reshape(upper.shape) - 1
    return clear(bits, points[rows], points[columns], slabs)[np.maximum(pair, 0)] & upper
