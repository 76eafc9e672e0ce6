"""Steer among movers: the cost-to-go around the vehicle, and the motion to fly from now on.

The static plan, made once a second, says where the way leads; ten times a second the motion is chosen anew
(`sim.moving.choice`) from where the present one is by now. Frame: world.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from maxjax.planning.windowed_route import boxed, corner_around
from maxjax.sim import rolling_map as mapping
from maxjax.sim.moving.among import Among, Avoidance, Flag
from maxjax.sim.moving.choice import Around, chosen
from maxjax.sim.moving.hard_set import HardSet, hard_set
from maxjax.sim.moving.local_value import LocalValue, crowding, local_value
from maxjax.sim.moving.motions import Motion, at, later
from maxjax.trajectories.online import Setpoint

if TYPE_CHECKING:
    from maxjax.sim.flight_state import Flight, FlightConfig, World

# Cost of a metre beside the static way, in metres of it.
_ASIDE = 1.5


def resting(position: Float[Array, "3"], how: Avoidance) -> Motion:
    """To stay where one is."""
    zero = jnp.zeros(3)
    return Motion(position, zero, zero, jnp.float32(0.0), jnp.float32(how.choice.acceleration))


def setpoint_of(among: Among, lead: float) -> Setpoint:
    """Of the motion that is flown; acceleration that much later [s]."""
    place, velocity, acceleration = at(among.motion, among.since)
    if lead:
        acceleration = at(among.motion, among.since + lead)[2]
    return Setpoint(place, velocity, acceleration, jnp.zeros((), place.dtype))


def steered(world: World, flight: Flight, config: FlightConfig) -> tuple[Among, Array]:
    """The motion from now on, and the flags that are up with it."""
    how, among = config.moving, flight.among
    assert how is not None
    assert among is not None
    left = later(among.motion, among.since)
    drifted = jnp.linalg.norm(left.place - flight.vehicle.position) > how.drift
    # Far from its motion the vehicle begins another one from where it is.
    here = Motion(flight.vehicle.position, flight.vehicle.velocity, jnp.zeros(3), jnp.float32(0.0), left.acceleration)
    left = jax.tree.map(lambda x, y: jnp.where(drifted, x, y), here, left)
    hard = _hard(flight, config, left.place)
    guide = _guide(world, flight, config, left.place)
    motion, verified = chosen(Around(among.seen.tracks, hard, guide), left, how.choice, how.bounds, how.keeping)
    up = among.seen.flags.at[Flag.DRIFTED].set(drifted).at[Flag.TRAPPED].set(~verified)
    return dataclasses.replace(among, motion=motion, since=jnp.float32(0.0)), up


def _hard(flight: Flight, config: FlightConfig, place: Float[Array, "3"]) -> HardSet:
    """The map as far as motions lead."""
    how, rolling_map = config.moving, flight.rolling_map
    assert how is not None
    furthest = how.choice.speed * how.choice.horizon
    half = math.ceil(furthest / config.spacing) + 1
    shape = (2 * half + 1,) * 3
    corner = corner_around((place - mapping.origin(rolling_map)) / config.spacing, half)
    blocked = mapping.occupied(rolling_map) | mapping.ground(rolling_map)
    origin = mapping.origin(rolling_map) + config.spacing * corner
    return hard_set(
        boxed(blocked, corner, shape, beyond=True), boxed(mapping.seen(rolling_map), corner, shape), origin,
        config.spacing,
    )  # fmt: skip


def _guide(world: World, flight: Flight, config: FlightConfig, place: Float[Array, "3"]) -> LocalValue:
    """Cost-to-go around the vehicle: where the window ends, along the static way."""
    how, among, rolling_map, spacing = config.moving, flight.among, flight.rolling_map, config.spacing
    assert how is not None
    assert among is not None
    shape = how.crowd.shape
    base = mapping.origin(rolling_map)
    corner = jnp.floor((place - base) / spacing + 0.5).astype(jnp.int32) - jnp.asarray(shape) // 2
    blocked = boxed(mapping.occupied(rolling_map) | mapping.ground(rolling_map), corner, shape, beyond=True)
    origin = base + spacing * corner
    centres = origin + spacing * jnp.stack(jnp.meshgrid(*map(jnp.arange, shape), indexing="ij"), -1).reshape(-1, 3)

    course = jax.tree.map(lambda x: x[:: max(round(spacing / 2 / config.sampling.spacing), 1)], flight.reference.course)
    points, s = course.points, course.arclength
    beside = jnp.linalg.norm(centres[:, None] - points, axis=-1)
    ends = jnp.min(s[-1] - s + _ASIDE * beside, axis=1).reshape(shape)
    inner = jnp.zeros(shape, bool).at[1:-1, 1:-1, 1:-1].set(True)
    # The end of the way: where it lies in the window, a way may end.
    close = (jnp.linalg.norm(centres - points[-1], axis=1) < spacing).reshape(shape)
    ends = jnp.where(inner & ~close, jnp.inf, ends)
    price = crowding(centres, place, how.choice.speed, among.seen.tracks, how.crowd).reshape(shape)
    return local_value(~blocked, origin, spacing, ends, price, how.crowd.sweeps)
