"""The matrix-free operator equals the stored matrix, and both are the physics."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.fields import stencil
from tests.references import conduction_matrix

SHAPE = (5, 6, 7)


def random_sigma(seed: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """Conductivities over six decades, with a third of the voxels walls."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < 0.33, 0, 10 ** rng.uniform(0, 6, shape))


def columns(linear: object, shape: tuple[int, ...]) -> np.ndarray:
    """The matrix of a linear map of volumes, column by column."""
    basis = jnp.eye(int(np.prod(shape))).reshape(-1, *shape)
    return np.asarray(jax.vmap(linear)(basis)).reshape(len(basis), -1).T  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [SHAPE, (1, 6, 7), (9, 1, 1)])
@pytest.mark.parametrize("grounded", [False, True])
@pytest.mark.parametrize("leak", [0.0, 0.25])
def test_equals_the_stored_matrix(shape: tuple[int, ...], grounded: bool, leak: float) -> None:
    sigma = random_sigma(1, shape)
    with jax.enable_x64(True):
        operator = stencil.assemble(jnp.asarray(sigma), leak, grounded)
        given = columns(lambda phi: stencil.apply(operator, phi), shape)
        np.testing.assert_allclose(given, conduction_matrix(sigma, leak, grounded).toarray(), rtol=1e-12, atol=1e-9)
        # Symmetric, non-positive off the diagonal, and diagonally dominant: an M-matrix.
        np.testing.assert_array_equal(given, given.T)
        off = given - np.diag(np.diag(given))
        assert off.max() <= 0
        slack = np.diag(given) + off.sum(axis=1)
        assert (slack >= -1e-12 * np.diag(given)).all()
        if leak:
            assert (slack[sigma.ravel() > 0] > 0).all()
        np.testing.assert_array_equal(np.diag(given) > 0, (sigma.ravel() > 0) & (np.abs(given).sum(axis=1) > 0))


def test_residual_is_what_the_operator_leaves() -> None:
    rng = np.random.default_rng(2)
    sigma, phi, source = random_sigma(2), rng.random(SHAPE), rng.random(SHAPE)
    with jax.enable_x64(True):
        operator = stencil.assemble(jnp.asarray(sigma), 0.1)
        given = stencil.residual(operator, jnp.asarray(phi), jnp.asarray(source))
    expected = source.ravel() - conduction_matrix(sigma, 0.1, False) @ phi.ravel()
    np.testing.assert_allclose(given, expected.reshape(SHAPE), rtol=1e-12, atol=1e-8)


def test_holding_voxels_replaces_their_rows_and_keeps_symmetry() -> None:
    sigma = random_sigma(3)
    rng = np.random.default_rng(3)
    held = (sigma > 0) & (rng.random(SHAPE) < 0.1)
    matrix = conduction_matrix(sigma, 0.25, False).toarray()
    flat = held.ravel()
    source = np.where(flat, 1, -matrix @ flat)
    matrix[flat], matrix[:, flat] = 0, 0
    matrix[flat, flat] = 1
    with jax.enable_x64(True):
        operator, given = stencil.hold(stencil.assemble(jnp.asarray(sigma), 0.25), jnp.asarray(held, float))
        np.testing.assert_allclose(given.ravel(), source, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(columns(lambda phi: stencil.apply(operator, phi), SHAPE), matrix, rtol=1e-12)


def test_normalised_faces_are_the_scaled_matrix() -> None:
    sigma = random_sigma(4)
    matrix = conduction_matrix(sigma, 0.25, False).toarray()
    diagonal = np.diag(matrix)
    root = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1)), 0)
    with jax.enable_x64(True):
        faces, scale = stencil.normalize(stencil.assemble(jnp.asarray(sigma), 0.25))
        np.testing.assert_allclose(scale.ravel(), root, rtol=1e-12)
        given = columns(lambda y: stencil.inflow(faces, y), SHAPE)
        expected = np.diag((diagonal > 0).astype(float)) - root[:, None] * matrix * root
        np.testing.assert_allclose(given, expected, rtol=1e-12, atol=1e-15)
        assert given.min() >= 0
        assert np.abs(np.linalg.eigvalsh(given)).max() < 1


def test_second_order_on_a_manufactured_solution() -> None:
    """−∇·(σ∇φ) + κσφ = q for φ and σ made of cosines whose slope vanishes on the insulated outer faces."""
    errors = []
    for n in (16, 32):
        h = 1 / n
        x, y, z = ((np.indices((n, n, n)) + 0.5) * h * np.pi).astype(float)
        sigma = 2 + np.cos(x) * np.cos(y)
        phi = np.cos(x) * np.cos(y) * np.cos(2 * z)
        sigma_x, sigma_y = -np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)
        phi_x, phi_y = -np.sin(x) * np.cos(y) * np.cos(2 * z), -np.cos(x) * np.sin(y) * np.cos(2 * z)
        q = np.pi**2 * (6 * sigma * phi - sigma_x * phi_x - sigma_y * phi_y) + 4 * sigma * phi
        with jax.enable_x64(True):
            operator = stencil.assemble(jnp.asarray(sigma), 4 * h**2)
            errors.append(float(jnp.abs(stencil.apply(operator, jnp.asarray(phi)) / h**2 - q).max() / np.abs(q).max()))
    assert errors[1] < 3e-3
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.3)


def test_insulated_slab_is_a_hyperbolic_cosine() -> None:
    """Exactly so on the lattice: φ_i ∝ cosh((n − 1/2 − i) θ) with 2 cosh θ = 2 + κ."""
    n, leak = 40, 0.25
    theta = np.arccosh(1 + leak / 2)
    phi = np.cosh((n - 0.5 - np.arange(n)) * theta) / np.cosh((n - 0.5) * theta)
    with jax.enable_x64(True):
        held = jnp.zeros((n, 1, 1)).at[0].set(1)
        operator, source = stencil.hold(stencil.assemble(jnp.full((n, 1, 1), 7.0), leak), held)
        residual = stencil.residual(operator, jnp.asarray(phi[:, None, None]), source)
    np.testing.assert_allclose(residual, 0, atol=1e-14)


def test_derivatives_at_walls_are_finite() -> None:
    sigma = jnp.asarray(random_sigma(5), jnp.float32)
    phi = jnp.asarray(np.random.default_rng(5).random(SHAPE), jnp.float32)
    slope = jax.grad(lambda sigma: jnp.sum(stencil.apply(stencil.assemble(sigma, 0.1, True), phi) ** 2))(sigma)
    assert np.isfinite(slope).all()
