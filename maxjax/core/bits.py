"""Occupancy as bits, eight voxels a byte, for the way to a device and back, which is narrow.

The order is that of NumPy's `packbits`: x slowest, z fastest, the first voxel in the highest bit.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, UInt8

from maxjax.core.grid import Index3


def pack(volumes: Bool[np.ndarray, "*b nx ny nz"]) -> UInt8[np.ndarray, "*b bytes"]:
    """Volumes on the host as bits; on a device `jnp.packbits` gives the same."""
    return np.packbits(volumes.reshape(*volumes.shape[:-3], -1), axis=-1)


def unpack(bits: UInt8[np.ndarray, "*b bytes"], shape: Index3) -> Bool[np.ndarray, "*b nx ny nz"]:
    """The volumes of this shape again, on the host."""
    voxels = np.unpackbits(bits, axis=-1, count=math.prod(shape)).view(bool)
    return voxels.reshape(*bits.shape[:-1], *shape)


def volume(bits: UInt8[Array, " bytes"], shape: Index3) -> Bool[Array, "nx ny nz"]:
    """One volume on a device; `jit`- and `vmap`-safe."""
    return jnp.unpackbits(bits, count=math.prod(shape)).reshape(shape) > 0
