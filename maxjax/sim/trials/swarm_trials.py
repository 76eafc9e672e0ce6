"""Swarms: many vehicles that swap their places in one city at the same time.

    swarm = (map, seed, count, how they agree, how each flies)

The ends are those of `sim.trials.swaps`, the key of vehicle k is fold_in(named_key(key(seed), "fleet MAP"), k); movers
are drawn around the box of all ends, and those that come near a start in the first two seconds are left out.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from maxjax.core.rng_streams import named_key
from maxjax.core.status import Status
from maxjax.sim.loop.flight import FlightConfig, World
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.swarm.swarm_flight import SwarmLog, log_of, watch_swarm
from maxjax.sim.swarm.together import Together
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.swaps import ALONE, Swaps, city_swaps
from maxjax.sim.trials.trial_movers import movers_key
from maxjax.sim.worlds.movers import Movers, places
from maxjax.sim.worlds.populations import Population, population
from maxjax.sim.worlds.scenes import make_scene

# Time in which movers keep away from starts, and a place that is out of the way [s], [m].
_SECONDS, _HIDDEN = 2.0, -1000.0
# Who goes less far than this from where it was such a time before the last plan does not get on [m], [s].
_STUCK, _WATCHED = 2.0, 20.0


@dataclasses.dataclass(frozen=True)
class SwarmTrial:
    """A trial of a swarm: city, vehicles, and how to fly them.

    Attributes:
        map: one of `maxjax.sim.worlds.layouts.MAPS`.
        seed: of the city and of all draws.
        count: of vehicles.
        together: how they agree.
        config: how each flies; its motions are those of `together`.
        movers: in the city besides, which each vehicle's own LiDAR has to find; None: there are none.
    """

    map: str
    seed: int
    count: int
    together: Together
    config: FlightConfig
    movers: Population | None = None

    @functools.cached_property
    def swaps(self) -> Swaps:
        """The ends; raises as `city_swaps`."""
        return city_swaps(self.map, self.seed, self.count)

    @property
    def flight(self) -> FlightConfig:
        """How each vehicle flies."""
        config = Campaign(self.map, self.seed, config=self.config, movers=self.movers).flight
        how = config.extension(Avoidance) if config.has(Avoidance) else Avoidance(None)
        return config.with_extension(dataclasses.replace(how, choice=self.together.motions()))

    def worlds(self) -> World:
        """The world of each vehicle, along a leading axis."""
        geoms = make_scene(self.map, self.seed).geoms
        ends = jnp.asarray(self.swaps.start, jnp.float32), jnp.asarray(self.swaps.goal, jnp.float32)
        movers = None
        if self.movers is not None:
            box = jnp.min(jnp.concatenate(ends), axis=0), jnp.max(jnp.concatenate(ends), axis=0)
            movers = population(geoms, *box, movers_key(self.map, self.seed, 0), how=self.movers)
            movers = _away(movers, ends[0])
        key, air = named_key(jax.random.key(self.seed), f"fleet {self.map}"), self.flight.disturbances
        calm = jax.tree.map(jnp.float32, air)
        worlds = [
            World(geoms, ends[0][k], ends[1][k], jax.random.fold_in(key, k), calm, movers) for k in range(self.count)
        ]
        stacked: World = jax.tree.map(lambda *x: jnp.stack(x), *worlds)
        return stacked


def fly_swarm_in_stages(worlds: World, config: FlightConfig, together: Together) -> SwarmLog:
    """The log of a swarm that is flown stage by stage, as single flights are: it ends with its last vehicle."""
    *_, last = watch_swarm(worlds, config, together)
    return log_of(last)


def stuck(log: SwarmLog) -> Bool[np.ndarray, "*batch"]:
    """Deadlocked vehicles: neither arrived nor in contact, and without progress at the end."""
    late = np.asarray(log.flights.status) == Status.OUT_OF_PLANS
    position = np.asarray(log.flights.position)
    recent = position[..., -1 - round(_WATCHED / LOG_PERIOD) :, :]
    went = np.linalg.norm(recent - recent[..., -1:, :], axis=-1).max(axis=-1)
    rests: Bool[np.ndarray, "*batch"] = late & (went < _STUCK)
    return rests


def _away(movers: Movers, starts: Float[Array, "n 3"]) -> Movers:
    """Movers, those hidden below the ground that come near a start in the first seconds."""
    early = jax.vmap(lambda time: places(movers, time)[0])(jnp.linspace(0.0, _SECONDS, 17))
    apart = jnp.min(jnp.linalg.norm(early[:, :, None] - starts, axis=-1), axis=(0, 2))
    near = apart < 2.0 * ALONE

    def hidden(x: Array, value: float) -> Array:
        return jnp.where(near.reshape(-1, *[1] * (x.ndim - 1)), value, x)

    return dataclasses.replace(
        movers,
        knots=movers.knots.at[..., 2].set(hidden(movers.knots[..., 2], _HIDDEN)),
        velocity=hidden(movers.velocity, 0.0),
        amplitude=hidden(movers.amplitude, 0.0),
    )
