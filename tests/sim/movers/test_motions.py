"""Motions against an integration in float64: where they lead, what they need, and what is left of them later."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from maxjax.sim.movers.motions import MotionPrimitive, MotionSet, at, duration, later, motion_to, motions, rest_at

CHOICE = MotionSet(speed=5.0, acceleration=6.0, jerk=30.0)


def drawn(seed: int) -> MotionPrimitive:
    """All motions from a state with some push, no larger than the greatest."""
    rng = np.random.default_rng(seed)
    place, velocity, push, towards = rng.normal(size=(4, 3)) * 2.0
    push *= min(1.0, CHOICE.acceleration / np.linalg.norm(push))
    state = (jnp.asarray(x, jnp.float32) for x in (place, velocity, push))
    present = motion_to(tuple(state), jnp.zeros(3), jnp.float32(0.0), CHOICE)  # type: ignore[arg-type]
    return motions(CHOICE, present, jnp.asarray(towards, jnp.float32))


def one_of(motion: MotionPrimitive, row: int) -> MotionPrimitive:
    one: MotionPrimitive = jax.tree.map(lambda x: x[row], motion)
    return one


STEP = 1e-3


def integrated(motion: MotionPrimitive) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, velocities and accelerations every `STEP`, of lines between the accelerations at their ends."""
    times = np.arange(0.0, 4.0, STEP)
    knots = np.concatenate([[0.0], np.cumsum(np.asarray(motion.lasts, float))])
    push = np.stack([np.interp(times, knots, np.asarray(motion.pushes[:, axis], float)) for axis in range(3)], -1)
    velocity = np.asarray(motion.velocity, float) + cumulative_trapezoid(push, dx=STEP, axis=0, initial=0.0)
    place = np.asarray(motion.place, float) + cumulative_trapezoid(velocity, dx=STEP, axis=0, initial=0.0)
    return place, velocity, push


def test_a_motion_is_where_its_accelerations_lead() -> None:
    tried = drawn(0)
    for row in range(0, len(tried.lasts), 23):
        one = one_of(tried, row)
        for step in (150, 300, 900, 1400, 2200):
            for found, expected in zip(at(one, jnp.float32(step * STEP)), integrated(one), strict=True):
                np.testing.assert_allclose(found, expected[step], atol=2e-3)


def test_a_motion_takes_up_its_target_and_goes_on_with_it_until_it_brakes() -> None:
    tried = drawn(4)
    whole = motions(
        dataclasses.replace(CHOICE, brakes=(3.0,), horizon=6.0), rest_at(jnp.zeros(3)), jnp.array([4.0, 3.0, 0.0])
    )
    for motion, brakes in ((tried, np.repeat(CHOICE.brakes, len(tried.target) // 2)), (whole, 3.0)):
        takes, until = jnp.sum(motion.lasts[:, :3], axis=1), jnp.sum(motion.lasts[:, :4], axis=1)
        rests = np.all(np.asarray(motion.target) == 0.0, axis=1)
        np.testing.assert_allclose(until[~rests], np.broadcast_to(brakes, rests.shape)[~rests], atol=1e-5)
        reached = ~rests & np.asarray(takes < until - 1e-4)
        if motion is whole:
            np.testing.assert_array_equal(reached, ~rests)
        for time in (takes, 0.5 * (takes + until), until):
            velocity = jax.vmap(lambda m, t: at(m, t)[1])(motion, time)
            np.testing.assert_allclose(velocity[reached], motion.target[reached], atol=2e-4)


def test_no_motion_needs_more_than_it_may_and_each_ends_at_rest() -> None:
    pushes, jerks = [], []
    times = np.linspace(0.0, 4.0, 801)
    for seed in range(1, 17):
        tried = drawn(seed)
        _, velocity, push = (np.asarray(x, float) for x in jax.vmap(at, (None, 0))(tried, jnp.asarray(times)))
        pushes.append(np.linalg.norm(push, axis=-1).max(axis=0))
        # Between two samples jerk is linear but for its jumps: its mean is no more than the greatest.
        jerks.append(np.linalg.norm(np.diff(push, axis=0), axis=-1).max(axis=0) / times[1])
        assert np.abs(velocity[-1]).max() < 1e-4
        ends = jax.vmap(lambda m, t: at(m, t)[1])(tried, duration(tried))
        assert np.abs(ends).max() < 1e-4
        before = jax.vmap(lambda m, t: at(m, t)[1])(tried, 0.8 * duration(tried))
        moving = np.linalg.norm(tried.target, axis=1) > 0.5
        assert (np.linalg.norm(before, axis=1)[moving] > 1e-3).all()
    assert np.max(pushes) <= CHOICE.acceleration * (1 + 1e-4)
    assert np.max(jerks) <= CHOICE.jerk * (1 + 1e-3)
    # And little of both is left unused.
    used = np.maximum(np.array(pushes) / CHOICE.acceleration, np.array(jerks) / CHOICE.jerk)
    assert np.median(used) > 0.9


def test_from_rest_no_speed_is_greater_than_the_target() -> None:
    tried = motions(CHOICE, rest_at(jnp.zeros(3)), jnp.array([5.0, 0.0, 0.0]))
    _, velocity, _ = jax.vmap(lambda t: at(tried, t))(jnp.linspace(0.0, 3.0, 601))
    assert np.linalg.norm(velocity, axis=-1).max() <= CHOICE.speed * (1 + 1e-5)
    level = jnp.zeros(3), jnp.array([5.0, 0.0, 0.0]), jnp.zeros(3)
    stop = motion_to(level, jnp.zeros(3), jnp.float32(0.0), CHOICE)
    assert float(duration(stop)) == pytest.approx(CHOICE.stopping, rel=1e-5)
    longest = motion_to(level, level[1], jnp.float32(max(CHOICE.brakes)), CHOICE)
    assert float(duration(longest)) == pytest.approx(CHOICE.lasts, rel=1e-5)


def test_what_is_left_of_a_motion_is_the_same_curve() -> None:
    tried = drawn(2)
    for passed in (0.0, 0.1, 0.2, 0.3, 0.7, 1.3, 2.1):
        rest = later(tried, jnp.float32(passed))
        np.testing.assert_allclose(duration(rest), jnp.maximum(duration(tried) - passed, 0.0), atol=1e-5)
        for time in (0.0, 0.15, 0.6, 1.9):
            whole, left = at(tried, jnp.float32(passed + time)), at(rest, jnp.float32(time))
            np.testing.assert_allclose(left[0], whole[0], atol=3e-4)
            np.testing.assert_allclose(left[1], whole[1], atol=1e-3)
            np.testing.assert_allclose(left[2], whole[2], atol=2e-2)


def test_a_motion_takes_the_place_of_another_without_a_jump() -> None:
    tried = drawn(3)
    present = one_of(later(tried, jnp.float32(0.1)), 5)
    after = motions(CHOICE, present, jnp.zeros(3))
    for before, now in zip(at(present, jnp.float32(0.0)), at(after, jnp.float32(0.0)), strict=True):
        np.testing.assert_allclose(now, np.broadcast_to(before, now.shape), atol=1e-5)


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
    with pytest.raises(ValueError, match=r"horizon: expected 1.53 s or more to come to rest, given 1.5"):
        MotionSet(horizon=1.5)
