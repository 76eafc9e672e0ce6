"""A short loop in the form that the device runs best.

On CPU a `lax` loop: in straight-line code XLA fuses one step into the next and computes it anew for each neighbour that
the next reads. Elsewhere straight-line code: there a turn of a loop costs several times what a short step does.
"""

from __future__ import annotations

from collections.abc import Callable

from jax import lax
from jaxtyping import Array

Arrays = tuple[Array, ...]


def repeat(count: int, step: Callable[[Arrays], Arrays], state: Arrays) -> Arrays:
    """`step`, `count` times.

    Args:
        count: static.
        step: maps a tuple of arrays to one of the same shapes and types.
        state: first argument.
    """

    def in_a_loop(*state: Array) -> Arrays:
        return tuple(lax.fori_loop(0, count, lambda _, s: step(s), state))

    def in_a_row(*state: Array) -> Arrays:
        for _ in range(count):
            state = lax.optimization_barrier(step(state))
        return state

    return tuple(lax.platform_dependent(*state, cpu=in_a_loop, default=in_a_row)) if count else state
