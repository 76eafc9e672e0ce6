"""Where boxes of maps lie open, by a table of each map: on a device, for boxes of any size at the same cost.

    T[x, y, z] = open voxels of layer z in [0, x) × [0, y)
    open voxels of a box's layer = T[x₁, y₁] − T[x₀, y₁] − T[x₁, y₀] + T[x₀, y₀]

On a host the maps themselves are searched (`windows.subvolumes`): a table takes longer than a plan.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, UInt

# Counts are kept modulo 2³² (2¹⁶ in small maps), as differences of them are right all the same.
Table = UInt[Array, "m px py nz"]


def count_columns(occupied: Bool[Array, "m nx ny nz"]) -> Table:
    """The table of several maps."""
    _, nx, ny, _ = occupied.shape
    kind = jnp.uint16 if nx * ny < 2**16 else jnp.uint32
    counts = jnp.cumsum(jnp.cumsum(~occupied, axis=1, dtype=kind), axis=2, dtype=kind)
    return jnp.pad(counts, ((0, 0), (1, 0), (1, 0), (0, 0)))


def lowest_open_layers(
    table: Table, map_of: Int[Array, " b"], low: Int[Array, "b k 3"], high: Int[Array, "b k 3"]
) -> Int[Array, "b k"]:
    """The lowest layer of each box that is not all occupied; one above the highest where all are.

    Args:
        table: of several maps.
        map_of: which of them the boxes of each problem lie in.
        low, high: the first and the last voxels of boxes; what lies beyond the map is left out.
    """
    limits = jnp.array(table.shape[1:], jnp.int32) - jnp.array([1, 1, 0], jnp.int32)
    first = jnp.clip(low, 0, limits)
    end = jnp.maximum(jnp.minimum(high + 1, limits), first)
    which = jnp.asarray(map_of)[:, None]

    def corner(x: Int[Array, "b k"], y: Int[Array, "b k"]) -> UInt[Array, "b k nz"]:
        return table[which, x, y]

    (x0, y0, z0), (x1, y1, z1) = jnp.moveaxis(first, -1, 0), jnp.moveaxis(end, -1, 0)
    opened = corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
    layer = jnp.arange(table.shape[-1], dtype=jnp.int32)
    counts = (opened > 0) & (layer >= z0[..., None]) & (layer < z1[..., None])
    return jnp.min(jnp.where(counts, layer, z1[..., None]), axis=-1)
