"""Effects of faults on a flight, and the checks by which it refuses impossible data.

A scan that repeats the one before or whose neighbouring ranges are unrelated, a position that is not a number or
further than `_JUMP` from where dead reckoning is, and a path that does not begin at the vehicle are refused. Planners
that answer wrongly are planners (`experiments.faults`): what they answer is verified like any path. What each mode does
is the table of `sim.faults.modes`. Frame: world.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.core.rng_streams import Stream, stream
from maxjax.core.status import Status
from maxjax.sim.faults.modes import STEPS_LATE, Failing, Mode, Target
from maxjax.sim.loop.flight_state import Flight, FlightConfig, World
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import Lidar, Scan
from maxjax.sim.vehicle.quadrotor import Vehicle

# How late: scans, positions, the clock [s].
_SCAN_LAG, _POSE_LAG, _CLOCK_LAG = 0.3, 0.5, 0.3
# Every so many scans or plans; seconds between positions.
_SLOW, _SLOW_POSE = 3, 2.0
# Ranges are too long by [m]; positions off by at most, at this rate [m, m/s].
_TOO_LONG, _OFF, _OFF_RATE = 0.5, 1.5, 0.2
_ANYWHERE = 20.0
# Wind: constant and squalls, random, downwards, growing at most to [m/s].
_SQUALL, _RANDOM_WIND, _DOWN, _MOST_WIND = 12.0, 10.0, 5.0, 15.0
# Motors: spread, share of the thrust, time constant [s].
_SPREAD, _WEAK, _LAZY = 0.3, 0.85, 0.1
_FAST, _SLOW_CLOCK = 1.3, 0.7

# Greatest innovation of a position [m], the time in which one is taken over [s], and the relative error of the speed
# that is integrated.
_JUMP, _TAKEN_OVER, _ODOMETER = 1.0, 0.5, 0.01
# Neighbouring ranges further apart than this, and than this share of their sum, are unrelated; a scan in which more
# than so many of them are, is none.
_UNRELATED, _SHARE, _MOST_UNRELATED = 5.0, 0.25, 0.5


def _mode(world: World, flight: Flight, target: Target) -> Int32[Array, ""]:
    """The mode of a target now; `OFF` in the bad periods of one that fails from time to time."""
    mode = jnp.where(flight.log.duration >= world.failures.onset, world.failures.modes[target], Mode.NONE)
    bad = jax.random.bernoulli(_key(world, flight, target))
    return jnp.where((mode == Mode.INTERMITTENT) & ~bad, Mode.NONE, mode)


def _key(world: World, flight: Flight, target: Target) -> PRNGKeyArray:
    """A key of its own for each target and planning period."""
    return jax.random.fold_in(stream(world.key, Stream.FAULTS, flight.log.planning_iterations), int(target))


def _step_key(world: World, flight: Flight, target: Target) -> PRNGKeyArray:
    """A key of its own for each time step."""
    return jax.random.fold_in(_key(world, flight, target), jnp.round(1e3 * flight.log.duration).astype(jnp.int32))


def scan_origin(world: World, flight: Flight) -> Float[Array, "3"]:
    """Where the scan that arrives now was taken [m]."""
    late = _mode(world, flight, Target.LIDAR) == Mode.LATE
    return flight.vehicle.position - jnp.where(late, _SCAN_LAG, 0.0) * flight.vehicle.velocity


def deliver_scan(
    world: World, flight: Flight, scan: Scan, lidar: Lidar, number: Int32[Array, ""]
) -> tuple[Scan, Failing]:
    """The usable part of a scan, after its fault and after the checks.

    Args:
        world, flight: before the scan.
        scan: as it would be.
        lidar: the sensor's model. Static.
        number: of the scan.
    """
    mode, before = _mode(world, flight, Target.LIDAR), flight.fault_memory.ranges
    lost_key, range_key = jax.random.split(_key(world, flight, Target.LIDAR))
    silent = (mode == Mode.OFF) | (mode == Mode.INTERMITTENT) | ((mode == Mode.SLOW) & (number % _SLOW != 0))
    lost = (mode == Mode.GARBAGE) & jax.random.bernoulli(lost_key, shape=scan.hit.shape)
    ranges = jnp.where(scan.hit & ~lost & ~silent, scan.distance, jnp.inf)
    ranges = jnp.where(mode == Mode.WRONG, ranges + _TOO_LONG, ranges)
    anywhere = jax.random.uniform(range_key, ranges.shape, maxval=lidar.max_range)
    ranges = jnp.where((mode == Mode.GARBAGE) & jnp.isfinite(ranges), anywhere, ranges)
    ranges = jnp.where((mode == Mode.STUCK) & jnp.any(jnp.isfinite(before)), before, ranges)
    hit = jnp.isfinite(ranges) & ~_refused(ranges, before, lidar)
    stretch = jnp.where(hit & scan.hit, ranges, 0.0) / jnp.where(scan.hit, scan.distance, 1.0)
    origin = scan_origin(world, flight)
    points = origin + (scan.points - origin) * stretch[:, None]
    used = Scan(jnp.where((hit & scan.hit)[:, None], points, jnp.nan), jnp.where(hit, ranges, jnp.inf), hit)
    return used, dataclasses.replace(flight.fault_memory, ranges=ranges)


def _refused(ranges: Float[Array, " r"], before: Float[Array, " r"], lidar: Lidar) -> Bool[Array, ""]:
    """Whether a scan is none: the one before once more, or ranges without any surface."""
    repeated = jnp.all(ranges == before) & jnp.any(jnp.isfinite(ranges))
    image = ranges.reshape(lidar.channels, -1)
    both = jnp.isfinite(image[:, 1:]) & jnp.isfinite(image[:, :-1])
    apart = jnp.abs(jnp.where(both, image[:, 1:] - image[:, :-1], 0.0))
    apart = apart > jnp.maximum(_UNRELATED, _SHARE * jnp.where(both, image[:, 1:] + image[:, :-1], 0.0))
    return repeated | (jnp.sum(apart) > _MOST_UNRELATED * jnp.sum(both))


def locate(world: World, flight: Flight, error: Float[Array, "3"], timestep: float) -> Failing:
    """Where the vehicle takes itself to be: dead reckoning, drawn to what the sensor says unless that cannot be.

        x̂' = v (1 + ε) + (said − x̂) / T    where |said − x̂| ≤ J, else v (1 + ε)

    Args:
        world, flight: now.
        error: of a sensor that works [m].
        timestep: since the last position [s].
    """
    vehicle, failing, mode = flight.vehicle, flight.fault_memory, _mode(world, flight, Target.POSE)
    exact = vehicle.position + error
    since = flight.log.duration - world.failures.onset
    fresh = (mode == Mode.NONE) | ((mode == Mode.SLOW) & (jnp.mod(since, _SLOW_POSE) < timestep))
    held = jnp.where(fresh, exact, failing.held)
    somewhere = jax.random.uniform(_step_key(world, flight, Target.POSE), (3,), minval=-_ANYWHERE, maxval=_ANYWHERE)
    aside = jnp.array([1.0, 0.0, 0.0]) * jnp.clip(_OFF_RATE * since, 0.0, _OFF)
    said = jnp.select(
        [mode == one for one in (Mode.NONE, Mode.STUCK, Mode.SLOW, Mode.GARBAGE, Mode.LATE, Mode.WRONG)],
        [exact, held, held, exact + somewhere, exact - _POSE_LAG * vehicle.velocity, exact + aside],
        jnp.nan,
    )
    reckoned = failing.position + (1.0 + _ODOMETER) * timestep * vehicle.velocity
    # NaN is not near either.
    believed = jnp.linalg.norm(said - reckoned) <= _JUMP
    taken = jnp.where(believed, (timestep / _TAKEN_OVER) * (said - reckoned), 0.0)
    return dataclasses.replace(failing, position=reckoned + taken, held=held)


def air(world: World, flight: Flight) -> Float[Array, "3"]:
    """Wind besides that of the disturbances [m/s]."""
    mode, since = _mode(world, flight, Target.WIND), flight.log.duration - world.failures.onset
    angle = 2.0 * math.pi * jax.random.uniform(stream(world.key, Stream.FAULTS))
    level = jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros(())])
    noise = _RANDOM_WIND * jax.random.normal(_step_key(world, flight, Target.WIND), (3,))
    growing = jnp.clip(since, 0.0, _MOST_WIND) * level
    found: Array = jnp.select(
        [mode == one for one in (Mode.STUCK, Mode.INTERMITTENT, Mode.GARBAGE, Mode.WRONG, Mode.SLOW)],
        [_SQUALL * level, _SQUALL * level, noise, jnp.array([0.0, 0.0, -_DOWN]), growing],
        jnp.zeros(3),
    )
    return found


def thrusts(
    world: World, flight: Flight, command: Float[Array, "4"], vehicle: Vehicle
) -> tuple[Float[Array, "4"], Failing]:
    """Thrusts that reach the motors [N], and the memory of the command."""
    mode, failing = _mode(world, flight, Target.MOTORS), flight.fault_memory
    spread = jax.random.uniform(_step_key(world, flight, Target.MOTORS), (4,), minval=-_SPREAD, maxval=_SPREAD)
    first = jnp.arange(4) == 0
    last = failing.commands[0]
    told = jnp.select(
        [mode == one for one in (Mode.OFF, Mode.STUCK, Mode.GARBAGE, Mode.LATE, Mode.INTERMITTENT, Mode.WRONG)],
        [
            jnp.where(first, 0.0, command),
            jnp.where(first, vehicle.hover, command),
            command * (1.0 + spread),
            failing.commands[STEPS_LATE - 1],
            jnp.where(first, 0.5 * command, command),
            _WEAK * command,
        ],
        command,
    )
    lazy = last + (command - last) * min(1.0, vehicle.timestep / _LAZY)
    kept = jnp.where(mode == Mode.SLOW, lazy, command)
    told = jnp.where(mode == Mode.SLOW, lazy, told)
    commands = jnp.concatenate([kept[None], failing.commands[:-1]])
    return told, dataclasses.replace(failing, commands=commands)


def answer_planner(
    world: World, flight: Flight, status: Int32[Array, ""], begins: Bool[Array, ""]
) -> tuple[Int32[Array, ""], Bool[Array, ""]]:
    """The status of what the planner answers, and whether that is flown a period later.

    Args:
        world, flight: now.
        status: of what it would answer.
        begins: whether the path of before begins where the vehicle is.
    """
    mode = _mode(world, flight, Target.PLANNER)
    silent = (mode == Mode.OFF) | (mode == Mode.INTERMITTENT)
    silent |= (mode == Mode.SLOW) & (flight.log.planning_iterations % _SLOW != 0)
    silent |= (mode == Mode.STUCK) & ~begins
    return jnp.where(silent, Status.TIMEOUT, status).astype(jnp.int32), mode == Mode.LATE


def tick_reference(world: World, flight: Flight, config: FlightConfig) -> Float[Array, ""]:
    """The time on the reference a time step later [s]."""
    mode, now, step = _mode(world, flight, Target.CLOCK), flight.reference_time, config.vehicle.timestep
    anywhere = jax.random.uniform(_step_key(world, flight, Target.CLOCK), maxval=config.period)
    stands = (mode == Mode.OFF) | (mode == Mode.STUCK) | (mode == Mode.INTERMITTENT)
    # Behind: it stands for so long at the beginning of each period.
    into = jnp.mod(flight.log.duration, config.period)
    stands |= (mode == Mode.LATE) & (into < _CLOCK_LAG)
    rate = jnp.select([stands, mode == Mode.WRONG, mode == Mode.SLOW], [0.0, _FAST, _SLOW_CLOCK], 1.0)
    return jnp.where(mode == Mode.GARBAGE, anywhere, now + rate * step)


def account(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """The stage that counts where the vehicle was not in sight of any voxel seen free, by its true positions."""
    rows = config.log_samples * (flight.log.planning_iterations - 1) + 1 + jnp.arange(config.log_samples)
    positions = flight.log.position[rows]
    local = positions - config.spacing * (flight.rolling_map.corner + jnp.asarray(config.shape) // 2)
    voxels = config.grid.index_of(jnp.where(jnp.isfinite(local), local, 0.0))
    seen = mapping.seen(flight.rolling_map)
    steps = jnp.stack(jnp.meshgrid(*[jnp.arange(-1, 2)] * 3, indexing="ij"), -1).reshape(-1, 3)
    around = jnp.clip(voxels[:, None] + steps, 0, jnp.asarray(config.shape) - 1)
    free = jnp.any(seen[around[..., 0], around[..., 1], around[..., 2]], axis=1)
    # What flew ended within the period has no position after that.
    unseen = jnp.sum(jnp.isfinite(positions[:, 0]) & ~free & ~flight.done, dtype=jnp.int32)
    log = dataclasses.replace(flight.log, unseen=flight.log.unseen_among_faults + unseen)
    return dataclasses.replace(flight, log=log)
