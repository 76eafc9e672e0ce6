"""The stages of a flight that see: a scan from the true pose, and what the map learns of it.

    scan = lidar at the true pose, degraded by the disturbances; its points at the estimated position
    map  = map recentred on the estimated position, but with the goal still in it, and with the scan

Among movers a scan is taken, and looked at, ten times a second, and fused once in a planning iteration. What moves is
no part of the map, but hides what is behind it. Frame: world.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int32

from maxjax.core.rng_streams import Stream, stream
from maxjax.sim.faults.effects import deliver_scan, scan_origin
from maxjax.sim.loop.flight_state import LOG_PERIOD, Flight, FlightConfig, World, estimated_position
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import scan
from maxjax.sim.vehicle.disturbances import degrade, outage
from maxjax.sim.worlds.movers import Moving


def sense(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """One scan from the true pose, its points shifted to the estimated position; movers were looked for already."""
    looked = config.moving is not None and config.moving.perception is not None
    return flight if looked else _scanned(world, flight, config, flight.log.planning_iterations)


def _scanned(world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
    """The flight with a scan, numbered for its noise."""
    sensor_key, degradation_key = jax.random.split(stream(world.key, Stream.SCAN, number))
    position, lidar = flight.vehicle.position, config.lidar
    if world.faults is not None:
        position = scan_origin(world, flight)
    failed = outage(world.disturbances, lidar, world.key, flight.log.duration)
    moving = None if world.movers is None else Moving(world.movers, flight.log.duration)
    measured = scan(world.geoms, lidar, position, flight.vehicle.rotation, sensor_key, moving)
    measured = degrade(measured, world.disturbances, lidar, position, failed, degradation_key)
    if world.faults is not None:
        measured, failing = deliver_scan(world, flight, measured, lidar, number)
        flight = dataclasses.replace(flight, failing=failing)
    measured = dataclasses.replace(measured, points=measured.points + (estimated_position(world, flight) - position))
    returns = flight.returns + jnp.sum(measured.hit, dtype=jnp.int32)
    return dataclasses.replace(flight, scan=measured, returns=returns)


def look(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A scan, and what it shows of movers; nothing where nobody looks for any."""
    perception = config.avoidance.perception
    if perception is None:
        return flight
    number = jnp.round(flight.log.duration / LOG_PERIOD).astype(jnp.int32)
    flight = _scanned(world, flight, config, number)
    seen = perception.look(world, flight, config)
    among = dataclasses.replace(flight.tracked, seen=seen)
    return dataclasses.replace(flight, among=among)


def fuse(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """The map recentred on the estimated position, but with the goal still in it, and with the scan."""
    position = estimated_position(world, flight)
    recentred = mapping.recentre(flight.rolling_map, position, world.goal)
    pose = position, flight.vehicle.rotation
    still = flight.scan
    if flight.among is not None:
        still = dataclasses.replace(still, hit=still.hit & ~flight.among.seen.returns)
    fused = mapping.fuse_scan(recentred, still, config.lidar, *pose, config.snapshot)
    return dataclasses.replace(flight, rolling_map=fused)
