"""Differences and smoothing that never read through a wall."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.sparse.linalg import expm_multiply

from maxjax.core.interpolation import trilinear
from maxjax.fields.gradient import gradient, gradient_at, log_potential, smooth
from tests.references import conduction_matrix

SHAPE = (12, 11, 13)
RNG = np.random.default_rng(1)
FREE = RNG.random(SHAPE) > 0.35
NOISE = RNG.normal(size=SHAPE).astype(np.float32)
OPEN = np.ones(SHAPE, bool)
POSITIONS = np.concatenate(
    [RNG.uniform(0, np.array(SHAPE) - 1, (200, 3)), RNG.integers(0, SHAPE, (100, 3)), RNG.uniform(-1, 13, (60, 3))]
).astype(np.float32)

everywhere = jax.jit(gradient)
at = jax.jit(jax.vmap(gradient_at, in_axes=(None, None, 0)))
blur = jax.jit(smooth, static_argnames="sigma")


def has_neighbour(free: np.ndarray, axis: int) -> np.ndarray:
    padded = np.moveaxis(np.pad(free, 1), axis, 0)
    either = np.moveaxis(padded[2:] | padded[:-2], 0, axis)
    return either[tuple(slice(None) if a == axis else slice(1, -1) for a in range(3))] & free


def test_linear_fields_have_their_slope_wherever_a_neighbour_is_free() -> None:
    """A one-sided difference is exact too; the walls hold garbage, which must not show."""
    slope = np.array([0.5, -2.0, 1.25])
    field = np.where(FREE, np.tensordot(slope, np.indices(SHAPE), 1), 1e6).astype(np.float32)
    given = np.asarray(everywhere(field, FREE))
    for axis in range(3):
        expected = np.where(has_neighbour(FREE, axis), slope[axis], 0)
        np.testing.assert_allclose(given[..., axis], expected, atol=1e-5)


def test_equals_numpy_in_open_space() -> None:
    """`numpy.gradient` too is central inside and one-sided at the edges of the grid."""
    np.testing.assert_allclose(everywhere(NOISE, OPEN), np.stack(np.gradient(NOISE), axis=-1), atol=1e-6)


def test_walls_have_no_gradient_and_no_influence() -> None:
    given = np.asarray(everywhere(NOISE, FREE))
    assert (given[~FREE] == 0).all()
    other = np.where(FREE, NOISE, np.float32(-87))
    np.testing.assert_array_equal(everywhere(other, FREE), given)


def test_interpolates_the_gradient_in_open_space_and_beyond_the_edges() -> None:
    given = at(NOISE, OPEN, POSITIONS)
    for axis, component in enumerate(np.gradient(NOISE.astype(float))):
        expected = map_coordinates(component, POSITIONS.T.astype(float), order=1, mode="nearest")
        np.testing.assert_allclose(given[:, axis], expected, atol=5e-6)


def test_interpolates_among_free_voxels_only() -> None:
    whole = everywhere(NOISE, FREE)
    given = at(NOISE, FREE, POSITIONS)
    pick = jax.jit(jax.vmap(trilinear, in_axes=(None, 0, None)))
    for axis in range(3):
        np.testing.assert_allclose(given[:, axis], pick(whole[..., axis], POSITIONS, FREE * 1.0), atol=5e-6)


# Steps are of first order in time: the rough parts of the field, which only a narrow blur keeps, show the error most.
@pytest.mark.parametrize(("sigma", "tolerance"), [(0.8, 0.15), (2.0, 0.06), (5.0, 0.02)])
def test_smoothing_is_the_heat_equation_with_insulated_walls(sigma: float, tolerance: float) -> None:
    """Equal to the exponential of the stored Laplacian, but for the error of the explicit steps."""
    laplacian = conduction_matrix(FREE.astype(float), 0.0, False)
    expected = expm_multiply(-0.5 * sigma**2 * laplacian, NOISE.ravel().astype(float))
    given = np.asarray(blur(NOISE, FREE, sigma)).ravel()
    error = np.linalg.norm((given - expected)[FREE.ravel()]) / np.linalg.norm(expected[FREE.ravel()])
    assert error < tolerance
    np.testing.assert_array_equal(given[~FREE.ravel()], NOISE[~FREE])


@pytest.mark.parametrize("sigma", [1.5, 3.0, 5.0])
def test_smoothing_in_open_space_is_gaussian(sigma: float) -> None:
    """`reflect` is SciPy's word for the insulated faces of the grid."""
    rng = np.random.default_rng(2)
    rough = gaussian_filter(rng.normal(size=(28, 27, 26)), 1.0)
    expected = gaussian_filter(rough, sigma, mode="reflect", truncate=6)
    given = blur(rough.astype(np.float32), np.ones(rough.shape, bool), sigma)
    assert np.linalg.norm(given - expected) < 0.05 * np.linalg.norm(expected)


def test_where_there_is_no_value_there_is_a_wall() -> None:
    """A log-potential is −inf where there is no current: behind walls, too."""
    pocket = FREE.copy()
    pocket[4:7, 4:7, 4:7] = False
    nothing = np.where(pocket, NOISE, -np.inf).astype(np.float32)
    for free in (FREE, pocket):
        np.testing.assert_array_equal(everywhere(nothing, free), everywhere(NOISE, pocket))
        np.testing.assert_array_equal(at(nothing, free, POSITIONS), at(NOISE, pocket, POSITIONS))
        np.testing.assert_array_equal(blur(nothing, free, 1.5)[pocket], blur(NOISE, pocket, 1.5)[pocket])


def test_no_smoothing_returns_the_field() -> None:
    np.testing.assert_array_equal(blur(NOISE, FREE, 0.0), NOISE)


def test_smoothing_stays_within_its_bounds() -> None:
    given = np.asarray(blur(NOISE, FREE, 5.0))
    assert given.min() >= NOISE.min()
    assert given.max() <= NOISE.max()


def test_two_rooms_never_mix_and_each_keeps_its_mean() -> None:
    free = OPEN.copy()
    free[6] = False  # one voxel thick
    other = NOISE.copy()
    other[7:] = RNG.normal(size=other[7:].shape) * 100
    one, two = (np.asarray(blur(field, free, 5.0)) for field in (NOISE, other))
    np.testing.assert_array_equal(one[:6], two[:6])  # bitwise
    assert not np.array_equal(one[7:], two[7:])
    for room in (slice(0, 6), slice(7, None)):
        assert two[room].mean() == pytest.approx(other[room].mean(), rel=1e-4, abs=1e-5)


def test_log_potential_of_nothing_is_finite_and_so_is_its_derivative() -> None:
    phi = jnp.asarray([[[1.0, 1e-30, 0.0, -1.0]]])
    given = log_potential(phi)
    np.testing.assert_allclose(given.ravel()[:2], [0, np.log(1e-30)], rtol=1e-6)
    assert np.isfinite(given).all()
    assert given[0, 0, 2] == given[0, 0, 3] < given[0, 0, 1]
    assert np.isfinite(jax.grad(lambda phi: log_potential(phi).sum())(phi)).all()


def test_vmap_equals_a_loop() -> None:
    fields = jnp.stack([jnp.asarray(NOISE), 2 * jnp.asarray(NOISE)])
    batch = jax.vmap(functools.partial(smooth, sigma=2.0), in_axes=(0, None))(fields, jnp.asarray(FREE))
    for k, field in enumerate(fields):
        np.testing.assert_allclose(batch[k], blur(field, FREE, 2.0), atol=1e-6)
