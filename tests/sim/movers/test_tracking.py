"""Following: sets hold movers of any bounded motion, only shrink, and say when a bound is broken."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import linear_sum_assignment

from maxjax.sim.movers.assignment import assign
from maxjax.sim.movers.body_marks import Marks
from maxjax.sim.movers.detection import Detections
from maxjax.sim.movers.tracking import ExpectedView, initial_tracker_state, update_tracks
from tests.sim.movers.scenes import SIGHT, arrays

jit_followed = jax.jit(update_tracks)
NO, NONE = jnp.zeros(SIGHT.slots, bool), jnp.zeros(SIGHT.slots)
PLAIN = ExpectedView(~NO, NO, NONE)


def measured(rng: np.random.Generator, place: np.ndarray, age: np.ndarray) -> Detections:
    """Boxes of random sizes around middles, each seen `age` ago; unused: the rest."""
    count, rest = len(place), SIGHT.detections - len(place)
    low = place - rng.uniform(0.0, 0.5, (count, 3))
    high = place + rng.uniform(0.0, 0.5, (count, 3))

    def filled(values: np.ndarray) -> jax.Array:
        return jnp.asarray(np.concatenate([values, np.zeros((rest, *values.shape[1:]))]), jnp.float32)

    # Of cubes with edges of 0.4 m, their faces are known to 0.1 m, on one side or the other.
    side = rng.uniform(size=(count, 3)) < 0.5
    lowest, highest = place - 0.2, place + 0.2
    lows = (low, np.where(side, lowest - 0.05, lowest - 0.6), np.where(side, highest - 0.3, highest - 0.05))
    highs = (high, np.where(side, lowest + 0.05, lowest + 0.3), np.where(side, highest + 0.6, highest + 0.05))
    marks = Marks(*(jnp.stack([filled(x) for x in values]) for values in (lows, highs)))
    return Detections(
        used=jnp.arange(SIGHT.detections) < count, marks=marks, half=filled(np.full((count, 3), 0.5)),
        large=jnp.zeros(SIGHT.detections, bool), place=filled(0.5 * (low + high)),
        variance=filled(np.full((count, 3), 0.02)), seen_low=filled(place - 0.2), seen_high=filled(place + 0.2),
        age=filled(age), count=filled(np.full(count, 9.0)),
    )  # fmt: skip


def test_sets_hold_every_bounded_motion_and_lie_in_the_ones_before() -> None:
    rng, bounds = np.random.default_rng(0), SIGHT.bounds
    for _ in range(6):
        place = np.array([[0.0, 0.0, 5.0], [20.0, 0.0, 5.0], [0.0, 20.0, 5.0]])
        velocity = rng.uniform(-8.0, 8.0, (3, 3))
        state, push = initial_tracker_state(SIGHT), np.zeros((3, 3))
        for k in range(30):
            past = []
            for step in range(10):
                if (10 * k + step) % 25 == 0:
                    push = rng.choice([-1.0, 0.0, 1.0], (3, 3)) * bounds.acceleration
                after = np.clip(velocity + 0.01 * push, -bounds.speed, bounds.speed)
                place, velocity = place + 0.005 * (velocity + after), after
                past.append(place)
            back = rng.integers(0, 10, 3)
            shown = np.stack([past[9 - back[j]][j] for j in range(3)])
            seen = np.flatnonzero(rng.uniform(size=3) < 0.8)
            state, matches = jit_followed(
                state, measured(rng, shown[seen], 0.01 * back[seen]), PLAIN, jnp.float32(0.1 * (k + 1)), SIGHT
            )
            tracks = arrays(state.tracks)
            assert not np.asarray(matches.broken).any()
            for s in np.flatnonzero(tracks.used):
                j = np.argmin(np.linalg.norm(place - tracks.place[s], axis=1))
                assert (tracks.low[s] - 2e-3 <= place[j]).all()
                assert (place[j] <= tracks.high[s] + 2e-3).all()
                assert (tracks.slowest[s] - 1e-3 <= velocity[j]).all()
                assert (velocity[j] <= tracks.fastest[s] + 1e-3).all()
        assert tracks.used.sum() == 3
        # Velocities are known better than by their bound: of what is free to turn for half a second.
        assert ((tracks.fastest - tracks.slowest)[tracks.used] < 2.0 * bounds.speed - 4.0).all()


def test_a_broken_bound_is_flagged_and_the_set_begins_again() -> None:
    rng, place = np.random.default_rng(1), np.array([[5.0, 0.0, 5.0]])
    state = initial_tracker_state(SIGHT)
    for k in range(12):
        place = place + (0.3 if k < 8 else -0.3) * np.array([[0.0, 1.0, 0.0]])
        state, matches = jit_followed(
            state, measured(rng, place, np.zeros(1)), PLAIN, jnp.float32(0.1 * (k + 1)), SIGHT
        )
        held = np.asarray((state.tracks.low[0] <= place[0] + 1e-3) & (place[0] <= state.tracks.high[0] + 1e-3))
        flagged = bool(matches.broken.any())
        assert held.all()
        assert k >= 8 or not flagged
        if flagged:
            np.testing.assert_allclose(state.tracks.fastest[0], SIGHT.bounds.speed, atol=1e-5)
            return
    raise AssertionError("a mover that turns back at once broke no bound")


def test_a_body_that_grows_breaks_the_bound_and_one_that_is_seen_as_before_does_not() -> None:
    """Half edges of its box, at each look [m]: whatever may be in a larger one was in no set before."""
    rng, place = np.random.default_rng(4), np.array([[5.0, 0.0, 5.0], [0.0, 9.0, 5.0]])
    state = initial_tracker_state(SIGHT)
    for k, half in enumerate([0.5, 0.5, 0.5, 0.5, 0.8, 0.8, 0.5, 0.5]):
        seen = measured(rng, place, np.zeros(2))
        seen = dataclasses.replace(seen, half=seen.half.at[0, 2].set(half))
        state, matches = jit_followed(state, seen, PLAIN, jnp.float32(0.1 * (k + 1)), SIGHT)
        slot = int(np.flatnonzero(np.asarray(matches.of_track) == 0)[0])
        assert np.asarray(matches.broken).tolist() == [j == slot and k == 4 for j in range(SIGHT.slots)], k


def test_in_plain_view_a_track_fades_and_hidden_it_grows_until_it_says_nothing() -> None:
    rng, place = np.random.default_rng(2), np.array([[5.0, 0.0, 5.0]])
    start = initial_tracker_state(SIGHT)
    for k in range(5):
        start, _ = jit_followed(start, measured(rng, place, np.zeros(1)), PLAIN, jnp.float32(0.1 * k), SIGHT)
    assert bool(start.tracks.confirmed[0])
    given = (start, measured(rng, place, np.zeros(1)), PLAIN, jnp.float32(0.5), SIGHT)
    for a, b in zip(jax.tree.leaves(jit_followed(*given)), jax.tree.leaves(update_tracks(*given)), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)
    lives = {}
    for plain in (True, False):
        state, lives[plain] = start, 0
        while bool(state.tracks.used[0]) and lives[plain] < 60:
            lives[plain] += 1
            now = jnp.float32(0.4 + 0.1 * lives[plain])
            nothing = measured(rng, np.zeros((0, 3)), np.zeros(0))
            state, _ = jit_followed(state, nothing, ExpectedView(NO | plain, NO, NONE), now, SIGHT)
            assert not bool(state.tracks.used[0]) or float((state.tracks.high - state.tracks.low)[0].max()) <= 12.0
    assert lives[True] == SIGHT.misses
    assert SIGHT.misses < lives[False] < 60


def test_assignment_is_greedy_by_cost() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        cost = np.where(rng.uniform(size=(6, 8)) < 0.4, rng.uniform(size=(6, 8)), np.inf)
        left, expected = cost.copy(), np.full(6, -1)
        while np.isfinite(left).any():
            i, j = np.unravel_index(np.argmin(left), left.shape)
            expected[i] = j
            left[i], left[:, j] = np.inf, np.inf
        np.testing.assert_array_equal(assign(jnp.asarray(cost, jnp.float32)), expected)
    # Where pairs are clear, it is the cheapest assignment of all.
    cost = rng.uniform(5.0, 9.0, (5, 5))
    cost[np.arange(5), [2, 0, 1, 4, 3]] = rng.uniform(0.0, 1.0, 5)
    np.testing.assert_array_equal(assign(jnp.asarray(cost, jnp.float32)), linear_sum_assignment(cost)[1])
