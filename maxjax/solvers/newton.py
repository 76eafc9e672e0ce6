"""Newton's method for log φ, its linear steps solved by aggregation multigrid (`solvers.aggregation`).

    d_i φ_i = Σ_j w_ij φ_j   (`fields.stencil`; φ > 0, held on the goal)

Linear solvers lose the far field: φ spans hundreds of decades, more than a float can, and what counts is its *relative*
accuracy in every voxel. So the unknown is u = log φ, and of φ only ratios of neighbours are computed (`stencil.rates`):

    p_ij = w_ij e^(u_j − u_i) / d_i,     ρ_i = log Σ_j p_ij = 0

The Newton step δ, u ← u + δ, solves

    δ_i = ρ_i + Σ_j p_ij δ_j / Σ_k p_ik,   δ = 0 on the goal:

a random walk that drifts to the goal (Doob's transform of the leaky one by φ), and δ_i the residual that it meets on
its way. Where the linear problem is about values that e-fold every voxel or two, this one is about transport: its
solution is smooth, and every quantity in it is of order one.

A cycle takes one correction δ, constant on aggregates of 2 × 2 × 2 voxels, and five weighted sweeps of the factor
ψ = e^δ, ψ_i ← ψ_i + ω (Σ_j p_ij ψ_j − ψ_i); then u ← u + log ψ. Everything stays positive: walls one voxel thick,
sealed pockets and dead ends need no care. Doors of one voxel in such walls may stall the cycles on deep levels; they
then end unconverged. A whole step, whose δ is solved to the end (`solvers.random_walk`), takes longer and stalls
nowhere: Σ_j p_ij is convex in u, so Newton's method converges from any start.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.batching import settle
from maxjax.compile.lowering import maximum, repeat
from maxjax.fields.stencil import Operator, Volume, cell, gather, rates
from maxjax.solvers.aggregation import AggregateLevel, correction, levels_of, spread
from maxjax.solvers.medium import Medium, Progress, operator_of
from maxjax.solvers.random_walk import SWEEPS, imbalance, random_walk

# Beyond it [nats] rounding is not excused.
_FAR = 1e5
# A correction changes no log φ by more than this: where walls mislead the coarse walks, they overshoot.
_BOUND = 8.0
# Cycles end when for so many of them the residual has not fallen below this share of the best. From a guess whose
# prices are rounded it rises first.
_PATIENCE, _PROGRESS = 8, 0.8
# Whole steps at most: from cycles that stalled, three or four suffice.
_MOST_STEPS = 12


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _System:
    """Inputs of the cycles.

    Attributes:
        operator: A.
        held: where log φ stays as it is: the goal's voxel, and what is not of its component.
        levels: the coarser grids.
    """

    operator: Operator
    held: Bool[Array, "nx ny nz"]
    levels: tuple[AggregateLevel, ...]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _CycleCarry:
    """Carry of the loop.

    Attributes:
        log_phi: finite on the component, zero elsewhere.
        cycles: taken.
        change: largest relative change of a voxel by the last full sweep.
        best: the least change so far.
        stalled: cycles in a row without progress.
    """

    log_phi: Volume
    cycles: Int32[Array, ""]
    change: Float[Array, ""]
    best: Float[Array, ""]
    stalled: Int32[Array, ""]


def newton_cycles(medium: Medium, progress: Progress, *, tolerance: float, most: int) -> Progress:
    """Cycles until no sweep would change any voxel by more than `tolerance` of itself.

    Args:
        medium: on a grid that is `aggregation.pad_to_aggregates`, conducting on the component only.
        progress: log φ finite on the component, zero elsewhere; its value on the goal is kept. `iterations` count on.
        tolerance: largest |ρ|, beyond what log φ's own rounding brings. Static.
        most: cap on iterations. Static.

    Returns:
        `converged` is False at the cap or once cycles make no progress; `residual` is the largest |ρ|, the relative
        change that one more sweep would make to a voxel.
    """

    def going(_: _System, carry: _CycleCarry) -> Bool[Array, ""]:
        return (carry.cycles < most) & (carry.change > tolerance) & (carry.stalled < _PATIENCE)

    # Scenes of a city take four to nine cycles, few take many.
    system, first = _system(medium, progress.length), _carry(progress)
    last = settle(going, _cycle, system, first, at_once=128)
    return dataclasses.replace(
        progress,
        log_phi=last.log_phi,
        iterations=last.cycles,
        residual=last.change,
        converged=last.change <= tolerance,
    )


@jax.named_scope("newton steps")
def newton_steps(medium: Medium, progress: Progress, *, tolerance: float, wanted: Bool[Array, ""]) -> Progress:
    """Whole Newton steps until no sweep would change any voxel by more than `tolerance` of itself.

    Args:
        medium, progress, tolerance: as of `newton_cycles`.
        wanted: whether any step is taken.
    """

    def going(carry: _CycleCarry) -> Bool[Array, ""]:
        return wanted & (carry.cycles < _MOST_STEPS) & (carry.change > tolerance)

    def step(carry: _CycleCarry) -> _CycleCarry:
        walk = random_walk(medium, progress.length, carry.log_phi)
        residual = imbalance(medium, progress.length, carry.log_phi)
        log_phi = carry.log_phi + walk.solve(residual)
        after = imbalance(medium, progress.length, log_phi)
        change = maximum(_beyond_rounding, after, log_phi)
        return dataclasses.replace(carry, log_phi=log_phi, cycles=carry.cycles + 1, change=change)

    last = lax.while_loop(going, step, dataclasses.replace(_carry(progress), cycles=jnp.int32(0)))
    # What is no number has no residual either.
    better = jnp.isfinite(last.change) & (last.cycles > 0)
    return dataclasses.replace(
        progress,
        log_phi=jnp.where(better, last.log_phi, progress.log_phi),
        iterations=progress.iterations + last.cycles,
        residual=jnp.where(better, last.change, progress.residual),
        converged=progress.converged | (better & (last.change <= tolerance)),
    )


def _beyond_rounding(change: Volume, log_phi: Volume) -> Volume:
    """How much larger a change is than what the rounding of log φ ≤ 0 itself brings."""
    ulp = 4 * float(np.finfo(log_phi.dtype).eps)
    return jnp.maximum(jnp.abs(change) + ulp * jnp.maximum(log_phi, -_FAR), 0)


def _system(medium: Medium, length: Float[Array, ""]) -> _System:
    operator = operator_of(medium, length)
    levels = levels_of(operator.faces, medium.component, medium.goal)
    return _System(operator, cell(medium.component.shape, medium.goal) | ~medium.component, levels)


def _carry(progress: Progress) -> _CycleCarry:
    return _CycleCarry(progress.log_phi, progress.iterations, progress.residual, progress.residual, jnp.int32(0))


def _cycle(system: _System, carry: _CycleCarry) -> _CycleCarry:
    """One correction, and sweeps."""
    links = rates(system.operator.faces, carry.log_phi)
    diagonal = jnp.where(system.operator.diagonal > 0, system.operator.diagonal, 1)
    psi = jnp.ones_like(carry.log_phi)
    if system.levels:
        delta = jnp.clip(correction(links, diagonal, carry.log_phi, system.levels), -_BOUND, _BOUND)
        psi = jnp.where(system.held, psi, spread(jnp.exp(delta), system.levels[0].axes))

    def sweep(psi: Volume, weight: Float[Array, ""] | float) -> Volume:
        here = psi * diagonal
        # Weights above one may overshoot: what remains is positive.
        swept = jnp.maximum(weight * gather(links, psi) + (1 - weight) * here, here / 8)
        return jnp.where(system.held, here, swept) / diagonal

    weights = jnp.asarray(SWEEPS, psi.dtype)
    with jax.named_scope("sweep"):
        first = jnp.int32(0), psi
        _, psi = repeat(len(SWEEPS) - 1, lambda state: (state[0] + 1, sweep(state[1], weights[state[0]])), first)
    with jax.named_scope("change"):
        after = sweep(psi, 1.0)
        change = maximum(
            lambda after, psi, log_phi: _beyond_rounding((after - psi) / psi, log_phi), after, psi, carry.log_phi
        )
        return _CycleCarry(
            log_phi=carry.log_phi + jnp.log(psi + SWEEPS[-1] * (after - psi)),
            cycles=carry.cycles + 1,
            change=change,
            best=jnp.minimum(change, carry.best),
            stalled=jnp.where(change < _PROGRESS * carry.best, 0, carry.stalled + 1),
        )
