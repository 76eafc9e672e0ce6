"""Flood fill: the free voxels joined to a seed through faces.

    R ← R ∪ (free ∩ {6-neighbours of R})   until nothing changes

The sets are packed 32 voxels to a word along x, so that one step over a million voxels costs some ten thousand word
operations. Faces are what the field conducts through; a legal diagonal move needs every voxel that it touches to be
free, hence joins nothing that faces do not.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool, Int32, UInt32

from maxjax.core import slabs
from maxjax.core.batching import one_a_member
from maxjax.core.lowering import Arrays, repeat
from maxjax.fields.stencil import cell

_WORD = 32
# Steps of a flood between two looks at what it reached.
_STEPS = 32


def _pack(mask: Bool[Array, "*b nx ny nz"]) -> UInt32[Array, "*b words ny nz"]:
    *batch, nx, ny, nz = mask.shape
    padded = jnp.pad(mask, [(0, 0)] * len(batch) + [(0, -nx % _WORD), (0, 0), (0, 0)])
    layers = padded.reshape(*batch, -1, _WORD, ny, nz)
    # Written out: a sum would have every bit of it, as wide as a word, in memory first.
    return functools.reduce(operator.or_, (layers[..., k, :, :].astype(jnp.uint32) << k for k in range(_WORD)))


def _digits(words: UInt32[Array, "*b words ny nz"], nx: int) -> UInt32[Array, "*b nx ny nz"]:
    *batch, _, ny, nz = words.shape
    bits = (words[..., None, :, :] >> jnp.arange(_WORD, dtype=jnp.uint32)[:, None, None]) & 1
    return bits.reshape(*batch, -1, ny, nz)[..., :nx, :, :]


def _unpack(words: UInt32[Array, "*b words ny nz"], nx: int) -> Bool[Array, "*b nx ny nz"]:
    return _digits(words, nx).astype(bool)


def _seed(shape: tuple[int, ...], index: Int32[Array, " 3"]) -> UInt32[Array, "words ny nz"]:
    """One voxel of a grid of this shape, packed; nothing inside the grid for an index outside it."""
    x, y, z = index
    word = cell((-(-shape[0] // _WORD), *shape[1:]), jnp.stack([x // _WORD, y, z]))
    return jnp.where(word, jnp.uint32(1) << (x % _WORD).astype(jnp.uint32), 0)


def _spread(words: UInt32[Array, "*b words ny nz"]) -> UInt32[Array, "*b words ny nz"]:
    """The set with its 6 neighbours."""
    return _spread_along_words(words) | _spread_across(words, -2) | _spread_across(words, -1)


def _spread_cube(words: UInt32[Array, "*b words ny nz"], passable: UInt32[Array, "*b words ny nz"]) -> Array:
    """The set with those of its 26 neighbours that face steps along z, then y, then x lead to.

    Free voxels that only touch at an edge or corner stay apart.
    """
    words = _spread_across(words, -1) & passable
    words = _spread_across(words, -2) & passable
    return _spread_along_words(words) & passable


def _spread_along_words(words: UInt32[Array, "*b words ny nz"]) -> UInt32[Array, "*b words ny nz"]:
    """Along x, the axis inside the words: shift by one bit, and carry the end bits into the next word."""
    up = (words << 1) | _moved(words >> (_WORD - 1), -3, 1)
    down = (words >> 1) | _moved(words << (_WORD - 1), -3, -1)
    return words | up | down


def _spread_across(words: UInt32[Array, "*b words ny nz"], axis: int) -> UInt32[Array, "*b words ny nz"]:
    """Along y or z."""
    return words | _moved(words, axis, 1) | _moved(words, axis, -1)


def _moved(words: UInt32[Array, "*b words ny nz"], axis: int, step: int) -> UInt32[Array, "*b words ny nz"]:
    """All words one place further along an axis, or one back; nothing comes in from beyond the grid."""
    config = [(0, 0, 0)] * words.ndim
    config[axis] = (step, -step, 0)
    return lax.pad(words, jnp.uint32(0), config)


def flood(free: Bool[Array, "nx ny nz"], seed: Int32[Array, " 3"]) -> Bool[Array, "nx ny nz"]:
    """The face-connected component of free voxels that holds `seed`; empty where the seed is not free or outside.

    Args:
        free: free voxels.
        seed: voxel index.
    """
    passable = _pack(free)

    def grow(state: tuple[Array, Array]) -> tuple[Array, Array]:
        before, _ = state
        (after,) = _grown((before,), passable)
        return after, jnp.any(after != before)

    first = grow((_seed(free.shape, seed) & passable, jnp.array(True)))
    words, _ = lax.while_loop(lambda state: state[1], grow, first)
    return _unpack(words, free.shape[0])


def _grown(words: Arrays, passable: UInt32[Array, "words ny nz"]) -> Arrays:
    """Sets grown by many steps: each look at the result waits for the device."""
    return repeat(_STEPS, lambda words: tuple(_spread(each) & passable for each in words), words, fused=2)


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
        first, last: which maps there are; last is static.
        a, b: voxel indices; nothing joins a voxel outside the grid.

    Returns:
        The map, and whether it joins them.
    """
    shape = jax.eval_shape(free, first).shape
    seeds = _seed(shape, a), _seed(shape, b)

    def grow(state: tuple[Arrays, Array, Array, Array]) -> tuple[Arrays, Array, Array, Array]:
        reached, k, _, _ = state
        passable = _pack(free(k))
        before = tuple((words | seed) & passable for words, seed in zip(reached, seeds, strict=True))
        after = _grown(before, passable)
        # All three answers from one reduction.
        grew_a, grew_b = (jnp.where(new != old, bit, 0) for new, old, bit in zip(after, before, (1, 2), strict=True))
        found = lax.reduce_or(grew_a | grew_b | jnp.where(after[0] & after[1] != 0, 4, 0), (0, 1, 2))
        met, filled = found >= 4, found & 3 != 3
        return after, jnp.where(filled & ~met, k + 1, k), met, met | (filled & (k >= last))

    nothing = jnp.zeros_like(seeds[0])
    start = (nothing, nothing), first, jnp.array(False), jnp.array(False)
    _, k, met, _ = lax.while_loop(lambda state: ~state[3], grow, grow(start))
    return jnp.minimum(k, last), met


