"""Fields that the loop climbs, by name.

(sigma, goal_index, price) ↦ Potential
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping

import jax.numpy as jnp
from jaxtyping import Array

from maxjax.fields.price import SCREENING_LENGTH
from maxjax.nn.model import MAX_SWEEPS, load_model, network_potential, predict_potential
from maxjax.planning.run.stages import PotentialFn
from maxjax.solvers.certify import swept
from maxjax.solvers.medium import medium_of, no_progress, run
from maxjax.solvers.paper import PaperSetting
from maxjax.solvers.potential import Potential, potential_of, solve_potential

SWEEPS = MAX_SWEEPS


def swept_prediction(name: str, sweeps: int) -> PotentialFn:
    """A network's potential after so many positive sweeps, certified or not, and no solver behind them."""

    def potential(sigma: Array, goal_index: Array, price: Array | None) -> Potential:
        predicted = predict_potential(model, sigma, goal_index, price)
        known = jnp.isfinite(predicted.log_phi)
        medium = medium_of(sigma, goal_index, price)
        length = jnp.asarray(SCREENING_LENGTH, sigma.dtype)
        log_phi = swept(medium, length, jnp.where(known, predicted.log_phi, 0), sweeps)
        return dataclasses.replace(predicted, log_phi=jnp.where(known, log_phi, -jnp.inf))

    model = load_model(name)
    return potential


def solved_in_float64(sigma: Array, goal_index: Array, price: Array | None) -> Potential:
    """The exact field of κ = 0 in double precision, in a process with JAX_EXPLICIT_X64_DTYPES=allow.

    Raises:
        ValueError: in another process.
    """
    solver, sigma = PaperSetting(), sigma.astype(jnp.float64)
    if sigma.dtype != jnp.float64:
        raise ValueError("float64: expected a process with JAX_EXPLICIT_X64_DTYPES=allow, given one without")
    medium = medium_of(sigma, goal_index, grounded=solver.grounded)
    nothing = no_progress(medium, solver.screening_length(medium).astype(sigma.dtype))
    return potential_of(run(solver.stages, medium, nothing), medium.component)


SOURCES: Mapping[str, Callable[[], PotentialFn]] = {
    **{name: functools.partial(network_potential, name, 0) for name in ("paper", "paper_difference", "maxjax")},
    "exact, κ = 0": lambda: functools.partial(solve_potential, solver=PaperSetting()),
    "exact, κ = 0, float64": lambda: solved_in_float64,
    "exact": lambda: solve_potential,
    "paper, swept": functools.partial(swept_prediction, "paper", SWEEPS),
    "paper, certified": functools.partial(network_potential, "paper", SWEEPS),
}
"""Makes of each; a network's weights are loaded when it is asked for."""


@functools.cache
def potential_from(source: str) -> PotentialFn:
    """The field of a name; the same function each time, for the caches of programs.

    Raises:
        KeyError: if there is none.
        ValueError: if the weights of a network are missing.
    """
    return SOURCES[source]()
