"""Conjugate gradients for the screened setting: a reference.

    (I − G) y = D^-1/2 q,   φ = D^-1/2 y,   I − G = D^-1/2 A D^-1/2        (`fields.stencil.normalize`)

with a Chebyshev polynomial of G as the preconditioner, until the residual of every voxel is small beside its own φ: a
norm says nothing about voxels far from the goal, where φ is small. Slower than Newton's cycles, but indifferent to
walls.
"""

from __future__ import annotations

import abc
import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.fields import stencil
from maxjax.fields.gradient import log_potential
from maxjax.fields.price import SCREENING_LENGTH
from maxjax.solvers.certify import decide_status, sweep_until_certified
from maxjax.solvers.krylov import Linear, chebyshev, pcg
from maxjax.solvers.medium import Medium, Progress, Stage, check_settings, system_with_goal, tolerance_of

# Degree of the Chebyshev preconditioner. The vector work of a CG iteration costs as much as eight applications of the
# stencil on two CPU cores, and a synchronisation on a GPU, so few iterations are taken.
DEGREE = 32
# Of a voxel's residual beside its own φ, by a number's bytes.
TOLERANCES = {4: 1e-2, 8: 1e-12}
SWEEPS_BETWEEN_LOOKS = 8
# float32 spans 87 nats below 1. What distance does not use up is left to prices and narrow passages, which attenuate φ
# as well, and to the few per cent by which `geodesic` may fall short.
NATS = 68.0


def screening_length_for(distance: Int32[Array, "nx ny nz"]) -> Float[Array, ""]:
    """The shortest screening length [voxels], not below the default, at which float32 spans the goal's component.

    Args:
        distance: to the goal inside its component (`fields.geodesic`) [voxels].
    """
    return jnp.maximum(jnp.max(distance).astype(jnp.float32) / NATS, SCREENING_LENGTH)


@dataclasses.dataclass(frozen=True)
class LinearSolver(abc.ABC):
    """Conjugate gradients on the scaled system from φ = 0, sweeps, status: `ConjugateGradients` and `PaperSetting`.

    Attributes:
        tolerance: of the stopping rule; None: `tolerances`.
        max_iterations: cap on CG iterations.
        max_sweeps: cap on positive sweeps.

    Raises:
        ValueError: if the tolerance is not positive, or a cap no whole number of at least 0.
    """

    tolerance: float | None = None
    max_iterations: int = 100
    max_sweeps: int = 400

    tolerances: ClassVar[Mapping[int, float]]
    grounded: ClassVar[bool]
    attempts: ClassVar[int]

    def __post_init__(self) -> None:
        check_settings(self.tolerance, self.max_iterations, self.max_sweeps)

    @abc.abstractmethod
    def preconditioner(self, medium: Medium, operator: stencil.Operator, faces: stencil.Faces) -> Linear:
        """Of I − G, whose faces these are."""

    @abc.abstractmethod
    def small(self, tolerance: float, y: stencil.Volume, r: stencil.Volume, b: stencil.Volume) -> Bool[Array, ""]:
        """The stopping rule: whether the residual r of the iterate y is small; b is the right-hand side."""

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Iterations, sweeps, status."""
        sweep = functools.partial(sweep_until_certified, most=self.max_sweeps, between=SWEEPS_BETWEEN_LOOKS)
        return self.iterate, sweep, decide_status

    def screening_length(self, medium: Medium) -> Float[Array, ""]:
        """Such that float32 spans φ."""
        return screening_length_for(medium.distance)

    def prepared(self, medium: Medium) -> Medium:
        """As it is."""
        return medium

    @jax.named_scope("conjugate gradients")
    def iterate(self, medium: Medium, progress: Progress) -> Progress:
        """Conjugate gradients from φ = 0 until the stopping rule holds; `iterations` count on."""
        operator, source = system_with_goal(medium, progress.length)
        faces, scale = stencil.normalize(operator)
        b, tolerance = source * scale, tolerance_of(self, medium)
        solution = pcg(
            lambda y: y - stencil.inflow(faces, y),
            b,
            precondition=self.preconditioner(medium, operator, faces),
            stop=lambda y, r: self.small(tolerance, y, r, b),
            max_iterations=self.max_iterations,
        )
        return dataclasses.replace(
            progress,
            log_phi=jnp.where(medium.component, log_potential(scale * solution.x), 0),
            iterations=progress.iterations + solution.iterations,
            residual=solution.residual,
            converged=solution.converged,
        )


@dataclasses.dataclass(frozen=True)
class ConjugateGradients(LinearSolver):
    """Conjugate gradients, screened, insulated outer faces; until |r_i| ≤ tolerance · y_i in every voxel."""

    tolerances: ClassVar[Mapping[int, float]] = TOLERANCES
    grounded: ClassVar[bool] = False
    attempts: ClassVar[int] = 4

    def preconditioner(self, medium: Medium, operator: stencil.Operator, faces: stencil.Faces) -> Linear:
        """The Chebyshev polynomial, its interval from the largest row sum (Gershgorin)."""
        diagonal = jnp.where(operator.diagonal > 0, operator.diagonal, 1)
        rows = stencil.inflow(operator.faces, jnp.ones_like(diagonal)) / diagonal
        # Below 1 - λ = 1/degree² a polynomial of this degree can do nothing; those few modes are left to CG.
        radius = jnp.minimum(jnp.max(rows), 1 - 1 / DEGREE**2)
        return chebyshev(functools.partial(stencil.inflow, faces), radius, DEGREE)

    def small(self, tolerance: float, y: stencil.Volume, r: stencil.Volume, b: stencil.Volume) -> Bool[Array, ""]:
        """The residual of every voxel is small beside its own y."""
        return jnp.all(jnp.abs(r) <= tolerance * y)