# Digits of the number of rounds, enough for 12,264 steps; the lowest of them count the eight rounds of a turn.
_DIGITS, _LOW = 12, 3


def geodesic(
    free: Bool[Array, "nx ny nz"], seed: Int32[Array, " 3"]
) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, "nx ny nz"]]:
    """The component of `seed` (as `flood`), and how many steps away each voxel is, walls in the way counted.

    A round is two steps to the 6 neighbours and one to the 26, by which n steps reach a ball of radius 0.94 n at least
    and of 1.1 n at its corners: Euclidean distance inside the component [voxels], about.

    Args:
        free: free voxels.
        seed: voxel index.

    Returns:
        The component, and the steps; 0 outside the component.
    """
    component, steps = _geodesic(free, _seed(free.shape, seed))
    return component, steps


@custom_vmap
def _geodesic(
    free: Bool[Array, "nx ny nz"], seed: UInt32[Array, "words ny nz"]
) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, "nx ny nz"]]:
    """`geodesic` from a packed seed."""
    whole_words = free.shape[0] % (_WORD * slabs.slabs()) == 0
    return _counted_in_slabs(free, seed) if slabs.slabs() > 1 and whole_words else _counted(free, seed, free.shape)


@_geodesic.def_vmap
def _geodesics(size: int, in_batch: list[bool], *masks: Array) -> tuple[tuple[Array, Array], tuple[bool, bool]]:
    """Several maps count the same rounds: under `vmap`, a loop would keep what each of them had, turn by turn."""
    free, seed = one_a_member(size, in_batch, masks)
    return _counted(free, seed, free.shape), (True, True)


def _counted_in_slabs(
    free: Bool[Array, "nx ny nz"], seed: UInt32[Array, "words ny nz"]
) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, "nx ny nz"]]:
    """`_counted`, each device on its slab between words of its neighbours, which last for the 24 steps of a turn."""

    def slab(
        free: Bool[Array, "sx ny nz"], seed: UInt32[Array, "sw ny nz"]
    ) -> tuple[Bool[Array, "sx ny nz"], Int32[Array, "sx ny nz"]]:
        component, steps = _counted(
            slabs.widened(free, _WORD),
            slabs.widened(seed, 1),
            shape,
            lambda words: slabs.refreshed(words, 1),
            slabs.anywhere,
        )
        return slabs.inside(component, _WORD), slabs.inside(steps, _WORD)

    shape = free.shape
    counted = jax.shard_map(
        slab, in_specs=(slabs.SPEC, slabs.SPEC), out_specs=(slabs.SPEC, slabs.SPEC), check_vma=False
    )
    result: tuple[Array, Array] = counted(free, seed)
    return result


