"""The derivative with respect to the goal against differences between goals, each one eliminated by SciPy."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import component_of, conduction_matrix, direct_potential, random_blocks
from scipy.sparse.linalg import splu

from maxjax import Status, solve_potential
from maxjax.solvers.goal import GoalGradient, goal_gradient

SHAPE = (12, 13, 14)
LENGTH = 2.0
START = (2, 3, 4)
derive = jax.jit(goal_gradient)


def at(start: tuple[int, ...], goal: object, sigma: np.ndarray) -> GoalGradient:
    return derive(
        jnp.asarray(sigma, jnp.float32),
        jnp.asarray(start, jnp.int32),
        jnp.asarray(goal, jnp.float32),
        screening_length=jnp.float32(LENGTH),
    )


def scene() -> np.ndarray:
    """Blocks, and a conductivity that varies at random by a factor of ten, centred on no goal."""
    rng = np.random.default_rng(3)
    blocked = random_blocks(rng, SHAPE, 10, 4)
    blocked[1:4, 2:5, 3:6] = False
    return np.where(blocked, 0, 10 ** rng.uniform(0, 1, SHAPE))


def unit_source(sigma: np.ndarray, goal: tuple[int, ...], start: tuple[int, ...]) -> float:
    """Potential at the start of a unit source at the goal, in float64."""
    joined = np.flatnonzero(component_of(sigma > 0, goal).ravel())
    source, sink = (int(np.ravel_multi_index(v, sigma.shape)) for v in (goal, start))
    matrix = conduction_matrix(sigma, LENGTH**-2, grounded=False)[joined][:, joined].tocsc()
    return float(splu(matrix).solve((joined == source).astype(float))[np.searchsorted(joined, sink)])


def test_equals_central_differences_between_goals_one_voxel_apart() -> None:
    sigma = scene()
    joined = np.pad(component_of(sigma > 0, START), 1)
    surrounded = joined.copy()
    for axis in range(3):
        surrounded &= np.roll(joined, 1, axis) & np.roll(joined, -1, axis)
    goals = np.argwhere(surrounded[1:-1, 1:-1, 1:-1])
    goals = goals[np.linalg.norm(goals - np.array(START), axis=1) > 3]
    for goal in np.random.default_rng(0).permutation(goals)[:5]:
        found = at(START, goal, sigma)
        assert found.status == Status.OK
        for axis, step in enumerate(np.eye(3, dtype=int)):
            plus, minus = (unit_source(sigma, tuple(goal + s), START) for s in (step, -step))
            assert found.gradient[axis] == pytest.approx(-LENGTH * math.log(plus / minus) / 2, abs=2e-3)


def test_equals_differences_of_this_solver_where_the_surroundings_are_alike() -> None:
    """Far from walls, in uniform sigma, the goal's own resistance is constant: φ = 1 on the goal changes nothing."""
    sigma, goal = jnp.ones((29, 29, 29), jnp.float32), np.array([15, 14, 13])
    start = (12, 12, 12)
    found = at(start, goal, np.asarray(sigma))

    @jax.jit
    def distance(goal: jax.Array) -> jax.Array:
        phi = solve_potential(sigma, goal, screening_length=LENGTH, tolerance=1e-5).phi
        return -LENGTH * jnp.log(phi[start])

    for axis, step in enumerate(np.eye(3, dtype=np.int32)):
        plus, minus = (distance(jnp.asarray(goal + s, jnp.int32)) for s in (step, -step))
        assert found.gradient[axis] == pytest.approx(float(plus - minus) / 2, abs=2e-2)
    assert found.gradient @ (goal - np.array(start)) > 0  # further from the start, the distance grows


def test_on_an_axis_it_is_the_derivative_of_the_screened_greens_function() -> None:
    """G ∝ exp(−r/ℓ) / r in open space, hence −ℓ d log G / dr = 1 + ℓ/r."""
    found = at((14, 14, 6), (14, 14, 16), np.ones((29, 29, 29)))
    np.testing.assert_allclose(found.gradient, [0, 0, 1 + LENGTH / 10], atol=0.02)


def test_what_is_wrong_is_told_and_gives_no_direction() -> None:
    sigma = np.ones(SHAPE)
    sigma[6] = 0
    for start, goal, status in (
        (START, (3.0, 3, 9), Status.OK),
        (START, (9.0, 3, 9), Status.NO_VALID_PATH),
        (START, (6.2, 3, 9), Status.GOAL_OCCUPIED),
        (START, (3.0, 3, 14), Status.GOAL_OUTSIDE_MAP),
        (START, (math.nan, 3, 9), Status.NONFINITE_INPUT),
        ((6, 3, 4), (3.0, 3, 9), Status.START_OCCUPIED),
        ((2, -1, 4), (3.0, 3, 9), Status.START_OUTSIDE_MAP),
    ):
        found = at(start, goal, sigma)
        assert Status(int(found.status)) is status
        assert bool(jnp.any(found.gradient != 0)) is (status is Status.OK)
        assert jnp.all(jnp.isfinite(found.gradient))
    with pytest.raises(ValueError, match=r"expected at least 4 voxels along each axis, given \(3, 4, 4\)"):
        at(START, (1.0, 1, 1), np.ones((3, 4, 4)))


def test_vmap_over_goals_equals_a_loop() -> None:
    sigma = jnp.asarray(scene(), jnp.float32)
    goals = jnp.asarray([[7.3, 8.1, 9.9], [4.0, 9.0, 2.0], [0.1, 0.2, 12.7]])
    start = jnp.asarray(START, jnp.int32)
    batch = jax.jit(jax.vmap(lambda g: goal_gradient(sigma, start, g, screening_length=LENGTH)))(goals)
    for k, goal in enumerate(goals):
        single = at(START, goal, np.asarray(sigma))
        assert batch.status[k] == single.status
        np.testing.assert_allclose(batch.gradient[k], single.gradient, atol=1e-4)


def test_the_derivative_by_screening_length_of_one_distance_equals_central_differences() -> None:
    sigma, goal = scene(), START
    far = tuple(np.argwhere(component_of(sigma > 0, goal))[-1])

    def distance(length: jax.Array) -> jax.Array:
        phi = solve_potential(jnp.asarray(sigma, jnp.float32), jnp.asarray(goal), screening_length=length).phi
        return -length * jnp.log(phi[far])

    def reference(length: float) -> float:
        return -length * math.log(direct_potential(np.float32(sigma), goal, length**-2)[far])

    expected = (reference(LENGTH + 1e-3) - reference(LENGTH - 1e-3)) / 2e-3
    assert jax.jit(jax.grad(distance))(jnp.float32(LENGTH)) == pytest.approx(expected, rel=1e-2)
