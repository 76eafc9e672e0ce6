"""What networks read and predict: the law of free space against SciPy, and finite potentials from any prediction."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from scipy.special import k0

from maxjax.core.grid import Grid
from maxjax.fields.conductivity import conductivity
from maxjax.nn.encoding import Known, decode, encode, law


def test_the_law_falls_as_the_bessel_function_does() -> None:
    """−ℓ log K₀(r/ℓ) up to a constant, where a voxel is small beside ℓ and K₀'s leading term holds."""
    length, r = 12.0, np.linspace(24.0, 80.0, 50)
    exact = -length * np.log(k0(r / length))
    given = np.asarray(law(jnp.asarray(r, jnp.float32), jnp.float32(length)))
    np.testing.assert_allclose(np.diff(given), np.diff(exact), rtol=0.02)
    assert law(jnp.zeros(1), jnp.float32(length)) == 0


def test_in_the_open_the_flood_adds_little_and_behind_walls_what_they_do() -> None:
    grid = Grid((20, 20, 20))
    goal = jnp.array([3, 10, 10], jnp.int32)
    steps = jnp.asarray(np.indices(grid.shape)[0] + 1, jnp.uint16)
    sigma = conductivity(jnp.zeros(grid.shape, bool), goal, grid)
    price = 1 + jnp.asarray(np.indices(grid.shape)[1], jnp.float32)
    known = Known(sigma, price, goal, steps, jnp.float32(2.0))
    x, base = encode("free", True, known)
    assert x.shape == (20, 20, 20, 5)
    assert (x[..., 0] > 0).all()
    np.testing.assert_allclose(x[3, 10, 10, 0], 1, rtol=1e-6)
    assert base[3, 10, 10] == 0
    np.testing.assert_allclose(x[..., 2], base / 100, rtol=1e-6)
    expected = law(steps.astype(jnp.float32), jnp.float32(2.0)) - base
    np.testing.assert_allclose(x[..., 3], expected / 10, atol=1e-5)
    np.testing.assert_allclose(x[..., 4], np.log(price), rtol=1e-5)
    plain, nothing = encode("nothing", False, known)
    np.testing.assert_array_equal(plain, x[..., :1])
    assert not nothing.any()


def test_a_log_potential_is_finite_whatever_the_network_predicts() -> None:
    predicted = jnp.asarray([[[0.0, 5.0, jnp.nan, jnp.inf, -jnp.inf, 1e30, 3.0]]])
    component = jnp.asarray([[[True, True, True, True, True, True, False]]])
    goal = jnp.asarray([[[True, False, False, False, False, False, False]]])
    log_phi = np.asarray(decode(predicted, component, goal, jnp.float32(2.0)))[0, 0]
    assert np.isfinite(log_phi).all()
    assert log_phi[0] == log_phi[6] == 0
    assert log_phi[2] == log_phi[3] == log_phi[5] == log_phi.min()  # as far as can be
    np.testing.assert_allclose(log_phi[1], -2.5, rtol=1e-6)
