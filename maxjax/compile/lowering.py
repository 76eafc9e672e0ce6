"""Everything that is written for the compiler: the same values, in the form that the target runs best.

The *target* is the platform that a program is lowered for: `cpu` or an accelerator. A program asks `by_target`, which
`jit` resolves when it lowers for a platform; `lowering_for` overrides it, so that a test on a CPU can run either form.

Each function is named after what it computes. What XLA makes of the plain form, and what this one gains, is in
docs/performance.md.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Shaped

Arrays = tuple[Array, ...]
Carry = TypeVar("Carry")
Volume = Shaped[Array, "nx ny nz"]
# Per axis, what belongs to the neighbour ahead and to the one behind.
Pairs = tuple[tuple[Volume, Volume], tuple[Volume, Volume], tuple[Volume, Volume]]

# Matrix products in full float32. On GPU the default rounds their factors to ten bits (TF32): decimetres at 100 m.
matmul = functools.partial(jnp.matmul, precision="highest")


def rotate(rotation: Float[Array, "*n 3 3"], vectors: Float[Array, "*m 3"]) -> Float[Array, "*k 3"]:
    """R v, term by term. XLA merges small matrix products of one factor, and may then find none for a GPU, and fail."""
    return jnp.sum(rotation * vectors[..., None, :], axis=-1)


# None: that of the device. A context that `jit` knows of: what was traced for one target is not used for another.
_TARGET = jax.make_user_context(None)


def lowering_for(platform: str) -> contextlib.AbstractContextManager[None]:
    """Choose the form for `platform` (`cpu`, `gpu`) in everything that is called inside."""
    chosen: contextlib.AbstractContextManager[None] = _TARGET(platform)
    return chosen


def target() -> str:
    """The platform that programs are lowered for: of JAX's default device, unless `lowering_for` says otherwise."""
    return _TARGET.value or jax.default_backend()


def by_target(*operands: Any, cpu: Callable[..., Any], default: Callable[..., Any]) -> Any:
    """cpu(*operands) on a CPU, default(*operands) on an accelerator: the same values."""
    chosen = _TARGET.value
    if chosen is None:
        return lax.platform_dependent(*operands, cpu=cpu, default=default)
    return (cpu if chosen == "cpu" else default)(*operands)


def in_host_memory(array: Array) -> Array:
    """The array in the host's own memory, from which it is read without another copy."""
    moved: Array = jax.device_put(array, jax.memory.Space.Host)
    return moved


# Steps that an accelerator takes in straight-line code: of more, programs grow, and gain nothing.
_STRAIGHT = 8


def repeat(count: int, step: Callable[[Carry], Carry], state: Carry, fused: int = 1) -> Carry:
    """`step`, `count` times: a loop on CPU; on an accelerator straight-line code, of many steps some a turn of a loop.

    Args:
        count: static.
        step: maps a pytree of arrays to one of the same structure, shapes and types.
        state: first argument.
        fused: steps of the straight-line code that may become one kernel. Static.
    """

    def loop(state: Carry) -> Carry:
        last: Carry = lax.fori_loop(0, count, lambda _, s: step(s), state)
        return last

    def straight(state: Carry, steps: int) -> Carry:
        for k in range(steps):
            state = step(state)
            if (k + 1) % fused == 0 or k + 1 == steps:
                state = lax.optimization_barrier(state)
        return state

    def in_turns(state: Carry) -> Carry:
        turns, rest = divmod(count, _STRAIGHT)
        if turns > 1:
            state = lax.fori_loop(0, turns, lambda _, s: straight(s, _STRAIGHT), state)
            return straight(state, rest)
        return straight(state, count)

    if not count:
        return state
    last: Carry = by_target(state, cpu=loop, default=in_turns)
    return last


def once(*arrays: Array) -> Any:
    """The arrays themselves, each element computed once, and all of them together: nothing that reads them is fused.

    One array is returned as it is, several as a tuple.
    """
    found = lax.optimization_barrier(arrays)
    return found[0] if len(arrays) == 1 else found


def in_this_turn(constants: Carry, carried: Any) -> Carry:
    """Constants of a loop, such that what is computed from them stays in the loop: a turn that is not taken costs none.

    Args:
        constants: what the turns of a loop share, a pytree of arrays.
        carried: any array of the loop carry.
    """
    kept: Carry
    kept, _ = lax.optimization_barrier((constants, carried))
    return kept


