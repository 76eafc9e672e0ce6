"""The completion network: P(occupied) of voxels that nobody saw, from what one scan shows.

x = (seen occupied, seen free, ground) of all layers of a column, patch² columns a site
y ← y + W₂ ∗ φ(n(W₁ ∗ φ(n(y))))            blocks at strides 1, 2, 4, …, down and up again, skips added
n(y) = g y / rms(y),   φ = max(·, 0)        last: logit of P for each layer and column of a site

Buildings stand upright, so that convolutions run over the ground and heights are channels: a scan costs some thirtieth
of what it does with convolutions in three dimensions. What was seen stays as it was seen.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.core.grid import Grid
from maxjax.core.serialization import load_pytree, save_pytree
from maxjax.fields.sighting import Sighting

GRID = Grid((96, 96, 40), 2.0, (-96.0, -96.0, -8.0))
"""Around a sensor at x = y = 0, the ground at z = 0 [m]."""

Params = dict[str, Any]
_WEIGHTS = Path(__file__).parent / "weights" / "completion.npz"


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


def init_completion(network: CompletionNet, key: PRNGKeyArray) -> Params:
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


def save_completion(params: Params, path: Path) -> None:
    """Write weights in float16, as `load_completion` reads them."""
    save_pytree(path, jax.tree.map(lambda weights: weights.astype(jnp.float16), params))


@functools.cache
def load_completion() -> Params:
    """The weights that come with maxjax, those of `NETWORK`."""
    shapes = jax.eval_shape(lambda: init_completion(NETWORK, jax.random.key(0)))
    like = jax.tree.map(lambda weights: jax.ShapeDtypeStruct(weights.shape, jnp.float16), shapes)
    found: Params = jax.tree.map(lambda weights: jnp.asarray(weights, jnp.float32), load_pytree(_WEIGHTS, like))
    return found


def completion_logits(
    params: Params, x: Bool[Array, "b nx ny nz 3"], network: CompletionNet
) -> Float[Array, "b nx ny nz"]:
    """Log P / (1 − P) of each voxel, seen or not.

    Args:
        params: of `init_completion`.
        x: whether a voxel was seen occupied, was seen free, is ground; as many layers as the network has.
        network: static.
    """
    b, nx, ny = x.shape[:3]
    over = ((0, -n % network.multiple) for n in (nx, ny))
    filled = jnp.pad(x.reshape(b, nx, ny, -1), ((0, 0), *over, (0, 0))).astype(jnp.float32)
    y = _convolve(_to_sites(filled, network), params["enter"])
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


def complete(
    params: Params, seen: Sighting, ground: Bool[Array, "nx ny nz"], network: CompletionNet = NETWORK
) -> Float[Array, "nx ny nz"]:
    """P(occupied) of one scan: 1 and 0 where that was seen, ground 1, the network's where nobody saw.

    Args:
        params: of `load_completion`.
        seen: what the scan shows.
        ground: voxels of the ground, which is known.
        network: static.
    """
    x = jnp.stack([seen.occupied, seen.free, ground], axis=-1)
    guessed = jax.nn.sigmoid(completion_logits(params, x[None], network)[0])
    return jnp.where(seen.occupied | ground, 1.0, jnp.where(seen.free, 0.0, guessed))


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
