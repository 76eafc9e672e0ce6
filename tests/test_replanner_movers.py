"""The loop on board among movers: what is seen, flown and flagged, whatever scans and poses come, without compiling."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Iterator
from inspect import unwrap as unwrapped  # without the run-time type checks of the tests, as users call it
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.common.compilations import compilations
from benchmarks.onboard_movers import SimulatedWorld, fly_cycles
from maxjax import Distances, Field, Grid, MoverSettings, Replanned, Replanner, SensorScan, Status, VoxelMap
from maxjax.sim.movers.lookout import ON_BOARD, clear_of_movers
from maxjax.sim.movers.motions import MotionSet
from maxjax.sim.movers.reachable_sets import Bounds, no_tracks, reachable
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.sensors.own_returns import Airframe
from maxjax.sim.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.populations import Population, population
from maxjax.sim.worlds.solids import upright_boxes
from tests.sim.movers.scenes import spheres

pytestmark = pytest.mark.large

GRID = Grid((37, 25, 13), 2.0, (-36.0, -24.0, 0.0))
DISTANCES = Distances(1.0, 4.0)
LIDAR = Lidar(channels=32, rays=32 * 256, max_range=60.0)
SETTINGS = MoverSettings(
    sight=dataclasses.replace(ON_BOARD, lidar=LIDAR, bounds=Bounds(4.0, 2.2), slots=6, detections=12, points=512),
    airframe=Airframe(0.4, ((-0.5, -0.5, -0.2), (0.5, 0.5, 0.2))),
)
START, GOAL = (-20.0, 0.0, 8.0), (20.0, 0.0, 8.0)
FAR = np.array([84_888.0, 447_500.0, 130.0])
HOUSES = upright_boxes(jnp.array([[0.0, 18.0, 12.0, 5.0, 0.0, 20.0, 0.0], [5.0, -18.0, 12.0, 5.0, 0.0, 16.0, 0.3]]))
CITY = concatenate([ground_plane(), HOUSES])


@pytest.fixture(scope="module")
def compiled() -> Replanner:
    made = Replanner(GRID, Field(focus=False), DISTANCES, movers=SETTINGS)
    made.warmup()
    return made


@pytest.fixture
def replanner(compiled: Replanner) -> Replanner:
    """One that has seen nothing."""
    compiled.warmup()
    return compiled


def nobody() -> Movers:
    """One that flies far below the ground."""
    return spheres(np.array([[0.0, 0.0, -50.0]]), np.zeros((1, 3)))


def crossing(speed: float = 3.0) -> Movers:
    """Across the view of a vehicle at the start, eight metres before it."""
    return spheres(np.array([[-12.0, -6.0, 8.0]]), np.array([[0.0, speed, 0.0]]))


def world_of(movers: Movers, geoms: Geoms = CITY) -> SimulatedWorld:
    return SimulatedWorld(geoms, movers, LIDAR)


def scan_of(world: SimulatedWorld, when: float, number: int, place: tuple[float, float, float] = START) -> SensorScan:
    return SensorScan(world.scan_at(np.array(place), when, number), np.array(place), np.eye(3), np.zeros(3), when)


def hover(replanner: Replanner, world: SimulatedWorld, times: np.ndarray) -> Iterator[tuple[float, Replanned]]:
    """Calls of a vehicle that is told to stay where it starts."""
    for number, when in enumerate(times):
        yield float(when), replanner.replan(scan_of(world, float(when), number), START, START, deadline=math.inf)


def after_all(replanner: Replanner, world: SimulatedWorld, times: np.ndarray) -> Replanned:
    """The last of these calls."""
    *_, (_, last) = hover(replanner, world, times)
    return last


# --- Calls as they should be. ---


def test_nothing_compiles_and_motions_lead_to_the_goal_past_movers_without_contact(replanner: Replanner) -> None:
    """Closed loop: by the exact distance to all solids, and by what each call hands out."""
    how = Population(5, 3.0, "encounters")
    movers = population(CITY, jnp.array(START), jnp.array(GOAL), jax.random.key(5), how=how)
    world, confirmed, before = world_of(movers), 0, None
    world.gap(np.tile(START, (10, 1)), np.zeros(10))
    world.scan_at(np.array(START), 0.0, 0)
    with compilations() as found:
        for number, cycle in enumerate(fly_cycles(replanner, world, START, GOAL, math.inf)):
            traffic = cycle.found.traffic
            assert traffic is not None
            assert cycle.gap > 0.5
            confirmed += int(traffic.confirmed.sum())
            assert (traffic.least <= traffic.greatest).all()
            assert traffic.returns.own == 0
            # A motion goes on where the one before is.
            if before is not None:
                here, there = (one.at(traffic.motion.begins) for one in (before, traffic.motion))
                np.testing.assert_allclose(there.positions, here.positions, atol=2e-3)
                np.testing.assert_allclose(there.velocities, here.velocities, atol=2e-3)
            before = traffic.motion
            assert number < 300
    assert found == []
    assert confirmed > 20


def test_set_points_are_one_curve_at_rest_in_the_end(replanner: Replanner) -> None:
    for _, cycle in zip(range(30), fly_cycles(replanner, world_of(nobody()), START, GOAL, math.inf), strict=False):
        traffic = cycle.found.traffic
    assert traffic is not None
    motion = traffic.motion
    assert motion.begins < motion.verified <= motion.ends + SETTINGS.choice.horizon
    times = np.linspace(motion.begins - 0.1, motion.ends + 0.5, 301)
    samples = motion.at(times)
    step = times[1] - times[0]
    speed = np.linalg.norm(samples.velocities, axis=1)
    assert speed.max() <= SETTINGS.choice.speed + 1e-3
    moved = 0.5 * (samples.velocities[1:] + samples.velocities[:-1]) * step
    np.testing.assert_allclose(np.diff(samples.positions, axis=0), moved, atol=2e-4)
    assert (speed[times > motion.ends + 1e-3] < 1e-3).all()
    with pytest.raises(ValueError, match="times: expected finite numbers"):
        motion.at(math.nan)


@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0, None])
def test_a_mover_is_in_its_box_at_any_rate_of_scans(replanner: Replanner, rate: float | None) -> None:
    """None: at times that jitter by a third of a period."""
    steps = np.full(35, 0.1) if rate is None else np.full(round(3.5 * rate), 1.0 / rate)
    if rate is None:
        steps *= np.random.default_rng(0).uniform(0.67, 1.33, len(steps))
    seen = 0
    for when, found in hover(replanner, world_of(crossing(2.0)), np.cumsum(steps)):
        traffic = found.traffic
        assert traffic is not None
        if not (traffic.confirmed & ~traffic.rests).any():
            continue
        assert traffic.confirmed.sum() == 1
        middle, row = np.array([-12.0, -6.0 + 2.0 * when, 8.0]), int(np.argmax(traffic.confirmed))
        assert (traffic.least[row] <= middle - 0.49).all()
        assert (traffic.greatest[row] >= middle + 0.49).all()
        assert np.linalg.norm(traffic.places[row] - middle) < 1.0
        assert not {"CLOCK", "POSE", "BLIND", "BOUND"} & traffic.flags
        seen += 1
    assert seen > 0.4 * len(steps)


@pytest.fixture(scope="module")
def far_away() -> Replanner:
    """Where coordinates are those of a map, and the ground lies 130 m above the sea."""
    x, y, z = (np.array(GRID.origin) + FAR).tolist()
    settings = dataclasses.replace(SETTINGS, ground=FAR[2])
    made = Replanner(Grid(GRID.shape, GRID.spacing, (x, y, z)), Field(focus=False), DISTANCES, movers=settings)
    made.warmup()
    return made


def test_far_from_zero_all_is_as_near_to_it(replanner: Replanner, far_away: Replanner) -> None:
    """With seconds since 1970, and a sensor that is turned by a column of its beams."""
    world, angle = world_of(crossing(1.0)), 2.0 * np.pi / LIDAR.columns
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    for number, when in enumerate(np.arange(0.0, 1.6, 0.1)):
        scan = scan_of(world, float(when), number)
        there = SensorScan(scan.returns @ turn, np.array(START) + FAR, turn, np.zeros(3), 1.7e9 + float(when))
        near = replanner.replan(scan, START, GOAL, deadline=math.inf)
        far = far_away.replan(there, np.array(START) + FAR, np.array(GOAL) + FAR, deadline=math.inf)
    assert near.traffic is not None
    assert far.traffic is not None
    assert near.traffic.confirmed.sum() == far.traffic.confirmed.sum() == 1
    np.testing.assert_allclose(far.traffic.places - FAR, near.traffic.places, atol=0.1)
    np.testing.assert_array_equal(np.asarray(far.map.ground), np.asarray(near.map.ground))
    assert np.asarray(near.map.ground)[:, :, 0].all()
    assert far.status == near.status == Status.OK


# --- What goes wrong. ---


def test_a_time_that_stands_still_or_runs_back_leaves_the_scan_out(replanner: Replanner) -> None:
    world = world_of(crossing())
    before = after_all(replanner, world, np.arange(1.0, 3.0, 0.1))
    assert before.traffic is not None
    for when in (2.9, 1.0, -5.0):
        found = replanner.replan(scan_of(world, when, 50), START, START, deadline=math.inf).traffic
        assert found is not None
        assert "CLOCK" in found.flags
        assert found.motion is before.traffic.motion
        np.testing.assert_array_equal(found.places, before.traffic.places)
    after = replanner.replan(scan_of(world, 3.0, 51), START, START, deadline=math.inf).traffic
    assert after is not None
    assert "CLOCK" not in after.flags
    late = replanner.replan(scan_of(world, 4.0, 52), START, START, deadline=math.inf).traffic
    assert late is not None
    assert "CLOCK" in late.flags


def test_what_cannot_be_a_scan_is_refused(replanner: Replanner) -> None:
    scan = scan_of(world_of(nobody()), 0.0, 0)
    for name, broken, sentence in (
        ("time", math.nan, r"SensorScan\.time: expected a finite number"),
        ("returns", np.zeros((4, 2)), r"SensorScan\.returns: expected numbers of shape \(n, 3\)"),
        ("returns", np.zeros(7), r"returns: expected points \(n, 3\) or 8192 distances"),
        ("rotation", np.zeros(3), r"SensorScan\.rotation: expected numbers of shape \(3, 3\)"),
    ):
        given = copy.copy(scan)
        object.__setattr__(given, name, broken)  # which the run-time checks of the tests would not let pass
        with pytest.raises(ValueError, match=sentence):
            unwrapped(Replanner.replan)(replanner, given, START, START)
    with pytest.raises(ValueError, match="start: expected where the vehicle is in the first call"):
        replanner.replan(scan, NAN, START)


NAN = np.full(3, np.nan)


@pytest.mark.parametrize(
    "broken",
    [{"position": NAN}, {"rotation": np.full((3, 3), np.nan)}, {"rotation": 2.0 * np.eye(3)}, {"velocity": NAN}],
)
def test_a_pose_that_is_none_is_flagged_and_tracks_go_on(replanner: Replanner, broken: dict[str, Any]) -> None:
    world = world_of(crossing(1.0))
    before = after_all(replanner, world, np.arange(0.0, 2.0, 0.1))
    scan = dataclasses.replace(scan_of(world, 2.0, 50), **broken)
    found = replanner.replan(scan, START, START, deadline=math.inf).traffic
    assert before.traffic is not None
    assert found is not None
    assert "POSE" in found.flags
    assert before.traffic.confirmed.sum() == found.confirmed.sum() == 1
    assert np.isfinite(found.motion.at(np.linspace(2.0, 4.0, 9)).positions).all()
    after = replanner.replan(scan_of(world, 2.1, 51), START, START, deadline=math.inf).traffic
    assert after is not None
    assert "POSE" not in after.flags
    assert after.confirmed.sum() == 1


def test_a_pose_that_jumps_is_flagged_for_a_second_and_makes_no_movers_of_walls(replanner: Replanner) -> None:
    world = world_of(nobody())
    for _, before in hover(replanner, world, np.arange(0.8, 2.0, 0.1)):
        assert before.traffic is not None
        assert not before.traffic.flags - {"TRAPPED"}
    ahead = np.array(START) + np.array([3.0, 0.0, 0.0])
    for number, when in enumerate(np.arange(2.0, 3.6, 0.1)):
        # The sensor is where it was; the pose says three metres further on.
        scan = dataclasses.replace(scan_of(world, when, 100 + number), position=ahead)
        found = replanner.replan(scan, ahead, ahead, deadline=math.inf).traffic
        assert found is not None
        assert ("POSE" in found.flags) == (when < 2.95)
        assert found.confirmed.sum() == 0
        assert "DRIFTED" in found.flags or number > 0


def test_a_scan_without_returns_is_blind_and_sets_grow(replanner: Replanner) -> None:
    world = world_of(crossing(1.0))
    before = after_all(replanner, world, np.arange(0.0, 2.0, 0.1))
    assert before.traffic is not None
    assert before.traffic.confirmed.sum() == 1
    empty = SensorScan(np.zeros((0, 3)), np.array(START), np.eye(3), np.zeros(3), 2.0)
    nothing = dataclasses.replace(empty, returns=np.full(LIDAR.rays, np.nan), time=2.1)
    size = before.traffic.greatest - before.traffic.least
    for scan in (empty, nothing):
        found = replanner.replan(scan, START, START, deadline=math.inf).traffic
        assert found is not None
        assert "BLIND" in found.flags
        assert found.confirmed.sum() == 1
        assert ((found.greatest - found.least) > size).all()
        size = found.greatest - found.least


def test_rotors_in_the_scan_are_no_movers_and_no_walls(replanner: Replanner) -> None:
    """They come and go, as blades do, in the box of the airframe."""
    world, rng = world_of(nobody()), np.random.default_rng(0)
    for number, when in enumerate(np.arange(0.0, 2.0, 0.1)):
        angle = rng.uniform(0.0, 2.0 * np.pi, 60)
        blades = np.stack([0.45 * np.cos(angle), 0.45 * np.sin(angle), rng.uniform(0.05, 0.15, 60)], axis=1)
        plain = scan_of(world, when, number)
        scan = dataclasses.replace(plain, returns=np.concatenate([blades, plain.returns]))
        found = replanner.replan(scan, START, GOAL, deadline=math.inf)
        assert found.traffic is not None
        assert found.traffic.returns.own == 60
        assert not found.traffic.confirmed.any()
        assert not {"NEAR", "BOUND", "CROWDED"} & found.traffic.flags
    assert found.status == Status.OK
    assert not np.asarray(found.map.occupied)[tuple(np.round((np.array(START) - GRID.origin) / 2.0).astype(int))]


def test_a_cloud_of_ten_times_the_points_with_nan_shows_the_same(replanner: Replanner) -> None:
    shown = []
    for many in (False, True):
        replanner.warmup()
        world, rng = world_of(crossing(1.0)), np.random.default_rng(0)
        for number, when in enumerate(np.arange(0.0, 2.0, 0.1)):
            scan = scan_of(world, when, number)
            if many:
                points = np.tile(scan.returns, (10, 1))
                points[rng.random(len(points)) < 0.1] = np.nan
                points = np.concatenate([points, scan.returns])
                scan = dataclasses.replace(scan, returns=rng.permutation(points))
            found = replanner.replan(scan, START, START, deadline=math.inf).traffic
        assert found is not None
        shown.append(found)
    plain, large = shown
    assert large.returns.missing > 0.09 * 10 * plain.returns.seen
    assert large.returns.seen == plain.returns.seen
    np.testing.assert_allclose(large.places, plain.places, atol=1e-4)
    np.testing.assert_allclose(large.greatest, plain.greatest, atol=1e-4)
    assert plain.confirmed.sum() == 1


def test_more_movers_than_slots_are_flagged(replanner: Replanner) -> None:
    angle = 2.0 * np.pi * np.arange(10) / 10
    places = np.array(START) + 7.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    velocity = 2.0 * np.stack([-np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)
    up: set[str] = set()
    for _, found in hover(replanner, world_of(spheres(places, velocity)), np.arange(0.0, 1.5, 0.1)):
        assert found.traffic is not None
        assert len(found.traffic.places) <= 6
        up |= found.traffic.flags
    assert "CROWDED" in up


def test_a_mover_that_rests_at_the_start_is_kept_away_from(replanner: Replanner) -> None:
    """It hangs a metre before the vehicle: no motion leads into it, and without a plan its status says why."""
    near = spheres(np.array([[-18.4, 0.0, 8.0]]), np.zeros((1, 3)))
    for _, found in hover(replanner, world_of(near), np.arange(0.0, 2.0, 0.1)):
        assert found.traffic is not None
        places = found.traffic.motion.at(np.linspace(0.0, 6.0, 30)).positions
        assert (np.linalg.norm(places - np.array([-18.4, 0.0, 8.0]), axis=1) > 0.5).all()
    assert found.status != Status.OK or found.plan is not None


# --- The map. ---


def test_what_was_surveyed_stays_and_what_scans_showed_is_forgotten(replanner: Replanner) -> None:
    surveyed = np.zeros(GRID.shape, bool)
    surveyed[26, 10:15, 1:6] = True
    known = VoxelMap.on(GRID, surveyed)
    something = spheres(np.array([[-8.0, 0.0, 8.0]]), np.zeros((1, 3)), 1.0)
    voxel = tuple(np.round((np.array([-8.0, 0.0, 8.0]) - GRID.origin) / 2.0).astype(int))
    for number, when in enumerate(np.arange(0.0, 3.5, 0.1)):
        world = world_of(something if when < 1.5 else nobody())
        found = replanner.replan(scan_of(world, when, number), START, GOAL, deadline=math.inf, known=known)
        occupied = np.asarray(found.map.occupied)
        assert occupied[surveyed].all()
        if 0.1 < when < 1.4:
            assert occupied[voxel]
    assert not occupied[voxel]
    with pytest.raises(ValueError, match="known: expected what was surveyed, given the map that was handed out"):
        replanner.replan(scan_of(world, 6.0, 99), START, GOAL, deadline=math.inf, known=found.map)


def test_the_map_moves_by_whole_voxels_and_keeps_what_it_has_seen(replanner: Replanner) -> None:
    world = world_of(nobody())
    before = after_all(replanner, world, np.arange(0.0, 1.2, 0.1))
    x, y, z = GRID.origin
    moved = Grid(GRID.shape, GRID.spacing, (x + 6.0, y, z))
    after = replanner.replan(scan_of(world, 1.2, 50), START, START, deadline=math.inf, known=moved)
    assert after.map.grid == moved
    np.testing.assert_array_equal(np.asarray(after.map.occupied)[:-3], np.asarray(before.map.occupied)[3:])
    aside = Grid(GRID.shape, GRID.spacing, (x + 1.0, y, z))
    with pytest.raises(ValueError, match=r"known: expected a grid whole voxels of 2 m from that of the replanner"):
        replanner.replan(scan_of(world, 1.3, 51), START, START, deadline=math.inf, known=aside)


def test_only_a_replanner_among_movers_takes_a_scan_with_its_pose(replanner: Replanner) -> None:
    with pytest.raises(ValueError, match="points: expected returns in the world frame of a Replanner without movers="):
        replanner.replan(np.zeros((1, 3)), START, GOAL)
    plain = Replanner(GRID, Field(focus=False), DISTANCES)
    plain._warm = True
    with pytest.raises(ValueError, match="and a SensorScan of one with it, given SensorScan"):
        plain.replan(scan_of(world_of(nobody()), 0.0, 0), START, GOAL)


# --- What is left of a plan. ---


@pytest.mark.parametrize("seed", range(4))
def test_a_way_is_clear_up_to_where_a_mover_may_be_when_the_vehicle_can_be_there(seed: int) -> None:
    """By brute force over times and speeds: whoever flies at most as fast meets no box before that length."""
    rng = np.random.default_rng(seed)
    choice = MotionSet()
    tracks = dataclasses.replace(
        no_tracks(3),
        low=jnp.asarray(rng.uniform(-8, 8, (3, 3)), jnp.float32),
        used=jnp.array([True, True, False]),
        half=jnp.full((3, 3), 0.5),
    )
    speed = jnp.asarray(rng.uniform(-2, 2, (3, 3)), jnp.float32)
    tracks = dataclasses.replace(tracks, high=tracks.low + 0.3, slowest=speed - 0.5, fastest=speed + 0.5)
    way = np.stack([np.linspace(-10, 22, 33), np.zeros(33), np.zeros(33)], axis=1)
    clear = float(clear_of_movers(jnp.asarray(way, jnp.float32), jnp.arange(33.0), tracks, rules=SETTINGS))
    times = np.linspace(0.0, choice.horizon, 221)
    least, greatest = (np.asarray(x) for x in reachable(tracks, jnp.asarray(times, jnp.float32), SETTINGS.bounds))
    first = math.inf
    for along in np.arange(0.0, 32.0, 0.05):
        place = np.array([-10.0 + along, 0.0, 0.0])
        outside = np.maximum(np.maximum(least - place, place - greatest), 0.0)
        apart = np.nanmin(np.linalg.norm(outside, axis=-1), axis=1)
        if (apart[times >= along / choice.speed] < SETTINGS.keeping.radius).any():
            first = along
            break
    assert clear <= first + 1e-6
    assert math.isinf(first) or clear > first - 3.0


def test_the_rest_of_a_plan_is_not_handed_out_into_a_mover(replanner: Replanner) -> None:
    """The mover comes across the way, too near to stop before it for who flies fast; for who hovers it is clear."""
    world, speeds = world_of(crossing(1.5)), (0.0, 5.0)
    handed = dict.fromkeys(speeds, 0)
    refused = dict.fromkeys(speeds, 0)
    for number, when in enumerate(np.arange(0.0, 4.0, 0.1)):
        scan = scan_of(world, float(when), number)
        fast = dataclasses.replace(scan, velocity=np.array([speeds[number % 2], 0.0, 0.0]))
        found = replanner.replan(fast, START, GOAL, deadline=math.inf)
        assert found.traffic is not None
        if found.plan is None:
            refused[speeds[number % 2]] += found.status == Status.OK
            assert math.isnan(found.traffic.clear)
        else:
            handed[speeds[number % 2]] += found.age > 0
            stopping = speeds[number % 2] * (SETTINGS.delay + 0.5 * speeds[number % 2] / SETTINGS.choice.acceleration)
            assert found.age == 0.0 or found.traffic.clear >= stopping
    assert refused[5.0] > 3
    assert refused[0.0] == 0
    assert handed[0.0] > 10


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: MoverSettings(drift=1.0), r"MoverSettings\.drift: expected less than the radius of 1\.0 m"),
        (lambda: MoverSettings(delay=-0.1), r"MoverSettings\.delay: expected a finite number, at least 0"),
        (lambda: MoverSettings(period=0.0), r"MoverSettings\.period: expected a finite number, above 0"),
        (lambda: MoverSettings(ground=math.nan), r"MoverSettings\.ground: expected a height"),
    ],
)
def test_settings_that_are_none_are_refused(make: object, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()  # type: ignore[operator]
