"""A flight among movers with true tracks, judged in float64; and the same flight that does not look."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.status import Status
from maxjax.planning.problem.distances import Distances
from maxjax.sim.loop.flight import FlightConfig, FlightLog, fly_closed_loop
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.worlds.geoms import SPHERE, Geoms, ground_plane
from maxjax.sim.worlds.movers import Movers, straight
from maxjax.ui.methods import planner_named

pytestmark = pytest.mark.large

CALM = FlightConfig(
    planner=planner_named("field"),
    shape=(61, 45, 17),
    lidar=Lidar(rays=4096, channels=64),
    plans=30,
    distances=Distances(1.0, 4.0),
)
HOW = Avoidance(TrueTracks(slots=8), bounds=Bounds(speed=10.0))
LOOKING = dataclasses.replace(CALM, extensions=(HOW,))
START, GOAL = np.array([-20.0, 0.0, 6.0]), np.array([20.0, 0.0, 6.0])
RADIUS = 0.6


def on_the_way() -> Movers:
    """One that overtakes the vehicle along its way, one that crosses it, one far away."""
    place = jnp.array([[-52.0, 0.0, 6.0], [-4.0, -18.0, 6.0], [0.0, 60.0, 30.0]])
    velocity = jnp.array([[10.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    solids = Geoms(jnp.zeros((3, 3)), jnp.broadcast_to(jnp.eye(3), (3, 3, 3)), jnp.full((3, 3), RADIUS), (SPHERE,) * 3)
    return straight(solids, place, velocity)


@functools.cache
def flown(config: FlightConfig) -> FlightLog:
    fly = jax.jit(functools.partial(fly_closed_loop, config=config))
    ends = jnp.asarray(START, jnp.float32), jnp.asarray(GOAL, jnp.float32)
    return fly(ground_plane(), *ends, jax.random.key(1), movers=on_the_way())


def gaps(log: FlightLog) -> np.ndarray:
    """Distance from the vehicle to the nearest mover at each logged position, by hand."""
    position = np.asarray(log.position, float)
    position = position[np.isfinite(position[:, 0])]
    times = LOG_PERIOD * np.arange(len(position))[:, None, None]
    movers = on_the_way()
    places = np.asarray(movers.knots[:, 0], float) + times * np.asarray(movers.velocity[:, 0], float)
    return (np.linalg.norm(position[:, None] - places, axis=-1) - RADIUS).min(axis=1)


def test_who_looks_arrives_and_keeps_away() -> None:
    log = flown(LOOKING)
    assert Status(int(log.status)) == Status.OK
    assert gaps(log).min() > HOW.keeping.radius - HOW.drift
    assert float(log.clearance) <= gaps(log).min() + 0.05  # the log counts movers, at every physics step
    flags = log.part(Flags)
    assert float(flags.any_seconds) == 0.0
    assert (np.asarray(flags.last) == -np.inf).all()
    assert len(np.asarray(flags.seconds)) == len(Flag)
    assert float(log.flown_length) < 1.5 * np.linalg.norm(GOAL - START)


def test_who_does_not_look_is_hit_and_the_log_says_so() -> None:
    log = flown(CALM)
    assert Status(int(log.status)) == Status.IN_CONTACT
    assert float(log.clearance) <= CALM.radius
    assert not log.has(Flags)


def test_nan_and_movers_on_the_start_end_the_flight_at_once() -> None:
    fly = jax.jit(functools.partial(fly_closed_loop, config=LOOKING))
    on_it = dataclasses.replace(on_the_way(), knots=jnp.asarray(np.broadcast_to(START, (3, 1, 3)), jnp.float32))
    goal = jnp.asarray(GOAL, jnp.float32)
    log = fly(ground_plane(), jnp.asarray(START, jnp.float32), goal, jax.random.key(1), movers=on_it)
    assert Status(int(log.status)) == Status.START_OCCUPIED
    assert float(log.duration) == 0.0
