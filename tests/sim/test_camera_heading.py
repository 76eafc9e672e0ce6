"""An exact vehicle with a narrow sensor turns it to where it flies, no faster than its limit."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.loop.follow import turn_heading
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.vehicle import quadrotor as physics

CAMERA = FlightConfig(planner=Field(), lidar=Lidar(width=76.0), exact=True)
RATE, STEP = CAMERA.limits.yaw_rate, CAMERA.vehicle.timestep


def headings(velocity: list[float], config: FlightConfig, seconds: float) -> np.ndarray:
    """The heading at every time step, from east."""

    def step(state: physics.State, _: None) -> tuple[physics.State, jax.Array]:
        yaw = turn_heading(state.rotation, jnp.array(velocity), config)
        return physics.hover(config.vehicle, jnp.zeros(3), yaw), yaw

    first = physics.hover(config.vehicle, jnp.zeros(3))
    return np.unwrap(np.asarray(jax.lax.scan(step, first, length=round(seconds / STEP))[1]))


@pytest.mark.parametrize("course", [90.0, -170.0, 30.0])
def test_camera_reaches_the_course_at_the_limit_and_stays(course: float) -> None:
    angle = math.radians(course)
    yaw = headings([3.0 * math.cos(angle), 3.0 * math.sin(angle), 1.0], CAMERA, 4.0)
    np.testing.assert_allclose(yaw[-1], angle, atol=1e-4)
    assert np.abs(np.diff(yaw)).max() <= RATE * STEP * 1.01
    np.testing.assert_allclose(yaw[round(0.2 / STEP) - 1], math.copysign(0.2 * RATE, angle), rtol=1e-3)


def test_camera_of_a_slow_vehicle_looks_around() -> None:
    yaw = headings([0.0, 0.1, 2.0], CAMERA, 3.0)
    np.testing.assert_allclose(yaw[-1], 3.0 * RATE, rtol=1e-3)


def test_sensor_that_sees_all_around_is_not_turned() -> None:
    config = dataclasses.replace(CAMERA, lidar=Lidar())
    assert np.all(headings([0.0, 3.0, 0.0], config, 1.0) == 0.0)
