"""The vehicle against C MuJoCo and against what can be computed by hand: drag, motor lag, energy, batches."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import jaxtyping
import mujoco
import numpy as np
import pytest
from jax import lax
from jaxtyping import Array

from maxjax.sim.vehicle.quadrotor import GRAVITY, Gusts, State, Vehicle, advance, gust, hover, mujoco_model

VEHICLE = Vehicle()
STEPS = 100
BATCH = 4


def roll(state: State, commands: Array, wind: Array) -> tuple[State, State]:
    """The last state, and the state before each step."""

    def body(s: State, u: Array) -> tuple[State, State]:
        return advance(VEHICLE, s, u, wind), s

    return lax.scan(body, state, commands)


rolls = jax.jit(jax.vmap(roll))
CALM = jnp.zeros((BATCH, 3))


def batch(state: State) -> State:
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (BATCH, *a.shape)), state)


def tumbling() -> tuple[State, Array, Array]:
    """Four vehicles that spin and fly any way, random commands beyond the motors' range, and wind."""
    rng = np.random.default_rng(0)
    quaternion = rng.normal(size=(BATCH, 4))
    state = State(
        *(
            jnp.asarray(a, jnp.float32)
            for a in (
                rng.normal(size=(BATCH, 3)),
                quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
                3.0 * rng.normal(size=(BATCH, 3)),
                2.0 * rng.normal(size=(BATCH, 3)),
                rng.uniform(0.0, 13.0, (BATCH, 4)),
            )
        )
    )
    # All four motors nearly alike, or the spin grows until nothing can be compared.
    commands = rng.uniform(-3.0, 16.0, (BATCH, STEPS, 1)) + 0.3 * rng.normal(size=(BATCH, STEPS, 4))
    return state, jnp.asarray(commands, jnp.float32), jnp.asarray(6.0 * rng.normal(size=(BATCH, 3)), jnp.float32)


def in_c(state: State, commands: Array, wind: Array, k: int) -> tuple[np.ndarray, list[float]]:
    """Flight k by C MuJoCo in float64: the last state as one vector, and the mechanical energy before each step."""
    model = mujoco_model(VEHICLE)
    model.opt.wind[:] = wind[k]
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate([state.position[k], state.quaternion[k]])
    data.qvel[:] = np.concatenate([state.velocity[k], state.rate[k]])
    data.act[:] = state.thrust[k]
    energy = []
    for command in np.asarray(commands[k]):
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
        energy.append(float(data.energy.sum()))
    return np.concatenate([data.qpos, data.qvel, data.act]), energy


def as_vector(state: State, k: int) -> np.ndarray:
    parts = (state.position, state.quaternion, state.velocity, state.rate, state.thrust)
    return np.concatenate([np.asarray(a[k]) for a in parts])


def energy(state: State) -> np.ndarray:
    inertia = jnp.asarray(VEHICLE.inertia)
    kinetic = VEHICLE.mass * jnp.sum(state.velocity**2, -1) + jnp.sum(inertia * state.rate**2, -1)
    return np.asarray(0.5 * kinetic + VEHICLE.mass * GRAVITY * state.position[..., 2])


def test_equals_c_mujoco_with_drag_wind_and_motors() -> None:
    state, commands, wind = tumbling()
    last, _ = rolls(state, commands, wind)
    for k in range(BATCH):
        expected, _ = in_c(state, commands, wind, k)
        # A hundred steps of float32 (6e-8) on numbers up to 20, amplified by the spin: 1e-5 seen. Drag or wind left
        # out would show as metres.
        np.testing.assert_allclose(as_vector(last, k), expected, atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(last.quaternion, axis=1), 1.0, atol=1e-6)
    still, _ = rolls(state, commands, CALM)
    assert np.abs(np.asarray(still.velocity - last.velocity)).max() > 1.0


def test_air_takes_energy_as_in_c_mujoco() -> None:
    state, commands, _ = tumbling()
    state = State(state.position, state.quaternion, state.velocity, state.rate, jnp.zeros((BATCH, 4)))
    _, trace = rolls(state, 0.0 * commands, CALM)
    for k in range(BATCH):
        one = energy(jax.tree.map(lambda a, k=k: a[k], trace))
        _, expected = in_c(state, 0.0 * commands, CALM, k)
        np.testing.assert_allclose(one, expected, atol=1e-3)
        assert np.all(np.diff(one) < 1e-3)
        assert one[-1] < one[0] - 0.1


