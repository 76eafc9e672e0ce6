"""Movers as they are: the perception that makes no mistake, for ceilings and for telling apart what limits a flight.

What is within `reach` of the vehicle is in a slot with its place, its velocity and its shape, hidden or not. Of movers
whose ways are known for a time T ahead the set of the velocity is that of all mean velocities from now on,

    v⁻ = min (p(t + τ) − p(t)) / τ,   v⁺ = max (p(t + τ) − p(t)) / τ,   0 < τ ≤ T

so that p(t) + v τ holds the mover at every τ, without any acceleration.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from maxjax.sim.loop.flight_state import Flight, FlightConfig, World
from maxjax.sim.movers.among import Flag, Sightings
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, no_tracks
from maxjax.sim.worlds.geoms import half_edges
from maxjax.sim.worlds.movers import Movers, places, solids_at

# Returns so near to a mover's box are its own [m], and how far it went during a turn of the sensor besides.
_ROUND = 0.15
# Times ahead at which known ways are looked at.
_AHEAD = 20


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class TrueTracks:
    """Tracks of the movers themselves; static.

    Attributes:
        reach: of sight [m].
        slots: movers that are followed, the nearest ones.
        place, velocity: half widths of their sets [m], [m/s].
        future: T, for which their ways are known [s]; 0: they are not.
    """

    reach: float = 45.0
    slots: int = 32
    place: float = 0.02
    velocity: float = 0.1
    future: float = 0.0

    def start(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        """No tracks: the first look makes them."""
        return self._seen(no_tracks(self.slots), config)

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        """All movers within reach."""
        movers, log = world.movers, flight.log
        if movers is None:
            return self._seen(no_tracks(self.slots), config)
        position = flight.vehicle.position
        bounds = config.extension(Avoidance).bounds
        tracks = tracks_of(movers, log.duration, position, bounds, self)
        seen, points = self._seen(tracks, config), flight.scan.points
        room = tracks.half + _ROUND + config.lidar.turn * jnp.abs(tracks.velocity)
        hit = jnp.zeros_like(seen.returns)
        for k in range(self.slots):
            hit |= tracks.used[k] & jnp.all(jnp.abs(points - tracks.place[k]) <= room[k], axis=1)
        return dataclasses.replace(seen, returns=hit)

    def _seen(self, tracks: Tracks, config: FlightConfig) -> Sightings:
        rays = config.lidar.rays
        return Sightings(tracks, jnp.zeros(rays, bool), jnp.zeros(len(Flag), bool), None)


def tracks_of(
    movers: Movers, time: Float[Array, ""], position: Float[Array, "3"], bounds: Bounds, how: TrueTracks
) -> Tracks:
    """The movers nearest to a position, as sets that hold them."""
    place, velocity = places(movers, time)
    half = half_edges(solids_at(movers, time))
    apart = jnp.linalg.norm(jnp.maximum(jnp.abs(place - position) - half, 0.0), axis=1)
    count = min(how.slots, movers.count)
    _, nearest = jax.lax.top_k(-apart, count)
    used = apart[nearest] < how.reach
    slowest, fastest, half = _mean_velocities(movers, time, how) if how.future else (velocity, velocity, half)
    place, velocity, half = place[nearest], velocity[nearest], half[nearest]
    found = Tracks(
        low=place - how.place,
        high=place + how.place,
        slowest=jnp.maximum(slowest[nearest] - how.velocity, -bounds.speed),
        fastest=jnp.minimum(fastest[nearest] + how.velocity, bounds.speed),
        half=half,
        used=used,
        confirmed=used,
        place=place,
        velocity=velocity,
        place_deviation=jnp.full_like(place, 0.5 * how.place),
        velocity_deviation=jnp.full_like(place, 0.5 * how.velocity),
        rests=jnp.all(movers.amplitude == 0.0, axis=(1, 2))[nearest] & jnp.all(velocity == 0.0, axis=1),
        seen=jnp.ones(count, jnp.int32),
        missed=jnp.zeros(count, jnp.int32),
    )
    filled: Tracks = jax.tree.map(lambda x, y: jnp.concatenate([x, y[count:]]), found, no_tracks(how.slots))
    return filled


def _mean_velocities(
    movers: Movers, time: Float[Array, ""], how: TrueTracks
) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"], Float[Array, "m 3"]]:
    """Least and greatest mean velocity from now on [m/s], and half edges that hold each mover meanwhile [m]."""
    after = how.future * jnp.linspace(0.0, 1.0, _AHEAD + 1)
    way, velocity = jax.vmap(lambda t: places(movers, time + t))(after)
    means = jnp.concatenate([velocity[:1], (way[1:] - way[0]) / after[1:, None, None]])
    half = jax.vmap(lambda t: half_edges(solids_at(movers, time + t)))(after)
    return jnp.min(means, axis=0), jnp.max(means, axis=0), jnp.max(half, axis=0)
