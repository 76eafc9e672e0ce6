"""The derivative of the potential at the start with respect to where the goal is, by reciprocity.

    φ(s; g) = G(s, g) = G(g, s),   so   ∂/∂g (−ℓ log φ(s; g)) = −ℓ ∇ log ψ at g,   ψ = G(·, s)

G = A⁻¹ is the potential of a unit source (`fields.stencil`), symmetric as A is: the start sees the goal as the goal
sees the start. Hence one solve with the source at the *start* holds the derivatives for every goal at once. The factor
by which `solve_potential` scales ψ to 1 at its source does not depend on g and drops out of the logarithm.

Sign: −ℓ log φ grows as distance does, so the derivative points to where the goal would be further from the start, with
length about 1 + ℓ/r at the distance r, beyond a few ℓ.

What is held fixed. A, hence sigma and ℓ: `fields.conductivity` centres sigma on the goal, and that dependence is not
part of this derivative. And the current, not the potential of the goal: with φ = 1 on the goal the start has
G(s, g) / G(g, g), and the goal's own resistance G(g, g) varies with the conductance around it, the same for each start.

Between voxel centres ∇ log ψ is the wall-aware interpolation that the ascent climbs (`fields.gradient`); on a centre
with free neighbours it is the central difference of two solves with the goal one voxel ahead and one behind.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from maxjax.core.status import Status
from maxjax.fields.gradient import gradient_at
from maxjax.solvers.derivative import TIGHT_TOLERANCE
from maxjax.solvers.potential import solve_potential


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class GoalGradient:
    """How the distance from the start changes with the goal.

    Attributes:
        gradient: ∂(−ℓ log φ(start)) / ∂goal, dimensionless; 0 unless `status` is OK.
        status: `Status` as int32: OK, NO_VALID_PATH where free space does not join start and goal, or what is wrong
            with either, or with the solve.
    """

    gradient: Float[Array, "*batch 3"]
    status: Int32[Array, "*batch"]


def goal_gradient(
    sigma: Float[Array, "nx ny nz"],
    start_index: Int32[Array, " 3"],
    goal: Float[Array, " 3"],
    *,
    screening_length: Float[Array, ""] | float | None = None,
) -> GoalGradient:
    """Derivative of −ℓ log φ at the start with respect to the position of the goal, sigma held fixed.

    Costs one solve; under `vmap` over goals alone still one. Differentiable in sigma, screening_length and goal.

    Args:
        sigma: conductivity, zero in obstacles; at least 4 voxels along each axis.
        start_index: voxel of the start.
        goal: index coordinates, whole numbers at voxel centres.
        screening_length: ℓ [voxels]; by default that of `solve_potential` for a source at the start.

    Raises:
        ValueError: as `solve_potential`, for a goal that is not (3,), or for a grid of fewer than 4 voxels along an
            axis.
    """
    sigma, goal = jnp.asarray(sigma), jnp.asarray(goal)
    if goal.shape != (3,):
        raise ValueError(f"goal: expected shape (3,) [voxels], given {goal.shape}")
    if min(sigma.shape, default=0) < 4:
        raise ValueError(f"sigma: expected at least 4 voxels along each axis, given {sigma.shape}")
    shape = jnp.asarray(sigma.shape)
    # Differences between neighbours are wanted, and at the default tolerance of `solve_potential` values are coarse.
    tolerance = TIGHT_TOLERANCE[sigma.dtype.itemsize]
    seen = solve_potential(sigma, start_index, screening_length=screening_length, tolerance=tolerance)
    finite = jnp.all(jnp.isfinite(goal))
    position = jnp.where(finite, goal, 0).astype(sigma.dtype)
    index = jnp.floor(jnp.clip(position, -1, max(sigma.shape)) + 0.5).astype(jnp.int32)
    outside = jnp.any((index < 0) | (index >= shape))
    x, y, z = jnp.clip(index, 0, shape - 1)
    # The source of this solve is the start, so its status about its goal is about the start.
    at_start = jnp.select(
        [seen.status == Status.GOAL_OUTSIDE_MAP, seen.status == Status.GOAL_OCCUPIED],
        [Status.START_OUTSIDE_MAP, Status.START_OCCUPIED],
        seen.status,
    )
    status = jnp.select(
        [~finite, at_start != Status.OK, outside, sigma[x, y, z] <= 0, ~jnp.isfinite(seen.log_phi[x, y, z])],
        [Status.NONFINITE_INPUT, at_start, Status.GOAL_OUTSIDE_MAP, Status.GOAL_OCCUPIED, Status.NO_VALID_PATH],
        Status.OK,
    )
    # A free voxel that no current reaches counts as a wall: its logarithm says nothing.
    slope = gradient_at(seen.log_phi, jnp.isfinite(seen.log_phi), position)
    gradient = jnp.where(status == Status.OK, -seen.screening_length * slope, 0)
    return GoalGradient(gradient, status.astype(jnp.int32))
