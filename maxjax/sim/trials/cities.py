"""Where trials are flown: in simulated cities, by the name of their map, or in a given one.

    trials_in(where, seed, indices)        ends of trials, and the cities of a simulated map that they are in
    TrialSite(where, city, start, goal)        its solids, and its movers by key

Both are pure functions of their arguments, so that a trial depends on no other.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PRNGKeyArray

from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.trials import Trial, draw_many
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.populations import Population, place_movers, population
from maxjax.sim.worlds.scenes import make_scene

Where = str | GivenCity
Vector = Float[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True, eq=False)
class TrialSite:
    """The place of one trial.

    Attributes:
        where: simulated map or given city.
        city: seed of the city of a simulated map.
        start, goal: of the trial [m].
    """

    where: Where
    city: int
    start: Vector
    goal: Vector

    @property
    def solids(self) -> Geoms:
        """All that is flown in."""
        if isinstance(self.where, GivenCity):
            return self.where.solids(self.start, self.goal)
        return _city(self.where, self.city)

    def movers(self, how: Population, key: PRNGKeyArray) -> Movers:
        """What moves around the way; heights of movers count from the ground beneath both ends, the lower one's."""
        geoms, start, goal = self.solids, jnp.asarray(self.start, jnp.float32), jnp.asarray(self.goal, jnp.float32)
        height = self.where.ground_below(self.start, self.goal) if isinstance(self.where, GivenCity) else 0.0
        if height == 0.0:
            return population(geoms, start, goal, key, how=how)
        down = jnp.array([0.0, 0.0, height], jnp.float32)
        lowered = dataclasses.replace(geoms, position=geoms.position - down)
        movers = population(lowered, start - down, goal - down, key, how=how)
        there = place_movers(movers)[:, None, None]
        return dataclasses.replace(movers, knots=jnp.where(there, movers.knots + down, movers.knots))


def name_of(where: Where) -> str:
    """Name of a simulated map, or of the file of a given city."""
    return where.name if isinstance(where, GivenCity) else where


def label_of_city(where: Where, city: int) -> str:
    """A city as pictures and pages name it."""
    return where.name if isinstance(where, GivenCity) else f"{where}:{city}"


def stream_of(where: Where) -> str:
    """Name of the random streams of trials there."""
    return where.stream if isinstance(where, GivenCity) else where


def trials_in(where: Where, seed: int, indices: Sequence[int]) -> Trial:
    """Trials of a seed, stacked in the order of the indices; raises as `draw_many` and `GivenCity.draw`."""
    return where.draw(seed, indices) if isinstance(where, GivenCity) else draw_many(where, seed, indices)


@functools.lru_cache(maxsize=256)
def _city(name: str, seed: int) -> Geoms:
    return make_scene(name, seed).geoms
