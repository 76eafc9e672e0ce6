"""Movers that pass each other: sets stay true while one measurement may be of either, or is of both."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.movers.ambiguity import is_ambiguous
from maxjax.sim.movers.body_marks import Marks
from maxjax.sim.movers.detection import Detections
from maxjax.sim.movers.reachable_sets import no_tracks
from maxjax.sim.movers.tracking import ExpectedView, initial_tracker_state, update_tracks
from tests.sim.movers.scenes import SIGHT, arrays

follow = jax.jit(update_tracks, static_argnames="sight")
NO, NONE = jnp.zeros(SIGHT.slots, bool), jnp.zeros(SIGHT.slots)
PLAIN = ExpectedView(~NO, NO, NONE)
# Half an edge of a cube [m].
HALF = 0.2


def seen_as(bodies: list[np.ndarray]) -> Detections:
    """One measurement each of boxes that hold bodies, given by their least and greatest corners, as of one body."""
    low, high = (np.array([body[k] for body in bodies]) for k in (0, 1))
    rest = SIGHT.detections - len(bodies)

    def filled(values: np.ndarray) -> jax.Array:
        return jnp.asarray(np.concatenate([values, np.zeros((rest, *values.shape[1:]))]), jnp.float32)

    middle, room = 0.5 * (low + high), 0.05
    marks = Marks(
        jnp.stack([filled(x - room) for x in (middle, low, high)]),
        jnp.stack([filled(x + room) for x in (middle, low, high)]),
    )
    count = len(bodies)
    return Detections(
        used=jnp.arange(SIGHT.detections) < count, marks=marks, half=filled(np.full((count, 3), 0.5)),
        large=jnp.zeros(SIGHT.detections, bool), place=filled(middle), variance=filled(np.full((count, 3), 0.01)),
        seen_low=filled(low), seen_high=filled(high), age=jnp.zeros(SIGHT.detections),
        count=filled(np.full(count, 9.0)),
    )  # fmt: skip


def cubes(place: np.ndarray) -> list[np.ndarray]:
    """The bodies as a sensor tells them apart: as one where they nearly touch."""
    bodies = [np.stack([one - HALF, one + HALF]) for one in place]
    if np.all(np.abs(place[0] - place[1]) < 2.0 * HALF + 0.1):
        return [np.stack([np.min(place, axis=0) - HALF, np.max(place, axis=0) + HALF])]
    return bodies


def passing(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two movers that meet after a second, near to each other, and their velocities."""
    speed = rng.uniform(2.0, 5.0, 2)
    angle = rng.uniform(0.5, np.pi) + np.array([0.0, rng.uniform(0.0, 0.3)])
    velocity = np.stack([speed * np.cos([0.0, angle[0]]), speed * np.sin([0.0, angle[0]]), [0.0, 0.0]], -1)
    meet = np.array([0.0, 0.0, 5.0]) + rng.uniform(-0.25, 0.25, (2, 3))
    return meet - velocity, velocity


def test_sets_hold_both_movers_while_they_pass_each_other_and_after() -> None:
    rng, merged = np.random.default_rng(0), 0
    for _ in range(12):
        place, velocity = passing(rng)
        state = initial_tracker_state(SIGHT)
        for k in range(21):
            bodies = cubes(place)
            merged += len(bodies) == 1
            state, found = follow(state, seen_as(bodies), PLAIN, jnp.float32(0.1 * k), sight=SIGHT)
            assert not np.asarray(found.broken).any(), k
            if k >= 2:
                tracks = arrays(state.tracks)
                for where, speed in zip(place, velocity, strict=True):
                    holds = tracks.used & np.all((tracks.low <= where + 1e-3) & (where - 1e-3 <= tracks.high), axis=1)
                    holds &= np.all((tracks.slowest <= speed + 1e-2) & (speed - 1e-2 <= tracks.fastest), axis=1)
                    assert holds.any(), k
            place = place + 0.1 * velocity
        tracks = arrays(state.tracks)
        used = tracks.used & tracks.confirmed
        assert used.sum() == 2
        # Apart again, they are known as well as before.
        assert (tracks.high - tracks.low)[used].max() < 0.3
    assert merged > 12