def materialise(x: Array) -> Array:
    """The array itself, written to memory before anything reads it; on an accelerator it is left to XLA.

    Stronger than `once`, which XLA drops on a CPU outside of loops: it does not fuse across a branch.

    Args:
        x: whose first element is not below −1: that is the branch's condition, which XLA cannot evaluate.
    """

    def behind_a_branch(x: Array) -> Array:
        expected = ~(x.reshape(-1)[0].astype(jnp.float32) < -1)
        return jnp.asarray(lax.cond(expected, lambda x: x, jnp.zeros_like, x))

    return jnp.asarray(by_target(x, cpu=behind_a_branch, default=lambda x: x))


# Parts of a volume whose maxima are taken side by side.
_PARTS = 8


def maximum(function: Callable[..., Array], *volumes: Array) -> Array:
    """The largest value of an elementwise function of volumes.

    Args:
        function: of arrays of any shape, elementwise.
        volumes: its arguments, of one shape.
    """

    def folded(*volumes: Array) -> Array:
        size = volumes[0].shape[0]
        cuts = [k * (size // _PARTS) for k in range(_PARTS + 1)]
        pieces = ([v[a:b] for v in volumes] for a, b in itertools.pairwise(cuts))
        fold = functools.reduce(jnp.maximum, (function(*piece) for piece in pieces))
        return jnp.maximum(
            jnp.max(fold, initial=-jnp.inf), jnp.max(function(*(v[cuts[-1] :] for v in volumes)), initial=-jnp.inf)
        )

    def whole(*volumes: Array) -> Array:
        return jnp.max(function(*volumes))

    return jnp.asarray(by_target(*volumes, cpu=folded, default=whole))


def first_maximum(score: Float[Array, " k"], *rows: Float[Array, "k 3"]) -> Arrays:
    """The largest of a few scores, the first of equals, and its row of each array: elementwise, without a look-up."""
    best = (score[0], *(row[0] for row in rows))
    for k in range(1, score.shape[0]):
        better = score[k] > best[0]
        best = tuple(jnp.where(better, new[k], old) for new, old in zip((score, *rows), best, strict=True))
    return best


# Numbers of one turn of a sum.
_STRETCH = 16


def total(terms: Callable[[Int32[Array | np.ndarray, " h"]], Any], count: int, needed: Int32[Array, ""]) -> Any:
    """Sums over the numbers 0 … count − 1; of truth values it is their count.

    Args:
        terms: numbers ↦ the term of each on the last axis, or a pytree of such arrays.
        count: static.
        needed: from this number on all terms are zero.
    """

    def summed(numbers: Int32[Array | np.ndarray, " h"]) -> Any:
        return jax.tree.map(lambda term: jnp.sum(term, axis=-1), terms(numbers))

    def together() -> Any:
        return summed(np.arange(count, dtype=np.int32))

    def in_turns() -> Any:
        stretch = jnp.arange(_STRETCH, dtype=jnp.int32)
        zero = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), jax.eval_shape(summed, stretch))
        turns = (jnp.minimum(needed, count) + _STRETCH - 1) // _STRETCH
        return lax.fori_loop(
            0, turns, lambda k, sums: jax.tree.map(jnp.add, sums, summed(k * _STRETCH + stretch)), zero
        )

    return by_target(cpu=in_turns, default=together)


# So few terms an accelerator takes one by one.
_FEW = 8


def every(
    holds: Callable[[Int32[Array | np.ndarray, " h"]], Bool[Array, "*k h"]], count: int, needed: Int32[Array, ""]
) -> Bool[Array, "*k"]:
    """Whether a condition holds for all of the numbers 0 … count − 1.

    Args:
        holds: numbers ↦ whether it holds for each, on the last axis.
        count: static.
        needed: it holds from this number on.
    """
    numbers = np.arange(count, dtype=np.int32)

    def together() -> Bool[Array, "*k"]:
        return jnp.all(holds(numbers), axis=-1)

    def one_by_one() -> Bool[Array, "*k"]:
        return functools.reduce(operator.and_, (holds(numbers[k : k + 1])[..., 0] for k in numbers))

    if count > _FEW:
        return jnp.asarray(total(lambda numbers: ~holds(numbers), count, needed) == 0)
    found: Bool[Array, "*k"] = by_target(cpu=together, default=one_by_one)
    return found


