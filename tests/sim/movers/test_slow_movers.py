"""Flights in the open among movers with true tracks, judged in float64: slow ones are passed, fast ones avoided."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import AStar
from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig, FlightLog, fly_closed_loop
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.loop.follow import follow
from maxjax.sim.loop.sensing import fuse, sense
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.movers.avoidance import Avoidance, straight_way
from maxjax.sim.movers.known_surroundings import clearance_to_movers
from maxjax.sim.movers.reachable_sets import Bounds, no_tracks
from maxjax.sim.movers.true_tracks import TrueTracks, tracks_of
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.worlds.geoms import ground_plane
from maxjax.sim.worlds.movers import Movers
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Sampling
from tests.sim.movers.scenes import spheres

pytestmark = [pytest.mark.large, pytest.mark.full_speed]  # flights run for longer than they compile

START, GOAL = np.array([-25.0, 0.0, 8.0]), np.array([25.0, 0.0, 8.0])
BOUNDS = Bounds(speed=5.5, acceleration=2.2, turn=0.0)
# Places and velocities known as by the LiDAR at ten metres.
HOW = Avoidance(TrueTracks(slots=1, place=0.2, velocity=1.0), BOUNDS, within=((-60.0, -60.0, 2.0), (60.0, 60.0, 30.0)))
CONFIG = FlightConfig(
    planner=Field(),
    extensions=(HOW,),
    lidar=Lidar(channels=16, rays=1024, reports_misses=True),
    exact=True,
    shape=(41, 41, 17),
    plans=40,
    limits=FlightLimits(speed=5.0, acceleration=8.0),
    sampling=Sampling(0.5, 256),
    stages=(sense, fuse, straight_way, follow),
)
# The same for faster ones, and without looking.
FAST = dataclasses.replace(
    HOW, perception=TrueTracks(slots=3, place=0.2, velocity=1.0), bounds=dataclasses.replace(BOUNDS, speed=10.0)
)
LOOKING = dataclasses.replace(CONFIG, planner=AStar(), extensions=(FAST,))
BLIND = dataclasses.replace(LOOKING, extensions=(), stages=(straight_way, follow))


@functools.cache
def fast_flight() -> jax.stages.Wrapped:
    ends = jnp.asarray(START, jnp.float32), jnp.asarray(GOAL, jnp.float32)
    key = jax.random.key(0)
    return jax.jit(lambda movers: fly_closed_loop(ground_plane(), *ends, key, CONFIG, movers))


@functools.partial(jax.jit, static_argnames="config")
def flight_among(movers: Movers, config: FlightConfig) -> FlightLog:
    start, goal = (jnp.asarray(end, jnp.float32) for end in ENDS)
    return fly_closed_loop(ground_plane(), start, goal, jax.random.key(0), config, movers)


def line_of(log: FlightLog) -> np.ndarray:
    position: np.ndarray = np.asarray(log.position, float)
    line: np.ndarray = position[np.isfinite(position[:, 0])]
    return line


@pytest.mark.parametrize(
    ("place", "velocity"),
    [
        ([-12.0, -0.8, 7.4], [0.7, 0.2, 0.1]),  # ahead, the same way
        ([0.0, 0.2, 8.0], [-1.3, 0.0, 0.0]),  # against it
        ([-10.0, -2.0, 8.5], [0.5, 0.3, 0.0]),  # aslant
    ],
)
def test_a_slow_mover_is_passed(place: list[float], velocity: list[float]) -> None:
    log: FlightLog = fast_flight()(spheres(np.array([place]), np.array([velocity])))
    assert Status(int(log.status)) == Status.OK
    # 10 s at 5 m/s, and a way round of some metres.
    assert float(log.duration) < 16.0
    assert float(log.part(Flags).any_seconds) == 0.0
    line = line_of(log)
    # The way on is not turned round again and again.
    ahead = np.diff(line[:, 0])
    assert (ahead < -0.05).sum() * LOG_PERIOD < 2.0
    gaps = np.linalg.norm(line - (place + LOG_PERIOD * np.arange(len(line))[:, None] * velocity), axis=1) - 0.45
    assert gaps.min() > HOW.keeping.radius


ENDS = np.array([-20.0, 0.0, 6.0]), np.array([20.0, 0.0, 6.0])
SIZE = 0.6
# One overtakes the vehicle along its way, one crosses it, one stands far away.
PLACES = np.array([[-52.0, 0.0, 6.0], [-4.0, -18.0, 6.0], [0.0, 60.0, 30.0]])
VELOCITIES = np.array([[10.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 0.0]])


def gaps(log: FlightLog) -> np.ndarray:
    """Distance from the vehicle to the nearest mover at each logged position, by hand."""
    line = line_of(log)
    times = LOG_PERIOD * np.arange(len(line))[:, None, None]
    least: np.ndarray = (np.linalg.norm(line[:, None] - (PLACES + times * VELOCITIES), axis=-1) - SIZE).min(axis=1)
    return least


def test_who_looks_arrives_and_keeps_away() -> None:
    log = flight_among(spheres(PLACES, VELOCITIES, SIZE), LOOKING)
    assert Status(int(log.status)) == Status.OK
    assert gaps(log).min() > FAST.keeping.radius - FAST.drift
    assert float(log.clearance) <= gaps(log).min() + 0.05  # the log counts movers, at every physics step
    flags = log.part(Flags)
    assert float(flags.any_seconds) == 0.0
    assert (np.asarray(flags.last) == -np.inf).all()
    assert len(np.asarray(flags.seconds)) == len(Flag)
    assert float(log.flown_length) < 1.5 * np.linalg.norm(ENDS[1] - ENDS[0])


def test_who_does_not_look_is_hit_and_the_log_says_so() -> None:
    log = flight_among(spheres(PLACES, VELOCITIES, SIZE), BLIND)
    assert Status(int(log.status)) == Status.IN_CONTACT
    assert float(log.clearance) <= BLIND.radius
    assert not log.has(Flags)


def test_movers_on_the_start_end_the_flight_at_once() -> None:
    log = flight_among(spheres(np.tile(ENDS[0], (3, 1)), VELOCITIES, SIZE), LOOKING)
    assert Status(int(log.status)) == Status.START_OCCUPIED
    assert float(log.duration) == 0.0


def test_what_motions_keep_of_a_mover_is_its_set_when_they_rest_and_the_radius() -> None:
    """Of one at 1 ± 1 m/s, known to 2 cm, backwards most: from 0 m/s it does not reach the bound on speed."""
    movers = spheres(np.array([[0.0, 0.0, 8.0]]), np.array([[1.0, 0.0, 0.0]]))
    seen = TrueTracks(slots=2, velocity=1.0)
    tracks = jax.jit(lambda movers: tracks_of(movers, jnp.float32(0.0), jnp.zeros(3), BOUNDS, seen))(movers)
    time = HOW.choice.lasts
    expected = HOW.keeping.radius + 0.02 + 1.0 * time + 0.5 * BOUNDS.acceleration * time**2
    np.testing.assert_allclose(clearance_to_movers(tracks, HOW), [expected, 0.0], rtol=1e-5)
    assert (clearance_to_movers(no_tracks(3), HOW) == 0.0).all()
