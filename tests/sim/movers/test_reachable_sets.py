"""Sets of movers: what keeps the bounds stays inside, sets only shrink, and the bounds are reached."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.movers.reachable_sets import Bounds, Tracks, likely_sets, no_tracks, propagate, reachable

BOUNDS = Bounds(speed=3.0, acceleration=2.0, size=1.0)


def drawn(rng: np.random.Generator, count: int) -> tuple[Tracks, np.ndarray, np.ndarray]:
    """Sets, and a mover inside each."""
    low, slowest = rng.uniform(-5.0, 5.0, (count, 3)), rng.uniform(-3.0, 2.0, (count, 3))
    high, fastest = low + rng.uniform(0.0, 2.0, (count, 3)), np.minimum(slowest + rng.uniform(0, 2, (count, 3)), 3.0)
    place, velocity = rng.uniform(low, high), rng.uniform(slowest, fastest)
    given = {"low": low, "high": high, "slowest": slowest, "fastest": fastest, "half": np.full((count, 3), 0.4)}
    used = jnp.ones(count, bool)
    tracks = dataclasses.replace(no_tracks(count), **{k: jnp.asarray(v) for k, v in given.items()}, used=used)
    return tracks, place, velocity


def flown(rng: np.random.Generator, place: np.ndarray, velocity: np.ndarray, seconds: float) -> list[np.ndarray]:
    """Places 0.01 s apart of a mover that accelerates as it likes within the bounds, in float64."""
    step, places = 0.01, [place]
    push = np.zeros_like(place)
    for k in range(round(seconds / step)):
        if k % 40 == 0:
            push = rng.choice([-1.0, 0.0, 1.0], place.shape) * BOUNDS.acceleration
        after = np.clip(velocity + step * push, -BOUNDS.speed, BOUNDS.speed)
        place, velocity = place + 0.5 * step * (velocity + after), after
        places.append(place)
    return places


def test_movers_that_keep_the_bounds_stay_in_their_sets() -> None:
    rng = np.random.default_rng(0)
    tracks, place, velocity = drawn(rng, 200)
    times = np.arange(0.0, 3.01, 0.1)
    least, greatest = (np.asarray(x) for x in reachable(tracks, jnp.asarray(times), BOUNDS))
    half = np.asarray(tracks.half)
    for _ in range(5):
        truth = np.stack(flown(rng, place, velocity, 3.0))[::10]
        assert (truth - half >= least - 1e-4).all()
        assert (truth + half <= greatest + 1e-4).all()


def test_what_rests_stays_and_what_moves_goes_on() -> None:
    """The likeliest place between measurements: along the measured velocity, and nowhere for a mover at rest."""
    tracks, place, velocity = drawn(np.random.default_rng(2), 20)
    rests = np.arange(20) % 2 == 0
    given = {"place": place, "velocity": velocity, "rests": rests}
    tracks = dataclasses.replace(tracks, **{k: jnp.asarray(v) for k, v in given.items()})
    later = np.asarray(propagate(tracks, 0.7, BOUNDS).place)
    np.testing.assert_allclose(later, place + 0.7 * velocity * ~rests[:, None], atol=1e-5)


def test_the_bound_is_reached() -> None:
    """The set is no larger than what its fastest member reaches, pushed all the time."""
    rng = np.random.default_rng(1)
    tracks, _, _ = drawn(rng, 50)
    place, velocity = np.asarray(tracks.high, float), np.asarray(tracks.fastest, float)
    step = 1e-3
    for _ in range(2000):
        after = np.minimum(velocity + step * BOUNDS.acceleration, BOUNDS.speed)
        place, velocity = place + 0.5 * step * (velocity + after), after
    _, greatest = reachable(tracks, jnp.array([2.0]), BOUNDS)
    np.testing.assert_allclose(greatest[0], place + np.asarray(tracks.half), atol=1e-3)


def test_later_sets_of_later_tracks_are_the_same_and_of_smaller_ones_smaller() -> None:
    tracks, _, _ = drawn(np.random.default_rng(2), 50)
    at_once = reachable(tracks, jnp.array([1.0, 2.5]), BOUNDS)
    by_steps = reachable(propagate(propagate(tracks, 0.4, BOUNDS), 0.6, BOUNDS), jnp.array([0.0, 1.5]), BOUNDS)
    for a, b in zip(at_once, by_steps, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4)
    middle = 0.5 * (tracks.low + tracks.high)
    smaller = dataclasses.replace(tracks, low=middle, high=tracks.high, slowest=tracks.fastest)
    inside = reachable(smaller, jnp.array([1.0, 2.5]), BOUNDS)
    assert (inside[0] >= at_once[0] - 1e-5).all()
    assert (inside[1] <= at_once[1] + 1e-5).all()


def test_likely_sets_reach_two_deviations_from_the_estimate_and_never_beyond_the_sets() -> None:
    wide, one = jnp.full((1, 3), 5.0), jnp.ones((1, 3))
    estimates = {"place": jnp.array([[0.0, 4.5, 9.0]]), "place_deviation": one, "velocity_deviation": 0.5 * one}
    tracks = dataclasses.replace(no_tracks(1), low=-wide, high=wide, slowest=-wide, fastest=wide, **estimates)
    likely = likely_sets(tracks)
    np.testing.assert_allclose(likely.low, [[-2.0, 2.5, 3.0]])  # an estimate beyond the set counts as its face
    np.testing.assert_allclose(likely.high, [[2.0, 5.0, 5.0]])
    np.testing.assert_allclose((likely.slowest, likely.fastest), ([[-1.0] * 3], [[1.0] * 3]))


def test_nobody_is_nowhere() -> None:
    least, greatest = reachable(no_tracks(4), jnp.array([0.0, 1.0]), BOUNDS)
    assert np.isnan(least).all()
    assert np.isnan(greatest).all()


def test_bounds_are_positive() -> None:
    with pytest.raises(ValueError, match=r"Bounds.acceleration: expected a positive finite number, given 0.0"):
        Bounds(acceleration=0.0)
    with pytest.raises(ValueError, match=r"Bounds.size: expected a positive finite number, given \(1.0, 0.0, 2.0\)"):
        Bounds(size=(1.0, 0.0, 2.0))
    with pytest.raises(ValueError, match=r"Bounds.turn: expected a finite number, at least 0, given -0.1"):
        Bounds(turn=-0.1)
    assert Bounds(size=0.5).edges.tolist() == [0.5, 0.5, 0.5]
    assert Bounds(size=(1.0, 2.0, 4.0)).edges.tolist() == [1.0, 2.0, 4.0]