# Of ways of one edge, before ways to the end are joined: by then they take 2³ edges at a time.
_DOUBLINGS = 3


def costs_to_last(edges: Float[Array, "n n"]) -> Float[Array, " n"]:
    """What the cheapest way from each of n points to the last one costs.

    Args:
        edges: what an edge from point i to point j costs; infinite unless i < j.
    """
    n = edges.shape[0]

    def point_by_point(edges: Float[Array, "n n"]) -> Float[Array, " n"]:
        def one(costs: Float[Array, " n"], i: Int32[Array, ""]) -> tuple[Float[Array, " n"], None]:
            return costs.at[i].set(jnp.min(edges[i] + costs)), None

        last = jnp.where(np.arange(n) == n - 1, 0, jnp.inf).astype(edges.dtype)
        costs, _ = lax.scan(one, last, jnp.arange(n - 2, -1, -1, dtype=jnp.int32))
        return costs

    def all_at_a_time(edges: Float[Array, "n n"]) -> Float[Array, " n"]:
        # The best ways of at most two edges, then four, eight; then those to the end, by eight edges more a turn.
        far = jnp.where(np.eye(n, dtype=bool), 0, edges)
        for _ in range(_DOUBLINGS):
            far = jnp.min(far[:, :, None] + far[None], axis=1)
        return repeat(-(-n // 2**_DOUBLINGS) - 1, lambda last: jnp.min(far + last[None], axis=1), far[:, -1])

    return jnp.asarray(by_target(edges, cpu=point_by_point, default=all_at_a_time))


def in_block(
    function: Callable[..., Any], volumes: Any, centre: Int32[Array, " 3"], reach: int, *arguments: Any
) -> Any:
    """function(volumes, corner, *arguments), which reads the volumes near a voxel alone.

    Args:
        function: of a pytree of volumes and of the voxel of the map that is their first one; what it makes of them is
            the same whatever lies further than `reach` from the centre.
        volumes: a pytree of volumes of one shape.
        centre: voxel inside them.
        reach: voxels to each side. Static.
        arguments: arrays.
    """

    def block(volumes: Any, centre: Int32[Array, " 3"], *arguments: Any) -> Any:
        shape = jax.tree.leaves(volumes)[0].shape
        sizes = tuple(min(2 * reach + 1, n) for n in shape)
        corner = jnp.clip(centre - reach, 0, jnp.asarray(shape, jnp.int32) - jnp.asarray(sizes, jnp.int32))
        near = jax.tree.map(lambda volume: lax.dynamic_slice(volume, tuple(corner), sizes), volumes)
        return function(near, corner, *arguments)

    def whole(volumes: Any, _: Int32[Array, " 3"], *arguments: Any) -> Any:
        return function(volumes, jnp.zeros(3, jnp.int32), *arguments)

    return by_target(volumes, centre, *arguments, cpu=block, default=whole)


def shift_axis(array: Shaped[Array, "..."], axis: int, step: int, beyond: float | int = 0) -> Shaped[Array, "..."]:
    """The values `step` places further along an axis; `beyond` (static) outside."""
    config = [(0, 0, 0)] * array.ndim
    config[axis] = (-step, step, 0)
    return lax.pad(array, jnp.asarray(beyond, array.dtype), config)


def neighbours(array: Volume, beyond: float | int = 0) -> Pairs:
    """Per axis, the values one voxel ahead and one behind; `beyond` (static) outside the grid."""

    def of_one_copy(array: Volume) -> Pairs:
        around = once(lax.pad(array, jnp.asarray(beyond, array.dtype), [(1, 1, 0)] * 3))

        def view(axis: int, start: int) -> Volume:
            corner = [1, 1, 1]
            corner[axis] = start
            return lax.slice(around, corner, [a + n for a, n in zip(corner, array.shape, strict=True)])

        x, y, z = ((view(axis, 2), view(axis, 0)) for axis in range(3))
        return x, y, z

    def of_itself(array: Volume) -> Pairs:
        x, y, z = ((shift_axis(array, axis, 1, beyond), shift_axis(array, axis, -1, beyond)) for axis in range(3))
        return x, y, z

    found: Pairs = by_target(array, cpu=of_one_copy, default=of_itself)
    return found
