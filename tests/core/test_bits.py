"""Bits there and back, on the host and on a device."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.bits import pack, unpack, volume


@pytest.mark.parametrize("shape", [(3, 5, 7), (1, 1, 1), (2, 4, 8)])
def test_there_and_back(shape: tuple[int, int, int]) -> None:
    volumes = np.random.default_rng(0).random((4, *shape)) < 0.4
    bits = pack(volumes)
    assert bits.shape == (4, -(-volumes[0].size // 8))
    np.testing.assert_array_equal(unpack(bits, shape), volumes)
    np.testing.assert_array_equal(jax.vmap(lambda b: volume(b, shape))(jnp.asarray(bits)), volumes)
    np.testing.assert_array_equal(jax.vmap(jnp.packbits)(jnp.asarray(volumes)), bits)
    np.testing.assert_array_equal(pack(volumes[0]), bits[0])
