"""The completion network: P(occupied) of voxels that nobody saw, from what was seen.

x = (seen occupied, seen free, ground) → convolutions with skips (`nn.autoencoder`) → logit of P
loss = mean over unseen voxels of −log P(what is there)
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray, UInt8

from experiments.completion.scenes import GROUND, OCCUPIED, SEEN_FREE, SEEN_OCCUPIED
from maxjax.nn.architecture import Autoencoder
from maxjax.nn.autoencoder import Params, apply_folded, fold, init_params


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class CompletionNet(Autoencoder):
    """An autoencoder that is given three numbers a voxel; static."""

    @property
    def inputs(self) -> int:
        """Channels: seen occupied, seen free, ground."""
        return 3


NETWORK = CompletionNet(
    encoder=((24,), (32, 32), (64, 64), (96, 96)),
    decoder=((96, 96), (64, 64), (32, 32), (24,)),
    kernels=(3,) * 4,
    skips=True,
    patch=2,
    dropout=0.0,
)
TINY_NETWORK = CompletionNet(((4,), (8,)), ((8,), (4,)), (3, 3), skips=True, patch=2, dropout=0.0)


def inputs_of(bits: UInt8[Array, "*b nx ny nz"]) -> Float[Array, "*b nx ny nz 3"]:
    """What the network is given."""
    return jnp.stack([(bits & bit) > 0 for bit in (SEEN_OCCUPIED, SEEN_FREE, GROUND)], axis=-1).astype(jnp.float32)


def unseen_in(bits: UInt8[Array, "*b nx ny nz"]) -> Bool[Array, "*b nx ny nz"]:
    """Voxels that nobody saw, ground left out, which is known."""
    return (bits & (SEEN_OCCUPIED | SEEN_FREE | GROUND)) == 0


def start(network: CompletionNet, key: PRNGKeyArray) -> Params:
    """Weights before the first step."""
    return init_params(key, network)


def logits(params: Params, bits: UInt8[Array, "b nx ny nz"], network: CompletionNet) -> Float[Array, "b nx ny nz"]:
    """Log P / (1 − P) of each voxel, seen or not.

    Args:
        params: of `start`.
        bits: of scans; what is there is not read.
        network: static.
    """
    return apply_folded(fold(params, network), inputs_of(bits), network)


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
