"""The reactive layer: a push away from LiDAR points within 3 m, on top of the planned path.

    F = gain · Σ q_i w_i n_i,    w_i = (1 − d_i² / R²)²₊,    q_i ~ (w_i / d_i²)⁴, Σ q_i = 1,    n_i = (x − p_i) / d_i

a weighted mean, not a sum: F does not depend on how densely a wall is sampled, |F| ≤ gain, and F = 0 beyond R. The
nearest points dominate: of a wall those within about its distance.

The paper (Bong and Beltrame, arXiv 2605.10880) reports that its layer, "3 m range, repulsive only", moves the vehicle
off the planned path into curly and circular motion. Pure repulsion has two such mechanisms: its component against the
direction of travel slows the vehicle until the lateral component turns it, and its component along that direction
accelerates it past obstacles at its side. So here only the component across the direction of travel t acts, and the
component against it only where a point is near enough to justify braking:

    push = F − (F·t) t + c min(F·t, 0) t,    c: smoothly from 0 where the nearest point is at 1.5 m to 1 at 0.75 m

Progress along the path is thus determined by the plan and its speed caps; the layer alone cannot stop the vehicle.
Added to a setpoint's acceleration, the push displaces the vehicle by at most gain / ω² (ω: bandwidth of the position
loop) and decays smoothly.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

RANGE = 3.0
# Distances [m] between which braking fades in.
_BRAKE, _FULL_BRAKE = 1.5, 0.75
# Regularises the shares of points at the edge of the range, 0 / 0 there; without effect from 2.95 m inwards.
_EPSILON = 1e-15
# Smoothing lengths of distance and speed at zero [m, m/s].
_NEAREST, _SLOWEST = 0.1, 0.3


def push(
    points: Float[Array, "n 3"],
    position: Float[Array, "3"],
    velocity: Float[Array, "3"],
    gain: float | Float[Array, ""] = 1.5,
) -> Float[Array, "3"]:
    """Acceleration away from near points [m/s²]; smooth, at most `gain`, 0 without points within 3 m.

    Args:
        points: LiDAR returns [m]; rows that are not finite are rays without a return.
        position: of the vehicle [m].
        velocity: that defines the direction of travel [m/s], best that of the reference; at rest the push is F.
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
    # Braking by the mean weight, a smooth measure of the nearest distance.
    weights = [(1.0 - d * d / RANGE**2) ** 2 for d in (_BRAKE, _FULL_BRAKE)]
    near = jnp.clip((jnp.sum(share * weight) - weights[0]) / (weights[1] - weights[0]), 0.0, 1.0)
    brake = near * near * (3.0 - 2.0 * near)
    return force - along * travel + brake * jnp.minimum(along, 0.0) * travel
