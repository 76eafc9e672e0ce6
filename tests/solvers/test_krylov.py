"""Conjugate gradients against SciPy, and the Chebyshev preconditioner against its closed form."""

from __future__ import annotations

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_banded
from scipy.sparse.linalg import cg

from maxjax.solvers.krylov import chebyshev, pcg


def spd(seed: int, n: int = 60, condition: float = 1e3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return (basis * np.geomspace(1, condition, n)) @ basis.T, rng.normal(size=n)


def below(tolerance: float, b: jax.Array):  # type: ignore[no-untyped-def]
    return lambda _, r: jnp.linalg.norm(r) <= tolerance * jnp.linalg.norm(b)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_scipy_in_solution_and_iterations(seed: int) -> None:
    matrix, b = spd(seed)
    iterations = []
    with jax.enable_x64(True):
        given = pcg(lambda x: jnp.asarray(matrix) @ x, jnp.asarray(b), stop=below(1e-10, b), max_iterations=1000)
        cg(matrix, b, rtol=1e-10, callback=iterations.append)
        np.testing.assert_allclose(given.x, np.linalg.solve(matrix, b), rtol=1e-7, atol=1e-9)
        assert given.converged
        # 60 unknowns take some 128 iterations: rounding, hence the order of operations, has a say in the last few.
        assert int(given.iterations) == pytest.approx(len(iterations), rel=0.03)
        true = np.linalg.norm(b - matrix @ np.asarray(given.x)) / np.linalg.norm(b)
        assert given.residual == pytest.approx(true, rel=0.2)


def test_float32_reaches_single_precision() -> None:
    matrix, b = (x.astype(np.float32) for x in spd(3, condition=100))
    given = jax.jit(lambda b: pcg(lambda x: matrix @ x, b, stop=below(1e-5, b), max_iterations=200))(b)
    assert given.converged
    np.testing.assert_allclose(given.x, np.linalg.solve(matrix.astype(float), b), atol=2e-5)


def test_a_preconditioner_and_an_initial_iterate_shorten_the_way() -> None:
    matrix, b = spd(4)
    scale = np.geomspace(1, 1e3, len(b))
    badly = scale[:, None] * matrix * scale
    with jax.enable_x64(True):

        def iterations(**options: object) -> int:
            given = pcg(
                lambda x: jnp.asarray(badly) @ x,
                jnp.asarray(b),
                stop=below(1e-6, b),
                max_iterations=5000,
                **options,  # type: ignore[arg-type]
            )
            assert given.converged
            np.testing.assert_allclose(scale * given.x, np.linalg.solve(matrix, b / scale), rtol=1e-2, atol=1e-6)
            return int(given.iterations)

        plain = iterations()
        assert iterations(precondition=lambda r: r / jnp.asarray(scale) ** 2) < plain / 2
        assert iterations(x0=jnp.asarray(np.linalg.solve(badly, b))) == 0


def test_the_cap_is_reported() -> None:
    matrix, b = (x.astype(np.float32) for x in spd(5))
    given = pcg(lambda x: matrix @ x, jnp.asarray(b), stop=below(1e-6, b), max_iterations=3)
    assert given.iterations == 3
    assert not given.converged
    assert given.residual == pytest.approx(
        np.linalg.norm(b - matrix @ np.asarray(given.x)) / np.linalg.norm(b), rel=1e-3
    )


def test_breakdown_is_reported() -> None:
    b = jnp.ones(4)
    singular = pcg(lambda x: 0 * x, b, stop=below(1e-6, b), max_iterations=50)
    assert not singular.converged
    broken = pcg(lambda x: jnp.nan * x, b, stop=below(1e-6, b), max_iterations=50)
    assert not broken.converged
    unclean = pcg(lambda x: x, b.at[0].set(jnp.nan), stop=below(1e-6, b), max_iterations=50)
    assert not unclean.converged
    assert max(singular.iterations, broken.iterations, unclean.iterations) <= 1


def test_no_right_hand_side_takes_no_iteration() -> None:
    given = pcg(lambda x: 2 * x, jnp.zeros(5), stop=below(1e-6, jnp.zeros(5)), max_iterations=50)
    assert (int(given.iterations), float(given.residual), bool(given.converged)) == (0, 0.0, True)
    np.testing.assert_array_equal(given.x, 0)


def test_tiny_entries_keep_their_relative_accuracy_in_float32() -> None:
    """A screened chain falls by 30 decades, far beyond what the square of a float32 residual can hold."""
    n, leak = 140, 0.25
    banded = np.stack([np.full(n, -1.0), np.full(n, 2 + leak), np.full(n, -1.0)])
    expected = solve_banded((1, 1), banded, np.eye(n)[0])
    assert expected[-1] < 1e-30

    def matvec(x: jax.Array) -> jax.Array:
        return (2 + leak) * x - jnp.pad(x[1:], (0, 1)) - jnp.pad(x[:-1], (1, 0))

    given = pcg(
        matvec,
        jnp.eye(n, dtype=jnp.float32)[0],
        stop=lambda x, r: jnp.all(jnp.abs(r) <= 1e-4 * x),
        max_iterations=400,
    )
    assert given.converged
    np.testing.assert_allclose(given.x, expected, rtol=1e-3)


@pytest.mark.parametrize("degree", [2, 4, 16])
@pytest.mark.parametrize("radius", [0.6, 0.9, 1.0])
def test_chebyshev_equals_its_closed_form(degree: int, radius: float) -> None:
    """z_k = (1 − T_k(λ/μ) / T_k(1/μ)) / (1 − λ) r on an eigenvector of G: positive for every |λ| < 1."""
    rng = np.random.default_rng(degree)
    basis, _ = np.linalg.qr(rng.normal(size=(30, 30)))
    eigenvalues = np.linspace(-0.98, 0.98, 30)
    smooth = (basis * eigenvalues) @ basis.T
    t = np.polynomial.chebyshev.Chebyshev.basis(degree)
    share = (1 - t(eigenvalues / radius) / t(1 / radius)) / (1 - eigenvalues)
    assert share.min() > 0
    with jax.enable_x64(True):
        precondition = chebyshev(lambda z: jnp.asarray(smooth) @ z, radius, degree)
        given = np.asarray(jax.vmap(precondition)(jnp.eye(30))).T
    np.testing.assert_allclose(given, (basis * share) @ basis.T, atol=1e-12)


@pytest.mark.parametrize("degree", [-2, 0, 1, 3, 15])
def test_chebyshev_of_odd_degree_is_refused(degree: int) -> None:
    with pytest.raises(ValueError, match=f"expected an even positive degree, given {degree}"):
        inspect.unwrap(chebyshev)(lambda z: z, 0.5, degree)
