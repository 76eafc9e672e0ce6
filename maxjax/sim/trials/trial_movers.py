"""The movers of a trial: a pure function of its campaign, its index and its ends, so nobody has to keep them.

movers of trial i = population(city, start, goal, fold_in(named(key(seed), "movers MAP"), i))
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from maxjax.core.rng_streams import named_key
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.populations import Population, population
from maxjax.sim.worlds.scenes import make_scene


def movers_key(name: str, seed: int, trial: int) -> PRNGKeyArray:
    """Key of the movers of a trial of a map and seed."""
    return jax.random.fold_in(named_key(jax.random.key(seed), f"movers {name}"), trial)


def movers_of(configuration: Mapping[str, Any], outcome: Outcome) -> Movers | None:
    """The movers of a trial that was flown, as its flight had them; None where there were none.

    Args:
        configuration: of its campaign, as its folder holds it.
        outcome: of the trial.
    """
    if configuration.get("movers") is None or not outcome.flown:
        return None
    key = movers_key(configuration["map"], configuration["seed"], outcome.trial)
    start, goal = (jnp.asarray(end, jnp.float32) for end in (outcome.start, outcome.goal))
    geoms = make_scene(configuration["map"], outcome.city).geoms
    return population(geoms, start, goal, key, how=Population(**configuration["movers"]))
