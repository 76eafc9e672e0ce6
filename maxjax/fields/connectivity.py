"""Flood fill: the free voxels joined to a seed through faces.

    R ← R ∪ (free ∩ {6-neighbours of R})   until nothing changes

The sets are packed, 32 voxels to a word (`fields.packed`). Faces are what the field conducts through; a legal diagonal
move needs every voxel that it touches to be free, hence joins nothing that faces do not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int32, UInt32

from maxjax.compile.lowering import Arrays, repeat
from maxjax.fields import packed

# Steps of a flood between two looks at what it reached.
_STEPS = 32


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _FloodCarry:
    """Carry of `flood`: what has been reached, packed, and whether the last steps reached more."""

    words: UInt32[Array, "words ny nz"]
    grew: Bool[Array, ""]


def flood(free: Bool[Array, "nx ny nz"], seed: Int32[Array, " 3"]) -> Bool[Array, "nx ny nz"]:
    """The face-connected component of free voxels that holds `seed`; empty where the seed is not free or outside.

    Args:
        free: free voxels.
        seed: voxel index.
    """
    passable = packed.pack(free)

    def grow(carry: _FloodCarry) -> _FloodCarry:
        (after,) = _grown((carry.words,), passable)
        return _FloodCarry(after, jnp.any(after != carry.words))

    first = grow(_FloodCarry(packed.single(free.shape, seed) & passable, jnp.array(True)))
    last = lax.while_loop(lambda carry: carry.grew, grow, first)
    return packed.unpack(last.words, free.shape[0])


def _grown(words: Arrays, passable: UInt32[Array, "words ny nz"]) -> Arrays:
    """Sets grown by many steps: each look at the result is a synchronisation."""
    return repeat(_STEPS, lambda words: tuple(packed.spread(each) & passable for each in words), words, fused=2)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _JoinCarry:
    """Carry of `first_joined`.

    Attributes:
        reached: from either voxel, packed.
        k: the map.
        met: whether the two floods have met in it.
        over: whether there is nothing more to do.
    """

    reached: Arrays
    k: Int32[Array, ""]
    met: Bool[Array, ""]
    over: Bool[Array, ""]


def first_joined(
    free: Callable[[Int32[Array, ""]], Bool[Array, "nx ny nz"]],
    first: Int32[Array, ""],
    last: int,
    a: Int32[Array, " 3"],
    b: Int32[Array, " 3"],
) -> tuple[Int32[Array, ""], Bool[Array, ""]]:
    """The first of several maps in which `flood` from one voxel reaches another; the last one if none is.

    Both flood, until they meet or one has filled its component; then they go on in the next map.

    Args:
        free: free voxels of the k-th map; they are free in the maps after it, too.
        first, last: which maps there are, none if first > last; last is static.
        a, b: voxel indices; nothing joins a voxel outside the grid.

    Returns:
        The map, and whether it joins them.
    """
    shape = jax.eval_shape(free, first).shape
    seeds = packed.single(shape, a), packed.single(shape, b)

    def grow(carry: _JoinCarry) -> _JoinCarry:
        passable = packed.pack(free(carry.k))
        before = tuple((words | seed) & passable for words, seed in zip(carry.reached, seeds, strict=True))
        after = _grown(before, passable)
        # All three answers from one reduction.
        grew_a, grew_b = (jnp.where(new != old, bit, 0) for new, old, bit in zip(after, before, (1, 2), strict=True))
        found = lax.reduce_or(grew_a | grew_b | jnp.where(after[0] & after[1] != 0, 4, 0), (0, 1, 2))
        met, filled = found >= 4, found & 3 != 3
        k = jnp.where(filled & ~met, carry.k + 1, carry.k)
        return _JoinCarry(after, k, met, met | (filled & (carry.k >= last)))

    nothing = jnp.zeros_like(seeds[0])
    start = _JoinCarry((nothing, nothing), first, jnp.array(False), first > last)
    end = lax.while_loop(lambda carry: ~carry.over, grow, start)
    return jnp.minimum(end.k, last), end.met
