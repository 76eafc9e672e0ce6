"""The conduction potential: solve, sweep until certified, and differentiate implicitly.

    A(σ, κ) φ = 0 on free voxels,   φ = 1 on the goal,   κ = 1/ℓ²

Settings: `screened` (leak κ, insulated outer faces; the default) and `paper` (κ = 0, outer faces grounded). Scaling φ
to 1 at the goal instead of feeding a unit source changes φ by a factor only, and spends float32's range where it is
needed.

Forward. Conjugate gradients on the Jacobi-scaled system, a Chebyshev polynomial as preconditioner, from φ = 0. (A guess
that decays with geodesic distance was tried and saves nothing: polynomials in A carry what error there is near the goal
outwards, one voxel a step, until its factor is below the φ of the farthest voxel.) It stops when the residual of every
voxel is small beside *that voxel's* φ: the relative change that one more sweep would make. Then positive sweeps
φ_i ← Σ_j w_ij φ_j / d_i run until the field is certified (`fields.certificate`) or a cap is reached.

Derivative. With F(φ, σ, κ) = A φ − q = 0, the implicit function theorem gives  A dφ = −(∂F/∂σ dσ + ∂F/∂κ dκ): one more
solve with the same symmetric A. It is written with `lax.custom_linear_solve`, so JAX transposes it for reverse mode:
the adjoint λ of a loss L solves A λ = ∂L/∂φ, and dL/dσ = −λᵀ ∂F/∂σ. Neither iterations nor sweeps are ever
differentiated.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.status import Status
from maxjax.fields import stencil
from maxjax.fields.certificate import uncertified
from maxjax.fields.connectivity import extent, flood
from maxjax.solvers.krylov import chebyshev, pcg

Setting = Literal["screened", "paper"]

# Degree of the Chebyshev preconditioner. The vector work of a CG iteration costs as much as eight applications of G on
# two CPU cores, and a wait for the device on a GPU, so few iterations are taken.
DEGREE = 32
# Residual of each voxel beside its own φ at which CG hands over to the sweeps, by number of bytes. The error falls by
# orders of magnitude within a few iterations once the front of the solution has passed a voxel, so the value hardly
# matters.
LOCAL_TOLERANCE = {4: 1e-2, 8: 1e-12}
# Residual of a derivative solve, largest entry beside the largest of the right-hand side, by number of bytes. An
# adjoint decays over as many decades as φ, and what the derivative needs is the product of both, hence so small.
DERIVATIVE_TOLERANCE = {4: 1e-12, 8: 1e-15}
SWEEPS = 8
# float32 spans 87 nats below 1. What distance does not use up is left to narrow passages, which attenuate φ as well,
# and to the 13 % by which `extent` may fall short.
NATS = 68.0
SHORTEST_LENGTH = 1.5
# Where that was not enough, the screening length grows by this factor.
_LENGTHEN = 1.5
_ATTEMPTS = 4


@dataclasses.dataclass(frozen=True)
class _Caps:
    """What is static in a solve."""

    setting: Setting
    max_iterations: int
    max_sweeps: int
    attempts: int


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Potential:
    """A potential and what is known of it.

    Attributes:
        phi: potential, 1 at the goal, 0 in obstacles and in pockets that no current reaches.
        status: `Status` as int32: OK, NOT_CONVERGED, NOT_CERTIFIED, GOAL_OUTSIDE_MAP, GOAL_OCCUPIED, NONFINITE_INPUT.
        iterations: CG iterations (each of `DEGREE` applications of the stencil).
        sweeps: positive sweeps after them.
        residual: |q − A φ| / |q| of the Jacobi-scaled system after CG, recomputed from φ.
        certified: every voxel of the goal's component but the goal has a strictly higher face neighbour.
        uncertified: number of voxels that have none.
        screening_length: ℓ that was used [voxels].
    """

    phi: Float[Array, "*batch nx ny nz"]
    status: Int32[Array, "*batch"]
    iterations: Int32[Array, "*batch"]
    sweeps: Int32[Array, "*batch"]
    residual: Float[Array, "*batch"]
    certified: Bool[Array, "*batch"]
    uncertified: Int32[Array, "*batch"]
    screening_length: Float[Array, "*batch"]


def screening_length_for(component: Bool[Array, "nx ny nz"], goal_index: Int32[Array, " 3"]) -> Float[Array, ""]:
    """The shortest screening length [voxels] at which float32 spans the goal's component.

    The shorter it is, the closer to shortest paths: −ℓ log φ tends to geodesic distance (Varadhan 1967). Below one and
    a half voxels the lattice itself shows.

    Args:
        component: the goal's component.
        goal_index: voxel of the goal.
    """
    return jnp.maximum(extent(component, goal_index) / NATS, SHORTEST_LENGTH)


def solve_potential(
    sigma: Float[Array, "nx ny nz"],
    goal_index: Int32[Array, " 3"],
    *,
    screening_length: Float[Array, ""] | float | None = None,
    setting: Setting = "screened",
    max_iterations: int = 200,
    max_sweeps: int = 400,
) -> Potential:
    """The certified conduction potential of a conductivity field; composes with `jit`, `vmap` and `grad`.

    Args:
        sigma: conductivity, zero in obstacles; float32, or float64 for references.
        goal_index: voxel of the goal, int32.
        screening_length: ℓ [voxels], an array argument, taken as it is; by default that of
            `screening_length_for`, lengthened where narrow passages take φ out of float32's range all the same.
            Unused in `paper`.
        setting: `screened` or `paper`. Static.
        max_iterations: cap on CG iterations. Static.
        max_sweeps: cap on positive sweeps. Static.

    Returns:
        A `Potential`; `phi` is differentiable in sigma and screening_length.

    Raises:
        ValueError: for a sigma that is not three-dimensional or not floating, a goal_index that is not (3,), or an
            unknown setting.
    """
    sigma, goal_index = jnp.asarray(sigma), jnp.asarray(goal_index)
    if sigma.ndim != 3 or not jnp.issubdtype(sigma.dtype, jnp.floating):
        raise ValueError(
            f"sigma: expected floating (nx, ny, nz), given {sigma.dtype} {sigma.shape}; use vmap for batches"
        )
    if goal_index.shape != (3,) or not jnp.issubdtype(goal_index.dtype, jnp.integer):
        raise ValueError(f"goal_index: expected integer (3,), given {goal_index.dtype} {goal_index.shape}")
    if setting not in ("screened", "paper"):
        raise ValueError(f"setting: expected 'screened' or 'paper', given {setting!r}")
    attempts = _ATTEMPTS if screening_length is None and setting == "screened" else 1
    goal = goal_index.astype(jnp.int32)
    component = flood(lax.stop_gradient(sigma) > 0, goal)
    if screening_length is None:
        screening_length = screening_length_for(component, goal)
    length = jnp.asarray(screening_length, sigma.dtype)
    caps = _Caps(setting, max_iterations, max_sweeps, attempts)
    return Potential(**_potential(caps, sigma, length, goal, component))


def _system(
    setting: Setting, sigma: stencil.Volume, length: Float[Array, ""], goal: Int32[Array, " 3"]
) -> tuple[stencil.Operator, stencil.Volume]:
    """A and q with φ = 1 held on the goal; a goal outside the grid holds nothing."""
    grounded = setting == "paper"
    operator = stencil.assemble(sigma, 0.0 if grounded else 1 / length**2, grounded)
    # One-hot by comparison, so that an index outside the grid marks no voxel.
    held = jnp.ones((), bool)
    for axis in range(3):
        held = held & (lax.broadcasted_iota(jnp.int32, sigma.shape, axis) == goal[axis])
    return stencil.hold(operator, (held & (sigma > 0)).astype(sigma.dtype))


def _preconditioner(operator: stencil.Operator, links: stencil.Links):  # type: ignore[no-untyped-def]
    """The Chebyshev polynomial for the scaled system: its interval from the largest row sum (Gershgorin)."""
    diagonal = jnp.where(operator.diagonal > 0, operator.diagonal, 1)
    rows = stencil.inflow(operator.faces, jnp.ones_like(diagonal)) / diagonal
    # Below 1 - λ = 1/degree² a polynomial of this degree can do nothing; those few modes are left to CG.
    radius = jnp.minimum(jnp.max(rows), 1 - 1 / DEGREE**2)
    return chebyshev(functools.partial(stencil.gather, links), radius, DEGREE)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _potential(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
) -> dict[str, Array]:
    """The forward solve, with a longer screening length while there is an attempt left and a voxel uncertified.

    Returns the fields of a `Potential` in a plain dictionary, since their tangents make no `Potential`.
    """
    first = _attempt(caps, sigma, length, goal, component)
    if caps.attempts == 1:
        return dict(vars(first))

    def again(state: tuple[Potential, Int32[Array, ""]]) -> tuple[Potential, Int32[Array, ""]]:
        potential, attempt = state
        return _attempt(caps, sigma, _LENGTHEN * potential.screening_length, goal, component), attempt + 1

    def unfinished(state: tuple[Potential, Int32[Array, ""]]) -> Bool[Array, ""]:
        potential, attempt = state
        retry = (potential.status == Status.NOT_CERTIFIED) | (potential.status == Status.NOT_CONVERGED)
        return retry & (attempt < caps.attempts)

    return dict(vars(lax.while_loop(unfinished, again, (first, jnp.int32(1)))[0]))


def _attempt(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
) -> Potential:
    operator, source = _system(caps.setting, sigma, length, goal)
    links, scale = stencil.normalize(operator)
    source = source * scale
    tolerance = LOCAL_TOLERANCE[sigma.dtype.itemsize]
    solution = pcg(
        lambda y: y - stencil.gather(links, y),
        source,
        precondition=_preconditioner(operator, links),
        stop=lambda y, r: jnp.all(jnp.abs(r) <= tolerance * y),
        max_iterations=caps.max_iterations,
    )

    y = jnp.maximum(solution.x, 0)
    lost = solution.converged & jnp.any(component & (y == 0))

    def sweep(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        y, sweeps, _ = state
        y = lax.fori_loop(0, SWEEPS, lambda _, y: stencil.gather(links, y) + source, y)
        return y, sweeps + SWEEPS, uncertified(y * scale, component, goal)

    y, sweeps, stuck = lax.while_loop(
        # A voxel at zero is out of float32's range, and sweeps cannot bring it back.
        lambda state: (state[2] != 0) & (state[1] < caps.max_sweeps) & ~(lost & (state[1] > 0)),
        sweep,
        (y, jnp.int32(0), jnp.int32(-1)),
    )
    phi = y * scale
    finite = jnp.all(jnp.isfinite(sigma) & (sigma >= 0)) & jnp.isfinite(length) & (length > 0)
    outside = jnp.any((goal < 0) | (goal >= jnp.asarray(sigma.shape)))
    blocked = ~jnp.any(component)
    certified = finite & ~outside & ~blocked & (stuck == 0) & jnp.all(jnp.isfinite(phi))
    status = jnp.select(
        [~finite, outside, blocked, certified, ~solution.converged],
        [Status.NONFINITE_INPUT, Status.GOAL_OUTSIDE_MAP, Status.GOAL_OCCUPIED, Status.OK, Status.NOT_CONVERGED],
        Status.NOT_CERTIFIED,
    )
    return Potential(
        phi=phi,
        status=status.astype(jnp.int32),
        iterations=solution.iterations,
        sweeps=sweeps,
        residual=solution.residual,
        certified=certified,
        uncertified=stuck,
        screening_length=length,
    )


@_potential.defjvp
def _potential_jvp(caps, primals, tangents):  # type: ignore[no-untyped-def]
    """Solve A φ̇ = −(∂F/∂σ σ̇ + ∂F/∂ℓ ℓ̇); see the head of this module."""
    sigma, length, goal, component = primals
    sigma_dot, length_dot, *_ = tangents
    solved = _potential(caps, sigma, length, goal, component)

    def imbalance(sigma: stencil.Volume, length: Float[Array, ""]) -> stencil.Volume:
        operator, source = _system(caps.setting, sigma, length, goal)
        return stencil.residual(operator, solved["phi"], source)

    _, right = jax.jvp(imbalance, (sigma, solved["screening_length"]), (sigma_dot, length_dot))
    operator, _ = _system(caps.setting, sigma, solved["screening_length"], goal)
    links, scale = stencil.normalize(operator)
    tolerance = DERIVATIVE_TOLERANCE[sigma.dtype.itemsize]

    def solve(matvec, b):  # type: ignore[no-untyped-def]
        return pcg(
            matvec,
            b,
            precondition=_preconditioner(operator, links),
            stop=lambda _, r: jnp.max(jnp.abs(r)) <= tolerance * jnp.max(jnp.abs(b)),
            max_iterations=caps.max_iterations,
        ).x

    y_dot = lax.custom_linear_solve(lambda y: y - stencil.gather(links, y), scale * right, solve, symmetric=True)

    def zero(x: Array) -> Array:
        return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.floating) else jnp.zeros(x.shape, jax.dtypes.float0)

    return solved, {**jax.tree.map(zero, solved), "phi": scale * y_dot}
