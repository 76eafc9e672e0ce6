"""Everything that is written for the compiler: the same values, in the form that the target runs best.

The *target* is the platform that a program is lowered for: `cpu` or an accelerator. A program asks `by_target`, which
`jit` resolves when it lowers for a platform; `lowered_for` overrides it, so that a test on a CPU can run either form.
"""

from __future__ import annotations

import contextlib
import contextvars
import functools
import itertools
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

Arrays = tuple[Array, ...]


_TARGET: contextvars.ContextVar[str | None] = contextvars.ContextVar("target", default=None)


@contextlib.contextmanager
def lowered_for(platform: str) -> Iterator[None]:
    """Choose the form for `platform` (`cpu`, `gpu`) in everything that is traced inside; what was traced before stays.

    For tests: `jit` keeps programs by their function and arguments, so trace a fresh function inside.
    """
    token = _TARGET.set(platform)
    try:
        yield
    finally:
        _TARGET.reset(token)


def target() -> str:
    """The platform that programs are lowered for: that of JAX's default device, unless `lowered_for` says otherwise."""
    return _TARGET.get() or jax.default_backend()


def by_target(*operands: Any, cpu: Callable[..., Any], default: Callable[..., Any]) -> Any:
    """cpu(*operands) on a CPU, default(*operands) on an accelerator: the same values."""
    chosen = _TARGET.get()
    if chosen is None:
        return lax.platform_dependent(*operands, cpu=cpu, default=default)
    return (cpu if chosen == "cpu" else default)(*operands)


def in_host_memory(array: Array) -> Array:
    """The array in the host's own memory, from which it is read without another copy."""
    moved: Array = jax.device_put(array, jax.memory.Space.Host)
    return moved


def repeat(count: int, step: Callable[[Arrays], Arrays], state: Arrays, fused: int = 1) -> Arrays:
    """`step`, `count` times.

    On CPU a `lax` loop: in straight-line code XLA fuses one step into the next and computes it anew for each neighbour
    that the next reads. Elsewhere straight-line code: there a turn of a loop costs several times what a short step
    does.

    Args:
        count: static.
        step: maps a tuple of arrays to one of the same shapes and types.
        state: first argument.
        fused: steps that may become one kernel: where a step is shorter than the start of a kernel, it is cheaper to
            compute some of it anew. Static; on CPU it does not matter.
    """

    def in_a_loop(*state: Array) -> Arrays:
        return tuple(lax.fori_loop(0, count, lambda _, s: step(s), state))

    def in_a_row(*state: Array) -> Arrays:
        for k in range(count):
            state = step(state)
            if (k + 1) % fused == 0 or k + 1 == count:
                state = lax.optimization_barrier(state)
        return state

    return tuple(by_target(*state, cpu=in_a_loop, default=in_a_row)) if count else state


def materialise(x: Array) -> Array:
    """The array itself, computed before anyone reads it.

    On CPU XLA fuses what looks cheap into all who read it, and computes it anew for each neighbour that a stencil
    reads: stencils of stencils then cost many times as much. It does not look behind a branch. Elsewhere nothing
    happens.

    Args:
        x: whose first element is not below −1: that is the question at the branch, which XLA cannot answer.
    """

    def behind_a_branch(x: Array) -> Array:
        there = ~(x.reshape(-1)[0].astype(jnp.float32) < -1)
        return jnp.asarray(lax.cond(there, lambda x: x, jnp.zeros_like, x))

    return jnp.asarray(by_target(x, cpu=behind_a_branch, default=lambda x: x))


# Parts of a volume whose maxima are taken side by side.
_PARTS = 8


def maximum(function: Callable[..., Array], *volumes: Array) -> Array:
    """The largest value of an elementwise function of volumes.

    On CPU XLA reduces a volume on one core: there it is folded first, one part on the other, on all cores.

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

    def at_once(*volumes: Array) -> Array:
        return jnp.max(function(*volumes))

    return jnp.asarray(by_target(*volumes, cpu=folded, default=at_once))
