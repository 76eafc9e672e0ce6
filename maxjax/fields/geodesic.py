"""Distance inside a component, from a seed, counted by floods: of steps, or of what steps cost.

    r(x) = min over ways from the seed of the sum of tolls,   toll = n rounded, 1 to 4

A round is two steps to the 6 neighbours and one to the 26, by which n steps reach a ball of radius 0.94 n at least and
of 1.1 n at its corners: Euclidean distance inside the component [voxels], about. A voxel of toll k is reached k steps
after its first neighbour; on the step to the 26, only voxels of toll 1 are passed on the way to an edge or a corner.
Hence every voxel but the seed has a face neighbour that is reached before it, if only earlier in the same step.

The sets are packed, 32 voxels to a word (`fields.packed`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Shaped, UInt32

from maxjax.compile import sharded_volume as slabs
from maxjax.compile.batching import with_batch_rule
from maxjax.compile.lowering import repeat
from maxjax.fields import packed

# The largest toll.
DEAREST = 4
Toll = Shaped[Array, "*b nx ny nz"]
Masks = tuple[UInt32[Array, "*b words ny nz"], ...]

# Digits of the number of rounds, enough for 3 million steps; the lowest of them count four rounds.
_DIGITS, _LOW = 20, 2
# Fours of rounds between two looks at what was reached, each a synchronisation.
_FOURS = 2


def geodesic(
    free: Bool[Array, "nx ny nz"], seed: Int32[Array, " 3"], price: Float[Array, "nx ny nz"] | None = None
) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, "nx ny nz"]]:
    """The component of `seed` (as `connectivity.flood`), and how many steps away each voxel is, walls counted.

    Args:
        free: free voxels.
        seed: voxel index.
        price: n ≥ 1, what a voxel costs, of which `DEAREST` is the most that counts; None: 1 everywhere.

    Returns:
        The component, and the steps; 0 outside the component.
    """
    toll = free
    if price is not None:
        # A price that is not a number counts as 1.
        toll = jnp.clip(jnp.round(jnp.where(price > 1, price, 1)), 1, DEAREST)
        toll = jnp.where(free, toll, 0).astype(jnp.uint8)
    component, steps = with_batch_rule(_geodesic, _geodesics)(toll, packed.single(free.shape, seed))
    return component, steps


def _geodesic(toll: Toll, seed: UInt32[Array, "words ny nz"]) -> tuple[Array, Array]:
    """`geodesic` from a packed seed."""
    whole_words = toll.shape[0] % (packed.WORD * slabs.slabs()) == 0
    return _counted_in_slabs(toll, seed) if slabs.slabs() > 1 and whole_words else _counted(toll, seed)


def _geodesics(toll: Toll, seed: UInt32[Array, "b words ny nz"]) -> tuple[Array, Array]:
    """The same of several maps, which count the same rounds: `vmap` of a loop would select for each, turn by turn."""
    return _counted(toll, seed)


def _counted_in_slabs(toll: Toll, seed: UInt32[Array, "words ny nz"]) -> tuple[Array, Array]:
    """`_counted`, each device on its slab between words of its neighbours, which last for the 24 steps of a turn."""

    def slab(toll: Toll, seed: UInt32[Array, "sw ny nz"]) -> tuple[Array, Array]:
        component, steps = _counted(
            slabs.add_halo(toll, packed.WORD),
            slabs.add_halo(seed, 1),
            lambda words: slabs.refresh_halo(words, 1),
            slabs.anywhere,
        )
        return slabs.inside(component, packed.WORD), slabs.inside(steps, packed.WORD)

    counted = jax.shard_map(
        slab, in_specs=(slabs.SPEC, slabs.SPEC), out_specs=(slabs.SPEC, slabs.SPEC), check_vma=False
    )
    result: tuple[Array, Array] = counted(toll, seed)
    return result


def _same(x: Array) -> Array:
    return x


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _RoundCarry:
    """Carry of four rounds.

    Attributes:
        words: reached so far.
        second, third: of these, the voxels first reached by the second and by the third step of a round.
        lowest, low: the two lowest digits of the number of rounds, in Gray code.
        waiting: voxels that are on the way, by toll and by the steps that they still take (`_advance`).
    """

    words: UInt32[Array, "*b words ny nz"]
    second: UInt32[Array, "*b words ny nz"]
    third: UInt32[Array, "*b words ny nz"]
    lowest: UInt32[Array, "*b words ny nz"]
    low: UInt32[Array, "*b words ny nz"]
    waiting: tuple[UInt32[Array, "*b words ny nz"], ...]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Recent:
    """Carry of single rounds: what has been reached now, and one to three rounds ago; the rest as above."""

    now: UInt32[Array, "*b words ny nz"]
    ago_1: UInt32[Array, "*b words ny nz"]
    ago_2: UInt32[Array, "*b words ny nz"]
    ago_3: UInt32[Array, "*b words ny nz"]
    second: UInt32[Array, "*b words ny nz"]
    third: UInt32[Array, "*b words ny nz"]
    waiting: tuple[UInt32[Array, "*b words ny nz"], ...]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _CountCarry:
    """Carry of fours of rounds.

    Attributes:
        rounds: after them.
        high: the digits above the two lowest, lowest first.
        fours: of rounds, taken.
        grown: whether the last of them reached more.
    """

    rounds: _RoundCarry
    high: UInt32[Array, "d *b words ny nz"]
    fours: Int32[Array, ""]
    grown: Bool[Array, ""]


@jax.named_scope("geodesic")
def _counted(
    toll: Toll,
    seed: UInt32[Array, "*b words ny nz"],
    refreshed: Callable[[Array], Array] = _same,
    anywhere: Callable[[Array], Array] = _same,
) -> tuple[Array, Array]:
    """`geodesic` from a packed seed, for one map or several at a time, or for the part of one that a device holds.

    The rounds are counted in packed Gray code, where counting on flips a single digit: once a round, for the voxels not
    yet reached. Of four rounds every odd one flips the lowest digit, the second the next one, the fourth one that has
    to be looked up.

    Args:
        toll: steps that a voxel takes, 0 in obstacles; or, all of them 1, whether it is free.
        seed: packed.
        refreshed: of what has been reached, with what the neighbours' part of it holds by now.
        anywhere: whether something is so on any device.
    """
    # passable[k]: toll above k.
    passable = tuple(packed.pack(toll > k) for k in range(1 if toll.dtype == bool else DEAREST))
    start = seed & passable[0]

    def four(_: Array, carry: _CountCarry) -> _CountCarry:
        after = _four_rounds(passable, carry.rounds)
        digit = lax.population_count(carry.fours ^ (carry.fours + 1)) - 1
        flipped = lax.dynamic_index_in_dim(carry.high, digit, keepdims=False) ^ ~after.words
        high = lax.dynamic_update_index_in_dim(carry.high, flipped, digit, 0)
        return _CountCarry(after, high, carry.fours + 1, jnp.any(after.words != carry.rounds.words))

    def turn(carry: _CountCarry) -> _CountCarry:
        rounds = carry.rounds
        waiting = tuple(map(refreshed, rounds.waiting))
        rounds = dataclasses.replace(rounds, words=refreshed(rounds.words), waiting=waiting)
        carry = lax.fori_loop(0, _FOURS, four, dataclasses.replace(carry, rounds=rounds))
        return dataclasses.replace(carry, grown=anywhere(carry.grown))

    def going(carry: _CountCarry) -> Bool[Array, ""]:
        return jnp.asarray(carry.grown & (carry.fours < 2 ** (_DIGITS - _LOW) - _FOURS))

    nothing = jnp.zeros_like(start)
    high = jnp.zeros((_DIGITS - _LOW, *start.shape), jnp.uint32)
    rounds = _RoundCarry(start, nothing, nothing, nothing, nothing, _nobody(passable))
    last = lax.while_loop(going, turn, _CountCarry(rounds, high, jnp.int32(0), jnp.array(True)))
    steps = _steps(last, toll.shape[-3])
    component = packed.unpack(last.rounds.words, toll.shape[-3])
    return component, jnp.where(component & ~packed.unpack(start, toll.shape[-3]), steps, 0)


def _four_rounds(passable: Masks, carry: _RoundCarry) -> _RoundCarry:
    """Four rounds of `geodesic`, and what they flip of the two lowest digits."""
    cheap = passable[0] if len(passable) == 1 else passable[0] & ~passable[1]

    def step(state: tuple[Array, Array, Masks]) -> tuple[Array, Array, Masks]:
        _, words, waiting = state
        return words, *_advance(passable, words, packed.spread(words), waiting)

    def round_(recent: _Recent) -> _Recent:
        first = recent.now, recent.now, recent.waiting
        after_one, after_two, waiting = repeat(2, step, first, fused=2)
        words, waiting = _advance(passable, after_two, packed.spread_cube(after_two, cheap), waiting)
        second, third = recent.second | (after_two & ~after_one), recent.third | (words & ~after_two)
        return _Recent(words, recent.now, recent.ago_1, recent.ago_2, second, third, waiting)

    now = carry.words
    recent = repeat(4, round_, _Recent(now, now, now, now, carry.second, carry.third, carry.waiting))
    return _RoundCarry(
        words=recent.now,
        second=recent.second,
        third=recent.third,
        lowest=carry.lowest ^ recent.ago_3 ^ recent.ago_1,
        low=carry.low ^ ~recent.ago_2,
        waiting=recent.waiting,
    )


def _nobody(passable: Masks) -> Masks:
    """Nothing on the way: a voxel of toll k waits for k − 1 steps, one set a step."""
    return (jnp.zeros_like(passable[0]),) * (len(passable) * (len(passable) - 1) // 2)


def _advance(
    passable: Masks, words: UInt32[Array, "*b words ny nz"], touched: UInt32[Array, "*b words ny nz"], waiting: Masks
) -> tuple[UInt32[Array, "*b words ny nz"], Masks]:
    """One step: what is reached after it, and what is on the way.

    Args:
        passable: voxels of a toll above 0, 1, …
        words: reached before.
        touched: these and their neighbours.
        waiting: for toll 2, 3, …, sets from the one that arrives now to the one that was touched last.
    """
    after = words
    still: list[UInt32[Array, "*b words ny nz"]] = []
    for toll, mask in enumerate(passable, start=1):
        dearer = passable[toll] if toll < len(passable) else jnp.zeros_like(mask)
        queue = (*waiting[: toll - 1], touched & mask & ~dearer)
        waiting = waiting[toll - 1 :]
        after = after | queue[0]
        still += queue[1:]
    return after, tuple(still)


def _steps(counted: _CountCarry, nx: int) -> Int32[Array, "*b nx ny nz"]:
    """The number of steps in Gray code as a number, for each voxel reached."""

    def unpacked(words: UInt32[Array, "*b words ny nz"]) -> Int32[Array, "*b nx ny nz"]:
        return packed.digits(words, nx).astype(jnp.int32)

    def read(gray: Array, so_far: tuple[Array, Array]) -> tuple[Array, Array]:
        digit, rounds = so_far[0] ^ gray, so_far[1]
        return digit, 2 * rounds + unpacked(digit)

    last = counted.rounds
    nothing = jnp.zeros_like(last.words)
    # The digits above those of the number of fours are zero.
    used = 32 - lax.clz(counted.fours)
    so_far = lax.fori_loop(
        0,
        used,
        lambda k, so_far: read(counted.high[used - 1 - k], so_far),
        (nothing, jnp.zeros_like(unpacked(nothing))),
    )
    for gray in (last.low, last.lowest):
        so_far = read(gray, so_far)
    rounds: Array = so_far[1]
    return 3 * rounds + unpacked(last.second) + 2 * unpacked(last.third) + 1
