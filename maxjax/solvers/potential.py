"""The conduction potential of a map, certified and differentiable: the public function.

    A(σ, κ n²) φ = 0 on free voxels,   φ = 1 on the goal,   κ = 1/ℓ²

A price n ≥ 1 is what a metre costs: −ℓ log φ tends to min ∫ n ds as ℓ shrinks (Varadhan 1967, with the metric n).

Solvers: `Screened` (leak κ, insulated outer faces; the default), `ConjugateGradients` (the same, by conjugate gradients
alone) and `PaperSetting` (κ = 0, outer faces grounded), each in a file of its own. Scaling φ to 1 at the goal instead
of feeding a unit source changes φ by a factor only, and spends float32's range where it is needed.

What is returned is log φ, since φ itself may span more than a float can. ℓ is 1.25 voxels, whatever the map's size;
the other two solve for φ, so `ConjugateGradients` chooses ℓ such that float32 spans it, and lengthens it where that was
not enough.
The solver does one attempt; what it finds carries the implicit derivative (`solvers.derivative`).
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.forked import refuse_after_fork
from maxjax.compile.lowering import maximum
from maxjax.core.status import Status
from maxjax.solvers.derivative import differentiable
from maxjax.solvers.medium import Medium, Progress, Solver, medium_of, no_progress, run
from maxjax.solvers.screened import Screened

SCREENED = Screened()

# Where float32's range was not enough, the screening length grows by this factor.
_LENGTHEN = 1.5
# Sigma is scaled by a power of two to a maximum between 2¹⁹ and 2²⁰, as `fields.conductivity` has it: exact, and φ does
# not depend on the scale, but products of two conductivities must stay within float32's range.
_EXPONENT = 20


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Potential:
    """A potential and what is known of it.

    Attributes:
        log_phi: logarithm of the potential: 0 at the goal, −∞ in obstacles and in pockets that no current reaches.
        status: `Status` as int32: OK, NOT_CONVERGED, NOT_CERTIFIED, GOAL_OUTSIDE_MAP, GOAL_OCCUPIED, NONFINITE_INPUT.
        iterations: Newton cycles (`Screened`); CG iterations (the others).
        sweeps: positive sweeps after them.
        residual: largest relative change that one more sweep would have made (`Screened`); |q − A φ| / |q| of the
            Jacobi-scaled system, recomputed from φ (the others).
        certified: every voxel of the goal's component but the goal has a strictly higher face neighbour, in `log_phi`.
        uncertified: number of voxels that have none.
        screening_length: ℓ that was used [voxels].
        geodesic: `log_phi` is no solution but the flood's distance (`solvers.geodesic_solver`), where none was
            certified.
    """

    log_phi: Float[Array, "*batch nx ny nz"]
    status: Int32[Array, "*batch"]
    iterations: Int32[Array, "*batch"]
    sweeps: Int32[Array, "*batch"]
    residual: Float[Array, "*batch"]
    certified: Bool[Array, "*batch"]
    uncertified: Int32[Array, "*batch"]
    screening_length: Float[Array, "*batch"]
    geodesic: Bool[Array, "*batch"]

    @property
    def phi(self) -> Float[Array, "*batch nx ny nz"]:
        """The potential, 1 at the goal; 0 where `log_phi` is −∞ or beyond the number format."""
        return jnp.exp(self.log_phi)


def solve_potential(
    sigma: Float[Array, "nx ny nz"],
    goal_index: Int32[Array, " 3"],
    price: Float[Array, "..."] | None = None,
    *,
    screening_length: Float[Array, ""] | float | None = None,
    solver: Solver = SCREENED,
) -> Potential:
    """The certified conduction potential of a conductivity field; composes with `jit`, `vmap` and `grad`.

    Args:
        sigma: conductivity, zero in obstacles, of any scale; float32, or float64 for references.
        goal_index: voxel of the goal, int32.
        price: n ≥ 1, what a metre costs, finite wherever sigma is positive; None: 1. Unused in `PaperSetting`.
            On the lattice φ decays along an axis by 2 asinh(n / 2ℓ) a voxel, which falls short of n/ℓ where n is large:
            `fields.price.lattice_price` makes up for it.
        screening_length: ℓ [voxels], an array argument, taken as it is; by default 1.25, in `ConjugateGradients` the
            length at which float32 spans φ. Unused in `PaperSetting`.
        solver: `maxjax.Screened()`, `PaperSetting()` or `ConjugateGradients()`. Their `tolerance` says when the solve
            stops. `Screened`: the relative change of any voxel by one more sweep; by default 1e-2 in float32, where
            directions are right and values to some ten times that (1e-5 once a derivative is taken, 1e-12 in float64);
            values to 1 % need 1e-4. `ConjugateGradients`: the residual of any voxel beside its own φ, likewise.
            `PaperSetting`: the residual's norm over the source's, by default 1e-6 (1e-13 in float64). `Screened` always
            answers (`geodesic`), unless `or_geodesic=False`; the others may end NOT_CONVERGED or NOT_CERTIFIED. Static.

    Returns:
        A `Potential`; `log_phi` is differentiable in sigma, price and screening_length at any distance from the goal
        (`phi` as far as it is within the range of its number format). In walls the derivative is 0.

    Raises:
        ValueError: for a sigma that is not three-dimensional or neither float32 nor float64, a goal_index that is not
            (3,), a price that is not of sigma's shape, or a solver that is none.
        RuntimeError: in a process that was forked after JAX had run.
    """
    refuse_after_fork()
    sigma, goal_index = jnp.asarray(sigma), jnp.asarray(goal_index)
    check_inputs(sigma, goal_index, price)
    if isinstance(solver, type) or not isinstance(solver, Solver):
        raise ValueError(f"solver: expected a solver, as maxjax.Screened(), given {solver!r}")
    price = None if price is None else jnp.asarray(price, sigma.dtype)
    if screening_length is not None:
        screening_length = jnp.asarray(screening_length, sigma.dtype)
    found: Potential = _potential(solver, sigma, goal_index.astype(jnp.int32), price, screening_length)
    return found


def check_inputs(sigma: Array, goal_index: Array, price: Array | None = None) -> None:
    """Raise a ValueError unless shapes and dtypes are those of `solve_potential`."""
    if price is not None and jnp.shape(price) != sigma.shape:
        raise ValueError(f"price: expected the shape of sigma, {sigma.shape}, given {jnp.shape(price)}")
    if sigma.ndim != 3 or sigma.dtype not in (jnp.float32, jnp.float64):
        raise ValueError(
            f"sigma: expected float32 or float64 (nx, ny, nz), given {sigma.dtype} {sigma.shape}; use vmap for batches"
        )
    if goal_index.shape != (3,) or not jnp.issubdtype(goal_index.dtype, jnp.integer):
        raise ValueError(f"goal_index: expected integer (3,), given {goal_index.dtype} {goal_index.shape}")


@functools.partial(jax.jit, static_argnames="solver")
def _potential(
    solver: Solver,
    sigma: Array,
    goal: Int32[Array, " 3"],
    price: Array | None,
    screening_length: Float[Array, ""] | None,
) -> Potential:
    """A program of its own, so that a call outside of `jit` compiles once as well."""
    medium = medium_of(sigma, goal, price, solver.grounded)
    attempts = solver.attempts if screening_length is None else 1
    if screening_length is None:
        screening_length = solver.screening_length(medium).astype(sigma.dtype)
    medium = dataclasses.replace(medium, sigma=sigma * lax.stop_gradient(_scale_of(sigma)))
    found: Progress = differentiable(functools.partial(_solve, attempts), solver, medium, screening_length)
    return potential_of(found, medium.component)


def potential_of(progress: Progress, component: Bool[Array, "nx ny nz"]) -> Potential:
    """The potential of a solve on the goal's component; certified where its status is OK."""
    return Potential(
        log_phi=jnp.where(component, progress.log_phi, -jnp.inf),
        status=progress.status,
        iterations=progress.iterations,
        sweeps=progress.sweeps,
        residual=progress.residual,
        certified=progress.status == Status.OK,
        uncertified=progress.uncertified,
        screening_length=progress.length,
        geodesic=progress.geodesic,
    )


