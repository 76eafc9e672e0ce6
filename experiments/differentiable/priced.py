"""The potential of a price field, its directions and its paths; differentiable in the price.

    −∇·(σ∇φ) + κ n² σ φ = q,        n = 1 + a exp(−(d − 1) / w) + v z / 10 m

φ = 1 at the goal; d is the distance to the nearest wall [voxels], z the height. The parameters θ are the logarithms of
a, w and v.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.fields import stencil
from maxjax.fields.certificate import uncertified
from maxjax.fields.connectivity import flood
from maxjax.fields.gradient import gradient
from maxjax.fields.gradient import log_potential as logarithm
from maxjax.planning.ascent import Ascent, ascend
from maxjax.planning.sight import sight_of
from maxjax.solvers.cg import DEGREE
from maxjax.solvers.derivative import DERIVATIVE_TOLERANCE, TIGHT_TOLERANCE
from maxjax.solvers.krylov import chebyshev, pcg


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Town:
    """What a price is made of.

    Attributes:
        free: voxels outside the margin.
        distance: to the nearest voxel that is not, the ground left out [voxels].
        height: above ground [10 m].
    """

    free: Bool[Array, "nx ny nz"]
    distance: Float[Array, "nx ny nz"]
    height: Float[Array, "nx ny nz"]


def price(town: Town, theta: Float[Array, " 3"]) -> Float[Array, "nx ny nz"]:
    """The price n of the logarithms of a, w and v."""
    a, w, v = jnp.exp(theta)
    n: Array = 1 + a * jnp.exp(-(town.distance - 1) / w) + v * town.height
    return n


def priced_potential(
    town: Town, n: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"], length: Float[Array, ""]
) -> Float[Array, "nx ny nz"]:
    """φ of a price field, 1 at the goal; differentiable in n.

    `solve_potential` has one leak for the whole map; here conjugate gradients solve the same system with a leak a
    voxel, to the same rule, and the derivative is the implicit one: φ + A⁻¹ r(n), where the residual r is zero but its
    derivative, −∂A/∂n φ, is not.
    """
    component = flood(town.free, goal)
    sigma = component.astype(n.dtype)
    held = stencil.cell(sigma.shape, goal).astype(n.dtype)
    still = stencil.assemble(sigma, 0.0)
    leaking = stencil.Operator(still.faces, still.diagonal + sigma * n**2 / length**2)
    operator, source = stencil.hold(leaking, held)
    fixed = jax.tree.map(lax.stop_gradient, operator)
    faces, scale = stencil.normalize(fixed)
    rows = stencil.inflow(fixed.faces, jnp.ones_like(sigma)) / jnp.where(fixed.diagonal > 0, fixed.diagonal, 1)
    smooth = functools.partial(stencil.inflow, faces)
    solve = functools.partial(
        pcg,
        lambda y: y - smooth(y),
        precondition=chebyshev(smooth, jnp.minimum(jnp.max(rows), 1 - 1 / DEGREE**2), DEGREE),
        max_iterations=100,
    )
    tight, tighter = TIGHT_TOLERANCE[n.dtype.itemsize], DERIVATIVE_TOLERANCE[n.dtype.itemsize]
    forward = solve(source * scale, stop=lambda y, r: jnp.all(jnp.abs(r) <= tight * y)).x
    phi = lax.stop_gradient(jnp.where(component, jnp.maximum(scale * forward, 0), 0))
    residual = stencil.residual(operator, phi, source)

    def adjoint(_: Any, b: Array) -> Array:
        return solve(b, stop=lambda _, r: jnp.max(jnp.abs(r)) <= tighter * jnp.max(jnp.abs(b))).x

    change = lax.custom_linear_solve(
        lambda y: y - smooth(y), scale * (residual - lax.stop_gradient(residual)), adjoint, symmetric=True
    )
    return jnp.asarray(phi + scale * change)


def bearings(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    voxels: Int32[Array, "n 3"],
) -> Float[Array, "n 3"]:
    """Where the planner would head at voxels: unit vectors along ∇ log φ, less what points into a wall."""
    log_phi = logarithm(priced_potential(town, price(town, theta), goal, length))
    slopes = gradient(log_phi, town.free)
    open_ahead, open_behind = (
        jnp.stack([shift(town.free.astype(log_phi.dtype), axis) for axis in range(3)], axis=-1) > 0
        for shift in (stencil.ahead, stencil.behind)
    )
    slopes = jnp.where(jnp.where(slopes > 0, open_ahead, open_behind), slopes, 0)
    slopes = slopes[voxels[:, 0], voxels[:, 1], voxels[:, 2]]
    square = jnp.sum(slopes**2, axis=1, keepdims=True)
    return slopes * lax.rsqrt(jnp.where(square > 0, square, 1))


@jax.jit
def linearized(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    voxels: Int32[Array, "n 3"],
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3 3"]]:
    """`bearings` and their derivative by theta, last axis: one solve, and a derivative solve a parameter."""
    value, push = jax.linearize(lambda theta: bearings(theta, town, goal, length, voxels), theta)
    return value, jax.vmap(push, out_axes=-1)(jnp.eye(3, dtype=theta.dtype))


@jax.jit
def follow(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    starts: Int32[Array, "m 3"],
) -> tuple[Float[Array, "m t 3"], Bool[Array, " m"], Int32[Array, ""]]:
    """Paths of our planner in a priced field, which of them arrived, and the voxels without a higher neighbour."""
    phi = priced_potential(town, price(town, theta), goal, length)
    log_phi, sight = logarithm(phi), sight_of(~town.free)

    def one(start: Int32[Array, " 3"]) -> tuple[Array, Array]:
        ends = start.astype(phi.dtype), goal.astype(phi.dtype)
        return ascend(log_phi, sight, town.free, *ends, Ascent(steps=1024))

    paths, arrived = jax.vmap(one)(starts)
    return paths, arrived, uncertified(phi, flood(town.free, goal), goal)


def fly(
    theta: Float[Array, " 3"], town: Town, goal: np.ndarray, starts: np.ndarray, length: float
) -> tuple[Array, Array, Array]:
    """`follow`; where high prices take φ out of float32's range, again with ℓ longer, as the solver does."""
    for attempt in range(4):
        stretched = jnp.float32(length * 1.5**attempt)
        found: tuple[Array, Array, Array] = follow(theta, town, jnp.asarray(goal), stretched, jnp.asarray(starts))
        if int(found[2]) == 0:
            break
    return found
