"""How near two motions come for ever, from below.

    |Δ(t)| ≥ |Δ̂(t)| − (a₁ + a₂) h² / 8         Δ = x₁ − x₂,  Δ̂: linear between its samples, h apart

The velocity of a motion is continuous and its acceleration bounded by a, which bounds how far a chord is from the
curve; how near a chord comes is exact. Motions end at rest, so that samples until then are samples for ever. Frame:
world; times are whole numbers of looks.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from maxjax.sim.movers.motions import MotionPrimitive, at

# Rounding of places in single precision, some hundred metres from the origin [m].
_ROUNDING = 1e-3


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Scheduled:
    """A motion, and the look at which it starts; batch axes lead."""

    motion: MotionPrimitive
    start: Int32[Array, "*batch"]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Sampled:
    """At which times motions are compared; static.

    Attributes:
        period: between two samples, one look [s].
        steps: looks after which every motion rests that has started by now.
        acceleration: that no motion exceeds [m/s²].

    Raises:
        ValueError: unless all are positive.
    """

    period: float
    steps: int
    acceleration: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ValueError(f"Sampled.{name}: expected a positive number, given {value!r}")

    @property
    def between(self) -> float:
        """How much nearer two motions may be between their samples than chords are, and rounding [m]."""
        return 2.0 * self.acceleration * self.period**2 / 8.0 + _ROUNDING


def courses(scheduled: Scheduled, look: Int32[Array, ""], sampled: Sampled) -> Float[Array, "*batch t 3"]:
    """Places from a look on [m]; of a motion that starts later, where it starts."""
    looks = look + jnp.arange(sampled.steps + 1)
    since = sampled.period * (looks - scheduled.start[..., None]).astype(jnp.float32)
    motion = jax.tree.map(lambda x: jnp.expand_dims(x, scheduled.start.ndim), scheduled.motion)
    return at(motion, since)[0]


def separation(one: Float[Array, "*a t 3"], other: Float[Array, "*b t 3"], sampled: Sampled) -> Float[Array, "*c"]:
    """No more than the least distance of two motions from the first sample on [m]; batch axes are broadcast."""
    return jnp.sqrt(jnp.min(chord_squares(one, other), axis=-1)) - sampled.between


def chord_squares(one: Float[Array, "*a t 3"], other: Float[Array, "*b t 3"]) -> Float[Array, "*c t-1"]:
    """Square of how near the chords of two motions come between each two samples [m²]; batch axes are broadcast."""
    axes = [one[..., k] - other[..., k] for k in range(3)]
    begin, along = [x[..., :-1] for x in axes], [x[..., 1:] - x[..., :-1] for x in axes]
    length = sum(x * x for x in along)
    share = -sum(x * y for x, y in zip(begin, along, strict=True)) / jnp.where(length > 0.0, length, 1.0)
    share = jnp.clip(share, 0.0, 1.0)
    squared: Array = sum(jnp.square(x + share * y) for x, y in zip(begin, along, strict=True))  # type: ignore[assignment]
    return squared
