"""A Kalman filter for place and velocity on each axis: for labels and prices, never for proofs.

    p(t + τ) = p + τ v,   v(t + τ) = v + ∫ a,   a: white, of density q

Covariances of place, place and velocity, and velocity are (…, 3) each: one filter an axis.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# q = (typical acceleration)² · its duration [m²/s³].
_DENSITY = 0.4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Estimate:
    """Place [m] and velocity [m/s] with their covariances; batch axes lead."""

    place: Float[Array, "*batch s 3"]
    velocity: Float[Array, "*batch s 3"]
    place_variance: Float[Array, "*batch s 3"]
    covariance: Float[Array, "*batch s 3"]
    velocity_variance: Float[Array, "*batch s 3"]


def predict(estimate: Estimate, time: Float[Array, "#s 1"]) -> Estimate:
    """The estimate a time later [s]."""
    pp, pv, vv = estimate.place_variance, estimate.covariance, estimate.velocity_variance
    return Estimate(
        estimate.place + time * estimate.velocity,
        estimate.velocity,
        pp + time * (2.0 * pv + time * vv) + _DENSITY * time**3 / 3.0,
        pv + time * vv + _DENSITY * time**2 / 2.0,
        vv + _DENSITY * time,
    )


def correct(estimate: Estimate, place: Float[Array, "s 3"], variance: Float[Array, "s 3"]) -> Estimate:
    """The estimate after a measurement of the place [m]."""
    pp, pv, vv = estimate.place_variance, estimate.covariance, estimate.velocity_variance
    total = jnp.maximum(pp + variance, 1e-9)
    gain, other = pp / total, pv / total
    surprise = place - estimate.place
    return Estimate(
        estimate.place + gain * surprise,
        estimate.velocity + other * surprise,
        (1.0 - gain) * pp,
        (1.0 - gain) * pv,
        vv - other * pv,
    )
