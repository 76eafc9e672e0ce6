"""Sweeps until a field is certified, and what its status is.

    φ_i ← Σ_j w_ij φ_j / d_i        (φ held on the goal)

A positive sweep adds only positive terms, so it has no cancellation: it restores the relative accuracy, hence the
direction, of every voxel. It runs until every voxel but the goal has a strictly higher neighbour
(`fields.certificate`), or a cap is reached.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import in_this_turn
from maxjax.core.status import Status
from maxjax.fields import stencil
from maxjax.fields.certificate import count_uncertified
from maxjax.solvers.medium import Medium, Progress, operator_of


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SweepCarry:
    """Carry of the loop.

    Attributes:
        log_phi: its logarithm.
        sweeps: taken.
        uncertified: voxels without a strictly higher neighbour.
    """

    log_phi: Float[Array, "nx ny nz"]
    sweeps: Int32[Array, ""]
    uncertified: Int32[Array, ""]


def swept(medium: Medium, length: Float[Array, ""], log_phi: stencil.Volume, times: int) -> stencil.Volume:
    """Log φ after so many (static) positive sweeps, of its ratio ψ to the φ before them."""
    held = stencil.cell(medium.sigma.shape, medium.goal) | ~medium.component
    operator = operator_of(medium, length)
    links = stencil.rates(operator.faces, log_phi)
    diagonal = jnp.where(operator.diagonal > 0, operator.diagonal, 1)
    psi = lax.fori_loop(
        0, times, lambda _, psi: jnp.where(held, psi, stencil.gather(links, psi) / diagonal), jnp.ones_like(log_phi)
    )
    return log_phi + jnp.log(psi)


@jax.named_scope("positive sweeps")
def sweep_until_certified(medium: Medium, progress: Progress, *, most: int, between: int) -> Progress:
    """Positive sweeps until φ is certified; none where it is.

    Args:
        medium, progress: of the stage.
        most: cap on sweeps. Static.
        between: sweeps between two looks at the certificate. Static.
    """

    def going(carry: SweepCarry) -> Bool[Array, ""]:
        return (carry.uncertified != 0) & (carry.sweeps < most)

    def turn(carry: SweepCarry) -> SweepCarry:
        # Few fields need sweeps, so A is assembled in the loop rather than kept.
        here, length = in_this_turn((medium, progress.length), carry.log_phi)
        log_phi = swept(here, length, carry.log_phi, between)
        return SweepCarry(log_phi, carry.sweeps + between, count_uncertified(log_phi, medium.component, medium.goal))

    first = SweepCarry(
        progress.log_phi, jnp.int32(0), count_uncertified(progress.log_phi, medium.component, medium.goal)
    )
    last = lax.while_loop(going, turn, first)
    return dataclasses.replace(progress, log_phi=last.log_phi, sweeps=last.sweeps, uncertified=last.uncertified)


def input_status(medium: Medium, length: Float[Array, ""]) -> Int32[Array, ""]:
    """The fault of sigma, price, ℓ or the goal; OK if there is none."""
    finite = jnp.all(jnp.isfinite(medium.sigma) & (medium.sigma >= 0)) & jnp.isfinite(length) & (length > 0)
    if medium.price is not None:
        finite = finite & jnp.all((medium.sigma == 0) | (jnp.isfinite(medium.price) & (medium.price >= 1)))
    outside = jnp.any((medium.goal < 0) | (medium.goal >= jnp.asarray(medium.shape, jnp.int32)))
    status = jnp.select(
        [~finite, outside, ~jnp.any(medium.component)],
        [Status.NONFINITE_INPUT, Status.GOAL_OUTSIDE_MAP, Status.GOAL_OCCUPIED],
        Status.OK,
    )
    return status.astype(jnp.int32)


def decide_status(medium: Medium, progress: Progress) -> Progress:
    """Set the status; OK only where the field is finite and certified."""
    wrong = input_status(medium, progress.length)
    certified = (progress.uncertified == 0) & jnp.all(jnp.isfinite(progress.log_phi))
    status = jnp.select(
        [wrong != Status.OK, certified, ~progress.converged], [wrong, Status.OK, Status.NOT_CONVERGED],
        Status.NOT_CERTIFIED,
    )  # fmt: skip
    return dataclasses.replace(progress, status=status.astype(jnp.int32))
