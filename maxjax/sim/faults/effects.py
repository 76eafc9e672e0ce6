"""Faults of a flight, an extension: their effects, and the checks by which it refuses impossible data.

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
from maxjax.sim.faults.modes import STEPS_LATE, Failing, Mode, Target, Unseen, none_yet
from maxjax.sim.loop.flight_state import Answer, Extension, Flight, FlightConfig, World
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import Lidar, Scan
from maxjax.sim.vehicle.disturbances import position_error

# How late: scans, positions, the clock [s].
_SCAN_LAG, _POSE_LAG, _CLOCK_LAG = 0.3, 0.5, 0.3
# Every so many scans or plans; seconds between positions.
_SLOW, _SLOW_POSE = 3, 2.0
# Ranges are too long by [m]; positions off by at most, at this rate [m, m/s].
_TOO_LONG, _OFF, _OFF_RATE = 0.5, 1.5, 0.2
_ANYWHERE = 20.0
# A path of before begins where the vehicle is within [m].
_BEGINS = 0.1
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


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Faults(Extension):
    """Faults of a flight, and their onset; batch axes lead. A flight has the part `Failing`, its log the part `Unseen`.

    Attributes:
        modes: the `Mode` of each `Target`.
        onset: time since take-off [s].
    """

    modes: Int32[Array, "*batch 6"]
    onset: Float[Array, "*batch"]

    @classmethod
    def of(cls, modes: dict[Target, Mode], onset: float = 3.0) -> Faults:
        """Those of one flight: targets that are not named work."""
        return cls(jnp.array([modes.get(target, Mode.NONE) for target in Target], jnp.int32), jnp.float32(onset))

    def _mode(self, world: World, flight: Flight, target: Target) -> Int32[Array, ""]:
        """The mode of a target now; `NONE` in the good periods of one that fails from time to time."""
        mode = jnp.where(flight.log.duration >= self.onset, self.modes[target], Mode.NONE)
        bad = jax.random.bernoulli(_key(world, flight, target))
        return jnp.where((mode == Mode.INTERMITTENT) & ~bad, Mode.NONE, mode)

    def take_off(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """With a memory of nothing that failed."""
        failing = none_yet(flight.vehicle.position, config.lidar.rays, config.vehicle)
        log = flight.log.with_part(Unseen(jnp.int32(0)))
        return dataclasses.replace(flight, log=log).with_part(failing)

    def scan_origin(
        self, world: World, flight: Flight, config: FlightConfig, position: Float[Array, "3"]
    ) -> Float[Array, "3"]:
        """Where the scan that arrives now was taken [m]."""
        late = self._mode(world, flight, Target.LIDAR) == Mode.LATE
        return position - jnp.where(late, _SCAN_LAG, 0.0) * flight.vehicle.velocity

    def deliver_scan(self, world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
        """The flight with the usable part of the scan, after its fault and after the checks.

        Args:
            world: that the flight is in.
            flight: with the scan as it would be.
            config: static.
            number: of the scan.
        """
        scan, lidar, failing = flight.scan, config.lidar, flight.part(Failing)
        mode, before = self._mode(world, flight, Target.LIDAR), failing.ranges
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
        origin = self.scan_origin(world, flight, config, flight.vehicle.position)
        points = origin + (scan.points - origin) * stretch[:, None]
        used = Scan(jnp.where((hit & scan.hit)[:, None], points, jnp.nan), jnp.where(hit, ranges, jnp.inf), hit)
        return dataclasses.replace(flight, scan=used).with_part(dataclasses.replace(failing, ranges=ranges))

    def advance(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """With where the vehicle takes itself to be: dead reckoning, drawn to what the sensor says where that can be.

        x̂' = v (1 + ε) + (said − x̂) / T    where |said − x̂| ≤ J, else v (1 + ε)
        """
        vehicle, failing, mode = flight.vehicle, flight.part(Failing), self._mode(world, flight, Target.POSE)
        timestep = config.vehicle.timestep
        exact = vehicle.position + position_error(world.disturbances, world.key, flight.log.duration)
        since = flight.log.duration - self.onset
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
        return flight.with_part(dataclasses.replace(failing, position=reckoned + taken, held=held))

    def estimate(
        self, world: World, flight: Flight, config: FlightConfig, position: Float[Array, "3"]
    ) -> Float[Array, "3"]:
        """Where the vehicle takes itself to be [m]."""
        return flight.part(Failing).position

    def wind(self, world: World, flight: Flight, config: FlightConfig, wind: Float[Array, "3"]) -> Float[Array, "3"]:
        """The wind with that of the faults [m/s]."""
        mode, since = self._mode(world, flight, Target.WIND), flight.log.duration - self.onset
        angle = 2.0 * math.pi * jax.random.uniform(stream(world.key, Stream.FAULTS))
        level = jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros(())])
        noise = _RANDOM_WIND * jax.random.normal(_step_key(world, flight, Target.WIND), (3,))
        growing = jnp.clip(since, 0.0, _MOST_WIND) * level
        found: Array = jnp.select(
            [mode == one for one in (Mode.STUCK, Mode.INTERMITTENT, Mode.GARBAGE, Mode.WRONG, Mode.SLOW)],
            [_SQUALL * level, _SQUALL * level, noise, jnp.array([0.0, 0.0, -_DOWN]), growing],
            jnp.zeros(3),
        )
        return wind + found

    def thrusts(
        self, world: World, flight: Flight, config: FlightConfig, command: Float[Array, "4"]
    ) -> tuple[Flight, Float[Array, "4"]]:
        """The flight with the memory of the command, and the thrusts that reach the motors [N]."""
        mode, failing, vehicle = self._mode(world, flight, Target.MOTORS), flight.part(Failing), config.vehicle
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
        return flight.with_part(dataclasses.replace(failing, commands=commands)), told

    def answer(self, world: World, flight: Flight, config: FlightConfig, answer: Answer) -> Answer:
        """The planner's answer: none at times, the one of before, or a period late."""
        begins = jnp.linalg.norm(flight.pending_path[0] - answer.start) <= _BEGINS
        mode = self._mode(world, flight, Target.PLANNER)
        silent = (mode == Mode.OFF) | (mode == Mode.INTERMITTENT)
        silent |= (mode == Mode.SLOW) & (flight.log.planning_iterations % _SLOW != 0)
        silent |= (mode == Mode.STUCK) & ~begins
        status = jnp.where(silent, Status.TIMEOUT, answer.status).astype(jnp.int32)
        return dataclasses.replace(answer, status=status, late=answer.late | (mode == Mode.LATE))

    def clock(self, world: World, flight: Flight, config: FlightConfig, time: Float[Array, ""]) -> Float[Array, ""]:
        """The time on the reference a time step later, by a clock that may be wrong [s]."""
        mode, now, step = self._mode(world, flight, Target.CLOCK), flight.reference_time, config.vehicle.timestep
        anywhere = jax.random.uniform(_step_key(world, flight, Target.CLOCK), maxval=config.period)
        stands = (mode == Mode.OFF) | (mode == Mode.STUCK) | (mode == Mode.INTERMITTENT)
        # Behind: it stands for so long at the beginning of each period.
        into = jnp.mod(flight.log.duration, config.period)
        stands |= (mode == Mode.LATE) & (into < _CLOCK_LAG)
        rate = jnp.select([stands, mode == Mode.WRONG, mode == Mode.SLOW], [0.0, _FAST, _SLOW_CLOCK], 1.0)
        return jnp.where(mode == Mode.GARBAGE, anywhere, now + rate * step)


