"""Assignment of measurements to tracks: pairs that are each other's nearest, again and again.

In each turn every free row takes its cheapest free column and every column its cheapest row; a pair that agrees is
assigned. The cheapest pair of all always agrees, so the result is that of the greedy method, in fewer turns.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int32

_TURNS = 6


def assign(cost: Float[Array, "s d"]) -> Int32[Array, " s"]:
    """Column of each row, or -1; a pair whose cost is infinite is none."""
    rows, columns = cost.shape

    def turn(_: Array | int, state: tuple[Array, Array]) -> tuple[Array, Array]:
        chosen, cost = state
        column, row = jnp.argmin(cost, axis=1), jnp.argmin(cost, axis=0)
        agree = (row[column] == jnp.arange(rows)) & (jnp.min(cost, axis=1) < jnp.inf)
        taken = jnp.zeros(columns, bool).at[column].max(agree)
        cost = jnp.where(agree[:, None] | taken[None], jnp.inf, cost)
        return jnp.where(agree, column, chosen).astype(jnp.int32), cost

    chosen: Array = lax.fori_loop(0, _TURNS, turn, (jnp.full(rows, -1, jnp.int32), cost))[0]
    return chosen