def _scale_of(sigma: Float[Array, "nx ny nz"]) -> Float[Array, ""]:
    """The power of two that brings sigma's maximum to 2^`_EXPONENT` or less, more than half of it."""
    largest = maximum(lambda sigma: sigma, sigma)
    _, exponent = jnp.frexp(jnp.where(jnp.isfinite(largest), largest, 1))
    # 2^126 is the largest power whose inverse is a normal float32, too.
    return jnp.ldexp(jnp.ones((), sigma.dtype), jnp.clip(_EXPONENT - exponent, -126, 126))


def _solve(attempts: int, solver: Solver, medium: Medium, length: Float[Array, ""]) -> Progress:
    """Attempts with longer and longer screening lengths, while there is one left and the solver has not succeeded."""
    here = solver.prepared(medium)

    def attempt(before: Progress) -> Progress:
        again = before.attempts > 0
        progress = dataclasses.replace(
            before,
            length=before.length * jnp.where(again, _LENGTHEN, 1).astype(length.dtype),
            iterations=jnp.where(again, 0, before.iterations),
            residual=jnp.where(again, jnp.inf, before.residual),
            attempts=before.attempts + 1,
        )
        return run(solver.stages, here, progress)

    def unfinished(progress: Progress) -> Bool[Array, ""]:
        retry = (progress.status == Status.NOT_CERTIFIED) | (progress.status == Status.NOT_CONVERGED)
        return retry & (progress.attempts < attempts)

    first = no_progress(here, length)
    found = attempt(first) if attempts == 1 else lax.while_loop(unfinished, attempt, first)
    return dataclasses.replace(found, log_phi=lax.slice(found.log_phi, (0, 0, 0), medium.shape))
