"""The linearised equation of log φ: a random walk to the goal.

    u = log φ,   p_ij = w_ij e^(u_j − u_i) / Σ_k w_ik e^(u_k − u_i):      (I − P) du = r,   du = 0 on the goal

P is the transition matrix of Doob's transform by φ: its rows sum to 1, and it drifts to the goal, where it ends. So
du_i is the sum of r over the steps of a walk from i, and the transposed solution λ, (I − Pᵀ) λ = g, is how often a walk
that starts with the weights g is expected at each voxel. Where φ spans hundreds of decades, both are of order one.

    x ← x + M (b − (I − P) x)

M is one correction on aggregates and five weighted sweeps, as in `solvers.newton`; the transposed system takes Mᵀ.
Where corrections make no progress, as behind doors of one voxel in thin walls, sweeps go on alone: those always
converge. Where the cap comes first, the solution is no number, rather than a wrong one.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.fields.stencil import Links, Volume, cell, gather, rates
from maxjax.solvers.aggregation import AggregateLevel, answer_on_aggregates, levels_of, spread
from maxjax.solvers.medium import Medium, operator_of

# Of the residual beside the right-hand side, by a number's bytes; or, where rounding allows no less, so many rounding
# errors of the solution.
TOLERANCES = {4: 1e-5, 8: 1e-12}
_ROUNDING = 4
# Cycles at most: a walk through a maze takes thousands of steps, of which a cycle without corrections takes five.
_MOST = 2000
# Corrections are left out when for so many cycles the residual has not fallen below this share of the least. Sweeps
# need no such rule: what they carry along does not shrink before it arrives.
_PATIENCE, _PROGRESS = 8, 0.8
# Weights of the sweeps after a correction, to damp what an aggregate cannot represent: (1 − 0.6 λ)² (1 − λ)²
# |1 − 1.7 λ| stays below 0.07 for 0.4 ≤ λ ≤ 1.9. Plain sweeps do not damp what alternates from voxel to voxel, λ = 2.
SWEEPS = (0.6, 1.0, 1.7, 1.0, 0.6)

Norm = Callable[[Volume], Float[Array, ""]]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class RandomWalk:
    """A walk on the goal's component.

    Attributes:
        steps: p_ij, per axis to the neighbour ahead and to the one behind.
        moving: voxels of the component but the goal's: where a walk goes on.
        log_phi: u, zero outside the component.
        levels: the coarser grids.
    """

    steps: Links
    moving: Bool[Array, "nx ny nz"]
    log_phi: Volume
    levels: tuple[AggregateLevel, ...]

    def apply(self, x: Volume) -> Volume:
        """(I − P) x; x itself where no walk moves."""
        return jnp.where(self.moving, x - gather(self.steps, jnp.where(self.moving, x, 0)), x)

    def improve(self, residual: Volume, corrected: Bool[Array, ""]) -> Volume:
        """M residual; without the correction on aggregates where `corrected` is False."""
        residual = jnp.where(self.moving, residual, 0)
        x = jnp.zeros_like(residual)
        if self.levels:
            delta = answer_on_aggregates(self.steps, residual, self.log_phi, self.levels)
            x = jnp.where(self.moving & corrected, spread(delta, self.levels[0].axes), 0)

        def sweep(x: Volume, weight: Float[Array, ""]) -> tuple[Volume, None]:
            return x + weight * jnp.where(self.moving, residual + gather(self.steps, x) - x, 0), None

        # A scan, which can be transposed.
        improved: Volume = lax.scan(sweep, x, jnp.asarray(SWEEPS, x.dtype))[0]
        return improved

    def solve(self, right: Volume) -> Volume:
        """(I − P)⁻¹ right, 0 where no walk moves: what a walk from each voxel sums up on its way."""
        right = jnp.where(self.moving, right, 0)
        return _iterate(self.apply, self.improve, right, lambda x: jnp.max(jnp.abs(x)))

    def solve_transposed(self, right: Volume) -> Volume:
        """(I − Pᵀ)⁻¹ right, 0 where no walk moves: how often walks that start with these weights are expected there."""

        def improve(residual: Volume, corrected: Bool[Array, ""]) -> Volume:
            return _transpose(functools.partial(self.improve, corrected=corrected), residual)

        right = jnp.where(self.moving, right, 0)
        # The norm dual to the other one: the weight that has not arrived.
        return _iterate(functools.partial(_transpose, self.apply), improve, right, lambda x: jnp.sum(jnp.abs(x)))


def random_walk(medium: Medium, length: Float[Array, ""], log_phi: Volume) -> RandomWalk:
    """The walk of a solution.

    Args:
        medium: on a grid that is `aggregation.pad_to_aggregates`, conducting on the component only.
        length: ℓ [voxels].
        log_phi: finite on the component, zero elsewhere.
    """
    faces = operator_of(medium, length).faces
    links = rates(faces, log_phi)
    total = sum((forward + backward for forward, backward in links), start=jnp.zeros((), log_phi.dtype))
    moving = medium.component & ~cell(medium.component.shape, medium.goal) & (total > 0)
    part = jnp.where(moving, 1 / jnp.where(total > 0, total, 1), 0)
    steps = tuple((forward * part, backward * part) for forward, backward in links)
    return RandomWalk(steps, moving, log_phi, levels_of(faces, medium.component, medium.goal))  # type: ignore[arg-type]


def imbalance(medium: Medium, length: Float[Array, ""], log_phi: Volume) -> Volume:
    """ρ_i = log Σ_j w_ij e^(u_j − u_i) − log d_i: 0 in a solution, on the goal, and where nothing conducts."""
    operator = operator_of(medium, length)
    links = rates(operator.faces, log_phi)
    total = sum((ahead + behind for ahead, behind in links), start=jnp.zeros((), log_phi.dtype))
    free = medium.component & ~cell(medium.component.shape, medium.goal) & (total > 0)
    return jnp.where(free, jnp.log(jnp.where(free, total, 1) / jnp.where(free, operator.diagonal, 1)), 0)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Carry:
    """Carry of the iteration.

    Attributes:
        x: iterate.
        residual: b − A x.
        size: its norm.
        best: the least so far.
        stalled: cycles in a row without progress.
        corrected: whether cycles take corrections.
        cycles: taken.
    """

    x: Volume
    residual: Volume
    size: Float[Array, ""]
    best: Float[Array, ""]
    stalled: Int32[Array, ""]
    corrected: Bool[Array, ""]
    cycles: Int32[Array, ""]


def _transpose(linear: Callable[[Volume], Volume], x: Volume) -> Volume:
    """Return Lᵀ x of a linear map of volumes."""
    (y,) = jax.linear_transpose(linear, x)(x)
    return jnp.asarray(y)


def _iterate(
    apply: Callable[[Volume], Volume], improve: Callable[[Volume, Bool[Array, ""]], Volume], b: Volume, norm: Norm
) -> Volume:
    """Repeat x ← x + M (b − A x) until the residual is small."""
    tolerance, eps = TOLERANCES[b.dtype.itemsize], float(np.finfo(b.dtype).eps)
    first, none = norm(b), jnp.int32(0)

    def enough(carry: _Carry) -> Bool[Array, ""]:
        return carry.size <= jnp.maximum(tolerance * first, _ROUNDING * eps * norm(carry.x))

    def going(carry: _Carry) -> Bool[Array, ""]:
        return ~enough(carry) & (carry.cycles < _MOST)

    def cycle(carry: _Carry) -> _Carry:
        x = carry.x + improve(carry.residual, carry.corrected)
        residual = b - apply(x)
        size = norm(residual)
        stalled = jnp.where(size < _PROGRESS * carry.best, 0, carry.stalled + 1)
        ends = carry.corrected & (stalled >= _PATIENCE)
        # What corrections have made worse is dropped with them.
        worse = ends & ~(size < first)
        return _Carry(
            x=jnp.where(worse, 0, x),
            residual=jnp.where(worse, b, residual),
            size=jnp.where(worse, first, size),
            best=jnp.minimum(size, carry.best),
            stalled=jnp.where(ends, 0, stalled),
            corrected=carry.corrected & ~ends,
            cycles=carry.cycles + 1,
        )

    last = lax.while_loop(going, cycle, _Carry(jnp.zeros_like(b), b, first, first, none, jnp.array(True), none))
    return jnp.where(enough(last), last.x, jnp.nan)
