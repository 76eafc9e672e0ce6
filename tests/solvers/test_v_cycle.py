"""The V-cycle as a dense matrix, and the CG iterations that it leaves, against SciPy's elimination."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, conductivity
from maxjax.fields import stencil
from maxjax.solvers.krylov import Solution, pcg
from maxjax.solvers.v_cycle import hierarchy, v_cycle
from tests.references import component_of, direct_potential, random_blocks, random_free

Discretised = tuple[stencil.Operator, jax.Array, jax.Array, np.ndarray, np.ndarray]


@functools.partial(jax.jit, static_argnames=("leak", "grounded"))
def discretised(sigma: jax.Array, mask: jax.Array, leak: float, grounded: bool) -> tuple[stencil.Operator, jax.Array]:
    return stencil.hold(stencil.assemble(sigma, leak, grounded), mask)


conducting = jax.jit(conductivity, static_argnames="grid")


@jax.jit
def cycled(operator: stencil.Operator, component: jax.Array, r: jax.Array) -> jax.Array:
    return v_cycle(hierarchy(operator, component))(r)


def held(
    sigma: np.ndarray, goal: np.ndarray, leak: float = 0.0, grounded: bool = True
) -> tuple[stencil.Operator, jax.Array]:
    mask = np.zeros(sigma.shape, sigma.dtype)
    mask[tuple(goal)] = 1
    return discretised(sigma, mask, leak, grounded)


def problem(seed: int, shape: tuple[int, int, int], walls: int = 3) -> Discretised:
    """Random boxes, `walls` plates one voxel thick with a hole each, and a sealed pocket."""
    rng = np.random.default_rng(seed)
    blocked = random_blocks(rng, shape, max(4, int(np.prod(shape)) // 400), max(2, min(shape) // 4))
    for k in range(walls):
        axis, hole = k % 3, rng.integers(0, shape)
        plate: list[int | slice] = [slice(None)] * 3
        plate[axis] = int(rng.integers(1, shape[axis] - 1))
        hole[axis] = plate[axis]
        blocked[tuple(plate)] = True
        blocked[tuple(hole)] = False
    blocked[:3, :3, :3] = True
    blocked[1, 1, 1] = False
    goal = random_free(rng, blocked, 1)[0].astype(np.int32)
    while tuple(goal) == (1, 1, 1):
        goal = random_free(rng, blocked, 1)[0].astype(np.int32)
    sigma = np.asarray(conducting(blocked, goal, grid=Grid(shape)))
    operator, source = held(sigma, goal)
    return operator, source, jnp.asarray(component_of(sigma > 0, tuple(goal))), sigma, goal


def dense(operator: stencil.Operator, component: jax.Array) -> np.ndarray:
    unit = jnp.eye(component.size, dtype=operator.diagonal.dtype)

    @jax.jit
    def columns(operator: stencil.Operator, component: jax.Array, unit: jax.Array) -> jax.Array:
        cycle = v_cycle(hierarchy(operator, component))
        return jax.lax.map(lambda r: cycle(r.reshape(component.shape)).ravel(), unit, batch_size=64)

    return np.asarray(columns(operator, component, unit))


@jax.jit
def solve(operator: stencil.Operator, source: jax.Array, component: jax.Array) -> Solution:
    faces, scale = stencil.normalize(operator)
    b = source * scale
    return pcg(
        lambda y: y - stencil.inflow(faces, y),
        b,
        precondition=v_cycle(hierarchy(operator, component)),
        stop=lambda _, r: jnp.linalg.norm(r) <= 1e-6 * jnp.linalg.norm(b),
        max_iterations=100,
    )


@pytest.mark.parametrize("shape", [(9, 10, 7), (3, 4, 45), (2, 30, 23)])
def test_the_cycle_is_symmetric_and_positive(shape: tuple[int, int, int]) -> None:
    operator, _, component, _, _ = problem(1, shape, walls=0 if min(shape) < 5 else 3)
    matrix = dense(operator, component)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-5 * np.abs(matrix).max())
    assert np.linalg.eigvalsh((matrix + matrix.T).astype(float)).min() > 0


def test_the_cycle_is_close_to_the_inverse() -> None:
    operator, _, component, _, _ = problem(2, (9, 10, 11))
    with jax.enable_x64(True):
        operator = jax.tree.map(lambda a: jnp.asarray(np.asarray(a), jnp.float64), operator)
        faces, _ = stencil.normalize(operator)
        matrix = dense(operator, component)
        unit = jnp.eye(component.size)
        system = np.eye(component.size) - np.asarray(
            jax.lax.map(lambda e: stencil.inflow(faces, e.reshape(component.shape)).ravel(), unit)
        )
    kept = np.asarray(component).ravel()
    root = np.linalg.cholesky(matrix[np.ix_(kept, kept)])
    spectrum = np.linalg.eigvalsh(root.T @ system[np.ix_(kept, kept)] @ root)
    # Without a coarse grid the ratio is that of I - G, in the hundreds.
    assert spectrum.max() / spectrum.min() < 15


def test_iterations_are_flat_in_size() -> None:
    iterations = []
    for size in (33, 101):
        rng = np.random.default_rng(size)
        blocked = random_blocks(rng, (size,) * 3, 60, size // 6)
        goal = random_free(rng, blocked, 1)[0].astype(np.int32)
        sigma = np.asarray(conducting(blocked, goal, grid=Grid(blocked.shape)))
        solution = solve(*held(sigma, goal), jnp.asarray(component_of(sigma > 0, tuple(goal))))
        assert solution.converged
        iterations.append(int(solution.iterations))
    assert max(iterations) <= 25
    assert iterations[-1] <= iterations[0] + 6


@pytest.mark.parametrize("shape", [(17, 19, 22), (32, 32, 8)])
def test_the_solution_equals_elimination(shape: tuple[int, int, int]) -> None:
    operator, source, component, sigma, goal = problem(3, shape)
    solution = solve(operator, source, component)
    assert solution.converged
    assert solution.iterations <= 25
    _, scale = stencil.normalize(operator)
    expected = direct_potential(sigma, tuple(goal), 0.0, grounded=True)
    np.testing.assert_allclose(solution.x * scale, expected, atol=1e-4)


def test_vmap_equals_a_loop() -> None:
    problems = [problem(seed, (9, 9, 10)) for seed in range(3)]
    one_hot = [np.zeros((9, 9, 10), np.float32) for _ in problems]
    for mask, (*_, goal) in zip(one_hot, problems, strict=True):
        mask[tuple(goal)] = 1

    def cycle(sigma: jax.Array, mask: jax.Array, component: jax.Array, r: jax.Array) -> jax.Array:
        operator, _ = stencil.hold(stencil.assemble(sigma, 0.0, True), mask)
        return v_cycle(hierarchy(operator, component))(r)

    r = jnp.asarray(np.random.default_rng(0).normal(size=(3, 9, 9, 10)), jnp.float32)
    arguments = (np.stack([p[3] for p in problems]), np.stack(one_hot), np.stack([p[2] for p in problems]), r)
    arguments = tuple(map(jnp.asarray, arguments))
    together = jax.jit(jax.vmap(cycle))(*arguments)
    for k in range(3):
        np.testing.assert_allclose(together[k], jax.jit(cycle)(*(a[k] for a in arguments)), atol=1e-4)


def test_degenerate_components_give_no_nan() -> None:
    sigma = np.zeros((9, 9, 9), np.float32)
    sigma[4, 4, 4] = 1
    operator, source = held(sigma, np.array([4, 4, 4]))
    for component in (sigma > 0, np.zeros_like(sigma, bool)):
        assert np.isfinite(cycled(operator, component, source)).all()
    # Nothing held, nothing grounded: singular.
    operator = stencil.assemble(jnp.ones((9, 9, 9)), 0.0, False)
    assert np.isfinite(cycled(operator, jnp.ones((9, 9, 9), bool), jnp.ones((9, 9, 9)))).all()
