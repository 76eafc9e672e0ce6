"""Flood fill: the free voxels joined to a seed through faces.

    R ← R ∪ (free ∩ {6-neighbours of R})   until nothing changes

The sets are packed, 32 voxels to a word (`fields.packed`). Faces are what the field conducts through; a legal diagonal
move needs every voxel that it touches to be free, hence joins nothing that faces do not.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int32, UInt32

from maxjax.core import slabs
from maxjax.core.batching import batched_by
from maxjax.core.lowering import Arrays, repeat
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


# Digits of the number of rounds, enough for 3 million steps; the lowest of them count the eight rounds of a turn.
_DIGITS, _LOW = 20, 3


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
    component, steps = batched_by(_geodesic, _geodesics)(free, packed.single(free.shape, seed))
    return component, steps


def _geodesic(
    free: Bool[Array, "nx ny nz"], seed: UInt32[Array, "words ny nz"]
) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, "nx ny nz"]]:
    """`geodesic` from a packed seed."""
    whole_words = free.shape[0] % (packed.WORD * slabs.slabs()) == 0
    return _counted_in_slabs(free, seed) if slabs.slabs() > 1 and whole_words else _counted(free, seed, free.shape)


def _geodesics(
    free: Bool[Array, "b nx ny nz"], seed: UInt32[Array, "b words ny nz"]
) -> tuple[Bool[Array, "b nx ny nz"], Int32[Array, "b nx ny nz"]]:
    """The same of several maps, which count the same rounds: `vmap` of a loop would select for each, turn by turn."""
    return _counted(free, seed, free.shape)


def _counted_in_slabs(
    free: Bool[Array, "nx ny nz"], seed: UInt32[Array, "words ny nz"]
) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, "nx ny nz"]]:
    """`_counted`, each device on its slab between words of its neighbours, which last for the 24 steps of a turn."""

    def slab(
        free: Bool[Array, "sx ny nz"], seed: UInt32[Array, "sw ny nz"]
    ) -> tuple[Bool[Array, "sx ny nz"], Int32[Array, "sx ny nz"]]:
        component, steps = _counted(
            slabs.widened(free, packed.WORD),
            slabs.widened(seed, 1),
            shape,
            lambda words: slabs.refreshed(words, 1),
            slabs.anywhere,
        )
        return slabs.inside(component, packed.WORD), slabs.inside(steps, packed.WORD)

    shape = free.shape
    counted = jax.shard_map(
        slab, in_specs=(slabs.SPEC, slabs.SPEC), out_specs=(slabs.SPEC, slabs.SPEC), check_vma=False
    )
    result: tuple[Array, Array] = counted(free, seed)
    return result


def _same(x: Array) -> Array:
    return x


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _RoundCarry:
    """What every four rounds change.

    Attributes:
        words: reached so far.
        second, third: of these, the voxels first reached by the second and by the third step of a round.
        lowest, low: the two lowest digits of the number of rounds, in Gray code.
    """

    words: UInt32[Array, "*b words ny nz"]
    second: UInt32[Array, "*b words ny nz"]
    third: UInt32[Array, "*b words ny nz"]
    lowest: UInt32[Array, "*b words ny nz"]
    low: UInt32[Array, "*b words ny nz"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Recent:
    """Carry of single rounds: what has been reached now, and one to three rounds ago; `second`, `third` as above."""

    now: UInt32[Array, "*b words ny nz"]
    ago_1: UInt32[Array, "*b words ny nz"]
    ago_2: UInt32[Array, "*b words ny nz"]
    ago_3: UInt32[Array, "*b words ny nz"]
    second: UInt32[Array, "*b words ny nz"]
    third: UInt32[Array, "*b words ny nz"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _CountCarry:
    """Carry of the turns of eight rounds.

    Attributes:
        rounds: after them.
        middle: the third digit.
        high: the digits above, lowest first.
        turns: taken.
        grown: whether the last four rounds reached more.
    """

    rounds: _RoundCarry
    middle: UInt32[Array, "*b words ny nz"]
    high: UInt32[Array, "d *b words ny nz"]
    turns: Int32[Array, ""]
    grown: Bool[Array, ""]


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
    passable = packed.pack(free)
    start = seed & passable
    half = functools.partial(_four_rounds, passable)

    def turn(carry: _CountCarry) -> _CountCarry:
        # Each look at the result is a synchronisation: eight rounds between two looks.
        middle = half(dataclasses.replace(carry.rounds, words=refreshed(carry.rounds.words)))
        whole = half(middle)
        digit = lax.population_count(carry.turns ^ (carry.turns + 1)) - 1
        flipped = lax.dynamic_index_in_dim(carry.high, digit, keepdims=False) ^ ~whole.words
        return _CountCarry(
            rounds=whole,
            middle=carry.middle ^ ~middle.words,
            high=lax.dynamic_update_index_in_dim(carry.high, flipped, digit, 0),
            turns=carry.turns + 1,
            grown=anywhere(jnp.any(whole.words != middle.words)),
        )

    def going(carry: _CountCarry) -> Bool[Array, ""]:
        return jnp.asarray(carry.grown & (carry.turns < 2 ** (_DIGITS - _LOW) - 1))

    nothing = jnp.zeros_like(start)
    high = jnp.zeros((_DIGITS - _LOW, *start.shape), jnp.uint32)
    rounds = _RoundCarry(start, nothing, nothing, nothing, nothing)
    # Turns that need no look: even from its middle the corner of an empty grid is as far away as half its diagonal, and
    # a round goes three steps, of 1.1 voxels at most.
    certain = math.ceil(math.hypot(*shape[-3:]) / 2 / (2**_LOW * 3 * 1.1))
    first = _CountCarry(rounds, nothing, high, jnp.int32(0), jnp.array(True))
    last = lax.while_loop(going, turn, lax.fori_loop(0, certain, lambda _, carry: turn(carry), first))
    steps = _steps(last, free.shape[-3])
    component = packed.unpack(last.rounds.words, free.shape[-3])
    return component, jnp.where(component & ~packed.unpack(start, free.shape[-3]), steps, 0)


def _four_rounds(passable: UInt32[Array, "*b words ny nz"], carry: _RoundCarry) -> _RoundCarry:
    """Four rounds of `geodesic`, and what they flip of the two lowest digits."""

    def step(last: tuple[Array, Array]) -> tuple[Array, Array]:
        return last[1], packed.spread(last[1]) & passable

    def round_(recent: _Recent) -> _Recent:
        after_one, after_two = repeat(2, step, (recent.now, recent.now), fused=2)
        words = packed.spread_cube(after_two, passable)
        second, third = recent.second | (after_two & ~after_one), recent.third | (words & ~after_two)
        return _Recent(words, recent.now, recent.ago_1, recent.ago_2, second, third)

    now = carry.words
    recent = repeat(4, round_, _Recent(now, now, now, now, carry.second, carry.third))
    return _RoundCarry(
        words=recent.now,
        second=recent.second,
        third=recent.third,
        lowest=carry.lowest ^ recent.ago_3 ^ recent.ago_1,
        low=carry.low ^ ~recent.ago_2,
    )


def _steps(counted: _CountCarry, nx: int) -> Int32[Array, "*b nx ny nz"]:
    """The number of steps in Gray code as a number, for each voxel reached."""

    def unpacked(words: UInt32[Array, "*b words ny nz"]) -> Int32[Array, "*b nx ny nz"]:
        return packed.digits(words, nx).astype(jnp.int32)

    def read(gray: Array, so_far: tuple[Array, Array]) -> tuple[Array, Array]:
        digit, rounds = so_far[0] ^ gray, so_far[1]
        return digit, 2 * rounds + unpacked(digit)

    last = counted.rounds
    nothing = jnp.zeros_like(last.words)
    # The digits above those of the number of turns are zero.
    used = 32 - lax.clz(counted.turns)
    so_far = lax.fori_loop(
        0,
        used,
        lambda k, so_far: read(counted.high[used - 1 - k], so_far),
        (nothing, jnp.zeros_like(unpacked(nothing))),
    )
    for gray in (counted.middle, last.low, last.lowest):
        so_far = read(gray, so_far)
    rounds: Array = so_far[1]
    return 3 * rounds + unpacked(last.second) + 2 * unpacked(last.third) + 1
