"""Limits to the centimetre: from where on a vehicle is off its motion, and from where on in contact."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.sim.loop.flight import Flight, FlightConfig, World, take_off
from maxjax.sim.loop.follow import step_alone
from maxjax.sim.movers.among import Among, Flag
from maxjax.sim.movers.avoidance import Avoidance, steer_vehicle
from maxjax.sim.movers.motions import MotionSet
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import ground_plane
from tests.sim.movers.scenes import spheres

pytestmark = pytest.mark.large

HOW = Avoidance(TrueTracks(slots=1), choice=MotionSet(directions=4), drift=0.4)
CONFIG = FlightConfig(
    planner=Field(), extensions=(HOW,), lidar=Lidar(channels=16, rays=1024), shape=(21, 21, 11), exact=True, radius=0.5
)
START, SIZE = np.array([0.0, 0.0, 10.0]), 0.3
AWAY = 20.0
WORLD = World(
    ground_plane(), jnp.asarray(START, jnp.float32), jnp.array([15.0, 0.0, 10.0]), jax.random.key(0), Disturbances(),
    movers=spheres(np.array([[0.0, AWAY, START[2]]]), np.zeros((1, 3)), SIZE),
)  # fmt: skip


@pytest.fixture(scope="module")
def hovering() -> Flight:
    """Before its first planning period, at the start."""
    flight = jax.jit(lambda world: take_off(world, CONFIG))(WORLD)
    assert Status(int(flight.log.status)) == Status.OK
    return flight


def moved(flight: Flight, by: np.ndarray) -> Flight:
    """The vehicle somewhere else than its motion leads [m]."""
    vehicle = dataclasses.replace(flight.vehicle, position=flight.vehicle.position + jnp.asarray(by, jnp.float32))
    return dataclasses.replace(flight, vehicle=vehicle)


def test_who_is_further_from_his_motion_than_allowed_for_is_flagged(hovering: Flight) -> None:
    steer = jax.jit(lambda flight: steer_vehicle(WORLD, flight, CONFIG))
    for direction in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, -0.8])):
        for off, flagged in ((0.0, False), (0.39, False), (0.41, True), (0.6, True)):
            among, up = steer(moved(hovering, off * direction))
            assert bool(up[Flag.DRIFTED]) == flagged, off
            # Whoever is, begins another motion from where he is.
            begins = START + (off * direction if flagged else 0.0)
            np.testing.assert_allclose(among.flown.motion.place, begins, atol=1e-5)


def test_a_contact_is_a_distance_of_the_radius(hovering: Flight) -> None:
    """By a wall, the ground, and by a mover: of the vehicle after a step, one that is where its motion is."""
    step = jax.jit(lambda flight: step_alone(WORLD, flight, CONFIG, jnp.zeros(3)))
    for touched in (np.array([0.0, 0.0, -START[2]]), np.array([0.0, AWAY - SIZE, 0.0])):
        unit = touched / np.linalg.norm(touched)
        for gap, contact in ((0.44, True), (0.49, True), (0.51, False), (0.6, False)):
            by = touched - gap * unit
            among = hovering.part(Among)
            motion = among.flown.motion
            motion = dataclasses.replace(motion, place=motion.place + jnp.asarray(by, jnp.float32))
            flown = dataclasses.replace(among.flown, motion=motion)
            after = step(moved(hovering, by).with_part(dataclasses.replace(among, flown=flown)))
            assert float(after.log.clearance) == pytest.approx(gap, abs=2e-3)
            assert (Status(int(after.log.status)) == Status.IN_CONTACT) == contact, gap
            assert bool(after.done) == contact
