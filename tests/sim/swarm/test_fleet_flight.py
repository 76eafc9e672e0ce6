"""Fleets that swap places in open sky, judged in float64 by where they were; and what they are told."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig, World
from maxjax.sim.loop.flight_state import Flight
from maxjax.sim.loop.follow import follow
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.movers.avoidance import Avoidance, straight_way
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.swarm.swarm_flight import SwarmLog, fly_swarm, log_of, swarm_take_off, watch_swarm
from maxjax.sim.swarm.together import Together
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import SPHERE, Geoms, ground_plane
from maxjax.sim.worlds.movers import Movers, straight
from maxjax.trajectories.online import Sampling

pytestmark = pytest.mark.large

TOGETHER = Together(delay=0.2, neighbours=4)
SMALL = dataclasses.replace(TOGETHER.motions(), directions=16, shares=(1.0,))
RADIUS = 14.0
COUNT = 4


def open_sky(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A stage in place of scans: all was seen free."""
    known = mapping.recentre(flight.rolling_map, flight.vehicle.position)
    known = dataclasses.replace(known, cells=jnp.full_like(known.cells, 128))
    return dataclasses.replace(flight, rolling_map=known)


CONFIG = FlightConfig(
    planner=Field(),
    extensions=(Avoidance(None, choice=SMALL),),
    shape=(31, 31, 31),
    plans=12,
    sampling=Sampling(0.5, 128),
    stages=(open_sky, straight_way, follow),
)


def worlds(start: np.ndarray, goal: np.ndarray, movers: Movers | None = None) -> World:
    keys = jax.random.split(jax.random.key(0), len(start))
    ends = jnp.asarray(start, jnp.float32), jnp.asarray(goal, jnp.float32)
    calm = jax.tree.map(jnp.float32, Disturbances())
    each = [World(ground_plane(), *pair, key, calm, movers) for *pair, key in zip(*ends, keys, strict=True)]
    return jax.tree.map(lambda *x: jnp.stack(x), *each)


def swaps(wide: float = 0.0) -> World:
    """Four vehicles at the corners of a square that fly to the opposite corners, all through one point."""
    turn = 0.5 * np.pi * np.arange(COUNT)
    corner = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], -1)
    middle = np.array([0.0, 0.0, 20.0])
    return worlds(middle + RADIUS * corner, middle - (RADIUS + wide) * corner)


@functools.cache
def flown() -> SwarmLog:
    """A fleet on the host."""
    *_, last = watch_swarm(swaps(), CONFIG, TOGETHER)
    return log_of(last)


@functools.cache
def flown_in_a_batch() -> SwarmLog:
    """Two fleets; the second one flies two metres further."""
    both = jax.tree.map(lambda *x: jnp.stack(x), swaps(), swaps(wide=2.0))
    return jax.jit(jax.vmap(functools.partial(fly_swarm, config=CONFIG, together=TOGETHER)))(both)


def check_swaps(log: SwarmLog) -> None:
    """All arrive, and nobody touches anybody."""
    assert (np.asarray(log.flights.status) == Status.OK).all()
    assert (np.asarray(log.touched) == -1).all()
    position = np.asarray(log.flights.position, float)
    apart = np.linalg.norm(position[..., :, None, :, :] - position[..., None, :, :, :], axis=-1)
    least = np.nanmin(apart + np.where(np.eye(COUNT, dtype=bool), np.inf, 0.0)[..., None]) - 2.0 * CONFIG.radius
    # The least over physics steps is below that over logged samples, and not by more than they go in between.
    assert least - 2.0 * 0.1 * SMALL.speed <= np.asarray(log.gap).min() <= least + 1e-3
    # Nobody was further from its motion than allowed for: what the motions keep, bodies keep.
    assert np.asarray(log.flights.part(Flags).seconds)[..., Flag.DRIFTED].max() == 0.0
    keeping = CONFIG.extension(Avoidance).keeping.radius
    assert np.asarray(log.gap).min() >= 2.0 * (keeping - CONFIG.extension(Avoidance).drift - CONFIG.radius)
    assert (np.asarray(log.swaps) >= 5).all()


def test_all_arrive_and_nobody_touches_anybody() -> None:
    check_swaps(flown())


def test_on_the_host_a_fleet_flies_as_in_a_batch() -> None:
    check_swaps(flown_in_a_batch())
    alone, flights = flown().flights, flown_in_a_batch().flights
    np.testing.assert_array_equal(alone.status, flights.status[0])
    np.testing.assert_allclose(alone.position, flights.position[0], atol=1e-2)
    assert not np.allclose(flights.duration[0], flights.duration[1])


def test_a_fleet_keeps_away_from_movers_too() -> None:
    """One comes across the middle when both vehicles are there."""
    size, place = 0.6, np.array([[0.0, -9.0, 20.0]])
    solid = Geoms(jnp.zeros((1, 3)), jnp.eye(3)[None], jnp.full((1, 3), size), (SPHERE,))
    velocity = np.array([[0.0, 2.5, 0.0]])
    mover = straight(solid, jnp.asarray(place, jnp.float32), jnp.asarray(velocity, jnp.float32))
    ends = np.array([[-RADIUS, 0.0, 20.0], [RADIUS, 0.0, 20.0]])
    bounds = Bounds(speed=3.0, acceleration=0.5)
    looking = dataclasses.replace(CONFIG.extension(Avoidance), perception=TrueTracks(slots=1), bounds=bounds)
    config = dataclasses.replace(CONFIG, extensions=(looking,), lidar=Lidar(rays=1024, channels=16))
    *_, last = watch_swarm(worlds(ends, ends[::-1], mover), config, TOGETHER)
    assert np.asarray(last.log.status).tolist() == [Status.OK, Status.OK]
    position = np.asarray(last.log.position, float)
    times = 0.1 * np.arange(position.shape[1])[:, None]
    apart = np.linalg.norm(position - (place + times * velocity), axis=-1)
    assert np.nanmin(apart) > size + CONFIG.radius
    assert np.nanmin(apart) < 12.0  # it was there
    # The others count for clearance as solids do not: the mover is the nearest one.
    assert np.nanmin(apart) - size - 0.5 <= np.asarray(last.log.clearance).min() <= np.nanmin(apart) - size + 1e-3


def test_who_starts_too_near_to_another_does_not_start() -> None:
    start = np.array([[0.0, 0.0, 20.0], [0.5, 0.0, 20.0], [20.0, 0.0, 20.0], [30.0, 0.0, 20.0]])
    fleet = worlds(start, start + np.array([0.0, 12.0, 0.0]))
    flights = jax.jit(lambda fleet: swarm_take_off(fleet, CONFIG, TOGETHER))(fleet)
    occupied, ok = int(Status.START_OCCUPIED), int(Status.OK)
    assert np.asarray(flights.log.status).tolist() == [occupied, occupied, ok, ok]
    assert np.asarray(flights.done).tolist() == [True, True, False, False]


def test_impossible_fleets_are_refused() -> None:
    with pytest.raises(ValueError, match="expected a finite number of seconds"):
        Together(delay=-0.1)
    with pytest.raises(ValueError, match="expected 2 vehicles or more, given 1"):
        fly_swarm(jax.tree.map(lambda x: x[:1], swaps()), CONFIG, TOGETHER)
    with pytest.raises(ValueError, match="given a config without"):
        fly_swarm(swaps(), dataclasses.replace(CONFIG, extensions=()), TOGETHER)
