"""The implicit derivative of log φ.

    ρ_i(u, σ, n, κ) = log Σ_j w_ij e^(u_j − u_i) − log d_i = 0,   u = log φ
    ⇒     (I − P) du = ∂ρ/∂σ dσ + ∂ρ/∂n dn + ∂ρ/∂κ dκ

by the implicit function theorem: one more solve, with the walk of `solvers.random_walk`. It is written with
`lax.custom_linear_solve`, so JAX transposes it for reverse mode: the adjoint λ of a loss L solves (I − Pᵀ) λ = ∂L/∂u,
and dL/dσ = λᵀ ∂ρ/∂σ. Neither iterations nor sweeps are ever differentiated.

All of it is in u: the derivative of log φ is as accurate 300 voxels from the goal as beside it. In walls, and in what
they seal off, a derivative is 0: give a wall a small conductivity to differentiate through it.
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

from maxjax.solvers.aggregation import pad_to_aggregates
from maxjax.solvers.medium import Medium, Progress, Solver, pad_medium, tolerance_of
from maxjax.solvers.random_walk import imbalance, random_walk

# Where a derivative is asked for, which depends on the values, the solve is at least as tight as this; by a number's
# bytes.
TIGHT_TOLERANCE = {4: 1e-5, 8: 1e-12}

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
    """Solve (I − P) u̇ = ∂ρ/∂σ σ̇ + ∂ρ/∂n ṅ + ∂ρ/∂ℓ ℓ̇."""
    (arrays, length), (arrays_dot, length_dot) = primals, tangents
    medium = Medium(**arrays, **dict(static))
    tight = min(tolerance_of(solver, medium), TIGHT_TOLERANCE[medium.sigma.dtype.itemsize])
    solver = dataclasses.replace(solver, tolerance=tight)
    solved = _solved(solve, solver, static, arrays, length)

    u, component = jnp.where(medium.component, solved["log_phi"], 0), medium.component

    def of_parts(sigma: Array, price: Array | None, length: Array) -> Array:
        return imbalance(dataclasses.replace(medium, sigma=sigma, price=price), length, u)

    # Where nothing conducts, in walls and in what they seal off, σ is no variable.
    sigma_dot = jnp.where(component, arrays_dot["sigma"], 0)
    parts = medium.sigma, medium.price, solved["length"]
    _, right = jax.jvp(of_parts, parts, (sigma_dot, arrays_dot["price"], length_dot))
    walk = random_walk(pad_medium(medium), solved["length"], pad_to_aggregates(u))
    u_dot = lax.custom_linear_solve(
        walk.apply, pad_to_aggregates(right), lambda _, b: walk.solve(b), lambda _, b: walk.solve_transposed(b)
    )

    def zero(x: Array) -> Array:
        return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.floating) else jnp.zeros(x.shape, jax.dtypes.float0)

    log_dot = jnp.where(component, lax.slice(u_dot, (0, 0, 0), component.shape), 0)
    return solved, {**jax.tree.map(zero, solved), "log_phi": log_dot}
