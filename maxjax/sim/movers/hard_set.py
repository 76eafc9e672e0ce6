"""The hard set around a vehicle: distances from points to the cubes of blocked voxels, and what was seen free.

    gap(x) = min over blocked voxels of the distance from x to their cubes

computed exactly as far as h, the edge of a voxel: from 27 bits a voxel, which tell what of it and its neighbours is
blocked. From h to 2 h it is h more than the same of what is blocked and one layer of voxels around it: a lower bound,
and the distance itself but beside edges and corners.
"""

from __future__ import annotations

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

_AROUND = tuple(itertools.product((-1, 0, 1), repeat=3))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class HardSet:
    """Blocked voxels and seen ones in a box; batch axes lead.

    Attributes:
        bits: of each voxel, which of the 27 voxels around it are blocked, itself included.
        wide: the same, with a layer of voxels around those that are blocked.
        seen: voxels seen free; what lies outside the box was not.
        origin: centre of voxel (0, 0, 0) [m].
        spacing: of the voxels [m]; static.
    """

    bits: Int32[Array, "*batch nx ny nz"]
    wide: Int32[Array, "*batch nx ny nz"]
    seen: Bool[Array, "*batch nx ny nz"]
    origin: Float[Array, "*batch 3"]
    spacing: float = dataclasses.field(metadata={"static": True})


def hard_set(
    blocked: Bool[Array, "nx ny nz"], seen: Bool[Array, "nx ny nz"], origin: Float[Array, "3"], spacing: float
) -> HardSet:
    """Of voxels; those outside the box count as free here, and as not seen.

    Args:
        blocked: no part of a way.
        seen: seen free.
        origin: centre of voxel (0, 0, 0) [m].
        spacing: [m]. Static.
    """
    bits = _bits(blocked)
    return HardSet(bits, _bits(bits != 0), seen, origin, spacing)


def _bits(blocked: Bool[Array, "nx ny nz"]) -> Int32[Array, "nx ny nz"]:
    """Which of the 27 voxels around each are blocked."""
    padded = jnp.pad(blocked, 1)
    nx, ny, nz = blocked.shape
    bits = jnp.zeros(blocked.shape, jnp.int32)
    for bit, (i, j, k) in enumerate(_AROUND):
        bits |= padded[1 + i : 1 + i + nx, 1 + j : 1 + j + ny, 1 + k : 1 + k + nz].astype(jnp.int32) << bit
    return bits


def gaps(hard: HardSet, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance to the nearest blocked cube [m], at most two edges of a voxel; 0 inside one."""
    index, inside, at = _voxels(hard, points)
    near, far = (
        _least(jnp.where(inside, bits[index[:, 0], index[:, 1], index[:, 2]], 0), at) for bits in (hard.bits, hard.wide)
    )
    return hard.spacing * jnp.where(far > 0.0, 1.0 + far, near)


def _least(bits: Int32[Array, " n"], at: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance to the nearest blocked cube of those around [edges of a voxel], at most one."""
    # Per axis the distance to the slab of the lower neighbour, of the own voxel (none), and of the upper one.
    to = jnp.stack([0.5 + at, jnp.zeros_like(at), 0.5 - at], -1)
    squared = to * to
    least = jnp.ones(len(at), at.dtype)
    for bit, (i, j, k) in enumerate(_AROUND):
        here = squared[:, 0, i + 1] + squared[:, 1, j + 1] + squared[:, 2, k + 1]
        least = jnp.where((bits >> bit) & 1 == 1, jnp.minimum(least, here), least)
    return jnp.sqrt(least)


def seen_free(hard: HardSet, points: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    """Whether the voxels that hold points were seen free."""
    index, inside, _ = _voxels(hard, points)
    return inside & hard.seen[index[:, 0], index[:, 1], index[:, 2]]


def _voxels(hard: HardSet, points: Array) -> tuple[Array, Array, Array]:
    """Voxel that holds each point, whether it lies in the box, and where in the voxel the point is, −½ to ½."""
    whole = (points - hard.origin) / hard.spacing
    index = jnp.floor(whole + 0.5)
    last = np.asarray(hard.bits.shape) - 1
    inside = jnp.all((index >= 0) & (index <= last), axis=1)
    return jnp.clip(index, 0, last).astype(jnp.int32), inside, whole - index
