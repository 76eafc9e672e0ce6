"""The stages of a flight that see: a scan from the true pose, and what the map learns of it.

    scan = lidar at the true pose, degraded by the disturbances; its points at the estimated position
    map  = map recentred on the estimated position, but with the goal still in it, and with the scan

Where an extension looks, a scan is taken ten times a second, and fused once in a planning iteration. Returns that an
extension takes out are no part of the map, but still hide what is behind them. Frame: world.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int32

from maxjax.core.rng_streams import Stream, stream
from maxjax.sim.loop.flight_state import LOG_PERIOD, Flight, FlightConfig, World, estimated_position, extensions_of
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import scan
from maxjax.sim.vehicle.disturbances import degrade, outage
from maxjax.sim.worlds.movers import Moving


def sense(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """One scan from the true pose, its points shifted to the estimated position; none where an extension looks."""
    looked = any(extension.looks for extension in extensions_of(world, config))
    return flight if looked else _scanned(world, flight, config, flight.log.planning_iterations)


def _scanned(world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
    """The flight with a scan, numbered for its noise."""
    sensor_key, degradation_key = jax.random.split(stream(world.key, Stream.SCAN, number))
    position, lidar, extensions = flight.vehicle.position, config.lidar, extensions_of(world, config)
    for extension in extensions:
        position = extension.scan_origin(world, flight, config, position)
    failed = outage(world.disturbances, lidar, world.key, flight.log.duration)
    moving = None if world.movers is None else Moving(world.movers, flight.log.duration)
    measured = scan(world.geoms, lidar, position, flight.vehicle.rotation, sensor_key, moving)
    measured = degrade(measured, world.disturbances, lidar, position, failed, degradation_key)
    flight = dataclasses.replace(flight, scan=measured)
    for extension in extensions:
        flight = extension.deliver_scan(world, flight, config, number)
    points = flight.scan.points + (estimated_position(world, flight, config) - position)
    returns = flight.returns + jnp.sum(flight.scan.hit, dtype=jnp.int32)
    return dataclasses.replace(flight, scan=dataclasses.replace(flight.scan, points=points), returns=returns)


def look(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A scan, and what extensions see in it; nothing where none of them looks."""
    looking = [extension for extension in extensions_of(world, config) if extension.looks]
    if looking:
        number = jnp.round(flight.log.duration / LOG_PERIOD).astype(jnp.int32)
        flight = _scanned(world, flight, config, number)
    for extension in looking:
        flight = extension.look(world, flight, config)
    return flight


def fuse(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """The map recentred on the estimated position, but with the goal still in it, and with the scan."""
    position = estimated_position(world, flight, config)
    recentred = mapping.recentre(flight.rolling_map, position, world.goal)
    pose = position, flight.vehicle.rotation
    still = flight.scan
    for extension in extensions_of(world, config):
        still = extension.still_scan(world, flight, config, still)
    fused = mapping.fuse_scan(recentred, still, config.lidar, *pose, config.snapshot)
    return dataclasses.replace(flight, rolling_map=fused)
