"""The potential of a price field, its directions and its paths; differentiable in the price.

    −∇·(σ∇φ) + κ n² σ φ = q,        n = 1 + a exp(−(d − 1) / w) + v z / 10 m

φ = 1 at the goal; d is the distance to the nearest wall [voxels], z the height. The parameters θ are the logarithms of
a, w and v.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

import maxjax
from maxjax.fields import stencil
from maxjax.fields.gradient import gradient
from maxjax.planning.path.ascent import Ascent, ascend
from maxjax.planning.path.line_of_sight import sight_of
from maxjax.solvers.derivative import TIGHT_TOLERANCE
from maxjax.solvers.potential import Potential


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
    town: Town, theta: Float[Array, " 3"], goal: Int32[Array, " 3"], length: Float[Array, ""]
) -> Potential:
    """The potential of a price field, differentiable in theta; σ = 1."""
    sigma, tolerance = town.free.astype(theta.dtype), TIGHT_TOLERANCE[theta.dtype.itemsize]
    found: Potential = maxjax.solve_potential(
        sigma, goal, price(town, theta), screening_length=length, solver=maxjax.Screened(tolerance=tolerance)
    )
    return found


def bearings(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    voxels: Int32[Array, "n 3"],
) -> Float[Array, "n 3"]:
    """Where the planner would head at voxels: unit vectors along ∇ log φ, less what points into a wall."""
    log_phi = priced_potential(town, theta, goal, length).log_phi
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
    field, sight = priced_potential(town, theta, goal, length), sight_of(~town.free)

    def one(start: Int32[Array, " 3"]) -> tuple[Array, Array]:
        ends = start.astype(theta.dtype), goal.astype(theta.dtype)
        return ascend(field.log_phi, sight, town.free, *ends, Ascent(steps=1024))

    paths, arrived = jax.vmap(one)(starts)
    return paths, arrived, field.uncertified
