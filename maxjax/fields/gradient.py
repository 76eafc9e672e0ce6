"""Wall-aware differences and smoothing of the log-potential u = log φ.

    ∂u/∂x at voxel i:  (u_{i+1} − u_{i−1}) / 2  where both neighbours are free,
                       u_{i+1} − u_i  or  u_i − u_{i−1}  where only that one is,   0 where neither is.

No difference ever reads a wall. The gradient points uphill, towards the goal [1/voxel].

Where there is no current u is −inf; such a voxel counts as a wall.

Smoothing solves the heat equation with insulated walls for the time t = σ²/2, at which its kernel in free space is the
Gaussian of standard deviation σ. Heat flows around a wall but never through it, so the two sides of a wall are never
mixed (a plain Gaussian mixes them, and then nearly every path fails).
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.interpolation import CORNERS, corner_weights
from maxjax.fields import stencil

# Explicit time step [voxel²]: stable below 1/6, and above 1/12 the highest modes only change sign while they decay.
_TIME_STEP = 1 / 8


def log_potential(phi: Float[Array, "*batch nx ny nz"]) -> Float[Array, "*batch nx ny nz"]:
    """Return log φ; where φ is not positive (walls, sealed pockets) the logarithm of the smallest normal number."""
    return jnp.log(jnp.maximum(phi, float(np.finfo(phi.dtype).tiny)))


def gradient(log_phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"]) -> Float[Array, "nx ny nz 3"]:
    """Gradient at every voxel centre [1/voxel]; zero in walls.

    Args:
        log_phi: log-potential.
        free: voxels that are not walls.
    """
    log_phi, weight = _of_current(log_phi, free)
    components = []
    for axis in range(3):
        forward = weight * stencil.ahead(weight, axis)
        backward = weight * stencil.behind(weight, axis)
        rise = forward * (stencil.ahead(log_phi, axis) - log_phi) + backward * (log_phi - stencil.behind(log_phi, axis))
        components.append(rise / jnp.maximum(forward + backward, 1))
    return jnp.stack(components, axis=-1)


def gradient_at(
    log_phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], position: Float[Array, " 3"]
) -> Float[Array, " 3"]:
    """The gradient of `gradient`, interpolated trilinearly among the free voxels around `position` (index coordinates).

    Reads the eight voxels around it and their neighbours only, so a path costs nothing that depends on the grid's size.
    """
    shape = jnp.asarray(log_phi.shape, jnp.int32)
    base = jnp.clip(jnp.floor(position).astype(jnp.int32), 0, shape - 2)
    corner = base + jnp.asarray(CORNERS, jnp.int32)

    def at(v: Int32[Array, "8 n 3"]) -> tuple[Float[Array, "8 n"], Float[Array, "8 n"]]:
        """Value, and 1 where the voxel is free and has one."""
        inside = jnp.all((v >= 0) & (v < shape), axis=-1)
        x, y, z = jnp.moveaxis(jnp.clip(v, 0, shape - 1), -1, 0)
        flat = (x * log_phi.shape[1] + y) * log_phi.shape[2] + z
        return _of_current(log_phi.reshape(-1)[flat], inside & free.reshape(-1)[flat])

    along = jnp.eye(3, dtype=jnp.int32)
    here, weight = at(corner[:, None])
    (above, forward), (below, backward) = at(corner[:, None] + along), at(corner[:, None] - along)
    rise = (forward * (above - here) + backward * (here - below)) / jnp.maximum(forward + backward, 1)
    share = corner_weights(jnp.clip(position - base, 0, 1)).reshape(8, 1) * weight
    # Both sums in one.
    *mean, total = jnp.sum(share * jnp.concatenate([rise, jnp.ones_like(share)], axis=1), axis=0)
    return jnp.stack(mean) / jnp.where(total > 0, total, 1)


def smooth(log_phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float) -> Float[Array, "nx ny nz"]:
    """Gaussian smoothing that respects walls.

    Args:
        log_phi: log-potential, or any field.
        free: voxels that are not walls; the others keep their value.
        sigma: standard deviation [voxels]; the paper uses 5. Static.
    """
    if sigma <= 0:
        return log_phi
    steps = math.ceil(0.5 * sigma**2 / _TIME_STEP)
    flow = 0.5 * sigma**2 / steps
    u, weight = _of_current(log_phi, free)
    x, y, z = (flow * weight * stencil.ahead(weight, axis) for axis in range(3))
    kept = 1 - stencil.inflow((x, y, z), jnp.ones_like(weight))

    def step(_: Array, u: Float[Array, "nx ny nz"]) -> Float[Array, "nx ny nz"]:
        return kept * u + stencil.inflow((x, y, z), u)

    return jnp.where(weight > 0, lax.fori_loop(0, steps, step, u), log_phi)


def _of_current(log_phi: Float[Array, "*n"], free: Bool[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Values without −inf, and 1 where a voxel is free and has a value."""
    finite = jnp.isfinite(log_phi)
    return jnp.where(finite, log_phi, 0), (free & finite).astype(log_phi.dtype)