def test_a_mover_that_breaks_its_bound_is_flagged_and_may_have_any_velocity() -> None:
    """One of two, far from each other, jumps by 1 m."""
    place = np.array([[0.0, 0.0, 5.0], [30.0, 0.0, 5.0]])
    state = initial_tracker_state(SIGHT)
    for k in range(10):
        state, found = follow(state, seen_as(cubes(place)), PLAIN, jnp.float32(0.1 * k), sight=SIGHT)
        assert not np.asarray(found.broken).any()
    place[0, 0] += 1.0
    state, found = follow(state, seen_as(cubes(place)), PLAIN, jnp.float32(1.0), sight=SIGHT)
    after, broken = arrays(state.tracks), np.asarray(found.broken)
    assert broken.sum() == 1
    assert (after.fastest - after.slowest)[broken].min() == pytest.approx(2.0 * SIGHT.bounds.speed)


def test_a_set_that_has_grown_wide_takes_what_it_may() -> None:
    """Two that fly on side by side, seen as one, are not left to grow until they say nothing."""
    place, velocity = np.array([[0.0, 0.0, 5.0], [0.0, 1.2, 5.0]]), np.array([2.0, 0.0, 0.0])
    state = initial_tracker_state(SIGHT)
    widest = 0.0
    for k in range(60):
        beside = place if k < 10 else np.stack([place[0], place[0] + [0.0, 0.45, 0.0]])
        state, _ = follow(state, seen_as(cubes(beside)), PLAIN, jnp.float32(0.1 * k), sight=SIGHT)
        tracks = arrays(state.tracks)
        used = tracks.used & tracks.confirmed
        if k > 2:
            holds = used & np.all((tracks.low - 0.3 <= place[0]) & (place[0] <= tracks.high + 0.3), axis=1)
            assert holds.any(), k
            widest = max(widest, float((tracks.high - tracks.low)[used & (tracks.missed == 0)].max(initial=0.0)))
        place = place + 0.1 * velocity
    assert 1.0 < widest < 2.0 * SIGHT.lost


def test_nothing_is_ambiguous_of_one_mover() -> None:
    state = initial_tracker_state(SIGHT)
    place = np.array([0.0, 0.0, 5.0])
    for k in range(8):
        body = [np.stack([place - HALF, place + HALF])]
        state, _ = follow(state, seen_as(body), PLAIN, jnp.float32(0.1 * k), sight=SIGHT)
        place = place + np.array([0.3, 0.0, 0.0])
    tracks = arrays(state.tracks)
    assert tracks.used.sum() == 1
    assert (tracks.high - tracks.low)[tracks.used].max() < 0.2


def test_a_measurement_in_the_sets_of_two_is_learnt_by_neither() -> None:
    """Unless the other one is not confirmed, or the own set is wide."""
    none = jnp.full(3, -1)
    seen = seen_as([np.array([[-0.2, -0.2, 4.8], [0.2, 0.2, 5.2]])])
    flags = jnp.ones(3, bool)
    tracks = dataclasses.replace(no_tracks(3), used=flags, confirmed=flags, high=jnp.full((3, 3), 1.0))
    for held, expected in (((0,), False), ((0, 1), True), ((0, 2), True), ((0, 1, 2), True)):
        consistent = jnp.zeros((3, SIGHT.detections), bool).at[jnp.array(held), 0].set(True)
        found = is_ambiguous(tracks, seen, consistent, none.at[0].set(0), ~flags)
        assert np.asarray(found).tolist() == [expected, False, False], held
    both = jnp.zeros((3, SIGHT.detections), bool).at[:2, 0].set(True)
    tentative = dataclasses.replace(tracks, confirmed=flags.at[1].set(False))
    assert not np.asarray(is_ambiguous(tentative, seen, both, none.at[0].set(0), ~flags)).any()
    wide = dataclasses.replace(tracks, high=tracks.high.at[0, 1].set(3.5))
    assert not np.asarray(is_ambiguous(wide, seen, both, none.at[0].set(0), ~flags)).any()
