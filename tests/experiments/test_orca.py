"""ORCA's constraints and its program against SciPy, and that what they allow does not collide."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from experiments.orca import _SECONDS, half_spaces, solved
from maxjax.sim.movers.reachable_sets import Tracks, no_tracks


def drawn(rng: np.random.Generator, count: int) -> Tracks:
    place = rng.normal(size=(count, 3))
    place *= rng.uniform(3.0, 12.0, (count, 1)) / np.linalg.norm(place, axis=1, keepdims=True)
    given = {"place": place, "velocity": rng.uniform(-3.0, 3.0, (count, 3)), "half": np.full((count, 3), 0.3)}
    tracks = dataclasses.replace(no_tracks(count), **{k: jnp.asarray(v, jnp.float32) for k, v in given.items()})
    return dataclasses.replace(tracks, used=jnp.ones(count, bool))


def test_the_velocity_is_the_nearest_that_all_constraints_allow() -> None:
    rng = np.random.default_rng(0)
    solve, compared = jax.jit(solved, static_argnums=4), 0
    for _ in range(20):
        tracks = drawn(rng, 4)
        velocity, wanted = rng.uniform(-2.0, 2.0, 3), rng.uniform(-3.0, 3.0, 3)
        change, normal = half_spaces(tracks, jnp.zeros(3), jnp.asarray(velocity, jnp.float32), 0.5)
        points, normals = velocity + np.asarray(change, float), np.asarray(normal, float)
        rules = [{"type": "ineq", "fun": lambda v, p=p, n=n: (v - p) @ n} for p, n in zip(points, normals, strict=True)]
        rules.append({"type": "ineq", "fun": lambda v: 25.0 - v @ v})
        best = minimize(lambda v, w=wanted: ((v - w) ** 2).sum(), np.zeros(3), constraints=rules, method="SLSQP")
        if not best.success or min(rule["fun"](best.x) for rule in rules) < -1e-4:
            continue
        compared += 1
        given = (jnp.asarray(x, jnp.float32) for x in (wanted, points, normals))
        found = solve(*given, tracks.used, 5.0)
        np.testing.assert_allclose(found, best.x, atol=0.05)
    assert compared >= 10


def test_a_velocity_beyond_a_constraint_passes_by_and_one_short_of_it_does_not() -> None:
    """The line of each constraint is the border of what collides within the time, near the point it is taken at."""
    rng = np.random.default_rng(1)
    times = np.linspace(0.0, _SECONDS, 400)
    sides = []
    for _ in range(60):
        tracks = drawn(rng, 1)
        velocity = rng.uniform(-4.0, 4.0, 3)
        change, normal = (np.asarray(x[0], float) for x in half_spaces(
            tracks, jnp.zeros(3), jnp.asarray(velocity, jnp.float32), 0.5))  # fmt: skip
        border = velocity + change
        reach = 0.5 + np.linalg.norm(np.asarray(tracks.half[0], float))
        place, moves = (np.asarray(x[0], float) for x in (tracks.place, tracks.velocity))
        for side in (-0.05, 0.05):
            own = times[:, None] * (border + side * normal)
            nearest = np.linalg.norm(place + times[:, None] * moves - own, axis=1).min()
            sides.append((side > 0.0) == (nearest > reach - 1e-3))
    assert np.mean(sides) > 0.97


def test_nobody_asks_for_nothing() -> None:
    wanted = jnp.array([1.0, -2.0, 0.5])
    change, normal = half_spaces(no_tracks(3), jnp.zeros(3), wanted, 0.5)
    np.testing.assert_allclose(solved(wanted, change, normal, no_tracks(3).used, 5.0), wanted, atol=1e-6)
