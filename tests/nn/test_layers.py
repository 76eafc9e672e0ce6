"""Layers against SciPy, and folded kernels against what they fold."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import correlate

from maxjax.nn import layers

FORMS = ("direct", "product", "planes")
SPACES = [(5,), (6,), (5, 6), (6, 5, 7)]


def random(*shape: int, seed: int = 0) -> jax.Array:
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


@pytest.mark.parametrize(("size", "by"), [((5,), "direct"), ((3, 5), "product"), *(((3, 3, 5), by) for by in FORMS)])
def test_convolution_is_scipys_correlation(size: tuple[int, ...], by: str) -> None:
    space = (7, 6, 8)[: len(size)]
    x, kernel = random(2, *space, 3), random(*size, 3, 4, seed=1)
    given = layers.convolve(x, kernel, by=by)
    valid = layers.convolve(x, kernel, same=False, by=by)
    for n in range(2):
        for o in range(4):
            for y, mode in ((given, "same"), (valid, "valid")):
                parts = [correlate(np.asarray(x[n, ..., i]), np.asarray(kernel[..., i, o]), mode) for i in range(3)]
                np.testing.assert_allclose(y[n, ..., o], sum(parts), rtol=1e-4, atol=1e-4)


def test_pooling_is_the_maximum_of_patches_and_drops_an_odd_voxel() -> None:
    x = random(2, 5, 6, 3)
    expected = np.asarray(x)[:, :4].reshape(2, 2, 2, 3, 2, 3).max(axis=(2, 4))
    np.testing.assert_array_equal(layers.pool(x), expected)


def test_upsampling_repeats_and_continues_odd_axes() -> None:
    x = jnp.arange(3.0)[None, :, None]
    np.testing.assert_array_equal(layers.upsample(x, (6,))[0, :, 0], [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(layers.upsample(x, (7,))[0, :, 0], [0, 0, 1, 1, 2, 2, 2, 2])
    with pytest.raises(ValueError, match="expected 6 or 7 voxels along axis 0, given 8"):
        layers.upsample(x, (8,))


@pytest.mark.parametrize("space", SPACES)
def test_patches_hold_their_voxels_in_order(space: tuple[int, ...]) -> None:
    even = tuple(n // 2 * 2 for n in space)
    x = random(2, *even, 3)
    found = layers.patches(x)
    np.testing.assert_array_equal(layers.unpatch(found), x)
    corner = np.asarray(x)[(0, *(slice(0, 2) for _ in even))]
    np.testing.assert_array_equal(found[(0, *(0 for _ in even))], corner.reshape(-1))


@pytest.mark.parametrize(
    ("space", "by"), [*((space, "direct") for space in SPACES), (SPACES[-1], "product"), (SPACES[-1], "planes")]
)
def test_folded_upsampling_is_upsampling_and_convolution(space: tuple[int, ...], by: str) -> None:
    coarse = random(2, *(n // 2 for n in space), 3)
    kernel = random(*(3 for _ in space), 3, 4, seed=1)
    plain = layers.crop(layers.convolve(layers.upsample(coarse, space), kernel), space)
    folded = layers.from_shifted(layers.convolve_up(coarse, layers.fold_up(kernel), space, by=by), space)
    np.testing.assert_allclose(folded, plain, atol=1e-5 * np.abs(plain).max())


@pytest.mark.parametrize("space", SPACES)
def test_a_folded_convolution_from_shifted_patches_gives_patches(space: tuple[int, ...]) -> None:
    x, kernel = random(2, *space, 3), random(*(3 for _ in space), 3, 4, seed=1)
    found = layers.convolve(layers.shifted_patches(x), layers.fold_patches(kernel), same=False)
    plain = layers.convolve(x, kernel)
    tolerance = 1e-5 * np.abs(plain).max()
    np.testing.assert_allclose(layers.crop(layers.unpatch(found), space), plain, atol=tolerance)
    coarse = [n // 2 for n in space]
    pooled = layers.crop(layers.pool_patches(found, len(space)), coarse)
    np.testing.assert_allclose(pooled, layers.pool(plain), atol=tolerance)


@pytest.mark.parametrize("space", SPACES)
def test_shifted_patches_know_which_voxels_lie_in_the_grid(space: tuple[int, ...]) -> None:
    ones = layers.shifted_patches(jnp.ones((1, *space, 1)))[0]
    inside = layers.inside_shifted(space)
    np.testing.assert_array_equal(ones[tuple(slice(0, n) for n in inside.shape[:-1])], inside)
    assert inside.sum() == np.prod(space)


def test_folding_is_linear_and_its_gradient_that_of_the_plain_kernel() -> None:
    x, kernel = random(1, 3, 4, 2), random(3, 3, 2, 3, seed=1)

    def plain(kernel: jax.Array) -> jax.Array:
        return jnp.sum(jnp.sin(layers.crop(layers.convolve(layers.upsample(x, (7, 8)), kernel), (7, 8))))

    def folded(kernel: jax.Array) -> jax.Array:
        y = layers.convolve_up(x, layers.fold_up(kernel), (7, 8))
        return jnp.sum(jnp.sin(layers.from_shifted(y, (7, 8))))

    np.testing.assert_allclose(jax.grad(folded)(kernel), jax.grad(plain)(kernel), atol=1e-4)


def test_only_three_taps_are_folded() -> None:
    with pytest.raises(ValueError, match="expected three taps along each axis, given \\(5, 5\\)"):
        layers.fold_up(random(5, 5, 1, 1))