def _same(x: Array) -> Array:
    return x


@jax.named_scope("geodesic")
def _counted(
    free: Bool[Array, "*b sx ny nz"],
    seed: UInt32[Array, "*b words ny nz"],
    shape: tuple[int, ...],
    refreshed: Callable[[Array], Array] = _same,
    anywhere: Callable[[Array], Array] = _same,
) -> tuple[Bool[Array, "*b sx ny nz"], Int32[Array, "*b sx ny nz"]]:
    """`geodesic` from a packed seed, for one map or several at a time, or for the part of one that a device holds.

    The rounds are counted in packed Gray code, where counting on flips a single digit: once a round, for the voxels not
    yet reached. Of eight rounds every odd one flips the lowest digit, the second and the sixth the next one, the fourth
    the one after that, the eighth one that has to be looked up.

    Args:
        free: free voxels.
        seed: packed.
        shape: of the whole grid.
        refreshed: of what has been reached, with what the neighbours' part of it holds by now.
        anywhere: whether something is so on any device.
    """
    passable = _pack(free)
    start = seed & passable

    def step(last: Arrays) -> Arrays:
        return last[1], _spread(last[1]) & passable

    def round_(state: Arrays) -> Arrays:
        # What the last rounds reached stays at hand: here, 1, 2 and 3 rounds ago.
        here, ago_1, ago_2, _, second, third = state
        after_one, after_two = repeat(2, step, (here, here), fused=2)
        words = _spread_cube(after_two, passable)
        return words, here, ago_1, ago_2, second | (after_two & ~after_one), third | (words & ~after_two)

    def four_rounds(state: Arrays) -> Arrays:
        before, second, third, lowest, low = state
        fourth, after_third, after_second, after_first, second, third = repeat(
            4, round_, (before, before, before, before, second, third)
        )
        return fourth, second, third, lowest ^ after_first ^ after_third, low ^ ~after_second

    def turn(state: Arrays) -> Arrays:
        # Each look at the result waits for the device: eight rounds between two looks.
        words, *digits, middle, high, turns, _ = state
        half = four_rounds((refreshed(words), *digits))
        whole = four_rounds(half)
        digit = lax.population_count(turns ^ (turns + 1)) - 1
        flipped = lax.dynamic_index_in_dim(high, digit, keepdims=False) ^ ~whole[0]
        high = lax.dynamic_update_index_in_dim(high, flipped, digit, 0)
        return *whole, middle ^ ~half[0], high, turns + 1, anywhere(jnp.any(whole[0] != half[0]))

    def going(state: Arrays) -> Bool[Array, ""]:
        *_, turns, grown = state
        return jnp.asarray(grown & (turns < 2 ** (_DIGITS - _LOW) - 1))

    nothing = jnp.zeros_like(start)
    high = jnp.zeros((_DIGITS - _LOW, *start.shape), jnp.uint32)
    first: Arrays = (start, nothing, nothing, nothing, nothing, nothing, high, jnp.int32(0), jnp.array(True))
    # Turns without a look: even from its middle the corner of an empty grid is as far away as half its diagonal, and a
    # round goes three steps, of 1.1 voxels at most.
    blind = math.ceil(math.hypot(*shape[-3:]) / 2 / (2**_LOW * 3 * 1.1))
    state = lax.fori_loop(0, blind, lambda _, state: turn(state), first)
    words, second, third, lowest, low, middle, high, _, _ = lax.while_loop(going, turn, state)

    def unpacked(words: UInt32[Array, "*b words ny nz"]) -> Int32[Array, "*b nx ny nz"]:
        return _digits(words, free.shape[-3]).astype(jnp.int32)

    rounds = jnp.zeros(free.shape, jnp.int32)
    digit = jnp.zeros_like(start)
    for gray in (*reversed(high), middle, low, lowest):
        digit = digit ^ gray
        rounds = 2 * rounds + unpacked(digit)
    steps = 3 * rounds + unpacked(second) + 2 * unpacked(third) + 1
    component = _unpack(words, free.shape[-3])
    return component, jnp.where(component & ~_unpack(start, free.shape[-3]), steps, 0)
