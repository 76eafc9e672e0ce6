"""Newton's method for log φ, its linear steps solved by aggregation multigrid (`solvers.aggregation`).

    d_i φ_i = Σ_j w_ij φ_j   (`fields.stencil`; φ > 0, held on the goal)

Linear solvers lose the far field: φ spans thirty decades, and what counts is its *relative* accuracy in every voxel.
So solve for u = log φ instead, 0 = log(Σ_j w_ij φ_j / d_i φ_i) = ρ_i. Its Newton step δ, φ ← φ e^δ, solves

    δ_i = ρ_i + Σ_j p_ij δ_j,   p_ij = w_ij φ_j / Σ_k w_ik φ_k,   δ = 0 on the goal:

rows of p sum to one. It is a random walk that drifts to the goal (Doob's transform of the leaky one by φ), and δ_i the
residual that it meets on its way. Where the linear problem is about values that e-fold every voxel or two, this one is
about transport: its solution is smooth, and every quantity in it is of order one.

A cycle is one correction e^δ, constant on aggregates of 2 × 2 × 2 voxels, and five weighted sweeps
φ_i ← φ_i + ω (Σ_j w_ij φ_j / d_i − φ_i). Everything stays positive: walls one voxel thick, sealed pockets and dead
ends need no care. Doors of one voxel in such walls may stall the cycles on deep levels; they then end unconverged.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.batching import settle
from maxjax.core.lowering import maximum, once
from maxjax.fields.stencil import Faces, Volume, cell, inflow
from maxjax.solvers.aggregation import Level, correction, levels_of, spread
from maxjax.solvers.medium import Medium, Progress, operator_of

# Weights of the sweeps after a correction, to damp what an aggregate cannot represent: (1 − 0.6 λ)² (1 − λ)²
# |1 − 1.7 λ| stays below 0.07 for 0.4 ≤ λ ≤ 1.9. Plain sweeps do not damp what alternates from voxel to voxel, λ = 2.
_SWEEPS = (0.6, 1.0, 1.7, 1.0, 0.6)
# Cycles end when for so many of them the residual has not fallen below this share of the best.
_PATIENCE, _PROGRESS = 4, 0.8


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _System:
    """What cycles read.

    Attributes:
        faces: conductances of A.
        diagonal: of A; 1 in obstacles.
        goal: the goal's voxel.
        levels: the coarser grids.
    """

    faces: Faces
    diagonal: Volume
    goal: Bool[Array, "nx ny nz"]
    levels: tuple[Level, ...]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _CycleCarry:
    """Carry of the loop.

    Attributes:
        phi: positive on the component, zero elsewhere.
        cycles: taken.
        change: largest relative change of a voxel by the last full sweep.
        best: the least change so far.
        stalled: cycles in a row without progress.
    """

    phi: Volume
    cycles: Int32[Array, ""]
    change: Float[Array, ""]
    best: Float[Array, ""]
    stalled: Int32[Array, ""]


def newton_cycles(medium: Medium, progress: Progress, *, tolerance: float, most: int) -> Progress:
    """Cycles until no sweep would change any voxel by more than `tolerance` of itself.

    Args:
        medium: on a grid that is `aggregation.padded`.
        progress: φ positive on the component, zero elsewhere; its value on the goal is kept. `iterations` count on.
        tolerance: largest |ρ|. Static.
        most: cap on iterations. Static.

    Returns:
        `converged` is False at the cap or once cycles make no progress; `residual` is the largest |ρ|, the relative
        change that one more sweep would make to a voxel.
    """

    def going(_: _System, carry: _CycleCarry) -> Bool[Array, ""]:
        return (carry.cycles < most) & (carry.change > tolerance) & (carry.stalled < _PATIENCE)

    # Most scenes of a city take three or four cycles, few take many.
    last = settle(going, _cycle, _system(medium, progress.length), _carry(progress), parts=16)
    return _progress(progress, last, tolerance)


def so_many_cycles(medium: Medium, progress: Progress, *, tolerance: float, count: int) -> Progress:
    """`newton_cycles`, but this number of them (static), converged or not."""
    system = _system(medium, progress.length)
    last = lax.fori_loop(0, count, lambda _, carry: _cycle(system, carry), _carry(progress))
    return _progress(progress, last, tolerance)


def _system(medium: Medium, length: Float[Array, ""]) -> _System:
    operator = operator_of(medium, length)
    diagonal = jnp.where(operator.diagonal > 0, operator.diagonal, 1)
    levels = levels_of(operator.faces, medium.component, medium.goal)
    return _System(operator.faces, diagonal, cell(medium.component.shape, medium.goal), levels)


def _carry(progress: Progress) -> _CycleCarry:
    return _CycleCarry(progress.phi, progress.iterations, progress.residual, progress.residual, jnp.int32(0))


def _progress(before: Progress, carry: _CycleCarry, tolerance: float) -> Progress:
    return dataclasses.replace(
        before,
        phi=carry.phi,
        iterations=carry.cycles,
        residual=carry.change,
        converged=carry.change <= tolerance,
    )


def _cycle(system: _System, carry: _CycleCarry) -> _CycleCarry:
    """One correction, and sweeps."""
    phi = carry.phi
    if system.levels:
        delta = correction(system.faces, system.diagonal, phi, system.levels)
        phi = phi / spread(jnp.exp(-delta), system.levels[0].axes)
    for weight in _SWEEPS[:-1]:
        phi = once(_sweep(system, phi, weight))
    with jax.named_scope("change"):
        after = _sweep(system, phi, 1.0)
        change = maximum(lambda after, phi: jnp.abs(after - phi) / jnp.where(phi > 0, phi, 1), after, phi)
        return _CycleCarry(
            phi=phi + _SWEEPS[-1] * (after - phi),
            cycles=carry.cycles + 1,
            change=change,
            best=jnp.minimum(change, carry.best),
            stalled=jnp.where(change < _PROGRESS * carry.best, 0, carry.stalled + 1),
        )


@jax.named_scope("sweep")
def _sweep(system: _System, phi: Volume, weight: float) -> Volume:
    here = phi * system.diagonal
    # Weights above one may overshoot: what remains of φ stays positive.
    swept = jnp.maximum(weight * inflow(system.faces, phi) + (1 - weight) * here, here / 8)
    return jnp.where(system.goal, here, swept) / system.diagonal
