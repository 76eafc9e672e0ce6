"""Faults: what is delivered is what the table says, what cannot be is refused, and nothing fails before its time."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import AStar
from maxjax.core.status import Status
from maxjax.planning.problem.distances import Distances
from maxjax.sim.faults.effects import Faults, account
from maxjax.sim.faults.modes import MEANINGLESS, Failing, Mode, Target, Unseen, none_yet
from maxjax.sim.loop.flight import STAGES, Flight, FlightConfig, World, take_off, watch
from maxjax.sim.loop.flight_state import estimated_position
from maxjax.sim.loop.follow import advance_time
from maxjax.sim.sensors.lidar import Lidar, Scan, scan
from maxjax.sim.vehicle.disturbances import Disturbances
from tests.scenes import wall_and_tower

LIDAR = Lidar(rays=4096, channels=64)
CONFIG = FlightConfig(
    planner=AStar(),  # it compiles nothing
    shape=(45, 45, 17),
    lidar=LIDAR,
    plans=40,
    distances=Distances(1.0, 4.0),
    stages=(*STAGES, account),
)
START, GOAL = jnp.array([-24.0, 1.0, 6.0]), jnp.array([14.0, -2.0, 8.0])


def world(*faults: Faults) -> World:
    return World(wall_and_tower(), START, GOAL, jax.random.key(5), Disturbances(), extensions=faults)


@jax.jit
def taken_off(one: World) -> Flight:
    return take_off(one, CONFIG)


@jax.jit
def delivered(one: World, flight: Flight, number: int) -> Flight:
    return one.extensions[0].deliver_scan(one, flight, CONFIG, jnp.int32(number))


def ready(target: Target, mode: Mode) -> tuple[Faults, World, Flight]:
    """A fault from the beginning, its world, and a flight that moves."""
    fault = Faults.of({target: mode}, onset=0.0)
    one = world(fault)
    flight = taken_off(one)
    vehicle = dataclasses.replace(flight.vehicle, velocity=jnp.array([4.0, 0.0, 0.0]))
    return fault, one, dataclasses.replace(flight, vehicle=vehicle)


@functools.cache
def honest() -> Scan:
    return scan(wall_and_tower(), LIDAR, START, jnp.eye(3), jax.random.key(1))


@functools.cache
def scans(mode: Mode) -> tuple[Scan, Failing]:
    _, one, flight = ready(Target.LIDAR, mode)
    after = delivered(one, dataclasses.replace(flight, scan=honest()), 1)
    return after.scan, after.part(Failing)


def test_a_sensor_that_works_delivers_what_it_measured() -> None:
    used, failing = scans(Mode.NONE)
    assert np.array_equal(used.hit, honest().hit)
    assert np.array_equal(used.distance, honest().distance)
    assert np.allclose(used.points, honest().points, atol=1e-4, equal_nan=True)
    assert np.array_equal(failing.ranges, honest().distance)


def test_ranges_that_are_too_long_are_so_along_their_beams() -> None:
    used, _ = scans(Mode.WRONG)
    hit = np.asarray(honest().hit)
    assert np.allclose(np.asarray(used.distance)[hit] - np.asarray(honest().distance)[hit], 0.5, atol=1e-4)
    beyond = np.asarray(used.points - START)[hit]
    assert np.allclose(np.linalg.norm(beyond, axis=1), np.asarray(used.distance)[hit], atol=1e-3)


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.GARBAGE, Mode.SLOW])
def test_of_no_scan_and_of_ranges_without_surfaces_nothing_is_used(mode: Mode) -> None:
    used, _ = scans(mode)
    assert not np.any(used.hit)
    assert np.all(np.isnan(used.points))


def test_a_scan_that_repeats_the_one_before_is_used_once() -> None:
    _, one, flight = ready(Target.LIDAR, Mode.STUCK)
    first = delivered(one, dataclasses.replace(flight, scan=honest()), 0)
    other = scan(wall_and_tower(), LIDAR, START + 1.0, jnp.eye(3), jax.random.key(2))
    second = delivered(one, dataclasses.replace(first, scan=other), 1)
    assert np.array_equal(first.scan.hit, honest().hit)
    assert not np.any(second.scan.hit)
    assert np.array_equal(second.part(Failing).ranges, first.part(Failing).ranges)


@jax.jit
def advanced(one: World, flight: Flight) -> tuple[Flight, jax.Array]:
    flight = one.extensions[0].advance(one, flight, CONFIG)
    return flight, estimated_position(one, flight, CONFIG)


@pytest.mark.parametrize(("mode", "off"), [(Mode.OFF, 0.01), (Mode.GARBAGE, 0.01), (Mode.STUCK, 1.1), (Mode.LATE, 1.1)])
def test_a_position_is_never_further_off_than_a_believable_jump(mode: Mode, off: float) -> None:
    """For two seconds at 4 m/s: dead reckoning errs by a hundredth of the way, what is believed by a metre at most."""
    _, one, flight = ready(Target.POSE, mode)
    assert CONFIG.vehicle.timestep == 0.01
    for k in range(200):
        vehicle = dataclasses.replace(flight.vehicle, position=START + jnp.array([0.04 * (k + 1), 0.0, 0.0]))
        log = dataclasses.replace(flight.log, duration=jnp.float32(0.01 * k))
        flight = dataclasses.replace(flight, vehicle=vehicle, log=log)
        flight, estimated = advanced(one, flight)
        error = np.linalg.norm(estimated - vehicle.position)
        assert float(error) <= off + 0.01 * 0.04 * (k + 1)


def test_commands_reach_late_motors_five_steps_later_and_weak_ones_in_part() -> None:
    commands = np.random.default_rng(0).uniform(1.0, 6.0, (12, 4)).astype(np.float32)
    for mode, expected in ((Mode.LATE, commands[:-5]), (Mode.WRONG, 0.85 * commands), (Mode.NONE, commands)):
        fault, one, flight = ready(Target.MOTORS, mode)
        told = []
        for command in commands:
            flight, got = fault.thrusts(one, flight, CONFIG, jnp.asarray(command))
            told.append(np.asarray(got))
        assert np.allclose(told[5:] if mode == Mode.LATE else told, expected, rtol=1e-6)


@jax.jit
def times(one: World, flight: Flight) -> jax.Array:
    """Of the reference, step by step."""
    step = CONFIG.vehicle.timestep

    def tick(flight: Flight, _: None) -> tuple[Flight, jax.Array]:
        told = one.extensions[0].clock(one, flight, CONFIG, flight.reference_time)
        now = advance_time(flight.reference_time, told, step)
        log = dataclasses.replace(flight.log, duration=flight.log.duration + step)
        return dataclasses.replace(flight, reference_time=now, log=log), now

    return jax.lax.scan(tick, flight, None, round(CONFIG.period / step))[1]


@pytest.mark.parametrize("mode", [mode for mode in Mode if (Target.CLOCK, mode) not in MEANINGLESS])
def test_whatever_the_clock_says_set_points_do_not_jump_nor_go_back(mode: Mode) -> None:
    one, step = world(Faults.of({Target.CLOCK: mode}, onset=0.0)), CONFIG.vehicle.timestep
    taken = np.diff(np.asarray(times(one, taken_off(one))), prepend=0.0)
    assert taken.min() >= 0.0
    assert taken.max() <= 1.5 * step + 1e-6
    # Clocks that go at all, however badly, let the vehicle fly.
    stands = mode in (Mode.OFF, Mode.STUCK, Mode.INTERMITTENT)
    assert stands or taken.sum() > 0.3 * CONFIG.period


def test_what_is_remembered_at_first_is_hovering_at_the_start() -> None:
    failing = none_yet(START, 7, CONFIG.vehicle)
    assert np.array_equal(failing.position, START)
    assert np.allclose(failing.commands, CONFIG.vehicle.hover)


@pytest.fixture(scope="module")
def flown() -> dict[str, Flight]:
    """Nothing fails; what may fail does not within the flight; a planner that stops answering after 4 s."""
    worlds = {
        "sound": world(Faults.of({}, onset=0.0)),
        "later": world(Faults.of(dict.fromkeys(Target, Mode.OFF), onset=1e3)),
        "silent": world(Faults.of({Target.PLANNER: Mode.OFF}, onset=4.0)),
        "slow": world(Faults.of({Target.PLANNER: Mode.SLOW}, onset=2.0)),
        "blind": world(Faults.of({Target.LIDAR: Mode.OFF, Target.POSE: Mode.OFF}, onset=4.0)),
    }
    return {name: list(watch(one, CONFIG))[-1] for name, one in worlds.items()}


@pytest.mark.parametrize("built", [True, pytest.param(False, marks=pytest.mark.nightly)], ids=["with faults", "as is"])
def test_before_its_time_a_fault_changes_next_to_nothing(flown: dict[str, Flight], built: bool) -> None:
    """Beside a flight in which none is set, and by night beside one that is built without any."""
    later = flown["later"].log
    sound = (flown["sound"] if built else list(watch(world(), dataclasses.replace(CONFIG, stages=None)))[-1]).log
    assert sound.status == later.status == Status.OK
    # But for what dead reckoning errs by.
    apart = np.linalg.norm(np.asarray(sound.position - later.position), axis=1)
    assert np.nanmax(apart[: int(10 * min(sound.duration, later.duration))]) < 0.5
    assert later.part(Unseen).samples == 0


@pytest.mark.parametrize(("name", "status"), [("silent", Status.TIMEOUT), ("blind", Status.OUT_OF_PLANS)])
def test_without_planner_or_senses_the_vehicle_stops_in_sight_of_what_it_saw(
    flown: dict[str, Flight], name: str, status: Status
) -> None:
    log = flown[name].log
    assert log.status == status
    assert np.isfinite(log.clearance)
    assert log.clearance > CONFIG.radius
    assert log.part(Unseen).samples == 0


def test_between_the_answers_of_a_slow_planner_the_vehicle_flies_on(flown: dict[str, Flight]) -> None:
    sound, slow = flown["sound"].log, flown["slow"].log
    assert slow.status == Status.OK
    assert slow.failed_plans >= slow.planning_iterations // 2
    assert slow.duration < 2.0 * sound.duration


def test_every_target_fails_in_some_way_that_means_something() -> None:
    for target in Target:
        assert sum((target, mode) not in MEANINGLESS for mode in Mode) >= 6
