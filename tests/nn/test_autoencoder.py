"""Architectures: their size, what they see, and that folding changes nothing."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.nn import layers
from maxjax.nn.architecture import CONFIGS, MAXJAX, PAPER, PAPER_2D, Autoencoder
from maxjax.nn.autoencoder import apply, apply_folded, fold, init_params

# Narrow copies: what is tested does not depend on the number of channels.
NARROW = ((2,), (3,), (4,), (5,), (6,))
BACK = ((6,), (5,), (4,), (3,), (2,))
SMALL = {
    "paper": dataclasses.replace(PAPER, encoder=NARROW, decoder=BACK),
    "paper2d": dataclasses.replace(PAPER_2D, encoder=NARROW, decoder=BACK),
    "maxjax": dataclasses.replace(
        MAXJAX, encoder=((4,), (5, 6), (6,)), decoder=((6,), (5, 6), (4,)), kernels=(3, 3, 3), dropout=0.5
    ),
}


def weights(config: Autoencoder, seed: int = 0) -> dict:
    """Of `init`, the head as large as the rest and biases that are not zero."""
    params = init_params(jax.random.key(seed), config)
    params["head"]["kernel"] = 100 * params["head"]["kernel"]
    return jax.tree.map(lambda w: w + 0.1 * (w.ndim == 1), params)


def given(config: Autoencoder, space: tuple[int, ...], batch: int = 2) -> jax.Array:
    return jax.random.normal(jax.random.key(9), (batch, *space, config.inputs))


@pytest.mark.parametrize(
    ("name", "expected"), [("paper", 4_121_409), ("paper_difference", 4_121_409), ("paper_large", 6_259_905)]
)
def test_the_papers_networks_have_its_number_of_weights(name: str, expected: int) -> None:
    assert layers.count(jax.eval_shape(lambda: init_params(jax.random.key(0), CONFIGS[name]))) == expected


def test_the_default_network_has_fewer_weights_than_the_papers() -> None:
    assert layers.count(jax.eval_shape(lambda: init_params(jax.random.key(0), MAXJAX))) < 4_121_409


def test_the_grid_shrinks_as_in_the_paper() -> None:
    assert [space[0] for space in PAPER.spaces((101, 101, 101))] == [101, 50, 25, 12, 6, 3]
    assert [space[0] for space in MAXJAX.spaces((101, 101, 101))] == [51, 25, 12, 6, 3]


def test_a_voxel_of_the_papers_bottleneck_sees_94_voxels_along_each_axis() -> None:
    """By the support of its gradient; with constant input and positive weights every maximum ties and passes all."""
    config = dataclasses.replace(PAPER, encoder=((1,),) * 5, decoder=((1,),) * 5)
    params = jax.tree.map(lambda w: jnp.abs(w) + 0.1, init_params(jax.random.key(0), config))

    def bottleneck(x: jax.Array) -> jax.Array:
        for (layer,) in params["encoder"]:
            x = layers.pool(jax.nn.relu(layers.convolve(x, layer["kernel"])))
        return x[0, 1, 1, 1, 0]

    slope = np.asarray(jax.grad(bottleneck)(jnp.ones((1, 101, 101, 101, 1))))[0, ..., 0]
    for axis in range(3):
        seen = np.flatnonzero(slope.any(axis=tuple(a for a in range(3) if a != axis)))
        assert seen.max() - seen.min() + 1 == 94 == layers.receptive_field(PAPER.kernels)


@pytest.mark.parametrize(
    ("name", "space", "by"),
    [
        ("paper", (35, 32, 33), "planes"),
        ("paper2d", (37, 40), "direct"),
        ("maxjax", (17, 18, 16), "product"),
    ],
)
def test_folded_equals_plain(name: str, space: tuple[int, ...], by: str) -> None:
    config = SMALL[name]
    params, x = weights(config), given(config, space)
    plain = jax.jit(lambda p, x: apply(p, x, config))(params, x)
    assert plain.shape == (2, *space)
    folded = jax.jit(lambda p, x: apply_folded(fold(p, config), x, config, by=by))(params, x)
    np.testing.assert_allclose(folded, plain, atol=1e-5 * float(jnp.abs(plain).max()))


def test_gradients_of_folded_and_plain_agree() -> None:
    config = SMALL["maxjax"]
    params, x = weights(config), given(config, (17, 16, 16), 1)
    plain = jax.jit(jax.grad(lambda p: jnp.sum(apply(p, x, config) ** 2)))(params)
    folded = jax.jit(jax.grad(lambda p: jnp.sum(apply_folded(fold(p, config), x, config) ** 2)))(params)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(folded), strict=True):
        np.testing.assert_allclose(b, a, atol=1e-4 * float(jnp.abs(a).max()) + 1e-7)


def test_dropout_needs_a_key_and_keeps_the_mean() -> None:
    config = SMALL["maxjax"]
    params, x = weights(config), given(config, (16, 16, 16), 1)
    run = jax.jit(lambda key: apply(params, x, config, key=key))
    still = apply(params, x, config)
    first, again, other = run(jax.random.key(1)), run(jax.random.key(1)), run(jax.random.key(2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert (first != still).any()


def test_a_batch_is_its_samples() -> None:
    config = SMALL["maxjax"]
    params, x = weights(config), given(config, (16, 17, 18), 3)
    run = jax.jit(lambda x: apply(params, x, config))
    np.testing.assert_allclose(run(x), jnp.concatenate([run(x[i : i + 1]) for i in range(3)]), atol=1e-5)


def test_what_does_not_fit_is_refused_with_both_shapes() -> None:
    params = init_params(jax.random.key(0), SMALL["paper"])
    with pytest.raises(ValueError, match="at least 32 voxels for 5 poolings, given \\(31, 40, 40\\)"):
        apply(params, jnp.zeros((1, 31, 40, 40, 1)), SMALL["paper"])
    with pytest.raises(ValueError, match="3 axes of space, 1 channels\\), given \\(1, 40, 40, 40, 2\\)"):
        apply(params, jnp.zeros((1, 40, 40, 40, 2)), SMALL["paper"])
    with pytest.raises(ValueError, match="as many levels"):
        Autoencoder(((4,),), ((4,), (4,)), (3,))
    with pytest.raises(ValueError, match="odd kernels"):
        Autoencoder(((4,),), ((4,),), (4,))
