"""Marks of a body, its middle and its lowest and highest coordinate along each axis, and velocities from two looks.

    x(t₂) − x(t₁) = ∫ v dt ± ρ,     ρ = (|E⊥| θ + E θ²/2) / 2,   θ = turn · T

All marks of a rigid body move with it, so each gives an interval for its velocity of its own. How deep a body is, is
hidden in both looks at its middle; a face that is seen is known to a step between beams. A body that turns by θ about
its middle moves its faces by ρ at most, for it lies in a box of edges E, of which E⊥ are those across the axis.

The mean velocity over a time T lies within A T / 2 of that at its end. A look T ago leaves (w₁ + w₂) / T + A T of an
interval, w the widths of its sets; earlier and later looks are intersected, so the best T need not be chosen.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from maxjax.sim.movers.reachable_sets import Bounds

# Earlier looks that velocities are taken from.
_EARLIER = 10


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Marks:
    """Sets of marks; batch axes lead.

    Attributes:
        low, high: of the middle, the lowest and the highest coordinate of each body along each world axis [m].
    """

    low: Float[Array, "*batch 3 s 3"]
    high: Float[Array, "*batch 3 s 3"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class History:
    """Marks at earlier looks, newest first; batch axes lead.

    Attributes:
        low, high: as in `Marks` [m]; infinite where there were none.
        times: when each body was measured [s].
    """

    low: Float[Array, "*batch j 3 s 3"]
    high: Float[Array, "*batch j 3 s 3"]
    times: Float[Array, "*batch j s"]


def no_history(slots: int) -> History:
    """An empty history."""
    never = jnp.full((_EARLIER, 3, slots, 3), jnp.inf)
    return History(-never, never, jnp.full((_EARLIER, slots), -jnp.inf))


def append_marks(history: History, marks: Marks, time: Float[Array, " s"], seen: Bool[Array, " s"]) -> History:
    """The history with the marks of bodies that were measured, at times [s]."""

    def pushed(new: Array, old: Array, kept: Array) -> Array:
        return jnp.where(kept, jnp.concatenate([new[None], old[:-1]]), old)

    body = seen[:, None]
    low, high = pushed(marks.low, history.low, body), pushed(marks.high, history.high, body)
    return History(low, high, pushed(time, history.times, seen))


def forget_marks(history: History, slots: Bool[Array, " s"]) -> History:
    """The history without that of some slots."""
    body = slots[:, None]
    return History(
        jnp.where(body, -jnp.inf, history.low),
        jnp.where(body, jnp.inf, history.high),
        jnp.where(slots, -jnp.inf, history.times),
    )


def propagate_marks(marks: Marks, moved: tuple[Array, Array], time: Array | float, bounds: Bounds) -> Marks:
    """The marks a time later [s], where middles may have moved by so much down and up [m]."""
    turned = _turned(marks, time, bounds)
    return Marks(marks.low - moved[0] - turned, marks.high + moved[1] + turned)


def velocities(
    history: History, marks: Marks, time: Float[Array, "s 1"], bounds: Bounds
) -> tuple[Float[Array, "s 3"], Float[Array, "s 3"]]:
    """Set of the velocity at a time [s], from the marks then and before [m/s]."""
    since = time - history.times[:, None, :, None]
    apart = jnp.isfinite(since) & (since > 1e-3)
    since = jnp.where(apart, since, 1.0)
    slack = 0.5 * bounds.acceleration * since + _turned(marks, since, bounds) / since
    slowest = jnp.where(apart, (marks.low - history.high) / since - slack, -jnp.inf)
    fastest = jnp.where(apart, (marks.high - history.low) / since + slack, jnp.inf)
    return jnp.max(slowest, axis=(0, 1)), jnp.min(fastest, axis=(0, 1))


def _turned(marks: Marks, time: Array | float, bounds: Bounds) -> Array:
    """How far a turn over a time may move each mark besides the middle [m]."""
    edges = jnp.clip(marks.high[2] - marks.low[1], 0.0, bounds.edges)
    across = jnp.hypot(jnp.roll(edges, 1, axis=-1), jnp.roll(edges, 2, axis=-1))
    angle = bounds.turn * time
    face = 0.5 * jnp.minimum(across * angle + 0.5 * edges * angle**2, across + edges)
    return jnp.where(jnp.arange(3)[:, None, None] > 0, face, 0.0)
