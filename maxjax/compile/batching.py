"""Batches: loops whose members need different numbers of turns, and batching rules."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool

Carry = TypeVar("Carry")
Result = TypeVar("Result")
Leaves = list[Any]


def settle(
    going: Callable[[Any, Carry], Bool[Array, ""]],
    step: Callable[[Any, Carry], Carry],
    data: Any,
    carry: Carry,
    *,
    at_once: int,
) -> Carry:
    """`lax.while_loop` for members of a batch that need different numbers of turns.

    Under `vmap`, `lax.while_loop` computes every turn for all members until the last one is done. Here each turn is
    taken by a part of the batch, gathered from those that still need one; a member that is done costs nothing more.
    What each member gets is the same.

    Args:
        going: (data, carry) ↦ whether to take another turn. Like `step`, it may close over nothing that is batched.
        step: (data, carry) ↦ carry.
        data: what they read, a pytree of arrays.
        carry: the loop carry, which they change, a pytree of arrays.
        at_once: members that take a turn at a time: the fewer, the less is computed for those that are done, and the
            less a device has to do at a time. Static.
    """
    # Leaves, not trees, cross the border of `custom_vmap`: there some have a batch axis and some have not, which a
    # dataclass need not allow.
    inputs, data_tree = jax.tree.flatten(data)
    first, carry_tree = jax.tree.flatten(carry)
    loop = _Loop(*_of_leaves(going, step, data_tree, carry_tree), at_once)
    run = custom_vmap(loop.of_one)
    run.def_vmap(loop.of_batch)
    result: Carry = jax.tree.unflatten(carry_tree, run(inputs, first))
    return result


def settle_batch(
    going: Callable[[Any, Carry], Bool[Array, ""]],
    step: Callable[[Any, Carry], Carry],
    data: Any,
    carry: Carry,
    *,
    at_once: int,
) -> Carry:
    """`settle` under `vmap`, of arrays that all have the batch's axis: a single member is not traced beside it."""
    inputs, data_tree = jax.tree.flatten(data)
    first, carry_tree = jax.tree.flatten(carry)
    loop = _Loop(*_of_leaves(going, step, data_tree, carry_tree), at_once)
    found, _ = loop.of_batch(len(first[0]), [[True] * len(inputs), [True] * len(first)], inputs, first)
    result: Carry = jax.tree.unflatten(carry_tree, found)
    return result


def _of_leaves(
    going: Callable[[Any, Any], Bool[Array, ""]], step: Callable[[Any, Any], Any], data_tree: Any, carry_tree: Any
) -> tuple[Callable[[Leaves, Leaves], Bool[Array, ""]], Callable[[Leaves, Leaves], Leaves]]:
    """The condition and the step of a loop, of the leaves of its data and of its carry."""

    def on(inputs: Leaves, leaves: Leaves) -> Bool[Array, ""]:
        return going(jax.tree.unflatten(data_tree, inputs), jax.tree.unflatten(carry_tree, leaves))

    def turn(inputs: Leaves, leaves: Leaves) -> Leaves:
        return jax.tree.leaves(step(jax.tree.unflatten(data_tree, inputs), jax.tree.unflatten(carry_tree, leaves)))

    return on, turn


@dataclasses.dataclass(frozen=True)
class _Loop:
    """The loop of `settle` on the leaves of its data (`inputs`) and of its carry (`leaves`)."""

    on: Callable[[Leaves, Leaves], Bool[Array, ""]]
    turn: Callable[[Leaves, Leaves], Leaves]
    at_once: int

    def of_one(self, inputs: Leaves, leaves: Leaves) -> Leaves:
        settled: Leaves = lax.while_loop(
            functools.partial(self.on, inputs), functools.partial(self.turn, inputs), leaves
        )
        return settled

    def of_batch(
        self, size: int, in_batch: list[list[bool]], inputs: Leaves, leaves: Leaves
    ) -> tuple[Leaves, list[bool]]:
        own, varying = in_batch
        axes = ([0 if batched else None for batched in own], 0)
        part = min(size, self.at_once)

        def unfinished(leaves: Leaves) -> Bool[Array, " b"]:
            return jnp.asarray(jax.vmap(self.on, axes)(inputs, leaves))

        def take_turn(leaves: Leaves) -> Leaves:
            with jax.named_scope("settle"):
                more = unfinished(leaves)
                # Those that go on, first come first served; what fills up the part is done, and stays as it is.
                chosen = jnp.argsort(~more, stable=True)[:part]
                some = [x[chosen] if batched else x for x, batched in zip(inputs, own, strict=True)]
                before = [x[chosen] for x in leaves]
            after = jax.vmap(self.turn, axes)(some, before)
            with jax.named_scope("settle"):
                kept = more[chosen]
                pairs = zip(after, before, strict=True)
                changed = [jnp.where(kept.reshape(-1, *[1] * (old.ndim - 1)), new, old) for new, old in pairs]
                return [x.at[chosen].set(new) for x, new in zip(leaves, changed, strict=True)]

        leaves = _one_a_member(size, varying, leaves)
        leaves = lax.while_loop(lambda leaves: jnp.any(unfinished(leaves)), take_turn, leaves)
        return leaves, [True] * len(leaves)


def with_batch_rule(single: Callable[..., Result], batch: Callable[..., Result]) -> Callable[..., Result]:
    """`single`, which under `vmap` is `batch`: of the same arrays, each with a leading axis.

    Args:
        single: (*arrays) ↦ a pytree of arrays.
        batch: the same for several members; what members share is broadcast before it is called.
    """
    run = custom_vmap(single)

    @run.def_vmap
    def many(size: int, in_batch: list[bool], *arrays: Array) -> tuple[Result, Any]:
        found = batch(*_one_a_member(size, in_batch, arrays))
        return found, jax.tree.map(lambda _: True, found)

    result: Callable[..., Result] = run
    return result


def _one_a_member(size: int, in_batch: Sequence[bool], arrays: Sequence[Any]) -> list[Array]:
    """Arrays with a batch axis each, for a rule of `custom_vmap`: what the members of a batch share is broadcast."""
    pairs = zip(arrays, in_batch, strict=True)
    return [x if batched else jnp.broadcast_to(x, (size, *jnp.shape(x))) for x, batched in pairs]
