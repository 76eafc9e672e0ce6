"""Prices fall from the wall to the margin, and the leak that pays them lets φ fall as they say."""

from __future__ import annotations

import inspect
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solveh_banded

from maxjax.fields.price import Price, lattice_price

MARGIN, HEIGHT = 8.0, 4.0
D = jnp.linspace(0, 12, 97)


@pytest.mark.parametrize(
    ("shape", "half"),
    [
        ("quadratic", 1 + HEIGHT / 4),
        ("exponential", 1 + HEIGHT / (1 + math.exp(1.5))),
        ("speed", 2.0),
    ],
)
def test_falls_from_the_wall_to_1_at_the_margin(shape: Any, half: float) -> None:
    price = Price(shape, HEIGHT)
    n = np.asarray(jax.jit(price.price_at, static_argnums=1)(D, MARGIN))
    assert n[0] == pytest.approx(1 + HEIGHT)
    assert (np.diff(n) <= 0).all()
    assert (n >= 1).all()
    np.testing.assert_allclose(n[D >= MARGIN], 1, atol=1e-6)
    assert n[D == MARGIN / 2] == pytest.approx(half, rel=1e-6)
    slope = jax.vmap(jax.grad(lambda d: price.price_at(d, MARGIN)))(D)
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("shape", ["quadratic", "exponential", "speed"])
def test_is_1_where_nothing_is_asked_for(shape: Any) -> None:
    np.testing.assert_array_equal(Price(shape).price_at(D, 0.0), 1)
    np.testing.assert_allclose(Price(shape, 0.0).price_at(D, MARGIN), 1, atol=1e-7)


def test_shapes_and_heights_that_are_none_are_refused() -> None:
    def build(shape: Any, height: Any) -> Price:
        """As users build it: without the run-time type checks of the tests."""
        price = object.__new__(Price)
        object.__setattr__(price, "shape", shape)
        object.__setattr__(price, "height", height)
        inspect.unwrap(Price.__post_init__)(price)
        return price

    assert build("speed", 3).height == 3.0
    for height in (-1, math.nan, math.inf, "4", True, None):
        with pytest.raises(ValueError, match=r"Price.height: expected a finite number of at least 0, given "):
            build("quadratic", height)
    for shape in ("cubic", None, []):
        with pytest.raises(ValueError, match="expected one of quadratic, exponential, speed, given "):
            build(shape, 4.0)


@pytest.mark.parametrize("length", [1.0, 1.5, 4.0])
def test_the_lattice_decays_by_the_price_a_voxel(length: float) -> None:
    """−(φ_{i+1} − 2 φ_i + φ_{i−1}) + κ N² φ = 0 with φ_0 = 1, by elimination in float64."""
    n, count = np.array([1.0, 2.0, 5.0]), 40
    for price, leak in zip(n, np.asarray(lattice_price(jnp.asarray(n), length)) ** 2 / length**2, strict=True):
        bands = np.array([np.full(count, -1.0), np.full(count, 2 + leak)])
        phi = solveh_banded(bands, np.eye(count)[0])
        theta = 2 * math.asinh(1 / (2 * length))
        np.testing.assert_allclose(-np.diff(np.log(phi))[:6], price * theta, rtol=1e-5)
    assert float(lattice_price(jnp.float32(1), length)) == pytest.approx(1, rel=1e-6)
