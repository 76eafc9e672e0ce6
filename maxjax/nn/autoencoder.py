"""Convolutional autoencoders, as pure functions of their weights.

    encoder level:  x ← relu(conv(x)), once or more;  keep x;  x ← maxpool(x)
    decoder level:  x ← upsample(x), with what was kept;  x ← relu(conv(x)), once or more
    head:           y = conv(x), one number a voxel

`apply` is the definition. `apply_folded` is the same function to rounding, with kernels folded as `nn.layers` derives:
no volume is upsampled, and the finest level of the paper's network works on patches too. Architectures are in
`nn.architecture`.
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from maxjax.nn import layers
from maxjax.nn.architecture import Autoencoder
from maxjax.nn.layers import Formulation, Volumes

# Layers of `{"kernel", "bias"}`: lists of levels in "encoder" and "decoder", one in "head".
Params = dict[str, Any]
Layer = dict[str, Array]


def init_params(key: PRNGKeyArray, config: Autoencoder) -> Params:
    """Weights drawn for rectifiers (He et al. 2015, variance 2 / fan-in), biases zero; the head starts small.

    Args:
        key: a JAX key.
        config: architecture.
    """
    drawn = [0]

    def layer(size: int, inputs: int, outputs: int, gain: float = 2.0) -> Layer:
        drawn[0] += 1
        shape = (*(size,) * config.dimensions, inputs, outputs)
        spread = math.sqrt(gain / (size**config.dimensions * inputs))
        kernel = spread * jax.random.normal(jax.random.fold_in(key, drawn[0]), shape, jnp.float32)
        return {"kernel": kernel, "bias": jnp.zeros(outputs, jnp.float32)}

    encoder, decoder = [], []
    width = config.inputs * config.channels
    for size, channels in zip(config.kernels, config.encoder, strict=True):
        encoder.append([layer(size, i, o) for i, o in zip((width, *channels), channels, strict=False)])
        width = channels[-1]
    for kept, channels in zip(reversed(config.encoder), config.decoder, strict=True):
        width += kept[-1] if config.skips else 0
        decoder.append([layer(3, i, o) for i, o in zip((width, *channels), channels, strict=False)])
        width = channels[-1]
    if config.skips:
        width += config.inputs * config.channels
    # The first output is near zero: a difference then predicts the start itself.
    return {"encoder": encoder, "decoder": decoder, "head": layer(3, width, config.channels, gain=1e-4)}


def fold(params: Params, config: Autoencoder) -> Params:
    """The weights as `apply_folded` reads them: linear in them, so gradients pass through.

    Args:
        params: of `init`.
        config: their architecture.
    """
    folded = {"encoder": [list(level) for level in params["encoder"]], "decoder": [], "head": params["head"]}
    width = config.encoder[-1][-1]
    for level, channels in zip(params["decoder"], config.decoder, strict=True):
        first, *others = level
        up, side = first["kernel"][..., :width, :], first["kernel"][..., width:, :]
        entry = {"kernel": layers.fold_up(up), "bias": first["bias"]}
        if config.skips:
            entry["side"] = side
        folded["decoder"].append([entry, *others])
        width = channels[-1]
    if _in_patches(config):
        folded["encoder"][0] = [_patched(params["encoder"][0][0])]
        folded["head"] = _patched(params["head"])
    return folded


def cast(params: Params, dtype: str) -> Params:
    """Folded weights in the precision to compute in; the first and the last convolution stay float32.

    Inputs and outputs resolve a hundredth of a voxel among hundreds; features do not need to.
    """
    lower: Params = jax.tree.map(lambda w: w.astype(dtype), params)
    (first, *others), *deeper = lower["encoder"]
    del first
    return {**lower, "encoder": [[params["encoder"][0][0], *others], *deeper], "head": params["head"]}


def _patched(layer: Layer) -> Layer:
    return {"kernel": layers.fold_patches(layer["kernel"]), "bias": layer["bias"]}


def _in_patches(config: Autoencoder) -> bool:
    """Whether the finest level is one 3³ convolution a side, which can work on patches."""
    single = len(config.encoder[0]) == len(config.decoder[-1]) == 1
    return single and not config.skips and config.patch == 1 and config.kernels[0] == 3


def apply(
    params: Params, x: Volumes, config: Autoencoder, *, key: PRNGKeyArray | None = None
) -> Float[Array, " n *space"]:
    """The network, as defined at the head of this module.

    Args:
        params: of `init`.
        x: (n, *space, config.inputs), float32.
        config: architecture; static.
        key: drops features, for training; None: all are kept.

    Raises:
        ValueError: for inputs or grids that do not fit the architecture.
    """
    spaces = _checked(x, config)
    given, space = x, x.shape[1:-1]
    inputs = x = _enter(x, config)
    kept = []
    for level in params["encoder"]:
        for layer in level:
            x = _relu(_convolve(x, layer), layer)
        kept.append(x)
        x = layers.pool(x)
    x = _drop(x, config, key)
    for level, space, side in zip(params["decoder"], reversed(spaces[:-1]), reversed(kept), strict=True):
        first, *others = level
        x = layers.upsample(x, space)
        if config.skips:
            side = layers.pad(side, [(0, n - m) for n, m in zip(x.shape[1:-1], space, strict=True)])
            x = jnp.concatenate([x, side], axis=-1)
        x = _relu(layers.crop(_convolve(x, first), space), first)
        for layer in others:
            x = _relu(_convolve(x, layer), layer)
    if config.skips:
        x = jnp.concatenate([x, inputs], axis=-1)
    return _leave(_convolve(x, params["head"]), params["head"], given, config)


def apply_folded(
    params: Params,
    x: Volumes,
    config: Autoencoder,
    *,
    key: PRNGKeyArray | None = None,
    by: Formulation = "direct",
) -> Float[Array, " n *space"]:
    """`apply`, from the weights of `fold`, in fewer operations.

    Args:
        params: of `fold`, perhaps in another precision (`cast`).
        x, config, key: as in `apply`.
        by: see `layers.convolve`; static.
    """
    spaces = _checked(x, config)
    inputs = _enter(x, config)
    deepest, kept = _encode_folded(params, inputs, config, by)
    y = _drop(deepest, config, key)
    for depth, (level, space, side) in enumerate(
        zip(params["decoder"], reversed(spaces[:-1]), reversed(kept), strict=True)
    ):
        first, *others = level
        y = layers.convolve_up(y, first["kernel"], space, by=by)
        if _in_patches(config) and depth == len(spaces) - 2:
            return _leave_in_patches(_relu(y, first), params["head"], space, by)
        y = layers.from_shifted(y, space)
        if config.skips:
            y = y + layers.convolve(side, first["side"], by=by)
        y = _relu(y, first)
        for layer in others:
            y = _relu(_convolve(y, layer, by), layer)
    if config.skips:
        y = jnp.concatenate([y.astype(inputs.dtype), inputs], axis=-1)
    return _leave(_convolve(y, params["head"], by), params["head"], x, config)


def _encode_folded(params: Params, x: Volumes, config: Autoencoder, by: Formulation) -> tuple[Volumes, list[Volumes]]:
    """Features of the bottleneck, and of each level before its pooling."""
    dtype = params["decoder"][0][0]["kernel"].dtype
    kept = []
    for depth, level in enumerate(params["encoder"]):
        if _in_patches(config) and depth == 0:
            (layer,) = level
            space = x.shape[1:-1]
            x = layers.convolve(layers.shifted_patches(x), layer["kernel"], same=False, by=by)
            # A maximum and a rectifier commute, and both are cheaper on an eighth of the numbers.
            x = layers.crop(layers.pool_patches(x, config.dimensions), [n // 2 for n in space])
            x = _relu(x, layer).astype(dtype)
            kept.append(x)
            continue
        for layer in level:
            x = _relu(_convolve(x, layer, by), layer).astype(dtype)
        kept.append(x)
        x = layers.pool(x)
    return x, kept


def _checked(x: Volumes, config: Autoencoder) -> list[tuple[int, ...]]:
    if x.ndim != config.dimensions + 2 or x.shape[-1] != config.inputs:
        raise ValueError(
            f"x: expected shape (n, {config.dimensions} axes of space, {config.inputs} channels), given {x.shape}"
        )
    return config.spaces(x.shape[1:-1])


def _convolve(x: Volumes, layer: Layer, by: Formulation = "direct") -> Volumes:
    """In the precision of the kernel."""
    return layers.convolve(x.astype(layer["kernel"].dtype), layer["kernel"], by=by)


def _relu(x: Volumes, layer: Layer) -> Volumes:
    # In float32, so that a bias's gradient, a sum over all voxels, is summed up in float32 too.
    return jax.nn.relu(x.astype(jnp.float32) + _spread(layer["bias"], x).astype(jnp.float32)).astype(x.dtype)


def _spread(bias: Float[Array, " o"], x: Volumes) -> Float[Array, " c"]:
    """A bias for channels that hold the voxels of a patch."""
    return jnp.tile(bias, x.shape[-1] // bias.shape[0])


def _drop(x: Volumes, config: Autoencoder, key: PRNGKeyArray | None) -> Volumes:
    if key is None or config.dropout == 0:
        return x
    stays = jax.random.bernoulli(key, 1 - config.dropout, x.shape)
    return jnp.where(stays, x / (1 - config.dropout), 0).astype(x.dtype)


def _enter(x: Volumes, config: Autoencoder) -> Volumes:
    if config.patch == 1:
        return x
    return layers.patches(layers.pad(x, [(0, -n % 2) for n in x.shape[1:-1]]))


def _leave(x: Volumes, head: Layer, given: Volumes, config: Autoencoder) -> Float[Array, " n *space"]:
    y = x.astype(jnp.float32) + head["bias"].astype(jnp.float32)
    if config.patch == 2:
        y = layers.crop(layers.unpatch(y), given.shape[1:-1])
    return y[..., 0]


def _leave_in_patches(x: Volumes, head: Layer, space: tuple[int, ...], by: Formulation) -> Float[Array, " n *space"]:
    """The paper's head: from shifted patches to plain ones."""
    d = len(space)
    x = x.astype(head["kernel"].dtype)
    inside = jnp.asarray(np.repeat(layers.inside_shifted(space), x.shape[-1] // 2**d, axis=-1), x.dtype)
    x = layers.pad(x * inside, [(0, n % 2) for n in space])
    y = layers.convolve(x, head["kernel"], same=False, by=by)
    y = y.astype(jnp.float32) + _spread(head["bias"], y).astype(jnp.float32)
    return layers.crop(layers.unpatch(y), space)[..., 0]
