"""Velocities from middles and faces: they hold those of bodies that translate and turn; faces make them narrower."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxjax.sim.movers.body_marks import Marks, append_marks, no_history, propagate_marks, velocities
from maxjax.sim.movers.reachable_sets import Bounds

COUNT = 64
fast_velocities = jax.jit(velocities)


def corners(rng: np.random.Generator) -> np.ndarray:
    """Of boxes whose diagonals are no longer than 1 m: turned as they may be, no edge around them is."""
    half = rng.uniform(0.05, 0.5 / np.sqrt(3.0), (COUNT, 3))
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1).reshape(8, 3)
    return half[:, None] * signs


def measured(rng: np.random.Generator, middle: np.ndarray, body: np.ndarray, widths: tuple[float, float]) -> Marks:
    """Intervals of the widths of a middle and a face, somewhere around the truth."""
    truth = np.stack([middle, middle + body.min(axis=1), middle + body.max(axis=1)])
    width = np.array([widths[0], widths[1], widths[1]])[:, None, None]
    below = rng.uniform(0.0, 1.0, truth.shape) * width
    return Marks(jnp.asarray(truth - below, jnp.float32), jnp.asarray(truth - below + width, jnp.float32))


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.0])
def test_velocities_hold_those_of_bodies_that_translate_and_turn(turn: float) -> None:
    rng, bounds = np.random.default_rng(0), Bounds(8.0, 2.0, 1.0, turn)
    middle, velocity, body = rng.uniform(-9.0, 9.0, (COUNT, 3)), rng.uniform(-6.0, 6.0, (COUNT, 3)), corners(rng)
    history, slots = no_history(COUNT), jnp.ones(COUNT, bool)
    marks, before = measured(rng, middle, body, (1.0, 0.05)), middle
    for k in range(15):
        now = np.full((COUNT, 1), 0.1 * k)
        fresh = measured(rng, middle, body, (1.0, 0.05))
        # One side of each body is hidden.
        hidden = jnp.asarray(rng.uniform(size=fresh.low.shape) < 0.3).at[0].set(False)
        fresh = Marks(jnp.where(hidden, -jnp.inf, fresh.low), jnp.where(hidden, jnp.inf, fresh.high))
        slowest, fastest = (np.asarray(x) for x in fast_velocities(history, fresh, jnp.asarray(now), bounds))
        assert (slowest <= velocity + 1e-3).all()
        assert (velocity <= fastest + 1e-3).all()
        # What was known of marks before, and how middles moved, holds them now.
        if k:
            moved = jnp.asarray(middle - before, jnp.float32)
            kept = propagate_marks(marks, (-moved, moved), 0.1, bounds)
            truth = np.stack([middle, middle + body.min(axis=1), middle + body.max(axis=1)])
            assert (np.asarray(kept.low) - 1e-4 <= truth).all()
            assert (truth <= np.asarray(kept.high) + 1e-4).all()
        marks, before = measured(rng, middle, body, (1.0, 0.05)), middle
        history = append_marks(history, fresh, jnp.asarray(now[:, 0], jnp.float32), slots)
        push = rng.uniform(-2.0, 2.0, (COUNT, 3))
        middle, velocity = middle + 0.1 * velocity + 0.005 * push, velocity + 0.1 * push
        axis = rng.normal(size=(COUNT, 3))
        axis *= 0.1 * turn / np.linalg.norm(axis, axis=1, keepdims=True)
        body = np.einsum("nij,nkj->nki", Rotation.from_rotvec(axis).as_matrix(), body)


def test_faces_make_velocities_as_narrow_as_their_own_widths_allow() -> None:
    """The best time leaves 2 √(A (w₁ + w₂)) of what is known of a mark."""
    rng, bounds = np.random.default_rng(1), Bounds(8.0, 2.0, 1.0, 0.0)
    body, spread = corners(rng), {}
    for hidden in (True, False):
        history, slots = no_history(COUNT), jnp.ones(COUNT, bool)
        for k in range(12):
            marks = measured(rng, np.full((COUNT, 3), 0.3 * k), body, (1.0, 0.1))
            if hidden:
                side = jnp.array([0.0, jnp.inf, jnp.inf])[:, None, None]
                marks = Marks(marks.low - side, marks.high + side)
            now = jnp.full((COUNT, 1), 0.1 * k)
            slowest, fastest = fast_velocities(history, marks, now, bounds)
            history = append_marks(history, marks, now[:, 0], slots)
        spread[hidden] = np.asarray(fastest - slowest)
    assert (spread[False] <= 2.0 * np.sqrt(2.0 * 0.2) + 0.1).all()
    assert np.median(spread[False]) < 0.5 * np.median(spread[True])
