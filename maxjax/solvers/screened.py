"""The default setting: a leak κ n², insulated outer faces; Newton's method on log φ.

    −∇·(σ∇φ) + κ n² σ φ = q,    κ = 1/ℓ²

A guess that decays with geodesic distance, then Newton cycles (`solvers.newton`) until one more sweep would change no
voxel by more than a small part of *its own* φ, then positive sweeps until the field is certified (`solvers.certify`).
Where that is out of reach, as in a maze whose doors stall the cycles, the flood's distance takes its place
(`solvers.geodesic`): certified as well, its prices rounded, and marked. Where a tolerance is asked for, values count:
cycles that stall are then followed by conjugate gradients (`solvers.cg`), as far as φ is within the number format.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.fields import stencil
from maxjax.fields.price import SCREENING_LENGTH, decay
from maxjax.programs.batching import settle
from maxjax.programs.lowering import in_this_turn
from maxjax.solvers.aggregation import padded
from maxjax.solvers.certify import decide_status, sweep_until_certified
from maxjax.solvers.cg import SWEEPS_BETWEEN_LOOKS, ConjugateGradients
from maxjax.solvers.geodesic import or_geodesic
from maxjax.solvers.krylov import Linear
from maxjax.solvers.medium import Medium, Progress, Stage, check_caps, tolerance_of
from maxjax.solvers.newton import newton_cycles

# Relative change of any voxel by one more sweep, by a number's bytes. Errors that remain are smooth, some ten times as
# large at the far end, and leave directions alone.
TOLERANCES = {4: 1e-2, 8: 1e-12}
# With prices the last voxels to settle lie beside walls, where few ways lead: when none changes by five times as much,
# log φ is as accurate as without prices (0.02 to 0.2 beside 0.04 to 0.3 at most, in eight windows of a city).
_PRICED = 5.0


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _FallbackCarry:
    """Carry of the fallback.

    Attributes:
        progress: of the solve.
        stalled: whether it is still to be solved by conjugate gradients.
    """

    progress: Progress
    stalled: Bool[Array, ""]


@dataclasses.dataclass(frozen=True)
class Screened:
    """The solver `screened`.

    Attributes:
        tolerance: the relative change of any voxel by one more sweep at which cycles end; None: `TOLERANCES`,
            and five times as much where there are prices.
        max_iterations: cap on Newton cycles, and on CG iterations.
        max_sweeps: cap on positive sweeps.
        or_geodesic: whether the flood's distance takes the place of a field that is not certified.

    Raises:
        ValueError: if a cap is no whole number of at least 0.
    """

    tolerance: float | None = None
    max_iterations: int = 100
    max_sweeps: int = 64
    or_geodesic: bool = True

    tolerances: ClassVar[Mapping[int, float]] = TOLERANCES
    grounded: ClassVar[bool] = False
    attempts: ClassVar[int] = 1

    def __post_init__(self) -> None:
        check_caps(self.max_iterations, self.max_sweeps)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Guess, Newton cycles, conjugate gradients, sweeps, the flood's distance, status."""
        sweep = functools.partial(sweep_until_certified, most=self.max_sweeps, between=SWEEPS_BETWEEN_LOOKS)
        exact = () if self.tolerance is None else (self.fall_back,)
        last = (or_geodesic,) if self.or_geodesic else ()
        return guess, self.iterate, *exact, sweep, *last, decide_status

    def screening_length(self, medium: Medium) -> Float[Array, ""]:
        """The same for all maps."""
        return jnp.asarray(SCREENING_LENGTH, medium.sigma.dtype)

    def prepared(self, medium: Medium) -> Medium:
        """Its component alone, padded with obstacles, so that every level consists of whole aggregates."""
        sigma = medium.sigma
        return dataclasses.replace(
            medium,
            # What is wrong with it stays.
            sigma=padded(jnp.where(medium.component | ~jnp.isfinite(sigma), sigma, jnp.minimum(sigma, 0))),
            price=None if medium.price is None else padded(medium.price),
            component=padded(medium.component),
            distance=padded(medium.distance),
        )

    def preconditioner(self, medium: Medium, operator: stencil.Operator, faces: stencil.Faces) -> Linear:
        """That of `cg`: it outdoes the V-cycle, which spans no distance faster."""
        return self._linear.preconditioner(medium, operator, faces)

    def iterate(self, medium: Medium, progress: Progress) -> Progress:
        """Newton cycles."""
        tolerance = tolerance_of(self, medium)
        if self.tolerance is None and medium.price is not None:
            tolerance *= _PRICED
        return newton_cycles(medium, progress, tolerance=tolerance, most=self.max_iterations)

    def fall_back(self, medium: Medium, progress: Progress) -> Progress:
        """Conjugate gradients where the cycles stalled; what they do not converge to is dropped."""

        def solve(medium: Medium, carry: _FallbackCarry) -> _FallbackCarry:
            found = self._linear.iterate(in_this_turn(medium, carry.stalled), carry.progress)
            # What underflows has no residual either.
            floor = math.log(float(np.finfo(found.log_phi.dtype).tiny)) + 1
            better = found.converged & (jnp.min(found.log_phi) > floor)
            chosen = jax.tree.map(lambda new, old: jnp.where(better, new, old), found, carry.progress)
            return _FallbackCarry(chosen, jnp.zeros_like(carry.stalled))

        stalled = ~progress.converged & (progress.iterations < self.max_iterations)
        first = _FallbackCarry(progress, stalled)
        return settle(lambda _, carry: carry.stalled, solve, medium, first, at_once=4).progress

    @property
    def _linear(self) -> ConjugateGradients:
        return ConjugateGradients(self.tolerance, self.max_iterations, self.max_sweeps)


@jax.named_scope("guess")
def guess(medium: Medium, progress: Progress) -> Progress:
    """A guess where no iteration has been taken."""
    decaying = guessed(medium.distance, progress.length, medium.component)
    return dataclasses.replace(progress, log_phi=jnp.where(progress.iterations > 0, progress.log_phi, decaying))


def guessed(
    distance: Int32[Array, "nx ny nz"], length: Float[Array, ""], component: Bool[Array, "nx ny nz"]
) -> stencil.Volume:
    """Log φ of a point source where σ ∝ 1/r: φ decays by θ a voxel, 2 (cosh θ − 1) = 1/ℓ², and by √r."""
    far = distance.astype(length.dtype)
    return jnp.where(component, -decay(1.0, length) * far - jnp.log1p(far) / 2, 0)
