"""The movers of a trial: a pure function of its campaign, its index and its ends, so nobody has to keep them.

movers of trial i = population(city, start, goal, fold_in(named(key(seed), "movers MAP"), i))

Heights of movers in a given city count from the ground beneath both ends (`sim.trials.cities`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import PRNGKeyArray

from maxjax.core.rng_streams import named_key
from maxjax.sim.trials.cities import TrialSite, Where, stream_of
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.populations import Population


def movers_key(where: Where, seed: int, trial: int) -> PRNGKeyArray:
    """Key of the movers of a trial of a map and seed."""
    return jax.random.fold_in(named_key(jax.random.key(seed), f"movers {stream_of(where)}"), trial)


def movers_of(configuration: Mapping[str, Any], outcome: Outcome, where: Where | None = None) -> Movers | None:
    """The movers of a trial that was flown, as its flight had them; None where there were none.

    Args:
        configuration: of its campaign, as its folder holds it.
        outcome: of the trial.
        where: it was flown; None: in the simulated map that the configuration names.
    """
    if configuration.get("movers") is None or not outcome.flown:
        return None
    where = configuration["map"] if where is None else where
    start, goal = (np.asarray(end, np.float32) for end in (outcome.start, outcome.goal))
    key = movers_key(where, configuration["seed"], outcome.trial)
    return TrialSite(where, outcome.city, start, goal).movers(Population(**configuration["movers"]), key)
