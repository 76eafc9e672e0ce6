"""The completion network over the bits of scans: its loss and what it predicts.

loss = mean over unseen voxels of −log P(what is there)
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray, UInt8

from experiments.completion.scenes import GROUND, OCCUPIED, SEEN_FREE, SEEN_OCCUPIED
from maxjax.nn.completion import CompletionNet, Params, completion_logits

TINY_NETWORK = CompletionNet((8, 8))


def inputs_of(bits: UInt8[Array, "*b nx ny nz"]) -> Bool[Array, "*b nx ny nz 3"]:
    """What the network is given."""
    return jnp.stack([(bits & bit) > 0 for bit in (SEEN_OCCUPIED, SEEN_FREE, GROUND)], axis=-1)


def unseen_in(bits: UInt8[Array, "*b nx ny nz"]) -> Bool[Array, "*b nx ny nz"]:
    """Voxels that nobody saw, ground left out, which is known."""
    return (bits & (SEEN_OCCUPIED | SEEN_FREE | GROUND)) == 0


def loss(params: Params, bits: UInt8[Array, "b nx ny nz"], network: CompletionNet) -> Float[Array, ""]:
    """Mean of −log P(what is there) over the unseen voxels of a batch."""
    y, there = completion_logits(params, inputs_of(bits), network), (bits & OCCUPIED) > 0
    each = jax.nn.softplus(jnp.where(there, -y, y))
    unseen = unseen_in(bits)
    return jnp.sum(jnp.where(unseen, each, 0)) / jnp.maximum(jnp.sum(unseen), 1)


def turn(bits: UInt8[Array, "n n nz"], key: PRNGKeyArray) -> UInt8[Array, "n n nz"]:
    """One of the eight symmetries of a scan about the vertical."""
    mirror_x, mirror_y, swap = jax.random.bernoulli(key, 0.5, (3,))
    bits = jnp.where(mirror_x, jnp.flip(bits, 0), bits)
    bits = jnp.where(mirror_y, jnp.flip(bits, 1), bits)
    return jnp.where(swap, jnp.swapaxes(bits, 0, 1), bits)
