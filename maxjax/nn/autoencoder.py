"""Convolutional autoencoders, as pure functions of their weights.

    encoder level:  x ← relu(conv(x)), once or more;  keep x;  x ← maxpool(x)
    decoder level:  x ← upsample(x), with what was kept;  x ← relu(conv(x)), once or more
    head:           y = conv(x), one number a voxel

`PAPER` is the network of Bong and Beltrame (arXiv 2605.10880, section III-B): five levels of one 3³ convolution,
nothing kept, 101 → 50 → 25 → 12 → 6 → 3 voxels and back, 4,121,409 weights; a voxel of its bottleneck sees 94.
`PAPER_2D` is the planar original with kernels from 11² to 3², and `PAPER_LARGE` the same kernels in three dimensions.
The paper does not list them; of the sequences that fall from 11 to 3, 11-11-7-5-3 in the encoder with its 3³ decoder
comes to 6.26 million weights, where the paper says 6.25.

`MAXJAX` keeps encoder features for the decoder, and works on blocks of 2³ voxels: they enter as channels of a grid of
51³ and leave as its channels. The finest grid, where most of the work of the paper's network is, then holds no
features.

`apply` is the definition. `apply_folded` is the same function to rounding, with kernels folded as `nn.layers` tells: no
volume is upsampled, and the paper's finest level too works on blocks.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from maxjax.fields.gradient import smooth
from maxjax.nn import layers
from maxjax.nn.encoding import FLOOD_CHANNELS, JOINED, Start
from maxjax.nn.layers import Formulation, Volumes

# Standard deviation of the smoothing behind a coarse output [voxels].
_SPREAD = 1.0

# Layers of `{"kernel", "bias"}`: lists of levels in "encoder" and "decoder", one in "head".
Params = dict[str, Any]
Layer = dict[str, Array]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Autoencoder:
    """Architecture; static.

    Attributes:
        encoder: for each level, finest first, the channels behind each of its convolutions.
        decoder: the same, coarsest first; as many levels.
        kernels: taps along an axis of the encoder's convolutions, level by level; all others have 3.
        dimensions: of the grid.
        start: what the output is added to (`nn.encoding`).
        flood: whether the inputs tell how a flood from the goal spreads.
        skips: whether encoder features are kept for the decoder.
        block: edge of the blocks that enter and leave as channels [voxels], 1 or 2.
        coarse: whether one number is said for each block. Its voxels repeat it, smoothed along free ways only: this
            upsampling does not reach through walls, which the inputs must tell.
        dropout: share of the bottleneck's features that training drops.

    Raises:
        ValueError: for levels that do not match, or values out of range.
    """

    encoder: tuple[tuple[int, ...], ...]
    decoder: tuple[tuple[int, ...], ...]
    kernels: tuple[int, ...]
    dimensions: int = 3
    start: Start = "nothing"
    flood: bool = False
    skips: bool = False
    block: int = 1
    coarse: bool = False
    dropout: float = 0.1

    def __post_init__(self) -> None:
        if not len(self.encoder) == len(self.decoder) == len(self.kernels) or not all((*self.encoder, *self.decoder)):
            raise ValueError(
                "Autoencoder: expected encoder, decoder and kernels of as many levels, with a convolution in each, "
                f"given {self.encoder}, {self.decoder} and {self.kernels}"
            )
        if self.block not in (1, 2) or not 0 <= self.dropout < 1 or min(self.kernels) % 2 == 0:
            raise ValueError(
                "Autoencoder: expected blocks of 1 or 2, odd kernels and a dropout below 1, given "
                f"{self.block}, {self.kernels} and {self.dropout}"
            )
        if self.coarse and not (self.block == 2 and self.flood and self.dimensions == 3):
            raise ValueError(
                "Autoencoder: expected blocks of 2 in three dimensions, and the flood among the inputs, for a coarse "
                f"output, given {self.block}, {self.dimensions} and {self.flood}"
            )

    @property
    def inputs(self) -> int:
        """Channels given for each voxel."""
        return 1 + FLOOD_CHANNELS * self.flood

    @property
    def channels(self) -> int:
        """Channels that enter with a block for each input: its voxels."""
        return int(self.block**self.dimensions)

    @property
    def outputs(self) -> int:
        """Channels that leave with a block."""
        return 1 if self.coarse else self.channels

    def spaces(self, space: tuple[int, ...]) -> list[tuple[int, ...]]:
        """The grid of each level, finest first, and of the bottleneck.

        Raises:
            ValueError: for a grid that is too small for the number of poolings, or of another dimension.
        """
        found = [tuple(-(-n // self.block) for n in space)]
        for _ in self.encoder:
            found.append(tuple(n // 2 for n in found[-1]))
        if len(space) != self.dimensions or min(found[-1]) < 1:
            least = self.block * 2 ** len(self.encoder)
            raise ValueError(
                f"grid: expected {self.dimensions} dimensions of at least {least} voxels for {len(self.encoder)} "
                f"poolings, given {space}"
            )
        return found


_PAPER = ((16,), (32,), (64,), (128,), (256,))
_BACK = ((256,), (128,), (64,), (32,), (16,))
_LARGE = (11, 11, 7, 5, 3)

PAPER = Autoencoder(_PAPER, _BACK, (3,) * 5)
PAPER_DIFFERENCE = dataclasses.replace(PAPER, start="free")
PAPER_2D = Autoencoder(_PAPER, _BACK, _LARGE, dimensions=2)
PAPER_LARGE = Autoencoder(_PAPER, _BACK, _LARGE)
MAXJAX = Autoencoder(
    encoder=((32,), (48, 48), (96, 96), (128, 128)),
    decoder=((128, 128), (96, 96), (48, 48), (32,)),
    kernels=(3,) * 4,
    start="free",
    flood=True,
    skips=True,
    block=2,
    dropout=0.0,
)


def init(key: PRNGKeyArray, config: Autoencoder) -> Params:
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
    # An output near zero to begin with: for a difference, the start itself.
    return {"encoder": encoder, "decoder": decoder, "head": layer(3, width, config.outputs, gain=1e-4)}


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
    if _in_blocks(config):
        folded["encoder"][0] = [_blocked(params["encoder"][0][0])]
        folded["head"] = _blocked(params["head"])
    return folded


def cast(params: Params, dtype: str) -> Params:
    """Folded weights in the precision to compute in; the first and the last convolution stay float32.

    What enters and leaves is as fine as a hundredth of a voxel among hundreds, and features are not.
    """
    lower: Params = jax.tree.map(lambda w: w.astype(dtype), params)
    (first, *others), *deeper = lower["encoder"]
    del first
    return {**lower, "encoder": [[params["encoder"][0][0], *others], *deeper], "head": params["head"]}


def _blocked(layer: Layer) -> Layer:
    return {"kernel": layers.fold_blocks(layer["kernel"]), "bias": layer["bias"]}


def _in_blocks(config: Autoencoder) -> bool:
    """Whether the finest level is one plain convolution a side, which blocks can take over."""
    single = len(config.encoder[0]) == len(config.decoder[-1]) == 1
    return single and not config.skips and config.block == 1 and config.kernels[0] == 3


def apply(
    params: Params, x: Volumes, config: Autoencoder, *, key: PRNGKeyArray | None = None
) -> Float[Array, " n *space"]:
    """The network, as the head of this module defines it.

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
    given = x
    inputs = x = _enter(x, config)
    whole, dtype = _in_blocks(config), params["decoder"][0][0]["kernel"].dtype
    kept = []
    for depth, level in enumerate(params["encoder"]):
        if whole and depth == 0:
            (layer,) = level
            space = x.shape[1:-1]
            x = layers.convolve(layers.shifted_blocks(x), layer["kernel"], same=False, by=by)
            # A maximum and a rectifier commute, and both are cheaper on an eighth of the numbers.
            x = layers.crop(layers.pool_blocks(x, config.dimensions), [n // 2 for n in space])
            x = _relu(x, layer).astype(dtype)
            kept.append(x)
            continue
        for layer in level:
            x = _relu(_convolve(x, layer, by), layer).astype(dtype)
        kept.append(x)
        x = layers.pool(x)
    x = _drop(x, config, key)
    for depth, (level, space, side) in enumerate(
        zip(params["decoder"], reversed(spaces[:-1]), reversed(kept), strict=True)
    ):
        first, *others = level
        x = layers.convolve_up(x, first["kernel"], space, by=by)
        if whole and depth == len(spaces) - 2:
            return _leave_in_blocks(_relu(x, first), params["head"], space, by)
        x = layers.from_shifted(x, space)
        if config.skips:
            x = x + layers.convolve(side, first["side"], by=by)
        x = _relu(x, first)
        for layer in others:
            x = _relu(_convolve(x, layer, by), layer)
    if config.skips:
        x = jnp.concatenate([x.astype(inputs.dtype), inputs], axis=-1)
    return _leave(_convolve(x, params["head"], by), params["head"], given, config)


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
    """A bias for channels that hold the voxels of a block."""
    return jnp.tile(bias, x.shape[-1] // bias.shape[0])


def _drop(x: Volumes, config: Autoencoder, key: PRNGKeyArray | None) -> Volumes:
    if key is None or config.dropout == 0:
        return x
    stays = jax.random.bernoulli(key, 1 - config.dropout, x.shape)
    return jnp.where(stays, x / (1 - config.dropout), 0).astype(x.dtype)


def _enter(x: Volumes, config: Autoencoder) -> Volumes:
    if config.block == 1:
        return x
    return layers.blocks(layers.pad(x, [(0, -n % 2) for n in x.shape[1:-1]]))


def _leave(x: Volumes, head: Layer, given: Volumes, config: Autoencoder) -> Float[Array, " n *space"]:
    y = x.astype(jnp.float32) + head["bias"].astype(jnp.float32)
    if config.coarse:
        y = jnp.tile(y, config.channels)
    if config.block == 2:
        y = layers.crop(layers.unblock(y), given.shape[1:-1])
    y = y[..., 0]
    if config.coarse:
        y = jax.vmap(functools.partial(smooth, sigma=_SPREAD))(y, given[..., JOINED] > 0)
    return y


def _leave_in_blocks(x: Volumes, head: Layer, space: tuple[int, ...], by: Formulation) -> Float[Array, " n *space"]:
    """The paper's head: from shifted blocks to plain ones."""
    d = len(space)
    x = x.astype(head["kernel"].dtype)
    inside = jnp.asarray(np.repeat(layers.inside_shifted(space), x.shape[-1] // 2**d, axis=-1), x.dtype)
    x = layers.pad(x * inside, [(0, n % 2) for n in space])
    y = layers.convolve(x, head["kernel"], same=False, by=by)
    y = y.astype(jnp.float32) + _spread(head["bias"], y).astype(jnp.float32)
    return layers.crop(layers.unblock(y), space)[..., 0]


MAXJAX_BLIND = dataclasses.replace(MAXJAX, flood=False)
# Compressed: half the channels; and, besides, one number a block of 2³ voxels.
MAXJAX_SLIM = dataclasses.replace(
    MAXJAX,
    encoder=((16,), (24, 24), (48, 48), (64, 64)),
    decoder=((64, 64), (48, 48), (24, 24), (16,)),
)
MAXJAX_HALF = dataclasses.replace(MAXJAX_SLIM, coarse=True)

# Trains in seconds, for trying things out.
TINY = dataclasses.replace(MAXJAX, encoder=((4,), (8,)), decoder=((8,), (4,)), kernels=(3, 3))

CONFIGS: dict[str, Autoencoder] = {
    "paper": PAPER,
    "paper_difference": PAPER_DIFFERENCE,
    "paper2d": PAPER_2D,
    "paper_large": PAPER_LARGE,
    "maxjax": MAXJAX,
    "maxjax_slim": MAXJAX_SLIM,
    "maxjax_half": MAXJAX_HALF,
    "maxjax_blind": MAXJAX_BLIND,
    "tiny": TINY,
}
