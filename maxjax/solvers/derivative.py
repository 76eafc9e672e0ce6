"""The implicit derivative of the potential.

    F(φ, σ, n, κ) = A φ − q = 0     ⇒     A dφ = −(∂F/∂σ dσ + ∂F/∂n dn + ∂F/∂κ dκ),     d log φ = dφ / φ

by the implicit function theorem: one more solve with the same symmetric A. It is written with
`lax.custom_linear_solve`, so JAX transposes it for reverse mode: the adjoint λ of a loss L solves A λ = ∂L/∂φ, and
dL/dσ = −λᵀ ∂F/∂σ. Neither iterations nor sweeps are ever differentiated.

The linear solve is one for φ itself: where φ is below the range of its number format, the derivative is 0.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from maxjax.fields import stencil
from maxjax.solvers.krylov import pcg
from maxjax.solvers.medium import Medium, Progress, Solver, held_system, tolerance_of

# Where a derivative is asked for, which depends on the values, the solve is at least as tight as this; by a number's
# bytes.
TIGHT_TOLERANCE = {4: 1e-5, 8: 1e-12}
# Residual of a derivative solve, largest entry beside the largest of the right-hand side, by a number's bytes. An
# adjoint decays over as many decades as φ, and what the derivative needs is the product of both, hence so small.
DERIVATIVE_TOLERANCE = {4: 1e-12, 8: 1e-15}

Solve = Callable[[Solver, Medium, Float[Array, ""]], Progress]
Leaves = dict[str, Any]


def differentiable(solve: Solve, solver: Solver, medium: Medium, length: Float[Array, ""]) -> Progress:
    """solve(solver, medium, length), whose `log_phi` is differentiable in `medium.sigma`, `medium.price` and `length`.

    Args:
        solve: to be differentiated. Static.
        solver: its settings. Static.
        medium: of any shape; `sigma` and `price` are its differentiable parts.
        length: ℓ to begin with.
    """
    static = {name: getattr(medium, name) for name in ("shape", "grounded")}
    arrays = {name: value for name, value in vars(medium).items() if name not in static}
    return Progress(**_solved(solve, solver, tuple(static.items()), arrays, length))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1, 2))
def _solved(solve: Solve, solver: Solver, static: tuple[Any, ...], arrays: Leaves, length: Array) -> Leaves:
    """In dictionaries, since tangents of whole numbers have no place in a dataclass."""
    return dict(vars(solve(solver, Medium(**arrays, **dict(static)), length)))


@_solved.defjvp
def _solved_jvp(solve, solver, static, primals, tangents):  # type: ignore[no-untyped-def]
    """Solve A φ̇ = −(∂F/∂σ σ̇ + ∂F/∂n ṅ + ∂F/∂ℓ ℓ̇)."""
    (arrays, length), (arrays_dot, length_dot) = primals, tangents
    medium = Medium(**arrays, **dict(static))
    tight = min(tolerance_of(solver, medium), TIGHT_TOLERANCE[medium.sigma.dtype.itemsize])
    solver = dataclasses.replace(solver, tolerance=tight)
    solved = _solved(solve, solver, static, arrays, length)

    phi = jnp.where(medium.component, jnp.exp(solved["log_phi"]), 0)

    def imbalance(sigma: stencil.Volume, price: stencil.Volume | None, length: Float[Array, ""]) -> stencil.Volume:
        operator, source = held_system(dataclasses.replace(medium, sigma=sigma, price=price), length)
        return stencil.residual(operator, phi, source)

    _, right = jax.jvp(
        imbalance,
        (medium.sigma, medium.price, solved["length"]),
        (arrays_dot["sigma"], arrays_dot["price"], length_dot),
    )
    operator, _ = held_system(medium, solved["length"])
    faces, scale = stencil.normalize(operator)
    tolerance = DERIVATIVE_TOLERANCE[medium.sigma.dtype.itemsize]
    precondition = solver.preconditioner(medium, operator, faces)

    def solve_linear(matvec, b):  # type: ignore[no-untyped-def]
        return pcg(
            matvec,
            b,
            precondition=precondition,
            stop=lambda _, r: jnp.max(jnp.abs(r)) <= tolerance * jnp.max(jnp.abs(b)),
            max_iterations=solver.max_iterations,
        ).x

    y_dot = lax.custom_linear_solve(lambda y: y - stencil.inflow(faces, y), scale * right, solve_linear, symmetric=True)

    def zero(x: Array) -> Array:
        return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.floating) else jnp.zeros(x.shape, jax.dtypes.float0)

    log_dot = jnp.where(phi > 0, scale * y_dot / jnp.where(phi > 0, phi, 1), 0)
    return solved, {**jax.tree.map(zero, solved), "log_phi": log_dot}
