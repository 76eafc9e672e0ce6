"""Flags and their times, what a record of a look says, and what a vehicle takes from its map and scan to steer."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.planners import Field
from maxjax.sim.loop.flight import take_off
from maxjax.sim.loop.flight_state import Flight, FlightConfig, World
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.among import AHEAD, Flag, Sightings, flags_of_look, no_flags, no_sightings, raise_flags
from maxjax.sim.movers.avoidance import Avoidance, guide_around, hard_around, straight_way
from maxjax.sim.movers.choice import MotionScores, last_resort
from maxjax.sim.movers.hard_set import gaps
from maxjax.sim.movers.known_surroundings import Knowledge, way_around
from maxjax.sim.movers.local_value import cost_to_go
from maxjax.sim.movers.reachable_sets import no_tracks
from maxjax.sim.sensors.lidar import Lidar, Scan
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import ground_plane

START = np.array([0.0, 0.0, 9.0])


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Blind:
    """Perception that never sees a mover."""

    def start(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        return no_sightings(config.lidar.rays)

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        return no_sightings(config.lidar.rays)


CONFIG = FlightConfig(
    planner=Field(),
    extensions=(Avoidance(Blind()),),
    lidar=Lidar(channels=4, rays=64, reports_misses=True),
    shape=(9, 9, 9),
    plans=3,
)


@functools.cache
def hovering() -> tuple[World, Flight]:
    """Nine metres above open ground."""
    start, goal = jnp.asarray(START, jnp.float32), jnp.array([12.0, 0.0, 9.0])
    world = World(ground_plane(), start, goal, jax.random.key(0), Disturbances())
    return world, jax.jit(take_off, static_argnums=1)(world, CONFIG)


def test_every_flag_has_its_place() -> None:
    assert list(Flag) == list(range(len(Flag)))
    assert len(no_flags().seconds) == len(no_flags().last) == len(Flag)


@pytest.mark.parametrize("up", [[], [Flag.NEAR], [Flag.TRAPPED, Flag.CROWDED], list(Flag)])
def test_times_of_flags_add_up(up: list[Flag]) -> None:
    raised = jnp.zeros(len(Flag), bool).at[jnp.array(up, int)].set(True)
    flags = no_flags()
    for k in range(3):
        flags = raise_flags(flags, raised, jnp.float32(10.0 + k), 0.1)
    for flag in Flag:
        assert float(flags.seconds[flag]) == pytest.approx(0.3 * (flag in up))
        assert float(flags.last[flag]) == (12.0 if flag in up else -np.inf)
    assert float(flags.any_seconds) == pytest.approx(0.3 * bool(up))


def test_a_record_tells_of_thirds_of_the_horizon() -> None:
    np.testing.assert_allclose(AHEAD, np.linspace(0.0, 1.0, 4))


def test_what_the_last_scan_met_is_blocked_in_its_voxel_alone() -> None:
    """Points anywhere in a voxel block that one; points beside the box, on one axis or more, block none of it."""
    _, flight = hovering()
    origin, spacing = np.asarray(mapping.origin(flight.rolling_map)), CONFIG.spacing
    rng = np.random.default_rng(0)
    index = np.array([6, 4, 5]) + np.zeros((40, 1), int)
    inside = origin + spacing * (index + rng.uniform(-0.49, 0.49, (40, 3)))
    beside = inside[:24] + 400.0 * np.eye(3)[np.arange(24) % 3] * np.where(np.arange(24) < 12, 1.0, -1.0)[:, None]
    for points, blocked in ((inside, True), (beside, False)):
        hits = np.arange(64) < len(points)
        padded = jnp.asarray(np.concatenate([points, np.full((64 - len(points), 3), np.nan)]), jnp.float32)
        scan = Scan(padded, jnp.where(hits, 5.0, jnp.inf), jnp.asarray(hits))
        hard, _ = hard_around(dataclasses.replace(flight, scan=scan), CONFIG, jnp.asarray(START, jnp.float32))
        centres = np.asarray(hard.origin) + spacing * np.stack(
            np.meshgrid(*map(np.arange, hard.seen.shape), indexing="ij"), -1
        ).reshape(-1, 3)
        in_map = (np.abs(centres - origin - spacing * 4) < spacing * 4.5).all(axis=-1) & (centres[:, 2] > 1.0)
        met = in_map & (np.asarray(gaps(hard, jnp.asarray(centres, jnp.float32))) == 0.0)
        expected = blocked & (np.linalg.norm(centres - origin - spacing * index[0], axis=-1) < 0.5)
        np.testing.assert_array_equal(met, expected)


def test_where_nothing_is_verified_hope_counts_by_the_second() -> None:
    """Each pair differs in one score; the weights are those that the docstring states, on both sides of each."""

    def better(**pairs: tuple[float | bool, float | bool]) -> bool:
        """Whether the first of two motions is flown."""
        both = {"verified": (False, False), "free": (0.5, 0.5), "hopeful": (1.0, 1.0), "allowed": (True, True)}
        both |= {
            "nearer": (0.0, 0.0),
            "cost": (20.0, 20.0),
            "margin": (0.3, 0.3),
            "near": (False, False),
            "promised": (2.2, 2.2),
        } | pairs
        return int(jnp.argmax(last_resort(MotionScores(**{k: jnp.array(v) for k, v in both.items()})))) == 0

    assert better(allowed=(True, False), hopeful=(0.1, 2.0))
    assert better(allowed=(False, False), nearer=(0.1, 0.2), hopeful=(0.1, 2.0))
    assert better(hopeful=(2.4, 2.1), cost=(90.0, 20.0))
    assert better(hopeful=(2.4, 2.4), cost=(19.0, 20.0), margin=(0.1, 0.9))
    for name, difference, seconds in (("margin", 0.4, 0.2), ("free", 0.5, 0.1), ("cost", -40.0, 0.8)):
        start = {"margin": 0.3, "free": 0.5, "cost": 60.0}[name]
        for off, first in ((-0.02, True), (0.02, False)):
            assert better(**{name: (start + difference, start)}, hopeful=(1.0, 1.0 + seconds + off)) is first, name
    assert not better(margin=(1.5, 1.1), hopeful=(1.0, 1.01))


def test_a_broken_bound_is_flagged_where_nothing_is_verified_against_it() -> None:
    no, yes = jnp.array(False), jnp.array(True)
    every = jnp.ones(len(Flag), bool)
    for trapped in (no, yes):
        up = np.asarray(flags_of_look(every, no, trapped, no))
        assert up[Flag.BOUND] == up[Flag.TRAPPED] == bool(trapped)
        assert not up[Flag.DRIFTED]
        assert up[[Flag.NEAR, Flag.CROWDED]].all()
    none = jnp.zeros(len(Flag), bool)
    assert np.flatnonzero(np.asarray(flags_of_look(none, yes, no, yes))).tolist() == [Flag.NEAR, Flag.DRIFTED]


def test_the_way_leads_through_a_passage_that_the_static_way_takes() -> None:
    """A passage of two voxels by two under a wall: the cost-to-go falls into it, not up the wall and down again."""
    shape = (41, 41, 21)
    empty = mapping.empty(jnp.array([0.0, 0.0, 20.0]), shape, 2.0)
    low = np.asarray(mapping.origin(empty))
    x, y, z = np.meshgrid(*(low[k] + 2.0 * np.arange(n) for k, n in enumerate(shape)), indexing="ij")
    blocked = (x > 7.0) & ~((np.abs(y - 1.0) < 2.0) & (z > 1.0) & (z < 5.0))
    way = np.stack([np.linspace(-20.0, 40.0, 121), np.full(121, 1.0), np.full(121, 3.0)], -1)
    known = Knowledge(
        empty, jnp.asarray(blocked | (z < 1.0)), None, jnp.asarray(way, jnp.float32),
        jnp.asarray(40.0 - way[:, 0], jnp.float32), 0.5,
    )  # fmt: skip
    for height in (3.0, 7.0, 11.0):
        place = np.array([4.0, 1.0, height])
        guide = way_around(known, jnp.asarray(place, jnp.float32), no_tracks(1), CONFIG.extension(Avoidance))
        for _ in range(30):
            steps = place + np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
            steps = steps[steps[:, 2] >= 2.0]  # above the ground
            value = np.asarray(cost_to_go(guide, jnp.asarray(steps, jnp.float32)))
            place = steps[value.argmin()] if place[0] < 14.0 else place
        assert place[0] > 12.0, height
        assert 1.0 <= place[2] <= 5.0


def test_no_way_leads_beyond_the_map() -> None:
    """The window of the cost-to-go, 48 m wide, reaches beyond a map of 18 m, of which nothing is known."""
    _, flight = hovering()
    guide = guide_around(flight, CONFIG, jnp.asarray(START, jnp.float32), no_tracks(1))
    origin, spacing = np.asarray(guide.origin), guide.spacing
    centres = origin + spacing * np.stack(np.meshgrid(*map(np.arange, guide.value.shape), indexing="ij"), -1)
    apart = np.abs(centres - np.asarray(mapping.origin(flight.rolling_map)) - CONFIG.spacing * 4)
    beyond = (apart > CONFIG.spacing * 4.5).any(axis=-1)
    assert (np.asarray(guide.value)[beyond] >= 1e4).all()
    assert (np.asarray(guide.value)[~beyond & (centres[..., 2] > 3.0)] < 1e3).all()


def test_a_straight_way_is_a_plan() -> None:
    world, flight = hovering()
    after = straight_way(world, flight, CONFIG)
    assert int(after.log.planning_iterations) == int(flight.log.planning_iterations) + 1
    np.testing.assert_allclose(np.asarray(after.path)[[0, -1]], np.asarray([world.start, world.goal]), atol=1e-5)
