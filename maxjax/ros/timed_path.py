"""From a path to set-points at even times, without compiling anything after the first call.

    path → rounded by at most `DEVIATION` → the fastest speeds within the limits → x, v, a at 0, STEP, 2 STEP, …

It begins with the speed that the vehicle has along the path, and ends at rest: at the end of the path, or before, where
it is longer than there are set-points for. Corners are rounded, so that the radius has to have room for `DEVIATION`.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64

from maxjax.compile.executable import Stored
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Sampling, profile, sample, setpoint_at

DEVIATION = 0.1
"""Greatest distance of the set-points from the path [m]."""
STEP = 0.1
"""Between set-points [s]."""
REACH = 60.0
"""Of the path, that is flown at most before a new one is made [m]."""
_POINTS = 512  # of a path
_TIMES = 256
_SAMPLING = Sampling(0.25, round(REACH / 0.25) + 1)


class Setpoints(NamedTuple):
    """Set-points at times from now on [s]: positions [m], velocities [m/s], accelerations [m/s²]."""

    times: Float64[np.ndarray, " n"]
    positions: Float64[np.ndarray, "n 3"]
    velocities: Float64[np.ndarray, "n 3"]
    accelerations: Float64[np.ndarray, "n 3"]


def time_path(path: Float64[np.ndarray, "n 3"], speed: float, limits: FlightLimits) -> Setpoints:
    """Set-points along a path.

    Args:
        path: of at least two points [m].
        speed: of the vehicle along it, at its start [m/s].
        limits: of speed and acceleration.
    """
    origin = path[0]
    rows = np.minimum(np.arange(_POINTS), len(path) - 1)
    if len(path) > _POINTS:
        path = path[:_POINTS]
    close = dataclasses.replace(limits, deviation=DEVIATION)
    found = _TIMED(jnp.asarray(path[rows] - origin, jnp.float32), jnp.float32(max(speed, 0.0)), limits=close)
    duration, *states = (np.asarray(x, np.float64) for x in found)
    count = min(int(np.ceil(float(duration) / STEP)) + 1, _TIMES)
    position, velocity, acceleration = (x[:count] for x in states)
    return Setpoints(STEP * np.arange(count), position + origin, velocity, acceleration)


def _timed(
    path: Float[Array, "n 3"], speed: Float[Array, ""], limits: FlightLimits
) -> tuple[Float[Array, ""], Float[Array, "t 3"], Float[Array, "t 3"], Float[Array, "t 3"]]:
    course = sample(path, limits, _SAMPLING)
    caps = jnp.full(course.arclength.shape, limits.speed)
    reference = profile(course, caps, speed, limits)
    # What lasts longer than there are set-points is left early enough to come to rest at the last one.
    latest = STEP * (_TIMES - 1) - limits.speed / limits.acceleration
    reference = profile(course, jnp.where(reference.time < latest, caps, 0.0), speed, limits)
    points = jax.vmap(lambda time: setpoint_at(reference, time))(STEP * jnp.arange(_TIMES, dtype=jnp.float32))
    return reference.duration, points.position, points.velocity, points.acceleration


_TIMED = Stored("times of a path", _timed, ("limits",))
