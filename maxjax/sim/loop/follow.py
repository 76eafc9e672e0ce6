"""The stage of a flight that moves: a planning period of physics along the reference, or as an extension steers.

The exact distance to every solid, moving or not, is computed at every physics step. Frame: world.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.rng_streams import Stream, stream
from maxjax.core.status import Status
from maxjax.sim.loop.flight_state import LOG_PERIOD, Flight, FlightConfig, World, estimated_position, extensions_of
from maxjax.sim.loop.reactive import push
from maxjax.sim.loop.sensing import look
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.sim.vehicle.disturbances import GUST_REFERENCE_WIND, mean_wind
from maxjax.sim.worlds.movers import solids_at
from maxjax.sim.worlds.solid_distance import distance
from maxjax.trajectories.online import setpoint_at

# Slower than this a vehicle has no course [m/s].
_SLOW = 0.5
# A clock may be faster than this loop's own steps by so much; what it says beyond is no time that has passed.
_FASTEST = 1.5

# (world, flight, config, number) ↦ flight with the motion to fly.
Steer = Callable[[World, Flight, FlightConfig, Int32[Array, ""]], Flight]
# (world, flight, config, noise) ↦ flight a time step later.
Step = Callable[[World, Flight, FlightConfig, Float[Array, "3"]], Flight]


def follow(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """One planning period of physics; a flight that is done does not change."""
    return fly_period(world, flight, config, steer_alone, step_alone)


def fly_period(world: World, flight: Flight, config: FlightConfig, steer: Steer, step: Step) -> Flight:
    """One planning period: ten times a second steer, step by the physics, look, and log where the vehicle is.

    Args:
        world: that the flight is in.
        flight: before the period.
        config: how to fly.
        steer: (world, flight, config, number of the look in its period) ↦ flight with the motion to fly; leaves what
            is done.
        step: (world, flight, config, noise) ↦ flight a time step later, by standard normal numbers that drive the
            gusts; leaves what is done.
    """
    steps = round(LOG_PERIOD / config.vehicle.timestep)
    key = stream(world.key, Stream.GUSTS, flight.log.planning_iterations)
    noise = jax.random.normal(key, (config.log_samples, steps, 3))

    def log_sample(flight: Flight, inputs: tuple[Array, Array]) -> tuple[Flight, None]:
        number, noise = inputs
        was_done = flight.done
        flight = steer(world, flight, config, number)
        flight, _ = lax.scan(lambda flight, noise: (step(world, flight, config, noise), None), flight, noise)
        flight = unless(flight.done, flight, look(world, flight, config))
        row = first + number
        position = jnp.where(was_done, flight.log.position[row], flight.vehicle.position)
        log = dataclasses.replace(flight.log, position=flight.log.position.at[row].set(position))
        return dataclasses.replace(flight, log=log), None

    first = 1 + config.log_samples * (flight.log.planning_iterations - 1)
    flight, _ = lax.scan(log_sample, flight, (jnp.arange(config.log_samples), noise))
    last = ~flight.done & (flight.log.planning_iterations >= config.plans)
    status = jnp.where(last, Status.OUT_OF_PLANS, flight.log.status).astype(jnp.int32)
    return dataclasses.replace(flight, done=flight.done | last, log=dataclasses.replace(flight.log, status=status))


def steer_alone(world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
    """As extensions steer a flight that is not done. `number`: as `fly_period`."""
    after = flight
    for extension in extensions_of(world, config):
        after = extension.steer(world, after, config, number)
    return unless(flight.done, flight, after)


def step_alone(world: World, flight: Flight, config: FlightConfig, noise: Float[Array, "3"]) -> Flight:
    """One time step of a flight that is not done."""
    return unless(flight.done, flight, _physics_step(world, flight, config, noise))


def _physics_step(world: World, flight: Flight, config: FlightConfig, noise: Float[Array, "3"]) -> Flight:
    """One time step of controller, gusts and vehicle, and what it adds to the log."""
    before, vehicle, extensions = flight.vehicle, config.vehicle, extensions_of(world, config)
    setpoint = setpoint_at(flight.reference, flight.reference_time, flight.yaw, config.controller.lead)
    for extension in extensions:
        setpoint = extension.setpoint(world, flight, config, setpoint)
        flight = extension.advance(world, flight, config)
    estimated = dataclasses.replace(before, position=estimated_position(world, flight, config))
    if config.reactive > 0:
        extra = push(flight.scan.points, estimated.position, setpoint.velocity, config.reactive)
        setpoint = dataclasses.replace(setpoint, acceleration=setpoint.acceleration + extra)
    observer, command = control.command(config.controller, vehicle, flight.observer, estimated, setpoint)
    gust = physics.gust(config.gusts, flight.gust, noise, vehicle.timestep)
    strength = jnp.asarray(world.disturbances.wind) / GUST_REFERENCE_WIND
    wind = mean_wind(world.disturbances, world.key)
    wind = wind + strength * gust
    reference_time = flight.reference_time + vehicle.timestep
    for extension in extensions:
        flight, command = extension.thrusts(world, flight, config, command)
        wind = extension.wind(world, flight, config, wind)
        reference_time = extension.clock(world, flight, config, reference_time)
    reference_time = advance_time(flight.reference_time, reference_time, vehicle.timestep)
    after = physics.advance(vehicle, before, command, wind)
    if config.exact:
        yaw = turn_heading(before.rotation, setpoint.velocity, config)
        after = dataclasses.replace(physics.hover(vehicle, setpoint.position, yaw), velocity=setpoint.velocity)

    log = flight.log
    clearance = clearance_of(world, after.position, log.duration + vehicle.timestep)
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(after)]))
    touches = clearance <= config.radius
    arrives = jnp.linalg.norm(world.goal - after.position) <= config.tolerance
    status = jnp.select([~finite, touches], [Status.NONFINITE_STATE, Status.IN_CONTACT], Status.OK)
    log = dataclasses.replace(
        log,
        status=jnp.where(log.status == Status.OK, status, log.status).astype(jnp.int32),
        flown_length=log.flown_length + jnp.linalg.norm(after.position - before.position),
        duration=log.duration + vehicle.timestep,
        clearance=jnp.minimum(log.clearance, clearance),
    )
    return dataclasses.replace(
        flight,
        vehicle=after,
        observer=observer,
        gust=gust,
        reference_time=reference_time,
        done=~finite | touches | arrives,
        log=log,
    )


def advance_time(before: Float[Array, ""], told: Float[Array, ""], timestep: float) -> Float[Array, ""]:
    """Advance the time on the reference to what the clock says, as far as a vehicle can follow [s].

    Time never goes back, and never on by more than `_FASTEST` time steps at once: whatever the clock says, set-points
    move along the reference that was verified, without a jump, and rest at its end.
    """
    return before + jnp.clip(told - before, 0.0, _FASTEST * timestep)


def turn_heading(rotation: Float[Array, "3 3"], velocity: Float[Array, "3"], config: FlightConfig) -> Float[Array, ""]:
    """Heading a time step later of a vehicle that is where its set-point is [rad].

    One that sees to one side turns its sensor to where it flies, and slow it looks around, at `limits.yaw_rate`.
    """
    if config.lidar.width == 360.0:
        return jnp.zeros(())
    cos, sin = rotation[0, 0], rotation[1, 0]
    aside = jnp.arctan2(cos * velocity[1] - sin * velocity[0], cos * velocity[0] + sin * velocity[1])
    most = config.limits.yaw_rate * config.vehicle.timestep
    turn = jnp.where(jnp.linalg.norm(velocity[:2]) < _SLOW, most, jnp.clip(aside, -most, most))
    return jnp.arctan2(sin, cos) + turn


def clearance_of(world: World, position: Float[Array, "3"], time: Float[Array, ""]) -> Float[Array, ""]:
    """Distance to the nearest solid, moving or not [m]."""
    still = distance(world.geoms, position)
    return still if world.movers is None else jnp.minimum(still, distance(solids_at(world.movers, time), position))


def unless(over: Bool[Array, ""], before: Flight, after: Flight) -> Flight:
    """`before` where the flight is over, leaf by leaf: what a step leaves alone costs nan."""
    kept: Flight = jax.tree.map(lambda x, y: x if x is y else jnp.where(over, x, y), before, after)
    return kept
