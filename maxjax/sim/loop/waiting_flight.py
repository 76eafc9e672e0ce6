"""Trajectories flown by a clock that waits for the vehicle (`trajectories.follower`), in batches on the device.

    (state, observer, gust, s) → error at s → pace → set-point at s → thrusts → state at t + Δt, s + pace Δt

Set-points are read from a table of the trajectory, a row a time step, between which they are linear.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Float64, Int32

from maxjax.compile.executable import Stored
from maxjax.core.rng_streams import Stream, stream
from maxjax.sim.loop.flight_air import AFTER, BEFORE, STEPS, Air, Carry, air_of, hover_in, setpoint_rows
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.trajectories.follower import Follower
from maxjax.trajectories.online import Setpoint
from maxjax.trajectories.trajectory import Trajectory

_PATIENCE = 5.0  # how often the duration of its trajectory a flight may take
Row = Float64[np.ndarray, " t"]
Rows = Float64[np.ndarray, "t 3"]


def follow_waiting(
    trajectories: Sequence[Trajectory],
    follower: Follower,
    wind: float = 0.0,
    seed: int = 0,
    vehicle: physics.Vehicle = physics.Vehicle(),  # noqa: B008 (frozen)
    controller: control.Controller = control.Controller(),  # noqa: B008 (frozen)
) -> list[tuple[Row, Rows, Rows, Row]]:
    """As `follow_setpoints`, by a clock that waits: in the winds of the same seed, with the clock's times [s] as well.

    A flight ends `AFTER` seconds after its clock, or when it has taken `_PATIENCE` times the trajectory's duration.
    """
    dt, most = vehicle.timestep, max(one.duration for one in trajectories)
    times = dt * np.arange(STEPS * int(np.ceil((most / dt + 2.0) / STEPS)))
    rows = [setpoint_rows(one, times, controller.lead) for one in trajectories]
    table = jax.tree.map(lambda *values: jnp.stack(values), *rows)
    air = jax.vmap(air_of, (None, 0))(jnp.float32(wind), jax.random.split(jax.random.key(seed), len(trajectories)))
    carry = jax.vmap(hover_in, (None, 0, 0))(vehicle, table.yaw[:, 0], air)
    durations = np.array([one.duration for one in trajectories])
    clock, parts = jnp.zeros(len(trajectories), jnp.float32), list[tuple[np.ndarray, ...]]()
    first = round(BEFORE / dt)
    ended = np.full(len(trajectories), np.inf)
    for k in range(int(np.ceil((BEFORE + AFTER + _PATIENCE * most) / dt / STEPS))):
        how, span = (vehicle, controller, follower), jnp.asarray(durations, jnp.float32)
        carry, clock, flown = _WAIT(how, air, (carry, clock), (table, span), jnp.int32(k))
        parts.append(tuple(map(np.asarray, flown)))
        done = (parts[-1][2] >= durations.astype(np.float32)[:, None]) & np.isinf(ended)[:, None]
        ended = np.where(done.any(1), np.minimum(ended, k * STEPS + done.argmax(1)), ended)
        if ((k + 1) * STEPS > ended + AFTER / dt).all():
            break
    position, velocity, told = (np.concatenate(values, axis=1) for values in zip(*parts, strict=True))
    found = []
    for i, one in enumerate(trajectories):
        last = int(min(ended[i] + AFTER / dt, position.shape[1]))
        places, speeds, clocks = (
            np.asarray(values[i, first:last], np.float64) for values in (position, velocity, told)
        )
        found.append((dt * np.arange(last - first), np.array(one.origin) + places, speeds, clocks))
    return found


def _wait(
    how: tuple[physics.Vehicle, control.Controller, Follower],
    air: Air,
    carry: tuple[Carry, Float[Array, " b"]],
    asked: tuple[Setpoint, Float[Array, " b"]],
    piece: Int32[Array, ""],
) -> tuple[Carry, Float[Array, " b"], tuple[Array, Array, Array]]:
    """A piece of all flights: the clocks move by what the vehicles reach of (b, n) set-points, a row a time step."""
    vehicle, controller, follower = how

    def one(air: Air, carry: Carry, clock: Array, table: Setpoint, duration: Array) -> tuple[Carry, Array, Any]:
        noise = jax.random.normal(stream(air.key, Stream.GUSTS, piece), (STEPS, 3))
        starts = (piece * STEPS + jnp.arange(STEPS)) * vehicle.timestep >= BEFORE

        def turn(carry: tuple[Carry, Array], now: tuple[Array, Array]) -> tuple[tuple[Carry, Array], Any]:
            (state, observer, gust), time = carry
            numbers, goes = now
            gust = physics.gust(physics.Gusts(), gust, numbers, vehicle.timestep)
            setpoint = _between(table, time / vehicle.timestep)
            error = jnp.linalg.norm(state.position - setpoint.position)
            # The acceleration leads, and would be that of the start already while the vehicle hovers before it.
            pace = jnp.where(goes, follower.pace(error), 0.0)
            velocity, acceleration = follower.scale(setpoint.velocity, setpoint.acceleration, pace)
            setpoint = dataclasses.replace(setpoint, velocity=velocity, acceleration=acceleration)
            observer, command = control.command(controller, vehicle, observer, state, setpoint)
            after = physics.advance(vehicle, state, command, air.mean + air.strength * gust)
            later = follower.advance(time, error, jnp.where(goes, vehicle.timestep, 0.0), duration)
            return (Carry(after, observer, gust), later), (state.position, state.velocity, time)

        (last, clock), flown = lax.scan(turn, (carry, clock), (noise, starts))
        return last, clock, flown

    return jax.vmap(one)(air, *carry, *asked)


def _between(table: Setpoint, row: Float[Array, ""]) -> Setpoint:
    """The set-point between two rows of a table."""
    low = jnp.clip(row.astype(jnp.int32), 0, table.yaw.shape[0] - 2)
    share = row - low
    before = jax.tree.map(lambda values: values[low], table)
    after = jax.tree.map(lambda values: values[low + 1], table)
    turn = jnp.arctan2(jnp.sin(after.yaw - before.yaw), jnp.cos(after.yaw - before.yaw))
    mixed: Setpoint = jax.tree.map(lambda a, b: a + share * (b - a), before, after)
    return dataclasses.replace(mixed, yaw=before.yaw + share * turn)


_WAIT = Stored("vehicle", _wait)
