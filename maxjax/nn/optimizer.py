"""AdamW (Loshchilov and Hutter 2019) and its learning rate.

    m ← β₁ m + (1 − β₁) g        v ← β₂ v + (1 − β₂) g²
    w ← w − η_t ( m̂ / (√v̂ + ε) + λ w )        m̂ = m / (1 − β₁ᵗ),  v̂ = v / (1 − β₂ᵗ),  t = 1, 2, …

The decay λ stands beside the gradient's step, not inside the gradient, so that it is not divided by √v̂. The rate falls
from its peak to zero along half a cosine (Loshchilov and Hutter 2017), after a linear rise of a few steps.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

Tree = TypeVar("Tree")


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class AdamW:
    """Settings; static.

    Attributes:
        rate: learning rate η at its peak.
        steps: length of the schedule; the rate is zero after it.
        warmup: steps in which the rate rises from zero.
        decay: λ.
        beta1, beta2: β₁, β₂.
        epsilon: ε.
    """

    rate: float
    steps: int
    warmup: int = 0
    decay: float = 1e-2
    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-8


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Moments:
    """State of the optimiser.

    Attributes:
        first, second: m and v, as the weights.
        step: updates made.
    """

    first: object
    second: object
    step: Int32[Array, ""]


def init_moments(params: object) -> Moments:
    """Moments of weights that have seen no gradient."""
    return Moments(jax.tree.map(jnp.zeros_like, params), jax.tree.map(jnp.zeros_like, params), jnp.int32(0))


def rate_at(settings: AdamW, step: Int32[Array, ""]) -> Float[Array, ""]:
    """η of the update after `step` others."""
    rise = jnp.minimum((step + 1) / (settings.warmup + 1), 1.0)
    done = jnp.clip((step - settings.warmup) / max(settings.steps - settings.warmup, 1), 0, 1)
    return settings.rate * rise * (1 + jnp.cos(math.pi * done)) / 2


def update(settings: AdamW, params: Tree, moments: Moments, gradients: Tree) -> tuple[Tree, Moments]:
    """One step.

    Args:
        settings: static.
        params: weights, float32.
        moments: from `init_moments` or the last step.
        gradients: of the loss, as the weights.
    """
    step = moments.step + 1
    b1, b2, rate = settings.beta1, settings.beta2, rate_at(settings, moments.step)
    first = jax.tree.map(lambda m, g: b1 * m + (1 - b1) * g, moments.first, gradients)
    second = jax.tree.map(lambda v, g: b2 * v + (1 - b2) * g * g, moments.second, gradients)
    t = step.astype(jnp.float32)
    grown1, grown2 = 1 - b1**t, 1 - b2**t

    def moved(w: Array, m: Array, v: Array) -> Array:
        direction = (m / grown1) / (jnp.sqrt(v / grown2) + settings.epsilon)
        return w - rate * (direction + settings.decay * w)

    return jax.tree.map(moved, params, first, second), Moments(first, second, step)
