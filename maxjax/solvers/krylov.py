"""Preconditioned conjugate gradients, and a Chebyshev polynomial as the preconditioner.

    A x = b,  A symmetric positive definite:   p ← z + β p,   x ← x + α p,   r ← r − α A p,   z = M⁻¹ r

The residual is carried as r = ρ r̂ with |r̂| = 1, because a potential spans more decades than float32 can square: CG
keeps its relative accuracy voxel by voxel long after |r|² would have underflowed. When to stop is the caller's
question: a norm says nothing about the voxels far from the goal, whose φ is small.

Sums are written `jnp.sum(a * b)`, which XLA vectorises on a CPU, and `vdot` it does not (docs/performance.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import once

Vector = Float[Array, "..."]
Linear = Callable[[Vector], Vector]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _CGCarry:
    """Carry of `pcg`. In units of ρ: r and p are those of the textbook divided by |r|.

    Attributes:
        x: iterate.
        r: residual / ρ, of norm 1.
        rho: ρ.
        shrink: by how much the last iteration changed ρ.
        p: direction.
        rz: rᵀ z of the last iteration.
        iterations: taken.
    """

    x: Vector
    r: Vector
    rho: Float[Array, ""]
    shrink: Float[Array, ""]
    p: Vector
    rz: Float[Array, ""]
    iterations: Int32[Array, ""]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _ChebyshevCarry:
    """Carry of `chebyshev`: two iterates in a row, and the last ω."""

    before: Vector
    after: Vector
    omega: Float[Array, ""]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Solution:
    """Result of `pcg`.

    Attributes:
        x: the iterate.
        iterations: CG iterations taken.
        residual: |b − A x| / |b|, recomputed from x, not carried along.
        converged: whether the stopping rule held; False at the iteration cap or after a breakdown.
    """

    x: Vector
    iterations: Int32[Array, ""]
    residual: Float[Array, ""]
    converged: Bool[Array, ""]


def pcg(
    matvec: Linear,
    b: Vector,
    *,
    x0: Vector | None = None,
    precondition: Linear = lambda r: r,
    stop: Callable[[Vector, Vector], Bool[Array, ""]],
    max_iterations: int,
) -> Solution:
    """Solve A x = b by preconditioned conjugate gradients.

    Args:
        matvec: x ↦ A x, symmetric positive definite on the span of b.
        b: right-hand side.
        x0: initial iterate, zero by default.
        precondition: r ↦ M⁻¹ r, linear, symmetric positive definite.
        stop: (x, r) ↦ whether to stop, asked before every iteration; r is the residual b − A x.
        max_iterations: cap.
    """

    def dot(u: Vector, v: Vector) -> Float[Array, ""]:
        return jnp.sum(u * v)

    def unit(r: Vector) -> tuple[Vector, Float[Array, ""]]:
        norm = jnp.sqrt(dot(r, r))
        return r / jnp.where(norm > 0, norm, 1), norm

    def going(carry: _CGCarry) -> Bool[Array, ""]:
        unfinished = (carry.iterations < max_iterations) & (carry.rho > 0) & jnp.isfinite(carry.rho)
        return unfinished & ~stop(carry.x, carry.rho * carry.r)

    def step(carry: _CGCarry) -> _CGCarry:
        # α is that of the textbook, so x moves by ρ α p.
        z = precondition(carry.r)
        rz = dot(carry.r, z)
        p = z + (carry.shrink * rz / carry.rz) * carry.p
        q = matvec(p)
        alpha = rz / dot(p, q)
        r, shrink = unit(carry.r - alpha * q)
        x = carry.x + (carry.rho * alpha) * p
        return _CGCarry(x, r, carry.rho * shrink, shrink, p, rz, carry.iterations + 1)

    x = jnp.zeros_like(b) if x0 is None else x0
    r, rho = unit(b - matvec(x))
    one = jnp.ones_like(rho)
    last = lax.while_loop(going, step, _CGCarry(x, r, rho, one, jnp.zeros_like(b), one, jnp.int32(0)))
    _, size = unit(b)
    _, error = unit(b - matvec(last.x))
    converged = (last.rho == 0) | stop(last.x, last.rho * last.r)
    return Solution(last.x, last.iterations, error / jnp.where(size > 0, size, 1), converged)


def chebyshev(smooth: Linear, radius: Float[Array, ""] | float, degree: int) -> Linear:
    """The Chebyshev iteration for (I − G) z = r, from zero, as a preconditioner.

        z₁ = r,   z_{k+1} = z_{k−1} + ω_k (G z_k + r − z_{k−1}),   ω₀ = 2,   ω_k = 1 / (1 − μ² ω_{k−1} / 4)

    With the spectrum of G inside (−1, 1) it is symmetric positive definite for every μ in (0, 1] when its degree is
    even, and the best polynomial when that spectrum fills [−μ, μ]. It replaces inner products, which cost CG more than
    G does.

    Args:
        smooth: z ↦ G z, symmetric.
        radius: μ.
        degree: k of the result z_k, even: k − 1 applications of G. Static.
    """
    if degree < 2 or degree % 2:
        raise ValueError(f"chebyshev: expected an even positive degree, given {degree}")

    def precondition(r: Vector) -> Vector:
        mu = jnp.asarray(radius, r.dtype)

        def omega_after(omega: Float[Array, ""]) -> Float[Array, ""]:
            return 1 / (1 - mu**2 * omega / 4)

        def two(_: Array, carry: _ChebyshevCarry) -> _ChebyshevCarry:
            # Two steps a turn, so that the iterates trade places without a copy.
            omega = omega_after(carry.omega)
            before = once(carry.before + omega * (smooth(carry.after) + r - carry.before))
            omega = omega_after(omega)
            return _ChebyshevCarry(before, carry.after + omega * (smooth(before) + r - carry.after), omega)

        # z₁ and z₂ by hand: the loop then advances from an odd and an even iterate to the next pair.
        omega = omega_after(jnp.asarray(2, r.dtype))
        first = _ChebyshevCarry(r, omega * (smooth(r) + r), omega)
        return jnp.asarray(lax.fori_loop(0, degree // 2 - 1, two, first).after)

    return precondition
