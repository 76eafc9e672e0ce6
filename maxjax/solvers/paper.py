"""The paper's setting (Bong and Beltrame, arXiv 2605.10880): no leak, outer faces grounded.

    −∇·(σ∇φ) = q,   φ = 0 on the outer faces

No current flows in a dead end, so there the gradient vanishes in float32. Kept for comparison: conjugate gradients,
preconditioned by a V-cycle (`solvers.v_cycle`), until the norm of the residual is small.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool

from maxjax.fields import stencil
from maxjax.solvers.certify import judge, sweep_until_certified
from maxjax.solvers.cg import SWEEPS_BETWEEN_LOOKS, conjugate_gradients
from maxjax.solvers.krylov import Linear
from maxjax.solvers.medium import Medium, Progress, Stage, tolerance_of
from maxjax.solvers.v_cycle import hierarchy, v_cycle

# |q − A φ| / |q| of the scaled system, by a number's bytes.
TOLERANCES = {4: 1e-6, 8: 1e-13}


@dataclasses.dataclass(frozen=True)
class Paper:
    """The solver `paper`.

    Attributes:
        tolerance: |q − A φ| / |q| of the scaled system; None: `TOLERANCES`.
        max_iterations: cap on CG iterations.
        max_sweeps: cap on positive sweeps.
    """

    tolerance: float | None = None
    max_iterations: int = 100
    max_sweeps: int = 400

    tolerances: ClassVar[Mapping[int, float]] = TOLERANCES
    grounded: ClassVar[bool] = True
    attempts: ClassVar[int] = 1
    opening: ClassVar[tuple[Stage, ...]] = ()

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Iterations, sweeps, status."""
        sweep = functools.partial(sweep_until_certified, most=self.max_sweeps, between=SWEEPS_BETWEEN_LOOKS)
        return self.iterate, sweep, judge

    def prepared(self, medium: Medium) -> Medium:
        """As it is."""
        return medium

    def preconditioner(self, medium: Medium, operator: stencil.Operator, faces: stencil.Faces) -> Linear:
        """The V-cycle: no leak bounds the condition of A."""
        return v_cycle(hierarchy(operator, medium.component))

    def iterate(self, medium: Medium, progress: Progress) -> Progress:
        """From φ = 0, until |r| ≤ tolerance · |b|."""
        tolerance = tolerance_of(self, medium)

        def small(_: stencil.Volume, r: stencil.Volume, b: stencil.Volume) -> Bool[Array, ""]:
            return jnp.sum(r * r) <= tolerance**2 * jnp.sum(b * b)

        return conjugate_gradients(self, small, medium, progress)
