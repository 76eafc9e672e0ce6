"""The default setting: a leak κ n², insulated outer faces; Newton's method on log φ.

    −∇·(σ∇φ) + κ n² σ φ = q,    κ = 1/ℓ²

A guess that decays with geodesic distance, then Newton cycles (`solvers.newton`) until one more sweep would change no
voxel by more than a small part of *its own* φ, then positive sweeps until the field is certified (`solvers.certify`).
Where that is out of reach, as in a maze whose doors stall the cycles, the flood's distance takes its place
(`solvers.geodesic_solver`): certified as well, its prices rounded, and marked. Where a tolerance is asked for, values
count: cycles that stall are then followed by whole Newton steps (`solvers.newton`).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.fields import stencil
from maxjax.fields.price import SCREENING_LENGTH, decay
from maxjax.solvers.certify import decide_status, sweep_until_certified
from maxjax.solvers.cg import SWEEPS_BETWEEN_LOOKS
from maxjax.solvers.geodesic_solver import or_geodesic
from maxjax.solvers.medium import Medium, Progress, Stage, check_settings, pad_medium, tolerance_of
from maxjax.solvers.newton import newton_cycles, newton_steps

# Relative change of any voxel by one more sweep, by a number's bytes. Errors that remain are smooth, some ten times as
# large at the far end, and leave directions alone.
TOLERANCES = {4: 1e-2, 8: 1e-12}
# With prices the last voxels to settle lie beside walls, where few ways lead: when none changes by five times as much,
# log φ is as accurate as without prices (0.02 to 0.2 beside 0.04 to 0.3 at most, in eight windows of a city).
_PRICED = 5.0


@dataclasses.dataclass(frozen=True)
class Screened:
    """The default: Newton on log φ, insulated outer faces.

    Attributes:
        tolerance: the relative change of any voxel by one more sweep at which cycles end; None: `TOLERANCES`,
            and five times as much where there are prices.
        max_iterations: cap on Newton cycles.
        max_sweeps: cap on positive sweeps.
        or_geodesic: whether the flood's distance takes the place of a field that is not certified.

    Raises:
        ValueError: if the tolerance is not positive, or a cap no whole number of at least 0.
    """

    tolerance: float | None = None
    max_iterations: int = 100
    max_sweeps: int = 64
    or_geodesic: bool = True

    tolerances: ClassVar[Mapping[int, float]] = TOLERANCES
    grounded: ClassVar[bool] = False
    attempts: ClassVar[int] = 1

    def __post_init__(self) -> None:
        check_settings(self.tolerance, self.max_iterations, self.max_sweeps)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Guess, Newton cycles, whole Newton steps, sweeps, the flood's distance, status."""
        sweep = functools.partial(sweep_until_certified, most=self.max_sweeps, between=SWEEPS_BETWEEN_LOOKS)
        exact = () if self.tolerance is None else (self.fall_back,)
        last = (or_geodesic,) if self.or_geodesic else ()
        return guess, self.iterate, *exact, sweep, *last, decide_status

    def screening_length(self, medium: Medium) -> Float[Array, ""]:
        """The same for all maps."""
        return jnp.asarray(SCREENING_LENGTH, medium.sigma.dtype)

    def prepared(self, medium: Medium) -> Medium:
        """On whole aggregates."""
        return pad_medium(medium)

    def iterate(self, medium: Medium, progress: Progress) -> Progress:
        """Newton cycles."""
        tolerance = tolerance_of(self, medium)
        if self.tolerance is None and medium.price is not None:
            tolerance *= _PRICED
        return newton_cycles(medium, progress, tolerance=tolerance, most=self.max_iterations)

    def fall_back(self, medium: Medium, progress: Progress) -> Progress:
        """Whole Newton steps where the cycles stalled."""
        stalled = ~progress.converged & (progress.iterations < self.max_iterations)
        return newton_steps(medium, progress, tolerance=tolerance_of(self, medium), wanted=stalled)


@jax.named_scope("guess")
def guess(medium: Medium, progress: Progress) -> Progress:
    """A guess where no iteration has been taken."""
    decaying = guess_log_phi(medium.distance, progress.length, medium.component)
    return dataclasses.replace(progress, log_phi=jnp.where(progress.iterations > 0, progress.log_phi, decaying))


def guess_log_phi(
    distance: Int32[Array, "nx ny nz"], length: Float[Array, ""], component: Bool[Array, "nx ny nz"]
) -> stencil.Volume:
    """Log φ of a point source where σ ∝ 1/r: φ decays by θ a voxel, 2 (cosh θ − 1) = 1/ℓ², and by √r."""
    far = distance.astype(length.dtype)
    return jnp.where(component, -decay(1.0, length) * far - jnp.log1p(far) / 2, 0)
