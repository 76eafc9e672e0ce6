"""A trajectory flown: the vehicle in MJX and its controller follow given set-points, and a map verifies what was flown.

    (state, observer, gust), set-point at t  →  thrusts  →  state at t + Δt          a scan over time steps, vmap over
                                                                                     trajectories

Set-points are the trajectory's position, velocity and yaw at each time step, and its acceleration `Controller.lead`
later. The vehicle hovers at the start until its controller has found the wind, and at the goal for `AFTER` seconds.
Scans run in pieces of `STEPS` time steps, so that one program flies trajectories of any duration.

World frame ENU [m]; on the device relative to the trajectory's origin, in float32. What was flown is verified in NumPy
in float64, by exact distances to the cubes of occupied voxels.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Float64, Int32

from maxjax.compile.executable import Stored
from maxjax.core.grid import Grid
from maxjax.core.rng_streams import Stream, stream
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap, check_map
from maxjax.sim.loop.flight_air import AFTER, BEFORE, STEPS, Air, Carry, air_of, hover_in, setpoint_rows
from maxjax.sim.loop.waiting_flight import follow_waiting
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.trajectories.follower import Follower
from maxjax.trajectories.online import Setpoint
from maxjax.trajectories.trajectory import Trajectory
from maxjax.verification.clearance import distances_at

# Radius of the sphere around the vehicle that must not touch anything, where the trajectory's is not smaller [m].
VEHICLE_RADIUS = 0.5
# Error beyond which a vehicle does not follow its trajectory any more [m].
ASTRAY = 1.0


@dataclasses.dataclass(frozen=True)
class Tracking:
    """How a vehicle kept to a trajectory; one row a time step.

    Attributes:
        status: OK; IN_CONTACT; OFF_TRAJECTORY where the error grew beyond `ASTRAY`; or NONFINITE_STATE.
        time: (t,) since the flight's start [s], to `AFTER` seconds beyond the trajectory's end.
        position: (t, 3) of the vehicle's centre [m], ENU.
        velocity: (t, 3) [m/s].
        error: (t,) distance from the vehicle to where the trajectory is at that time, or at that of a clock that
            waits [m].
        clearance: (t,) distance from the vehicle's centre to the cube of an occupied voxel [m], ground left out;
            infinite where there is none.
        contact: (t,) whether an occupied voxel, ground included, is within the vehicle's radius, 0.5 m or the
            trajectory's if smaller. In the exemption of a waypoint that radius is less by what the waypoint itself is
            short of the trajectory's, and 0 if it is short of more: then contact is a voxel that holds the centre.
    """

    status: Status
    time: Float64[np.ndarray, " t"]
    position: Float64[np.ndarray, "t 3"]
    velocity: Float64[np.ndarray, "t 3"]
    error: Float64[np.ndarray, " t"]
    clearance: Float64[np.ndarray, " t"]
    contact: Bool[np.ndarray, " t"]


class _Flown(NamedTuple):
    """Positions relative to the origin [m] and velocities [m/s], a row a time step."""

    position: Float[Array, "*batch t 3"]
    velocity: Float[Array, "*batch t 3"]


def fly(
    trajectory: Trajectory,
    where: VoxelMap | None = None,
    *,
    wind: float = 0.0,
    seed: int = 0,
    follower: Follower | None = None,
) -> Tracking:
    """Fly a trajectory with a quadrotor in MJX, and measure what was flown in a map: error, clearance, contact.

    The vehicle sees nothing and plans nothing: it follows the trajectory's set-points.

    Args:
        trajectory: of a plan or a mission.
        where: the map that is flown in. None: that of the plan, without what the rules of the air close.
        wind: mean speed of the wind [m/s], with gusts in proportion.
        seed: of the wind's direction and the gusts.
        follower: the clock, which waits for the vehicle. None: time alone.

    Returns:
        A `Tracking`; its status is OK if the vehicle kept to the trajectory and touched nothing.

    Raises:
        ValueError: if the map is none, or the wind is no speed.
    """
    return fly_all([trajectory], trajectory.map if where is None else check_map(where), wind, seed, follower)[0]


def fly_all(
    trajectories: Sequence[Trajectory],
    where: VoxelMap,
    wind: float = 0.0,
    seed: int = 0,
    follower: Follower | None = None,
) -> list[Tracking]:
    """Fly trajectories in one map, all at a time.

    Args:
        trajectories: at least one.
        where: the map.
        wind, seed: as in `fly`; each trajectory has a wind of its own.
        follower: as in `fly`.
    """
    if follower is not None:
        waited = follow_waiting(trajectories, follower, wind, seed)
        return [summarize_tracking(one, *how[:3], where, how[3]) for one, how in zip(trajectories, waited, strict=True)]
    flown = follow_setpoints(trajectories, wind, seed)
    return [summarize_tracking(one, *how, where) for one, how in zip(trajectories, flown, strict=True)]


def follow_setpoints(
    trajectories: Sequence[Trajectory],
    wind: float = 0.0,
    seed: int = 0,
    vehicle: physics.Vehicle = physics.Vehicle(),  # noqa: B008 (frozen)
    controller: control.Controller = control.Controller(),  # noqa: B008 (frozen)
) -> list[tuple[Float64[np.ndarray, " t"], Float64[np.ndarray, "t 3"], Float64[np.ndarray, "t 3"]]]:
    """Times [s], positions [m] and velocities [m/s] of vehicles that follow trajectories.

    Args:
        trajectories, wind, seed: as in `fly_all`.
        vehicle, controller: static.

    Raises:
        ValueError: without a trajectory, or for a wind that is no speed.
    """
    if not trajectories:
        raise ValueError("trajectories: expected at least one, given none")
    if not 0.0 <= wind < np.inf:
        raise ValueError(f"wind: expected a speed from 0 on [m/s], given {wind}")
    dt = vehicle.timestep
    counts = [round(BEFORE / dt) + int(np.ceil((one.duration + AFTER) / dt)) + 1 for one in trajectories]
    keys = jax.random.split(jax.random.key(seed), len(trajectories))
    air = jax.vmap(air_of, (None, 0))(jnp.float32(wind), keys)
    carry = jax.vmap(hover_in, (None, 0, 0))(
        vehicle, jnp.array([one.at([0.0]).yaw[0] for one in trajectories], jnp.float32), air
    )
    parts = []
    for k in range(0, max(counts), STEPS):
        times = dt * np.arange(k, k + STEPS) - BEFORE
        asked = [setpoint_rows(one, times, controller.lead) for one in trajectories]
        wanted = jax.tree.map(lambda *rows: jnp.stack(rows), *asked)
        carry, flown = _FOLLOW((vehicle, controller), air, carry, wanted, jnp.int32(k // STEPS))
        parts.append(jax.tree.map(np.asarray, flown))
    position, velocity = (np.concatenate(values, axis=1) for values in zip(*parts, strict=True))
    first, found = round(BEFORE / dt), []
    for k, (one, count) in enumerate(zip(trajectories, counts, strict=True)):
        places = np.array(one.origin) + np.asarray(position[k, first:count], np.float64)
        found.append((dt * np.arange(count - first), places, np.asarray(velocity[k, first:count], np.float64)))
    return found


def summarize_tracking(
    trajectory: Trajectory,
    time: Float64[np.ndarray, " t"],
    position: Float64[np.ndarray, "t 3"],
    velocity: Float64[np.ndarray, "t 3"],
    where: VoxelMap,
    clock: Float64[np.ndarray, " t"] | None = None,
) -> Tracking:
    """How any vehicle kept to a trajectory, by what it flew, and what it came near to in a map.

    Args:
        trajectory: that it followed.
        time, position, velocity: of the flight [s], [m], [m/s].
        where: the map.
        clock: the trajectory's time then [s]. None: that of the flight.
    """
    grid, finite = where.grid, np.isfinite(position).all(axis=1) & np.isfinite(velocity).all(axis=1)
    error = np.where(
        finite, np.linalg.norm(position - trajectory.at(time if clock is None else clock).position, axis=1), np.inf
    )
    index = _index(np.where(finite[:, None], position, trajectory.origin), grid)
    first, solid = np.zeros(len(index), np.int64), np.asarray(where.occupied)[None]
    any_solid = grid.spacing * distances_at(index, first, solid, None)
    clearance = grid.spacing * distances_at(index, first, solid, np.asarray(where.ground)[None])
    places = trajectory.at(trajectory.passes).position
    own = grid.spacing * distances_at(_index(places, grid), np.zeros(len(places), np.int64), solid, None)
    short = np.zeros(len(index))  # of the radius, where a waypoint is
    for place, distance, reach in zip(places, own, trajectory.exemptions, strict=True):
        exempt = np.linalg.norm(position - place, axis=1) < reach
        short[exempt] = np.maximum(short[exempt], trajectory.radius - distance)
    contact = any_solid <= np.maximum(min(VEHICLE_RADIUS, trajectory.radius) - short, 0.0)
    if not finite.all():
        status = Status.NONFINITE_STATE
    elif contact.any():
        status = Status.IN_CONTACT
    else:
        status = Status.OFF_TRAJECTORY if error.max() > ASTRAY else Status.OK
    return Tracking(status, time, position, velocity, error, clearance, contact)


def _index(points: Float64[np.ndarray, "n 3"], grid: Grid) -> Float64[np.ndarray, "n 3"]:
    """Index coordinates of points in the world, voxel i being [i, i + 1]."""
    index: Float64[np.ndarray, "n 3"] = (points - np.array(grid.origin)) / grid.spacing + 0.5
    return index


def _follow(
    how: tuple[physics.Vehicle, control.Controller],
    air: Air,
    carry: Carry,
    setpoints: Setpoint,
    piece: Int32[Array, ""],
) -> tuple[Carry, _Flown]:
    """A piece of all flights: (b, STEPS) set-points."""
    vehicle, controller = how

    def one(air: Air, carry: Carry, setpoints: Setpoint) -> tuple[Carry, _Flown]:
        noise = jax.random.normal(stream(air.key, Stream.GUSTS, piece), (STEPS, 3))

        def turn(carry: Carry, now: tuple[Setpoint, Array]) -> tuple[Carry, _Flown]:
            state, observer, gust = carry
            setpoint, numbers = now
            gust = physics.gust(physics.Gusts(), gust, numbers, vehicle.timestep)
            observer, command = control.command(controller, vehicle, observer, state, setpoint)
            after = physics.advance(vehicle, state, command, air.mean + air.strength * gust)
            return Carry(after, observer, gust), _Flown(state.position, state.velocity)

        return lax.scan(turn, carry, (setpoints, noise))

    return jax.vmap(one)(air, carry, setpoints)


_FOLLOW = Stored("vehicle", _follow)
