"""Motions against an integration in float64: where they lead, what they need, and what is left of them later."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.movers.motions import MotionPrimitive, MotionSet, at, duration, later, motions

CHOICE = MotionSet(speed=5.0, acceleration=3.0)


def drawn(seed: int) -> MotionPrimitive:
    rng = np.random.default_rng(seed)
    place, velocity, towards = (jnp.asarray(rng.normal(size=3) * 2.0, jnp.float32) for _ in range(3))
    return motions(CHOICE, place, velocity, towards)


def integrated(motion: MotionPrimitive, row: int, end: float, step: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    """Place and velocity of one motion at a time, by small steps of the law in the module's first lines."""
    place, velocity, target = (np.asarray(x[row], float) for x in (motion.place, motion.velocity, motion.target))
    a, brakes = float(motion.acceleration[row]), float(motion.brakes[row])
    for k in range(round(end / step)):
        aim = target if (k + 0.5) * step < brakes else np.zeros(3)
        change = aim - velocity
        size = np.linalg.norm(change)
        after = aim if size <= a * step else velocity + a * step * change / size
        place, velocity = place + 0.5 * step * (velocity + after), after
    return place, velocity


@pytest.mark.parametrize("end", [0.3, 0.9, 1.4, 2.2])
def test_a_motion_is_where_its_law_leads(end: float) -> None:
    tried = drawn(0)
    for row in range(0, len(tried.brakes), 23):
        place, velocity, _ = at(jax.tree.map(lambda x, row=row: x[row], tried), jnp.float32(end))
        expected = integrated(tried, row, end)
        np.testing.assert_allclose(place, expected[0], atol=5e-3)
        np.testing.assert_allclose(velocity, expected[1], atol=5e-3)


def test_no_motion_needs_more_than_it_may_and_each_ends_at_rest() -> None:
    tried = drawn(1)
    start = float(jnp.linalg.norm(tried.velocity[0]))
    times = np.linspace(0.0, CHOICE.horizon, 200)
    _, velocity, acceleration = jax.vmap(lambda t: at(tried, t))(jnp.asarray(times, jnp.float32))
    assert np.linalg.norm(acceleration, axis=-1).max() <= CHOICE.acceleration * (1 + 1e-5)
    assert np.linalg.norm(velocity, axis=-1).max() <= max(CHOICE.speed, start) * (1 + 1e-5)
    assert np.abs(velocity[-1]).max() < 1e-5
    ends = jax.vmap(lambda m, t: at(m, t)[1])(tried, duration(tried))
    assert np.abs(ends).max() < 1e-4
    just_before = jax.vmap(lambda m, t: at(m, t)[1])(tried, 0.9 * duration(tried))
    moving = np.linalg.norm(tried.target, axis=1) > 0.5
    assert (np.linalg.norm(just_before, axis=1)[moving] > 1e-3).all()


def test_what_is_left_of_a_motion_is_the_same_curve() -> None:
    tried = drawn(2)
    for passed in (0.0, 0.1, 0.3, 0.7, 1.3, 2.1):
        rest = later(tried, jnp.float32(passed))
        for time in (0.0, 0.15, 0.6, 1.9):
            whole, left = at(tried, jnp.float32(passed + time)), at(rest, jnp.float32(time))
            np.testing.assert_allclose(left[0], whole[0], atol=2e-4)
            np.testing.assert_allclose(left[1], whole[1], atol=2e-4)


def test_targets_are_spread_over_all_directions() -> None:
    targets = CHOICE.targets
    assert len(targets) == 1 + len(CHOICE.shares) * CHOICE.directions
    unit = targets[1 : 1 + CHOICE.directions] / CHOICE.speed
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1.0, atol=1e-12)
    # Every direction has a target within 22 degrees.
    rng = np.random.default_rng(0)
    asked = rng.normal(size=(2000, 3))
    asked /= np.linalg.norm(asked, axis=1, keepdims=True)
    assert (asked @ unit.T).max(axis=1).min() > np.cos(np.deg2rad(22.0))


def test_a_horizon_too_short_to_come_to_rest_is_refused() -> None:
    with pytest.raises(ValueError, match=r"horizon: expected 2.17 s or more to come to rest, given 2.0"):
        MotionSet(horizon=2.0)
