"""Sets of voxels, 32 to a word along x, so that one step over a million voxels costs some ten thousand operations.

    bit k of word (i, y, z) is set   ⇔   voxel (32 i + k, y, z) is in the set

The last word of a column is padded with voxels that are not. Words shift by one voxel along y and z as they are; along
x, the axis inside the words, their bits shift, and the end bits are carried into the next word.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32, UInt32

from maxjax.compile.lowering import shift_axis
from maxjax.fields.stencil import cell

WORD = 32


def pack(mask: Bool[Array, "*b nx ny nz"]) -> UInt32[Array, "*b words ny nz"]:
    """The set of voxels that are True."""
    *batch, nx, ny, nz = mask.shape
    padded = jnp.pad(mask, [(0, 0)] * len(batch) + [(0, -nx % WORD), (0, 0), (0, 0)])
    layers = padded.reshape(*batch, -1, WORD, ny, nz).astype(jnp.uint32)
    # Halves onto halves: a sum would have every bit of it, as wide as a word, in memory first.
    while (half := layers.shape[-3] // 2) > 0:
        layers = layers[..., :half, :, :] | (layers[..., half:, :, :] << half)
    return layers[..., 0, :, :]


def digits(words: UInt32[Array, "*b words ny nz"], nx: int) -> UInt32[Array, "*b nx ny nz"]:
    """1 for each of `nx` layers of voxels that is in the set, else 0."""
    *batch, _, ny, nz = words.shape
    bits = (words[..., None, :, :] >> jnp.arange(WORD, dtype=jnp.uint32)[:, None, None]) & 1
    return bits.reshape(*batch, -1, ny, nz)[..., :nx, :, :]


def unpack(words: UInt32[Array, "*b words ny nz"], nx: int) -> Bool[Array, "*b nx ny nz"]:
    """Inverse of `pack`."""
    return digits(words, nx).astype(bool)


def single(shape: tuple[int, ...], index: Int32[Array, " 3"]) -> UInt32[Array, "words ny nz"]:
    """The set of one voxel of a grid of this shape; nothing inside the grid for an index outside it."""
    x, y, z = index
    word = cell((-(-shape[0] // WORD), *shape[1:]), jnp.stack([x // WORD, y, z]))
    return jnp.where(word, jnp.uint32(1) << (x % WORD).astype(jnp.uint32), 0)


def spread(words: UInt32[Array, "*b words ny nz"]) -> UInt32[Array, "*b words ny nz"]:
    """The set with its 6 neighbours."""
    return _along_words(words) | _across(words, -2) | _across(words, -1)


def spread_cube(words: UInt32[Array, "*b words ny nz"], passed: UInt32[Array, "*b words ny nz"]) -> Array:
    """The set with those of its 26 neighbours that face steps along z, then y, then x lead to.

    Args:
        words: the set.
        passed: voxels from which the next face step may go on; the set itself counts as well. Voxels that only touch at
            an edge or corner stay apart.
    """
    z = _across(words, -1)
    y = _across(words | (z & passed), -2)
    return z | y | _along_words(words | ((z | y) & passed))


def _along_words(words: UInt32[Array, "*b words ny nz"]) -> UInt32[Array, "*b words ny nz"]:
    """Along x, the axis inside the words: shift by one bit, and carry the end bits into the next word."""
    up = (words << 1) | _moved(words >> (WORD - 1), -3, 1)
    down = (words >> 1) | _moved(words << (WORD - 1), -3, -1)
    return words | up | down


def _across(words: UInt32[Array, "*b words ny nz"], axis: int) -> UInt32[Array, "*b words ny nz"]:
    """Along y or z."""
    return words | _moved(words, axis, 1) | _moved(words, axis, -1)


def _moved(words: UInt32[Array, "*b words ny nz"], axis: int, step: int) -> UInt32[Array, "*b words ny nz"]:
    """All words one place further along an axis, or one back; nothing comes in from beyond the grid."""
    return shift_axis(words, axis, -step)
