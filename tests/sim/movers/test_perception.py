"""A look at a scan: movers are found and held, what stands is not, and bad scans do no harm."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.movers.lidar_perception import sightings_of
from maxjax.sim.movers.perception import PerceptionState, initial_perception, process_scan
from maxjax.sim.movers.reachable_sets import reachable
from maxjax.sim.sensors.lidar import Scan, directions
from maxjax.sim.worlds.movers import Movers, Moving
from tests.sim.movers.scenes import CITY, LIDAR, SIGHT, arrays, fast_look, fast_scan, pose, spheres

# Two hundred looks: they run for longer than they compile.
pytestmark = pytest.mark.full_speed


def watched(movers: Movers | None, looks: int, speed: float = 0.0, key: int = 0) -> list[tuple[PerceptionState, Scan]]:
    """States and scans of a flight."""
    seeing, shown = initial_perception(SIGHT), []
    for k in range(looks):
        now = jnp.float32(0.1 * (k + 1))
        moving = None if movers is None else Moving(movers, now)
        result = fast_scan(CITY, LIDAR, pose(k, speed), jax.random.key(1000 * key + k), moving)
        seeing = fast_look(seeing, result, *pose(k, speed), now, SIGHT)
        shown.append((seeing, result))
    return shown


def confirmed(seeing: PerceptionState) -> np.ndarray:
    return np.flatnonzero(np.asarray(seeing.tracks.used & seeing.tracks.confirmed))


@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_where_nothing_moves_nothing_is_seen(speed: float) -> None:
    for seeing, _ in watched(None, 20, speed):
        assert not confirmed(seeing).size
        assert not np.asarray(seeing.moving).any()
        assert not seeing.overflow


def test_lost_beams_make_no_movers() -> None:
    """Three of ten returns are lost, thirty times as many as the sensor is said to lose."""
    lossy = dataclasses.replace(LIDAR, dropout=0.3)
    seeing = initial_perception(SIGHT)
    for k in range(30):
        result = fast_scan(CITY, lossy, pose(k, 5.0), jax.random.key(k))
        seeing = fast_look(seeing, result, *pose(k, 5.0), jnp.float32(0.1 * (k + 1)), SIGHT)
        assert not confirmed(seeing).size
        assert not np.asarray(seeing.moving).any()
        assert not seeing.overflow


PLACE = np.array([[9.0, -5.0, 4.0], [8.0, 6.0, 5.0]])
VELOCITY = np.array([[0.0, 3.0, 0.2], [-1.0, -2.5, 0.0]])


def test_movers_are_found_and_held_by_their_sets() -> None:
    shown = watched(spheres(PLACE, VELOCITY), 20, 1.0)
    for k, (seeing, result) in enumerate(shown):
        now = 0.1 * (k + 1)
        truth = PLACE + now * VELOCITY
        tracks = arrays(seeing.tracks)
        if k < 8:
            continue
        slots = confirmed(seeing)
        assert len(slots) == 2
        nearest = [int(np.argmin(np.linalg.norm(truth - tracks.place[s], axis=1))) for s in slots]
        assert sorted(nearest) == [0, 1]
        for s, j in zip(slots, nearest, strict=True):
            assert (tracks.low[s] - 1e-3 <= truth[j]).all()
            assert (truth[j] <= tracks.high[s] + 1e-3).all()
            assert (tracks.low[s] - tracks.half[s] <= truth[j] - 0.45).all()
            assert (tracks.high[s] + tracks.half[s] >= truth[j] + 0.45).all()
            assert (tracks.slowest[s] <= VELOCITY[j]).all()
            assert (VELOCITY[j] <= tracks.fastest[s]).all()
            assert np.linalg.norm(tracks.place[s] - truth[j]) < 0.4
            # Who moves at 2.5 m/s or more is not taken for one that may rest.
            assert k < 14 or not ((tracks.slowest[s] <= 0.0) & (tracks.fastest[s] >= 0.0))[1]
        assert not np.asarray(seeing.broken).any()
        # The mask has their returns, as truth tells them, and no others.
        moving, points = np.asarray(seeing.moving), np.asarray(result.points)
        ages = 0.1 * (1.0 - np.tile(np.arange(1, 257) / 256, 32))
        own = np.zeros(LIDAR.rays, bool)
        for j in range(2):
            middle = truth[j] - ages[:, None] * VELOCITY[j]
            own |= np.linalg.norm(points - middle, axis=1) < 0.6
        assert not (moving & ~own).any()
        assert (moving & own).sum() > 0.9 * own.sum()
    tracks = arrays(shown[-1][0].tracks)
    speeds = np.sort(tracks.velocity[confirmed(shown[-1][0])][:, 1])
    np.testing.assert_allclose(speeds, [-2.5, 3.0], atol=0.6)


def test_a_mover_that_is_confirmed_nearby_is_flagged_once() -> None:
    for away, times in ((12.0, 0), (6.0, 1)):
        movers = spheres(np.array([[away, -1.5, 4.0]]), np.array([[0.0, 1.5, 0.0]]))
        shown = watched(movers, 12)
        assert len(confirmed(shown[-1][0])) == 1
        assert sum(bool(seeing.near.any()) for seeing, _ in shown) == times


MOVES, RESTS, STARTS = 1.5, 4.5, 7.0


def stopped_and_went(time: float, out: np.ndarray, on: np.ndarray) -> np.ndarray:
    """How far a mover has come [m] that brakes at the bound until 1.5 s, rests until 4.5 s, and flees at the bound."""
    bound, top = SIGHT.bounds.acceleration, SIGHT.bounds.speed
    before, after = max(MOVES - time, 0.0), max(time - RESTS, 0.0)
    speeding = min(after, top / bound)
    return -0.5 * bound * before**2 * out + (0.5 * bound * speeding**2 + top * (after - speeding)) * on


@pytest.mark.parametrize(
    ("middle", "out", "on"),
    [
        ([8.0, 0.0, 4.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]),
        ([8.0, 0.0, 4.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]),
        ([14.54, 1.0, 4.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]),  # at a wall
        ([14.54, 1.0, 4.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]),
    ],
)
def test_what_has_stopped_is_held_by_its_set_when_it_starts_again(
    middle: list[float], out: list[float], on: list[float]
) -> None:
    """At rest for three seconds, of which it takes half to be called so, then away as fast as the bounds allow."""
    rest, way, flees = (np.array(x) for x in (middle, out, on))
    size, seeing, rested = 0.45, initial_perception(SIGHT), 0
    ahead = np.arange(0.0, 1.6, 0.05)
    reached = jax.jit(functools.partial(reachable, bounds=SIGHT.bounds))

    def truth(time: float) -> np.ndarray:
        return rest + stopped_and_went(time, way, flees)

    for k in range(round(10.0 * STARTS) - 15):
        now = 0.1 * (k + 1)
        speed = (truth(now) - truth(now - 0.02)) / 0.02  # at the middle of a scan the places differ by a millimetre
        movers = spheres((truth(now) - now * speed)[None], speed[None], size)
        result = fast_scan(CITY, LIDAR, pose(0, 0.0), jax.random.key(k), Moving(movers, jnp.float32(now)))
        seeing = fast_look(seeing, result, *pose(0, 0.0), jnp.float32(now), SIGHT)
        if k < 8:
            continue
        tracks = sightings_of(seeing).tracks
        least, greatest = (np.asarray(x) for x in reached(tracks, jnp.asarray(ahead, jnp.float32)))
        for step, later in enumerate(now + ahead):
            place = truth(later)
            held = (least[step] <= place - size + 2e-3) & (place + size - 2e-3 <= greatest[step])
            assert held.all(axis=1).any(), (now, later, place, least[step], greatest[step])
        assert not np.asarray(seeing.broken).any()
        rested += int(np.asarray(seeing.rests).sum())
        # The map has it as well: what a confirmed mover hides, it would not.
        assert not np.asarray(seeing.moving).any() or not np.asarray(seeing.rests).any()
    assert rested > 10


def test_what_was_taken_for_a_mover_but_never_moved_is_a_wall_again() -> None:
    """A thing that appears from nowhere, 8 m away, and stays: at first a mover, then none, and no track."""
    stays = spheres(np.array([[8.0, 0.0, 4.0]]), np.zeros((1, 3)))
    seeing, states = initial_perception(SIGHT), []
    for k in range(45):
        now = jnp.float32(0.1 * (k + 1))
        moving = Moving(stays, now) if k >= 6 else None
        result = fast_scan(CITY, LIDAR, pose(0, 0.0), jax.random.key(k), moving)
        seeing = fast_look(seeing, result, *pose(0, 0.0), now, SIGHT)
        states.append((len(confirmed(seeing)), int(seeing.moving.sum()), bool(seeing.rests.any())))
    assert max(count for count, _, _ in states) == 1
    assert max(count for _, count, _ in states) > 5
    assert any(rests for _, _, rests in states)
    assert not sightings_of(seeing).tracks.used.any()
    assert states[-1] == (0, 0, False)


def test_more_movers_than_slots_are_flagged() -> None:
    y = np.linspace(-9.0, 9.0, 8)
    movers = spheres(np.stack([np.full(8, 8.0), y, np.full(8, 4.0)], axis=1), np.tile([0.0, 0.0, 2.0], (8, 1)))
    assert any(bool(seeing.overflow) for seeing, _ in watched(movers, 9))
    few = spheres(PLACE, VELOCITY)
    assert not any(bool(seeing.overflow) for seeing, _ in watched(few, 9))


def test_bad_scans_and_poses_do_no_harm() -> None:
    """False returns, lost scans, poses that are not numbers, time that stands still: all finite, and it recovers."""
    rng, movers, seeing = np.random.default_rng(0), spheres(PLACE, VELOCITY), initial_perception(SIGHT)
    for k in range(24):
        now = jnp.float32(0.1 * (k + 1))
        where, turned = pose(k, 1.0)
        result = fast_scan(CITY, LIDAR, (where, turned), jax.random.key(k), Moving(movers, now))
        distance = np.array(result.distance)
        if k in (6, 7):
            burst = rng.choice(LIDAR.rays, 4000, replace=False)
            distance[burst] = rng.uniform(0.0, 12.0, 4000)
        if k == 9:
            distance[:] = np.inf
        if k == 11:
            where = where * jnp.nan
        if k == 12:
            now = jnp.float32(0.1 * k)
        hit = jnp.asarray(np.isfinite(distance))
        seeing = fast_look(seeing, Scan(result.points, jnp.asarray(distance), hit), where, turned, now, SIGHT)
        used = np.asarray(seeing.tracks.used)
        for name in ("low", "high", "slowest", "fastest", "half", "place", "velocity"):
            assert np.isfinite(np.asarray(getattr(seeing.tracks, name))[used]).all(), (k, name)
        assert np.isfinite(np.asarray(seeing.memory.background)).all()
    truth = PLACE + 2.4 * VELOCITY
    places = np.asarray(seeing.tracks.place)[confirmed(seeing)]
    assert all(np.linalg.norm(places - p, axis=1).min() < 0.5 for p in truth)


def test_a_batch_is_each_of_its_flights() -> None:
    movers = spheres(PLACE, VELOCITY)
    flights = [watched(None if i else movers, 6, 1.0) for i in range(2)]
    states = jax.tree.map(lambda *x: jnp.stack(x), *[flight[4][0] for flight in flights])
    scans = jax.tree.map(lambda *x: jnp.stack(x), *[flight[5][1] for flight in flights])
    where = tuple(jnp.stack([x, x]) for x in pose(5, 1.0))
    both = jax.jit(jax.vmap(process_scan, (0, 0, 0, 0, None, None)), static_argnums=5)(
        states, scans, *where, jnp.float32(0.6), SIGHT
    )
    for i, flight in enumerate(flights):
        one = flight[5][0]
        for a, b in zip(jax.tree.leaves(both), jax.tree.leaves(one), strict=True):
            np.testing.assert_allclose(np.asarray(a[i], float), np.asarray(b, float), atol=2e-3)


def test_another_sensor_is_refused() -> None:
    result = Scan(jnp.zeros((64, 3)), jnp.ones(64), jnp.ones(64, bool))
    with pytest.raises(ValueError, match=r"expected 8192 rays as in `sight.lidar`, given \(64,\)"):
        process_scan(initial_perception(SIGHT), result, *pose(0, 0.0), jnp.float32(0.1), SIGHT)
    assert directions(LIDAR).shape == (8192, 3)
