"""The completion network: P(occupied) of voxels that nobody saw, from what was seen.

x = (seen occupied, seen free, ground) of all layers of a column, patch² columns a site
y ← y + W₂ ∗ φ(n(W₁ ∗ φ(n(y))))            blocks at strides 1, 2, 4, …, down and up again, skips added
n(y) = g y / rms(y),   φ = max(·, 0)        last: logit of P for each layer and column of a site
loss = mean over unseen voxels of −log P(what is there)

Buildings stand upright, so that convolutions run over the ground and heights are channels: a scan costs some thirtieth
of what it does with convolutions in three dimensions.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, PRNGKeyArray, UInt8

from experiments.completion.scenes import GRID, GROUND, OCCUPIED, SEEN_FREE, SEEN_OCCUPIED

Params = dict[str, Any]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class CompletionNet:
    """Widths; static.

    Attributes:
        widths: channels at each stride.
        patch: columns along an edge of a site.
        layers: of voxels.
    """

    widths: tuple[int, ...]
    patch: int = 2
    layers: int = GRID.shape[2]

    @property
    def multiple(self) -> int:
        """Of columns along an edge that a map is filled up to."""
        return int(self.patch * 2 ** (len(self.widths) - 1))


NETWORK = CompletionNet((64, 96, 128, 128))
TINY_NETWORK = CompletionNet((8, 8))


def inputs_of(bits: UInt8[Array, "*b nx ny nz"]) -> Float[Array, "*b nx ny nz 3"]:
    """What the network is given."""
    return jnp.stack([(bits & bit) > 0 for bit in (SEEN_OCCUPIED, SEEN_FREE, GROUND)], axis=-1).astype(jnp.float32)


def unseen_in(bits: UInt8[Array, "*b nx ny nz"]) -> Bool[Array, "*b nx ny nz"]:
    """Voxels that nobody saw, ground left out, which is known."""
    return (bits & (SEEN_OCCUPIED | SEEN_FREE | GROUND)) == 0


def start(network: CompletionNet, key: PRNGKeyArray) -> Params:
    """Weights before the first step: of variance 2 / inputs, the second ones of a block zero."""
    keys = (jax.random.fold_in(key, k) for k in itertools.count())
    site, widths = network.patch**2 * network.layers, network.widths

    def kernel(size: int, given: int, made: int) -> Array:
        return jax.random.normal(next(keys), (size, size, given, made)) * math.sqrt(2 / (size**2 * given))

    def block(width: int) -> Params:
        return {"scale": jnp.ones((2, width)), "first": kernel(3, width, width), "last": 0 * kernel(3, width, width)}

    return {
        "enter": kernel(1, 3 * site, widths[0]),
        "down": [block(width) for width in widths],
        "narrow": [kernel(2, a, b) for a, b in itertools.pairwise(widths)],
        "widen": [kernel(1, b, a) for a, b in itertools.pairwise(widths)],
        "up": [block(width) for width in widths],
        "leave": {"scale": jnp.ones(widths[0]), "kernel": 0 * kernel(1, widths[0], site), "bias": jnp.zeros(site)},
    }


def logits(params: Params, bits: UInt8[Array, "b nx ny nz"], network: CompletionNet) -> Float[Array, "b nx ny nz"]:
    """Log P / (1 − P) of each voxel, seen or not.

    Args:
        params: of `start`.
        bits: of scans, as many layers as the network has; what is there is not read.
        network: static.
    """
    _, nx, ny, _ = bits.shape
    filled = jnp.pad(bits, ((0, 0), *((0, -n % network.multiple) for n in (nx, ny)), (0, 0)))
    x = inputs_of(filled)
    y = _to_sites(x.reshape(*x.shape[:3], -1), network)
    y = _convolve(y, params["enter"])
    kept = []
    for level, weights in enumerate(params["down"]):
        y = _convolve(y, params["narrow"][level - 1], 2) if level else y
        y = _block(weights, y)
        kept.append(y)
    for level in reversed(range(len(network.widths))):
        if level < len(network.widths) - 1:
            wide = _convolve(y, params["widen"][level])
            y = kept[level] + wide.repeat(2, axis=1).repeat(2, axis=2)
        y = _block(params["up"][level], y)
    last = params["leave"]
    y = _convolve(_activate(y, last["scale"]), last["kernel"]) + last["bias"]
    return _to_columns(y, network)[:, :nx, :ny]


def _block(weights: Params, y: Float[Array, "b n m c"]) -> Float[Array, "b n m c"]:
    inner = _convolve(_activate(y, weights["scale"][0]), weights["first"])
    return y + _convolve(_activate(inner, weights["scale"][1]), weights["last"])


def _activate(y: Float[Array, "b n m c"], scale: Float[Array, " c"]) -> Float[Array, "b n m c"]:
    return jax.nn.relu(scale * y * lax.rsqrt(jnp.mean(y * y, axis=-1, keepdims=True) + 1e-6))


def _convolve(y: Float[Array, "b n m c"], kernel: Float[Array, "k l c d"], stride: int = 1) -> Float[Array, "b i j d"]:
    return lax.conv_general_dilated(y, kernel, (stride, stride), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC"))


def _to_sites(x: Float[Array, "b nx ny c"], network: CompletionNet) -> Float[Array, "b n m d"]:
    """Columns of a site side by side in its channels."""
    b, nx, ny, c = x.shape
    p = network.patch
    return x.reshape(b, nx // p, p, ny // p, p, c).transpose(0, 1, 3, 2, 4, 5).reshape(b, nx // p, ny // p, -1)


def _to_columns(y: Float[Array, "b n m d"], network: CompletionNet) -> Float[Array, "b nx ny nz"]:
    """The inverse."""
    b, n, m, _ = y.shape
    p = network.patch
    return y.reshape(b, n, m, p, p, -1).transpose(0, 1, 3, 2, 4, 5).reshape(b, n * p, m * p, -1)


def probability(params: Params, bits: UInt8[Array, "nx ny nz"], network: CompletionNet) -> Float[Array, "nx ny nz"]:
    """P(occupied) of one scan: 1 and 0 where that was seen, the network's where it was not."""
    guessed = jax.nn.sigmoid(logits(params, bits[None], network)[0])
    known = (bits & (SEEN_OCCUPIED | GROUND)) > 0
    return jnp.where(unseen_in(bits), guessed, known.astype(jnp.float32))


def loss(params: Params, bits: UInt8[Array, "b nx ny nz"], network: CompletionNet) -> Float[Array, ""]:
    """Mean of −log P(what is there) over the unseen voxels of a batch."""
    y, there = logits(params, bits, network), (bits & OCCUPIED) > 0
    each = jax.nn.softplus(jnp.where(there, -y, y))
    unseen = unseen_in(bits)
    return jnp.sum(jnp.where(unseen, each, 0)) / jnp.maximum(jnp.sum(unseen), 1)


def turn(bits: UInt8[Array, "n n nz"], key: PRNGKeyArray) -> UInt8[Array, "n n nz"]:
    """One of the eight symmetries of a scan about the vertical."""
    mirror_x, mirror_y, swap = jax.random.bernoulli(key, 0.5, (3,))
    bits = jnp.where(mirror_x, jnp.flip(bits, 0), bits)
    bits = jnp.where(mirror_y, jnp.flip(bits, 1), bits)
    return jnp.where(swap, jnp.swapaxes(bits, 0, 1), bits)
