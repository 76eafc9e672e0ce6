"""Closed loop: hover, steps, corners, wind; saturation; a NaN stays within its trial."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from jax import lax
from jaxtyping import Array
from scipy.spatial.transform import Rotation

from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle.controller import Controller, Observer, mix
from maxjax.sim.vehicle.quadrotor import Gusts, State, Vehicle, advance, gust, hover
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Sampling, Setpoint, profile, sample, setpoint_at

VEHICLE = Vehicle()
CONTROLLER = Controller()
LIMITS, SAMPLING = FlightLimits(speed=5.0, acceleration=3.0, deviation=0.3), Sampling(samples=160)
DT = VEHICLE.timestep
# Two seconds to find the wind, then the flight.
SETTLE, STEPS = 200, 1600
POINTS = 8
PATHS = {
    "hover": [[0, 0, 10]],
    "corners": [[0, 0, 10], [12, 0, 10], [12, 12, 10], [20, 12, 10]],
    "climb": [[0, 0, 5], [8, 0, 5], [8, 0, 25]],
    "city": [[0, 0, 5], [9, 1, 6], [13, 8, 8], [13, 18, 12], [17, 20, 15]],
}
HOVER, CORNERS, CLIMB, CITY = range(4)


def padded(points: list[list[float]]) -> np.ndarray:
    return np.asarray(points + [points[-1]] * (POINTS - len(points)), np.float32)


def fly(
    path: Array, state: State, wind: Array, noise: Array, jump: Array, spin: Array
) -> tuple[State, Observer, Setpoint]:
    """Follow a path from a state in wind with gusts.

    `jump` is added to the positions asked for after half the time, `spin` to the heading once a second.
    """
    course = sample(path, LIMITS, SAMPLING)
    reference = profile(course, jnp.full(SAMPLING.samples, LIMITS.speed), jnp.float32(0.0), LIMITS)
    times = DT * (jnp.arange(STEPS, dtype=jnp.float32) - SETTLE)
    setpoints = jax.vmap(lambda t: setpoint_at(reference, t, 0.0, CONTROLLER.lead))(times)
    shift = jnp.where(jnp.arange(STEPS)[:, None] >= STEPS // 2, jump, 0.0)
    yaw = spin * jnp.floor(times)
    setpoints = Setpoint(setpoints.position + shift, setpoints.velocity, setpoints.acceleration, yaw)
    gusts = Gusts()

    def turn(
        carry: tuple[State, Observer, Array], now: tuple[Setpoint, Array]
    ) -> tuple[tuple[State, Observer, Array], tuple[State, Observer]]:
        state, observer, g = carry
        setpoint, n = now
        g = gust(gusts, g, n, DT)
        new, command = control.command(CONTROLLER, VEHICLE, observer, state, setpoint)
        return (advance(VEHICLE, state, command, wind + g), new, g), (state, observer)

    start = (state, control.init(state), jnp.zeros(3))
    _, (states, memories) = lax.scan(turn, start, (setpoints, noise))
    return states, memories, setpoints


flights = jax.jit(jax.vmap(fly))

# path, wind [m/s], gusts, jump [m], initial attitude (roll, pitch) [rad]
CASES: list[tuple[str, list[float], bool, list[float], tuple[float, float]]] = [
    ("hover", [0, 0, 0], False, [0, 0, 0], (0, 0)),
    ("hover", [0, 0, 0], False, [2, -1, 0.5], (0, 0)),
    ("hover", [8, -6, 0], False, [0, 0, 0], (0, 0)),
    ("hover", [0, 0, 0], False, [300, 0, 0], (0, 0)),
    ("hover", [0, 0, 0], False, [0, 0, 0], (2.0, 0.8)),
    ("corners", [0, 0, 0], False, [0, 0, 0], (0, 0)),
    ("climb", [0, 0, 0], False, [0, 0, 0], (0, 0)),
    ("city", [0, 0, 0], False, [0, 0, 0], (0, 0)),
    ("city", [0, 0, 0], False, [0, 0, 0], (0, 0)),  # with a spin
    *[(p, wind, True, [0, 0, 0], (0, 0)) for p in ("corners", "climb", "city") for wind in ([10, 0, 0], [-6, 8, 0])],
]  # fmt: skip


SPIN = 8


def inputs() -> tuple[np.ndarray, State, Array, Array, Array, Array]:
    path = np.stack([padded(PATHS[c[0]]) for c in CASES])
    state = hover(VEHICLE, jnp.asarray(path[:, 0]))
    turned = Rotation.from_euler("xy", [c[4] for c in CASES]).as_quat(scalar_first=True)
    state = State(state.position, jnp.asarray(turned, jnp.float32), state.velocity, state.rate, state.thrust)
    blows = jnp.asarray([float(c[2]) for c in CASES])[:, None, None]
    noise = blows * jax.random.normal(jax.random.key(3), (len(CASES), STEPS, 3))
    return (
        path,
        state,
        jnp.asarray([c[1] for c in CASES], jnp.float32),
        noise,
        jnp.asarray([c[3] for c in CASES], jnp.float32),
        jnp.zeros(len(CASES)).at[SPIN].set(np.pi / 2),
    )


@pytest.fixture(scope="module")
def flown() -> tuple[State, Observer, Setpoint]:
    result: tuple[State, Observer, Setpoint] = flights(*inputs())
    return result


def off_path(points: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distance of points to a polyline, in float64."""
    points, a, b = points.astype(float), path[:-1].astype(float), path[1:].astype(float)
    edge = b - a
    along = np.clip(((points[:, None] - a) * edge).sum(-1) / np.maximum((edge**2).sum(1), 1e-30), 0.0, 1.0)
    return np.linalg.norm(points[:, None] - (a + along[..., None] * edge), axis=-1).min(1)


