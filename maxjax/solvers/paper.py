"""The paper's setting (Bong and Beltrame, arXiv 2605.10880): no leak, outer faces grounded.

    −∇·(σ∇φ) = q,   φ = 0 on the outer faces

No current flows in a dead end, so there the gradient vanishes in float32. Kept for comparison: conjugate gradients,
preconditioned by a V-cycle (`solvers.v_cycle`), until the norm of the residual is small.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool

from maxjax.fields import stencil
from maxjax.solvers.cg import LinearSolver
from maxjax.solvers.krylov import Linear
from maxjax.solvers.medium import Medium
from maxjax.solvers.v_cycle import hierarchy, v_cycle

# |q − A φ| / |q| of the scaled system, by a number's bytes.
TOLERANCES = {4: 1e-6, 8: 1e-13}


@dataclasses.dataclass(frozen=True)
class PaperSetting(LinearSolver):
    """The paper's setting: κ = 0, outer faces grounded; until |r| ≤ tolerance · |b|."""

    tolerances: ClassVar[Mapping[int, float]] = TOLERANCES
    grounded: ClassVar[bool] = True
    attempts: ClassVar[int] = 1

    def preconditioner(self, medium: Medium, operator: stencil.Operator, faces: stencil.Faces) -> Linear:
        """The V-cycle: no leak bounds the condition of A."""
        return v_cycle(hierarchy(operator, medium.component))

    def small(self, tolerance: float, y: stencil.Volume, r: stencil.Volume, b: stencil.Volume) -> Bool[Array, ""]:
        """The norm of the residual is small beside that of the source."""
        return jnp.sum(r * r) <= tolerance**2 * jnp.sum(b * b)
