"""The clock that waits: its pace, its time, and vehicles that cannot keep up."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import maxjax
from maxjax import Follower

errors = st.floats(0.0, 1e6) | st.just(float("nan")) | st.just(float("inf"))
TOLERANCES = st.floats(0.1, 10.0)


@given(errors, TOLERANCES)
def test_the_pace_is_full_within_the_tolerance_and_none_at_twice(error: float, tolerance: float) -> None:
    pace = float(Follower(tolerance).pace(error))
    assert 0.0 <= pace <= 1.0
    if error <= tolerance:
        assert pace == 1.0
    if not error < 2.0 * tolerance:
        assert pace == 0.0


@given(errors, errors, TOLERANCES)
def test_who_is_further_behind_is_not_led_faster(a: float, b: float, tolerance: float) -> None:
    follower = Follower(tolerance)
    near, far = sorted((a, b)) if not np.isnan(a + b) else (0.0, float("nan"))
    assert float(follower.pace(far)) <= float(follower.pace(near))


@given(st.floats(0.0, 50.0), errors, st.floats(-10.0, 10.0))
def test_time_never_goes_back_nor_beyond_the_end(time: float, error: float, step: float) -> None:
    later = float(Follower().advance(time, error, step, 50.0))
    assert time <= later <= min(50.0, time + max(step, 0.0))


def test_it_is_time_itself_for_a_vehicle_that_keeps_up_and_ends_with_the_trajectory() -> None:
    def tick(time: jax.Array, error: jax.Array) -> tuple[jax.Array, jax.Array]:
        return Follower().advance(time, error, 0.05, 9.98), time

    late = jnp.abs(jnp.sin(jnp.arange(400.0)))  # up to the tolerance
    last, times = jax.jit(lambda: jax.lax.scan(tick, jnp.float32(0.0), late))()
    np.testing.assert_allclose(times, np.minimum(0.05 * np.arange(400), 9.98), atol=1e-4)
    assert last == np.float32(9.98)


def test_jax_and_numpy_agree_over_batches() -> None:
    far = np.linspace(0.0, 3.0, 31)
    inside = jax.vmap(Follower(1.2).pace)(jnp.asarray(far))
    np.testing.assert_allclose(inside, Follower(1.2).pace(far), atol=1e-6)


def test_velocity_and_acceleration_follow_the_chain_rule() -> None:
    """Against differences of x(s(t)) with s growing at a constant pace."""
    pace, s, h = 0.6, 1.3, 1e-4

    def x(t: float) -> np.ndarray:
        u = s + pace * t
        return np.array([np.sin(u), u**3, np.exp(-u)])

    rate, second = np.array([np.cos(s), 3 * s**2, -np.exp(-s)]), np.array([-np.sin(s), 6 * s, np.exp(-s)])
    velocity, acceleration = Follower().scale(rate, second, pace)
    np.testing.assert_allclose(velocity, (x(h) - x(-h)) / (2 * h), rtol=1e-6)
    np.testing.assert_allclose(acceleration, (x(h) - 2 * x(0.0) + x(-h)) / h**2, rtol=1e-5)


@pytest.mark.parametrize("speed", [1.0, 4.0, 8.0])
def test_a_vehicle_that_is_slower_than_its_way_is_never_left_behind(speed: float) -> None:
    """A set-point at 8 m/s, a vehicle of bounded speed that flies to it: behind by twice the tolerance at most."""
    follower, time, place, step = Follower(1.0), 0.0, 0.0, 0.02
    for _ in range(4000):
        lead = 8.0 * time - place
        assert lead <= 2.0 + 8.0 * step
        time = float(follower.advance(time, abs(lead), step, 10.0))
        place += step * min(speed, max(3.0 * (8.0 * time - place), 0.0))
        if time == 10.0:
            break
    assert time == 10.0


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan"), float("inf")])
def test_a_tolerance_is_a_positive_number(tolerance: float) -> None:
    with pytest.raises(ValueError, match="expected a positive number of metres"):
        maxjax.Follower(tolerance)