def _key(world: World, flight: Flight, target: Target) -> PRNGKeyArray:
    """A key of its own for each target and planning period."""
    return jax.random.fold_in(stream(world.key, Stream.FAULTS, flight.log.planning_iterations), int(target))


def _step_key(world: World, flight: Flight, target: Target) -> PRNGKeyArray:
    """A key of its own for each time step."""
    return jax.random.fold_in(_key(world, flight, target), jnp.round(1e3 * flight.log.duration).astype(jnp.int32))


def _refused(ranges: Float[Array, " r"], before: Float[Array, " r"], lidar: Lidar) -> Bool[Array, ""]:
    """Whether a scan is none: the one before once more, or ranges without any surface."""
    repeated = jnp.all(ranges == before) & jnp.any(jnp.isfinite(ranges))
    image = ranges.reshape(lidar.channels, -1)
    both = jnp.isfinite(image[:, 1:]) & jnp.isfinite(image[:, :-1])
    apart = jnp.abs(jnp.where(both, image[:, 1:] - image[:, :-1], 0.0))
    apart = apart > jnp.maximum(_UNRELATED, _SHARE * jnp.where(both, image[:, 1:] + image[:, :-1], 0.0))
    return repeated | (jnp.sum(apart) > _MOST_UNRELATED * jnp.sum(both))


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
    log = flight.log.with_part(Unseen(flight.log.part(Unseen).samples + unseen))
    return dataclasses.replace(flight, log=log)