def tilt(state: State) -> np.ndarray:
    return np.rad2deg(np.arccos(np.clip(np.asarray(state.rotation)[..., 2, 2], -1.0, 1.0)))


def test_hover_holds(flown: tuple[State, Observer, Setpoint]) -> None:
    np.testing.assert_allclose(flown[0].position[0], np.tile([0, 0, 10.0], (STEPS, 1)), atol=1e-3)


def test_step_response_settles_with_little_overshoot(flown: tuple[State, Observer, Setpoint]) -> None:
    moved = np.asarray(flown[0].position[1])[STEPS // 2 :] - [0, 0, 10.0]
    share = moved / np.array([2.0, -1.0, 0.5])
    assert share.max() < 1.15
    assert share.min() > -0.02
    # Both poles at ω: 5 % after 4.7 / ω = 1.9 s, and the lag of the attitude.
    np.testing.assert_allclose(share[int(2.5 / DT) :], 1.0, atol=0.05)


def test_steady_wind_is_found_and_withstood(flown: tuple[State, Observer, Setpoint]) -> None:
    state, observer, _ = flown
    np.testing.assert_allclose(
        np.asarray(state.position[2])[SETTLE + 300 :], np.tile([0, 0, 10.0], (1100, 1)), atol=0.01
    )
    # At rest thrust, weight and what the observer found balance.
    thrust = float(state.thrust[2, -1].sum()) / VEHICLE.mass * np.asarray(state.rotation)[2, -1, :, 2]
    np.testing.assert_allclose(thrust - [0, 0, 9.81] + np.asarray(observer.disturbance)[2, -1], 0.0, atol=0.02)
    assert np.linalg.norm(observer.disturbance[2, -1]) > 1.0


def test_tilt_is_limited_and_height_kept_on_the_way(flown: tuple[State, Observer, Setpoint]) -> None:
    state = jax.tree.map(lambda a: a[3], flown[0])
    assert 20.0 < tilt(state).max() < CONTROLLER.tilt + 3.0
    assert np.abs(np.asarray(state.position)[:, 2] - 10.0).max() < 0.5
    # A position 300 m away is approached at the speed that errors may ask for, but for an overshoot.
    assert np.linalg.norm(state.velocity, axis=1).max() < 1.15 * CONTROLLER.approach


def test_recovers_from_beyond_the_horizontal(flown: tuple[State, Observer, Setpoint]) -> None:
    state = jax.tree.map(lambda a: a[4], flown[0])
    assert tilt(state)[0] > 90.0
    assert tilt(state)[200:].max() < 30.0
    np.testing.assert_allclose(state.position[-1], [0, 0, 10.0], atol=0.02)


def test_corners_and_climbs_are_tracked_in_still_air_and_in_gusts(flown: tuple[State, Observer, Setpoint]) -> None:
    states, _, setpoints = flown
    for k in range(5, len(CASES)):
        path = padded(PATHS[CASES[k][0]])
        position = np.asarray(states.position[k])[SETTLE:]
        error = np.linalg.norm(position - np.asarray(setpoints.position[k])[SETTLE:], axis=1).max()
        bound, cross = (0.5, 0.5) if CASES[k][2] else (0.2, 0.3)
        assert error < bound, CASES[k]
        # Rounding included.
        assert off_path(position, path).max() < cross + 0.01, CASES[k]
        np.testing.assert_allclose(position[-1], path[-1], atol=0.2)
        assert np.all((np.asarray(states.thrust[k]) >= 0.0) & (np.asarray(states.thrust[k]) <= VEHICLE.thrust))


def test_nan_stays_within_its_trial(flown: tuple[State, Observer, Setpoint]) -> None:
    path, state, wind, noise, jump, spin = inputs()
    spoilt = flights(path, state, wind.at[5, 0].set(jnp.nan), noise.at[0, 700].set(jnp.nan), jump, spin)
    assert np.all(np.isnan(spoilt[0].position[5, -1]))
    assert np.all(np.isnan(spoilt[0].position[0, -1]))
    for a, b in zip(jax.tree.leaves(spoilt), jax.tree.leaves(flown), strict=True):
        assert np.array_equal(np.delete(a, [0, 5], 0), np.delete(b, [0, 5], 0))


def test_batch_equals_loop(flown: tuple[State, Observer, Setpoint]) -> None:
    states, memories, setpoints = flown
    single = jax.jit(control.command, static_argnums=(0, 1))
    many = jax.jit(jax.vmap(control.command, (None, None, 0, 0, 0)), static_argnums=(0, 1))
    at = [(4, 10), (5, 900), (9, 1100)]
    given = [
        jax.tree.map(lambda *a: jnp.stack(a), *[jax.tree.map(lambda a, i=i: a[i], tree) for i in at])
        for tree in (memories, states, setpoints)
    ]
    together = many(CONTROLLER, VEHICLE, *given)
    for k in range(len(at)):
        alone = single(CONTROLLER, VEHICLE, *[jax.tree.map(lambda a, k=k: a[k], tree) for tree in given])
        for a, b in zip(jax.tree.leaves(alone), jax.tree.leaves(together), strict=True):
            np.testing.assert_allclose(a, b[k], atol=1e-3, rtol=1e-5)


def test_mixing_serves_roll_and_pitch_first_then_height_then_yaw() -> None:
    rng = np.random.default_rng(0)
    collective = rng.uniform(0.0, 60.0, 4000)
    moment = rng.normal(size=(4000, 3)) * [2.5, 2.0, 0.3]
    thrust = np.asarray(
        jax.vmap(lambda c, m: mix(VEHICLE, c, m))(
            jnp.asarray(collective, jnp.float32), jnp.asarray(moment, jnp.float32)
        )
    )
    assert np.all((thrust >= 0.0) & (thrust <= VEHICLE.thrust))
    got = thrust.astype(float) @ VEHICLE.mixing.T
    asked = np.concatenate([collective[:, None], moment], axis=1)
    exact = asked @ np.linalg.inv(VEHICLE.mixing).T
    fits = np.all((exact >= 0.0) & (exact <= VEHICLE.thrust), axis=1)
    # Yaw may use the room that is left, it never makes any.
    level = asked * [0, 1, 1, 0] @ np.linalg.inv(VEHICLE.mixing).T
    without = level + 0.25 * collective[:, None]
    fits &= np.all((without >= 0.0) & (without <= VEHICLE.thrust), axis=1)
    assert 0.05 < fits.mean() < 0.9
    np.testing.assert_allclose(got[fits], asked[fits], atol=1e-4)
    # Roll and pitch are met exactly wherever the motors' range can hold them alone, else scaled by one factor.
    factor = np.minimum(1.0, VEHICLE.thrust / np.ptp(level, axis=1))
    assert 0.01 < (factor < 1.0).mean() < 0.5
    np.testing.assert_allclose(got[:, 1:3], factor[:, None] * asked[:, 1:3], atol=1e-3)
    # Height gives way only to them: the collective is the nearest that they leave room for.
    low, high = -(level * factor[:, None]).min(1), VEHICLE.thrust - (level * factor[:, None]).max(1)
    np.testing.assert_allclose(got[:, 0], 4.0 * np.clip(0.25 * collective, low, high), atol=1e-3)
    # Yaw gets a share of what it asks, never the opposite.
    share = got[:, 3] / asked[:, 3]
    assert share.min() > -1e-3
    assert share.max() < 1.0 + 1e-3


def test_derivatives_through_vehicle_and_controller_are_finite_at_rest() -> None:
    rest = hover(VEHICLE, jnp.zeros(3))

    # Lengths that are 0 here: of the velocity, the rate, the wind seen from the vehicle, the errors.
    def after(velocity: Array, rate: Array, target: Array, wind: Array) -> Array:
        state = dataclasses.replace(rest, velocity=velocity, rate=rate)
        setpoint = Setpoint(target, jnp.zeros(3), jnp.zeros(3), jnp.float32(0.0))
        observer, command = control.command(CONTROLLER, VEHICLE, control.init(state), state, setpoint)
        new = advance(VEHICLE, state, command, wind)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves((observer, new)))

    # Compiled without optimisation: it runs once.
    once = jax.jit(jax.grad(after, (0, 1, 2, 3)), compiler_options={"xla_backend_optimization_level": 0})
    slopes = once(*[jnp.zeros(3)] * 4)
    for leaf in jax.tree.leaves(slopes):
        assert np.all(np.isfinite(leaf))
    # A target a metre higher: ω² m newtons more on four motors, through the lag of one step.
    lag = 1.0 - np.exp(-DT / VEHICLE.motor_lag)
    assert float(slopes[2][2]) == pytest.approx(CONTROLLER.position**2 * VEHICLE.mass * lag, rel=1e-3)


def test_bad_settings_and_shapes_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for setting, match in (({"position": 0.0}, "position"), ({"tilt": 85.0}, "tilt"), ({"yaw": float("nan")}, "yaw")):
        with pytest.raises(ValueError, match=match):
            Controller(**setting)
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    state = hover(VEHICLE, jnp.zeros((2, 3)))
    setpoint = Setpoint(state.position, state.velocity, state.velocity, jnp.zeros(2))
    with pytest.raises(ValueError, match=r"positions \(3,\)"):
        control.command(CONTROLLER, VEHICLE, control.init(state), state, setpoint)
