"""The medium that is solved, the progress of a solve, and the protocol of solvers.

    A(σ, κ n²) φ = 0 on free voxels,   φ = 1 on the goal,   κ = 1/ℓ²

A solve is a chain of *stages*, pure functions (Medium, Progress) ↦ Progress. A solver is a frozen dataclass of static
settings whose stages take a `Medium` to a certified φ for one screening length ℓ.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.status import Status
from maxjax.fields import stencil
from maxjax.fields.geodesic import geodesic
from maxjax.fields.price import SCREENING_LENGTH, decay
from maxjax.solvers.aggregation import pad_to_aggregates


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Medium:
    """The conductor.

    Attributes:
        sigma: conductivity, zero in obstacles.
        price: n ≥ 1, what a metre costs; None: 1 everywhere.
        goal: voxel of the goal.
        component: the goal's component of free voxels.
        distance: to the goal inside it, what voxels cost counted (`fields.geodesic`) [voxels].
        shape: of the map; what the volumes hold beyond it is padding, obstacles. Static.
        grounded: whether the outer faces are held at φ = 0 and nothing leaks (the paper's setting); else they are
            insulated and the leak is n²/ℓ². Static.
    """

    sigma: Float[Array, "nx ny nz"]
    price: Float[Array, "nx ny nz"] | None
    goal: Int32[Array, " 3"]
    component: Bool[Array, "nx ny nz"]
    distance: Int32[Array, "nx ny nz"]
    shape: tuple[int, ...] = dataclasses.field(metadata={"static": True})
    grounded: bool = dataclasses.field(default=False, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Progress:
    """How far a solve is.

    Attributes:
        log_phi: logarithm of the iterate; zero outside the goal's component.
        length: ℓ [voxels].
        iterations: of the solver, with this ℓ.
        sweeps: positive sweeps after them.
        residual: as the solver measures it; infinite before the first iteration.
        converged: whether it is within the solver's tolerance.
        uncertified: voxels of the component, goal aside, without a strictly higher neighbour.
        status: `Status` as int32; NOT_CONVERGED until the last stage decides.
        attempts: screening lengths tried, with this one.
        geodesic: whether log φ is the distance of the flood instead of a solution.
    """

    log_phi: Float[Array, "nx ny nz"]
    length: Float[Array, ""]
    iterations: Int32[Array, ""]
    sweeps: Int32[Array, ""]
    residual: Float[Array, ""]
    converged: Bool[Array, ""]
    uncertified: Int32[Array, ""]
    status: Int32[Array, ""]
    attempts: Int32[Array, ""]
    geodesic: Bool[Array, ""]


Stage = Callable[[Medium, Progress], Progress]


@runtime_checkable
class Solver(Hashable, Protocol):
    """Static settings, and the stages of one attempt; hashable, so that `jit` takes it as a static argument."""

    @property
    def tolerance(self) -> float | None:
        """When iterations end; None: by the dtype, of `tolerances`."""

    @property
    def max_iterations(self) -> int:
        """Cap on iterations."""

    @property
    def tolerances(self) -> Mapping[int, float]:
        """The default tolerance, by a number's bytes."""

    @property
    def grounded(self) -> bool:
        """Of the `Medium` that it solves."""

    @property
    def attempts(self) -> int:
        """Screening lengths to try, where the caller leaves ℓ open."""

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Stages of an attempt; the last one sets the status."""

    def screening_length(self, medium: Medium) -> Float[Array, ""]:
        """ℓ [voxels], where the caller leaves it open."""

    def prepared(self, medium: Medium) -> Medium:
        """The medium on the grid that the stages expect."""


def medium_of(
    sigma: Float[Array, "nx ny nz"],
    goal: Int32[Array, " 3"],
    price: Float[Array, "nx ny nz"] | None = None,
    grounded: bool = False,
) -> Medium:
    """The medium of a conductivity field; `grounded` is static."""
    length = SCREENING_LENGTH
    steps = None if price is None else decay(lax.stop_gradient(price), length) / decay(1.0, length)
    component, distance = geodesic(lax.stop_gradient(sigma) > 0, goal, steps)
    return Medium(sigma, price, goal, component, distance, sigma.shape, grounded)


def pad_medium(medium: Medium) -> Medium:
    """Its component alone, padded with obstacles, so that every level consists of whole aggregates."""
    sigma = medium.sigma
    return dataclasses.replace(
        medium,
        # What is wrong with it stays.
        sigma=pad_to_aggregates(jnp.where(medium.component | ~jnp.isfinite(sigma), sigma, jnp.minimum(sigma, 0))),
        price=None if medium.price is None else pad_to_aggregates(medium.price),
        component=pad_to_aggregates(medium.component),
        distance=pad_to_aggregates(medium.distance),
    )


def no_progress(medium: Medium, length: Float[Array, ""]) -> Progress:
    """Before the first iteration."""
    none = jnp.int32(0)
    return Progress(
        log_phi=jnp.zeros_like(medium.sigma),
        length=length,
        iterations=none,
        sweeps=none,
        residual=jnp.asarray(jnp.inf, length.dtype),
        converged=jnp.array(False),
        uncertified=none,
        status=jnp.int32(Status.NOT_CONVERGED),
        attempts=none,
        geodesic=jnp.array(False),
    )


def run(stages: Iterable[Stage], medium: Medium, progress: Progress) -> Progress:
    """One stage after the other."""
    return functools.reduce(lambda progress, stage: stage(medium, progress), stages, progress)


def check_settings(tolerance: Any, max_iterations: Any, max_sweeps: Any) -> None:
    """Check a solver's settings.

    Raises:
        ValueError: if a tolerance is not positive and finite, or a cap no whole number of at least 0.
    """
    if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"tolerance: expected a positive finite number, given {tolerance}")
    for name, cap in (("max_iterations", max_iterations), ("max_sweeps", max_sweeps)):
        if isinstance(cap, bool) or not isinstance(cap, int) or cap < 0:
            raise ValueError(f"{name}: expected a whole number, 0 or more, given {cap}")


def tolerance_of(solver: Solver, medium: Medium) -> float:
    """The solver's tolerance, or its default for the medium's dtype."""
    return solver.tolerances[medium.sigma.dtype.itemsize] if solver.tolerance is None else solver.tolerance


def operator_of(medium: Medium, length: Float[Array, ""]) -> stencil.Operator:
    """A, without φ held on the goal."""
    leak = 0.0 if medium.grounded else (1 if medium.price is None else medium.price**2) / length**2
    return stencil.assemble(medium.sigma, leak, grounded=medium.grounded)


def system_with_goal(medium: Medium, length: Float[Array, ""]) -> tuple[stencil.Operator, stencil.Volume]:
    """A and q with φ = 1 held on the goal; a goal outside the grid holds nothing."""
    held = stencil.cell(medium.sigma.shape, medium.goal) & (medium.sigma > 0)
    return stencil.hold(operator_of(medium, length), held.astype(medium.sigma.dtype))
