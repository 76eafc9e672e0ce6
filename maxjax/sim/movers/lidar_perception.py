"""Perception of movers by the flight's own LiDAR: ten looks a second, at the estimated pose."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from maxjax.sim.loop.flight_state import Flight, FlightConfig, World, estimated_position
from maxjax.sim.movers.among import Among, Flag, Sightings
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.perception import PerceptionState, initial_perception, process_scan
from maxjax.sim.movers.tracking_settings import TrackingSettings


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class LidarPerception:
    """Tracks of confirmed movers; static.

    Attributes:
        sight: settings; its sensor is the flight's, its bounds are those that motions are verified with.
    """

    sight: TrackingSettings = TrackingSettings()  # noqa: RUF009 (frozen)

    def start(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        """Nobody.

        Raises:
            ValueError: for another sensor than the flight's, or other bounds.
        """
        if self.sight.lidar != config.lidar or self.sight.bounds != config.extension(Avoidance).bounds:
            raise ValueError(
                "TrackingSettings: expected the lidar of the flight and the bounds of its avoidance, given "
                f"{self.sight.lidar} and {self.sight.bounds}"
            )
        return sightings_of(initial_perception(self.sight))

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        """After the scan in `flight.scan`."""
        pose = estimated_position(world, flight, config), flight.vehicle.rotation
        return sightings_of(
            process_scan(flight.part(Among).seen.memory, flight.scan, *pose, flight.log.duration, self.sight)
        )


def sightings_of(seeing: PerceptionState) -> Sightings:
    """Sightings for the choice of motions: confirmed movers, at rest as well, and flags that are up."""
    used = seeing.tracks.used & seeing.tracks.confirmed & ~seeing.walls
    tracks = dataclasses.replace(seeing.tracks, used=used, rests=seeing.rests)
    up: Bool[Array, " f"] = jnp.zeros(len(Flag), bool)
    up = up.at[Flag.BOUND].set(jnp.any(seeing.broken)).at[Flag.NEAR].set(jnp.any(seeing.near))
    return Sightings(tracks, seeing.moving, up.at[Flag.CROWDED].set(seeing.overflow), seeing)
