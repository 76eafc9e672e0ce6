"""Trilinear interpolation equals SciPy's, and walls have no say in it."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from maxjax.core.interpolation import corner_weights, trilinear

SHAPE = (5, 6, 7)
RNG = np.random.default_rng(3)
VALUES = RNG.normal(size=SHAPE).astype(np.float32)
WEIGHTS = (RNG.random(SHAPE) < 0.5).astype(np.float32)
# Inside, beyond every face, on voxel centres, on cell faces, and at the last voxel.
POSITIONS = np.concatenate(
    [
        RNG.uniform(-2, 9, (300, 3)),
        RNG.integers(0, 5, (40, 3)),
        RNG.integers(0, 9, (40, 3)) / 2,
        np.array(list(itertools.product(*((0, n - 1) for n in SHAPE)))),
    ]
).astype(np.float32)

at = jax.jit(jax.vmap(trilinear, in_axes=(None, 0, None)))


def test_equals_scipy_and_continues_the_nearest_face() -> None:
    expected = map_coordinates(VALUES.astype(float), POSITIONS.T.astype(float), order=1, mode="nearest")
    np.testing.assert_allclose(at(VALUES, POSITIONS, None), expected, atol=2e-6)


@pytest.mark.parametrize("shape", [(1, 6, 7), (5, 1, 1), (1, 1, 1)])
def test_grids_one_voxel_thick(shape: tuple[int, int, int]) -> None:
    values = VALUES[: shape[0], : shape[1], : shape[2]]
    expected = map_coordinates(values.astype(float), POSITIONS.T.astype(float), order=1, mode="nearest")
    np.testing.assert_allclose(at(values, POSITIONS, None), expected, atol=2e-6)


def test_weights_drop_walls_and_renormalise() -> None:
    expected = []
    for position in np.clip(POSITIONS.astype(float), 0, np.array(SHAPE) - 1):
        total = share = 0.0
        for voxel in itertools.product(*(range(n) for n in SHAPE)):
            tent = np.prod(np.maximum(1 - np.abs(position - voxel), 0)) * WEIGHTS[voxel]
            total, share = total + tent * VALUES[voxel], share + tent
        expected.append(total / share if share > 0 else 0.0)
    # A wall's value must not matter, not even when it is no number.
    walls = np.where(WEIGHTS > 0, VALUES, np.nan).astype(np.float32)
    np.testing.assert_allclose(at(walls, POSITIONS, WEIGHTS), expected, atol=2e-5)


def test_weights_of_a_cell_sum_to_one_and_reproduce_its_corners() -> None:
    for corner in itertools.product((0.0, 1.0), repeat=3):
        weights = np.asarray(corner_weights(jnp.asarray(corner)))
        assert weights[tuple(int(c) for c in corner)] == weights.sum() == 1
    assert np.sum(corner_weights(jnp.asarray([0.2, 0.7, 0.4]))) == pytest.approx(1, abs=1e-6)


def test_derivative_is_the_slope_and_finite_among_walls() -> None:
    x, y, z = np.indices(SHAPE).astype(np.float32)
    linear = 2 * x - 3 * y + 0.5 * z
    slope = jax.grad(lambda position: trilinear(jnp.asarray(linear), position))(jnp.asarray([1.3, 2.6, 3.1]))
    np.testing.assert_allclose(slope, [2, -3, 0.5], rtol=1e-5)
    walled = jax.grad(lambda position: trilinear(jnp.asarray(linear), position, jnp.zeros(SHAPE)))
    np.testing.assert_array_equal(walled(jnp.asarray([1.3, 2.6, 3.1])), [0, 0, 0])
