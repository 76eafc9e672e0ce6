"""Movers that nobody promised: a status, a flag or a graceful loss; never NaN, never a vehicle that stays where it is.

All flights have the same shapes, so that they share one program. Eight movers are recorded motions: any function of
time, in knots a quarter of a second apart.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from _pytest.mark import ParameterSet
from jax.tree_util import keystr, tree_flatten_with_path

from maxjax.core.status import Status
from maxjax.planning.problem.distances import Distances
from maxjax.sim.loop.flight import Flight, FlightConfig, World, watch
from maxjax.sim.loop.follow import follow
from maxjax.sim.loop.sensing import fuse, sense
from maxjax.sim.movers.among import AHEAD, Among, Flag, Flags, Sightings
from maxjax.sim.movers.avoidance import Avoidance, straight_way
from maxjax.sim.movers.lidar_perception import LidarPerception
from maxjax.sim.movers.local_value import Crowding
from maxjax.sim.movers.moments import moments_of
from maxjax.sim.movers.motions import MotionSet, at, duration
from maxjax.sim.movers.reachable_sets import Bounds, reachable
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import SPHERE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers, through
from maxjax.ui.methods import planner_named
from tests.sim.movers.scenes import box

pytestmark = pytest.mark.large

COUNT, SLOTS, RADIUS = 8, 6, 0.5
LIDAR = Lidar(channels=32, rays=4096, elevation_min=-30.0, elevation_max=30.0)
STEP, SECONDS = 0.25, 30.0
START, GOAL = np.array([-10.0, 0.0, 5.0]), np.array([10.0, 0.0, 5.0])
STREET = concatenate(
    [ground_plane(), box([0.0, 10.0, 5.0], [20.0, 2.0, 5.0]), box([0.0, -10.0, 5.0], [20.0, 2.0, 5.0])]
)
FAR = np.array([0.0, 0.0, -500.0])
HAUNTED = 100
"""Flights whose key is made of this number or more see false returns."""


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Haunted:
    """Perception of scans in which, for a second, a dozen blobs of returns are wherever chance puts them."""

    inner: LidarPerception

    def start(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        return self.inner.start(world, flight, config)

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        time, lidar, blobs = flight.log.duration, config.lidar, 12
        haunted = (jax.random.key_data(world.key)[-1] >= HAUNTED) & (time >= 0.5) & (time <= 1.5)
        keys = jax.random.split(jax.random.fold_in(world.key, jnp.round(10.0 * time).astype(jnp.int32)), 3)
        row = jax.random.randint(keys[0], (blobs,), 1, lidar.channels - 1)
        column = jax.random.randint(keys[1], (blobs,), 1, lidar.columns - 1)
        away = jax.random.uniform(keys[2], (blobs,), minval=1.5, maxval=15.0)
        i, j = np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij")
        ray = ((row[:, None] + i.ravel()) * lidar.columns + column[:, None] + j.ravel()).ravel()
        false = flight.scan.distance.at[ray].min(jnp.repeat(away, 9))
        scan = dataclasses.replace(flight.scan, distance=jnp.where(haunted, false, flight.scan.distance))
        return self.inner.look(world, dataclasses.replace(flight, scan=scan), config)


BOUNDS = Bounds(6.0, 2.2, 1.0, 0.0)
SIGHT = TrackingSettings(lidar=LIDAR, bounds=BOUNDS, slots=SLOTS, detections=12, points=512, pose_error=0.2)
HOW = Avoidance(
    Haunted(LidarPerception(SIGHT)), BOUNDS, MotionSet(directions=24), crowd=Crowding(shape=(16, 16, 7), sweeps=24)
)
CONFIG = FlightConfig(
    planner=planner_named("field"),
    lidar=LIDAR,
    shape=(41, 21, 13),
    plans=30,
    distances=Distances(1.0, 4.0),
    extensions=(HOW,),
    stages=(sense, fuse, straight_way, follow),
)
Way = Callable[[np.ndarray], np.ndarray]
"""Places (t, 3) at times (t,)."""


def rests(x: float, y: float, z: float) -> Way:
    return lambda t: np.tile([x, y, z], (len(t), 1))


def waits(x: float, y: float, z: float) -> Way:
    """At rest for three seconds, then it flies up."""
    return lambda t: np.stack([0.0 * t + x, 0.0 * t + y, z + 4.0 * np.maximum(t - 3.0, 0.0)], -1)


def passes(place: np.ndarray, velocity: np.ndarray, when: float) -> Way:
    """At constant velocity through a place at a time."""
    return lambda t: np.asarray(place) + (t - when)[:, None] * np.asarray(velocity)


def crowd(*ways: Way) -> Movers:
    times = STEP * np.arange(round(SECONDS / STEP) + 1)
    far = rests(*FAR)
    knots = np.stack([way(times) for way in (*ways, *[far] * (COUNT - len(ways)))])
    velocity = np.gradient(knots, STEP, axis=1)
    solids = Geoms(
        jnp.zeros((COUNT, 3)), jnp.broadcast_to(jnp.eye(3), (COUNT, 3, 3)), jnp.full((COUNT, 3), RADIUS),
        (SPHERE,) * COUNT,
    )  # fmt: skip
    knots, velocity = jnp.asarray(knots, jnp.float32), jnp.asarray(velocity, jnp.float32)
    return through(solids, knots, velocity, jnp.full(COUNT, STEP))


@functools.cache
def flown(name: str) -> list[Flight]:
    """The flight of a case before its first planning period and after each."""
    movers, disturbances, seed = CASES[name]
    air = Disturbances(*(jnp.float32(x) for x in dataclasses.astuple(disturbances)))
    ends = jnp.asarray(START, jnp.float32), jnp.asarray(GOAL, jnp.float32)
    return list(watch(World(STREET, *ends, jax.random.key(seed), air, movers), CONFIG))


def zigzag(x: float, speed: float, turns: float) -> Way:
    """Across the street, turning round at its borders without any time for it; after six seconds it flies up."""
    return lambda t: np.stack(
        [
            0.0 * t + x,
            5.0 * (2.0 * np.abs((speed * t / 10.0 + turns) % 2.0 - 1.0) - 1.0),
            5.0 + 5.0 * np.maximum(t - 6.0, 0.0),
        ],
        axis=-1,
    )


def ring(radius: float, until: float) -> list[Way]:
    """Around the start until a time, then away."""
    out = [np.array([np.cos(a), np.sin(a), 0.0]) for a in np.arange(SLOTS) * 2.0 * np.pi / SLOTS]
    return [lambda t, n=n: START + (radius + 4.0 * np.maximum(t - until, 0.0))[:, None] * n for n in out]


CALM = Disturbances()
CASES: dict[str, tuple[Movers, Disturbances, int]] = {
    "in the vehicle": (crowd(passes(START, [2.0, 0.0, 0.0], 0.0)), CALM, 1),
    "within the radius that is kept": (crowd(waits(-10.0, 1.2, 5.0), waits(-10.0, -1.2, 5.0)), CALM, 1),
    "around the vehicle": (crowd(*ring(2.5, 3.0)), CALM, 1),
    "through one another": (
        crowd(*(passes([0.0, 0.0, 5.0], [2.0 * np.cos(a), 4.0 * np.sin(a), 0.0], 2.0) for a in (1.5, 1.2, -1.2, -1.5))),
        CALM, 1,
    ),
    "through walls": (
        crowd(*(passes([x, 0.0, 5.0], [0.0, side * 4.0, 0.0], when)
                for x, side, when in ((-4.0, 1, 1.5), (0.0, -1, 2.5), (4.0, 1, 3.5), (7.0, -1, 4.0)))),
        CALM, 1,
    ),
    "away and back": (
        crowd(lambda t: np.stack([2.0 + 0.0 * t, 50.0 * np.abs(np.sin(t / 3.0)), 5.0 + 0.0 * t], -1),
              lambda t: np.stack([0.0 * t - 3.0, 0.0 * t, 5.0 + 50.0 * np.abs(np.cos(t / 3.0))], -1)),
        CALM, 1,
    ),
    "more than slots": (
        crowd(*(passes([x, y, 5.0], [0.0, 0.6 * y, 0.0], 0.0) for x in (-4.0, 0.0, 4.0, 8.0) for y in (-4.0, 4.0))),
        CALM, 1,
    ),
    "false returns": (crowd(passes([2.0, 0.0, 5.0], [0.0, 2.0, 0.0], 3.0)), CALM, HAUNTED),
    "drop-outs": (
        crowd(passes([-3.0, 0.0, 5.0], [0.0, 2.0, 0.0], 2.5), passes([3.0, 0.0, 5.0], [0.0, -2.0, 0.0], 4.0)),
        Disturbances(dropout=0.02, blackout=1.5), 2,
    ),
    "wind and drift": (
        crowd(passes([-3.0, 0.0, 5.0], [0.0, 2.0, 0.0], 2.5), passes([3.0, 0.0, 5.0], [0.0, -2.0, 0.0], 4.0)),
        Disturbances(wind=8.0, drift=1.0), 3,
    ),
    "turns at borders": (crowd(zigzag(-3.0, 4.0, 0.0), zigzag(1.0, 5.0, 0.7), zigzag(5.0, 3.0, 1.2)), CALM, 1),
}  # fmt: skip


def nan_in(flight: Flight) -> set[str]:
    """Names of arrays that hold NaN."""
    named = tree_flatten_with_path(flight)[0]
    floats = [(keystr(path), np.asarray(x)) for path, x in named if jnp.issubdtype(x.dtype, jnp.floating)]
    return {name for name, x in floats if np.isnan(x).any()}


NAN = {
    ".scan.points": "rays without a return",
    ".log.position": "after the end",
    ".log.margin": "no plan",
    ".parts[0].record.least": "nobody",
    ".parts[0].record.greatest": "nobody",
}
"""Where NaN says that there is nothing."""


# Flown by day; the others by night.
DAY = ("in the vehicle", "more than slots", "false returns")


def cases(*left_out: str) -> list[ParameterSet]:
    return [
        pytest.param(name, marks=() if name in DAY else pytest.mark.nightly) for name in CASES if name not in left_out
    ]


@pytest.mark.parametrize("name", cases())
def test_nothing_is_nan(name: str) -> None:
    flights = flown(name)
    assert set().union(*map(nan_in, flights)) <= set(NAN)
    finite = np.isfinite(np.asarray(flights[-1].log.position)).all(axis=1)
    count = int(finite.sum())
    assert finite[:count].all()
    assert 0.1 * (count - 1) == pytest.approx(float(flights[-1].log.duration), abs=0.11)
    for flight in flights:
        record = flight.part(Among).record
        np.testing.assert_array_equal(np.isnan(record.least), np.isnan(record.greatest))
        assert np.isfinite(flight.scan.points[flight.scan.hit]).all()


@pytest.mark.parametrize("name", cases("in the vehicle"))
def test_the_vehicle_moves_on_or_a_flag_was_up_before_the_contact(name: str) -> None:
    log = flown(name)[-1].log
    status = Status(int(log.status))
    if status == Status.IN_CONTACT:
        assert np.max(log.part(Flags).last) >= float(log.duration) - HOW.choice.horizon
    else:
        assert status == Status.OK  # it arrived: out of plans is who stays where he is


@pytest.mark.parametrize(
    ("name", "flag"),
    [
        pytest.param("around the vehicle", Flag.TRAPPED, marks=pytest.mark.nightly),
        ("more than slots", Flag.CROWDED),
        ("false returns", Flag.CROWDED),
        pytest.param("turns at borders", Flag.BOUND, marks=pytest.mark.nightly),
    ],
)
def test_what_does_not_hold_is_flagged(name: str, flag: Flag) -> None:
    flags = flown(name)[-1].log.part(Flags)
    assert float(flags.seconds[flag]) > 0.0


@pytest.mark.nightly  # by day errors of the position are those of sim/movers/test_flight_limits.py
def test_an_error_of_the_estimated_position_is_no_error_of_following() -> None:
    flags = flown("wind and drift")[-1].log.part(Flags)
    assert (
        float(flags.seconds[Flag.DRIFTED]) < 0.3
    )  # gusts; the estimate is off by up to a metre, and 0.4 m are allowed


def test_a_mover_in_the_vehicle_is_a_status_at_once() -> None:
    flights = flown("in the vehicle")
    assert len(flights) == 1
    assert Status(int(flights[0].log.status)) == Status.START_OCCUPIED
    assert moments_of(flights) == []


def test_slots_are_free_again_soon_after_false_returns() -> None:
    """They last until 1.5 s; what they left is given up in plain view, or when its set says nothing any more."""
    log = flown("false returns")[-1].log
    assert float(log.duration) > 4.0
    assert 0.5 < float(log.part(Flags).last[Flag.CROWDED]) < 3.5


def test_moments_tell_what_was_known_and_chosen() -> None:
    flights = flown("more than slots")
    moments, position = moments_of(flights), np.asarray(flights[-1].log.position)
    position = position[np.isfinite(position[:, 0])]
    assert len(moments) == len(position)
    times = HOW.choice.horizon * jnp.asarray(AHEAD)
    for number, flight in enumerate(flights[1:-1], 1):
        among = flight.part(Among)
        least, greatest = reachable(among.seen.tracks, times, BOUNDS)
        used = np.asarray(among.seen.tracks.used)
        shown = moments[10 * number].boxes
        np.testing.assert_allclose(shown, np.stack([least[:, used], greatest[:, used]], axis=2), atol=1e-4)
        end = at(among.flown.motion, duration(among.flown.motion))[0]
        np.testing.assert_allclose(moments[10 * number - 1].motion[-1], end, atol=1e-4)
    assert any(Flag.CROWDED in moment.flags for moment in moments)
    assert max(len(moment.boxes[0]) for moment in moments) > 1


def test_a_planning_period_leaves_types_as_they_are() -> None:
    """Else the programs of all stages would be compiled a second time."""
    first, *_, last = flown("more than slots")
    assert [x.aval for x in jax.tree.leaves(first)] == [x.aval for x in jax.tree.leaves(last)]
