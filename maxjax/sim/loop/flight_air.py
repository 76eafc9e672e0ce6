"""What flights along trajectories share: the wind of each, a vehicle that hovers in it, rows of set-points.

World frame ENU, relative to the trajectory's origin [m], in float32.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, PRNGKeyArray

from maxjax.core.rng_streams import Stream, stream
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.sim.vehicle.disturbances import GUST_REFERENCE_WIND, Disturbances, mean_wind
from maxjax.trajectories.online import Setpoint
from maxjax.trajectories.trajectory import Trajectory

BEFORE, AFTER = 2.0, 2.0  # seconds in hover at both ends
STEPS = 400  # of a piece


class Air(NamedTuple):
    """The wind of one flight."""

    mean: Float[Array, "3"]
    strength: Float[Array, ""]  # of the gusts
    key: PRNGKeyArray


class Carry(NamedTuple):
    """A vehicle in flight: its state, what its controller knows, the gust [m/s]."""

    state: physics.State
    observer: control.Observer
    gust: Float[Array, "3"]


def air_of(wind: Float[Array, ""], key: PRNGKeyArray) -> Air:
    """The air of a flight: its mean wind in a random direction, and gusts in proportion."""
    return Air(mean_wind(Disturbances(wind=wind), key), wind / GUST_REFERENCE_WIND, key)


def hover_in(vehicle: physics.Vehicle, yaw: Float[Array, ""], air: Air) -> Carry:
    """A vehicle at rest at the origin, in the first gust."""
    state = physics.hover(vehicle, jnp.zeros(3), yaw)
    noise = jax.random.normal(stream(air.key, Stream.FIRST_GUST), (3,))
    return Carry(state, control.init(state), physics.gust(physics.Gusts(), jnp.zeros(3), noise, 1e3))


def setpoint_rows(trajectory: Trajectory, times: Float64[np.ndarray, " t"], lead: float) -> Setpoint:
    """Those of a vehicle's time steps, relative to the origin."""
    motion = trajectory.at(times)
    position = motion.position - np.array(trajectory.origin)
    # The heading may have gone round often: float32 keeps it within a turn.
    yaw = np.angle(np.exp(1j * motion.yaw))
    values = position, motion.velocity, trajectory.at(times + lead).acceleration, yaw
    return Setpoint(*(jnp.asarray(value, jnp.float32) for value in values))
