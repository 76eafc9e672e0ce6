"""The reactive layer: a push away from LiDAR points within 3 m, on top of the planned path.

    F = gain · Σ q_i w_i n_i,    w_i = (1 − d_i² / R²)²₊,    q_i ~ (w_i / d_i²)⁴, Σ q_i = 1,    n_i = (x − p_i) / d_i

a weighted mean, not a sum: how densely a wall is sampled does not matter, |F| ≤ gain, and beyond R nothing is left. The
nearest points decide: of a wall those within about its distance.

The paper (Bong and Beltrame, arXiv 2605.10880) reports that its layer, "3 m range, repulsive only", drifts the
vehicle off the planned path into curly and circular motion. Pure repulsion has two ways to do that: its part against
the direction of travel holds the vehicle back until the sideways part turns it, and its part along that direction
throws it past obstacles beside it faster than planned. So here only the part across the direction of travel t acts,
and the part against it only where something is so near that stopping is right:

    push = F − (F·t) t + c min(F·t, 0) t,    c: smoothly from 0 where the nearest point is at 1.5 m to 1 at 0.75 m

Whether to go on along the path is thus decided by the plan and its speed caps; the layer alone cannot stall it. Added
to a setpoint's acceleration, the push shifts the vehicle by at most gain / ω² (ω: bandwidth of the position loop) and
lets go smoothly.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

RANGE = 3.0
# Distances [m] between which braking fades in.
_BRAKE, _FULL_BRAKE = 1.5, 0.75
# Keeps the shares of points at the very edge of the range from being 0 / 0; at 2.95 m they are rid of it.
_EPSILON = 1e-15
# Lengths below these are smoothed over [m, m/s].
_NEAREST, _SLOWEST = 0.1, 0.3


def push(
    points: Float[Array, "n 3"],
    position: Float[Array, "3"],
    velocity: Float[Array, "3"],
    gain: float | Float[Array, ""] = 1.5,
) -> Float[Array, "3"]:
    """Acceleration away from what is near [m/s²]; smooth, at most `gain` long, 0 where nothing is within 3 m.

    Args:
        points: LiDAR returns [m]; rows that are not finite are misses.
        position: of the vehicle [m].
        velocity: which way it travels [m/s], best that of its reference; at rest the push is the whole of F.
        gain: [m/s²].
    """
    seen = jnp.all(jnp.isfinite(points), axis=-1)
    away = position - jnp.where(seen[:, None], points, position + 2.0 * RANGE)
    square = jnp.sum(away * away, axis=-1)
    weight = jnp.square(jnp.maximum(1.0 - square / RANGE**2, 0.0))
    smoothed = square + _NEAREST**2
    normal = away / jnp.sqrt(smoothed)[:, None]
    power = jnp.square(jnp.square(weight / smoothed))
    share = power / (_EPSILON + jnp.sum(power))
    force = gain * jnp.sum((share * weight)[:, None] * normal, axis=0)

    travel = velocity / jnp.sqrt(jnp.sum(velocity * velocity) + _SLOWEST**2)
    along = jnp.sum(force * travel)
    # The nearest distance, from the same mean of weights.
    weights = [(1.0 - d * d / RANGE**2) ** 2 for d in (_BRAKE, _FULL_BRAKE)]
    near = jnp.clip((jnp.sum(share * weight) - weights[0]) / (weights[1] - weights[0]), 0.0, 1.0)
    brake = near * near * (3.0 - 2.0 * near)
    return force - along * travel + brake * jnp.minimum(along, 0.0) * travel