def test_hover_holds_and_heading_is_as_asked() -> None:
    state = hover(VEHICLE, jnp.tile(jnp.array([1.0, 2.0, 3.0]), (BATCH, 1)), jnp.array([0.0, 0.5, -2.0, 3.0]))
    last, _ = rolls(state, jnp.full((BATCH, STEPS, 4), VEHICLE.hover, jnp.float32), CALM)
    np.testing.assert_allclose(last.position, state.position, atol=1e-4)
    np.testing.assert_allclose(last.velocity, 0.0, atol=1e-4)
    forward = np.asarray(last.rotation)[:, :, 0]
    np.testing.assert_allclose(np.arctan2(forward[:, 1], forward[:, 0]), [0.0, 0.5, -2.0, 3.0], atol=1e-5)


def box() -> np.ndarray:
    """Edges of MuJoCo's equivalent box, from I_x = m (b² + c²) / 12."""
    i = np.asarray(VEHICLE.inertia)
    return np.sqrt(6.0 / VEHICLE.mass * (i.sum() - 2.0 * i))


def test_terminal_speed_is_where_drag_carries_the_weight() -> None:
    state = batch(hover(VEHICLE, jnp.zeros(3)))
    state = State(state.position, state.quaternion, state.velocity, state.rate, jnp.zeros((BATCH, 4)))
    edges = box()
    terminal = np.sqrt(2.0 * VEHICLE.mass * GRAVITY / (VEHICLE.density * edges[0] * edges[1]))
    # Air that rises at that speed carries the vehicle from the beginning.
    wind = CALM.at[1, 2].set(terminal)
    for _ in range(5):
        state, _ = rolls(state, jnp.zeros((BATCH, STEPS, 4)), wind)
    assert abs(float(state.velocity[0, 2]) + terminal) < 0.01
    assert abs(float(state.velocity[1, 2])) < 0.01
    # The vehicle drifts with the wind, never faster.
    assert np.abs(np.asarray(state.rate)).max() < 1e-4


def test_motors_lag_exponentially_and_saturate() -> None:
    state = batch(hover(VEHICLE, jnp.zeros(3)))
    wanted = jnp.array([5.0, 20.0, -4.0, 0.0])
    _, trace = rolls(state, jnp.broadcast_to(wanted, (BATCH, STEPS, 4)), CALM)
    time = VEHICLE.timestep * np.arange(STEPS)[:, None]
    reached = np.clip(wanted, 0.0, VEHICLE.thrust)
    expected = reached + (VEHICLE.hover - reached) * np.exp(-time / VEHICLE.motor_lag)
    np.testing.assert_allclose(trace.thrust[0], expected, atol=1e-4)


def test_batch_equals_loop_and_nan_stays_within_its_trial() -> None:
    state, commands, wind = tumbling()
    last, _ = rolls(state, commands, wind)
    single = jax.jit(roll)
    for k in (0, 3):
        alone, _ = single(jax.tree.map(lambda a, k=k: a[k], state), commands[k], wind[k])
        for a, b in zip(jax.tree.leaves(alone), jax.tree.leaves(last), strict=True):
            np.testing.assert_allclose(a, b[k], atol=2e-4)
    spoilt, _ = rolls(state, commands.at[1, 50].set(jnp.nan), wind)
    assert np.all(np.isnan(spoilt.position[1]))
    for a, b in zip(jax.tree.leaves(spoilt), jax.tree.leaves(last), strict=True):
        assert np.array_equal(np.delete(a, 1, 0), np.delete(b, 1, 0))


def test_gusts_keep_their_deviation_and_forget_at_their_time() -> None:
    gusts = Gusts()
    noise = jax.random.normal(jax.random.key(0), (2001, 500, 3))
    start = jnp.asarray(gusts.deviation) * noise[0]
    _, path = lax.scan(lambda g, n: (gust(gusts, g, n, 0.01), g), start, noise[1:])
    np.testing.assert_allclose(np.std(path[-1], axis=0), gusts.deviation, rtol=0.15)
    apart = 100
    seen = np.mean(np.asarray(path[apart:] * path[:-apart]), axis=(0, 1)) / np.mean(np.asarray(path) ** 2, axis=(0, 1))
    np.testing.assert_allclose(seen, np.exp(-0.01 * apart / np.asarray(gusts.time)), atol=0.05)


def test_bad_settings_and_shapes_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for setting, match in (
        ({"mass": 0.0}, "mass"),
        ({"arm": (0.1, -0.1)}, "arm"),
        ({"inertia": (1.0, 1.0, 3.0)}, "principal moments"),
        ({"density": 0.0}, "density"),
        ({"timestep": 0.1}, "timestep"),
        ({"thrust": 3.0}, "do not lift"),
        ({"motor_lag": float("nan")}, "motor_lag"),
    ):
        with pytest.raises(ValueError, match=match):
            Vehicle(**setting)
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match=r"command \(4,\)"):
        advance(VEHICLE, hover(VEHICLE, jnp.zeros(3)), jnp.zeros((2, 4)), jnp.zeros(3))
