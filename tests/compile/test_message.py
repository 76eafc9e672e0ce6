"""A message holds its pytree: the same bytes from host and device, read back on either side, batched or not."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxjax.compile.message import pack, unpack

DTYPES = ("bool", "uint8", "int8", "uint16", "int16", "float16", "int32", "uint32", "float32", "complex64")
LEAVES = st.lists(
    st.tuples(st.sampled_from(DTYPES), st.lists(st.integers(0, 5), max_size=3).map(tuple)), min_size=1, max_size=5
)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Parcel:
    first: np.ndarray | jax.Array
    others: tuple[np.ndarray | jax.Array, ...]


def parcel_of(leaves: list[tuple[str, tuple[int, ...]]], seed: int, batch: tuple[int, ...] = ()) -> Parcel:
    """Random bits as each type, NaN included; booleans are 0 and 1."""
    rng = np.random.default_rng(seed)

    def leaf(name: str, shape: tuple[int, ...]) -> np.ndarray:
        dtype = np.dtype(name)
        raw = rng.integers(0, 256, (*batch, *shape, dtype.itemsize), np.uint8)
        return (raw[..., 0] % 2 > 0) if name == "bool" else raw.view(dtype)[..., 0]

    first, *others = (leaf(*each) for each in leaves)
    return Parcel(first, tuple(others))


def bits_of(parcel: Parcel) -> list[tuple[tuple[int, ...], np.dtype, bytes]]:
    return [(x.shape, x.dtype, np.asarray(x).tobytes()) for x in jax.tree.leaves(parcel)]


@settings(max_examples=40, deadline=None)
@given(leaves=LEAVES, seed=st.integers(0, 1000))
def test_there_and_back_on_the_host(leaves: list[tuple[str, tuple[int, ...]]], seed: int) -> None:
    parcel = parcel_of(leaves, seed)
    message = pack(parcel)
    assert (message.dtype, message.ndim) == (np.uint8, 1)
    assert bits_of(unpack(message, parcel)) == bits_of(parcel)
    many = parcel_of(leaves, seed, (3,))
    messages = pack(many, axes=1)
    assert messages.shape == (3, message.size)
    assert bits_of(unpack(messages, parcel)) == bits_of(many)
    alone = jax.tree.map(lambda x: x[1, ...], many)
    np.testing.assert_array_equal(messages[1], pack(alone))


@settings(max_examples=15, deadline=None)
@given(leaves=LEAVES, seed=st.integers(0, 1000))
def test_the_device_reads_and_writes_the_same(leaves: list[tuple[str, tuple[int, ...]]], seed: int) -> None:
    parcel = parcel_of(leaves, seed)
    message = pack(parcel)
    on_device = unpack(jnp.asarray(message), parcel)
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(on_device))
    assert bits_of(on_device) == bits_of(parcel)
    np.testing.assert_array_equal(pack(on_device), message)


def test_under_jit_and_vmap_a_batch_equals_its_members() -> None:
    leaves = [("bool", (3, 5, 7)), ("float32", (4, 3)), ("int32", ()), ("bool", ())]
    many, like = parcel_of(leaves, 0, (4,)), parcel_of(leaves, 0)
    messages = pack(many, axes=1)

    @jax.jit
    @jax.vmap
    def there_and_back(message: jax.Array) -> jax.Array:
        return jnp.asarray(pack(unpack(message, like)))

    np.testing.assert_array_equal(there_and_back(messages), messages)


def test_a_message_of_another_length_is_refused() -> None:
    parcel = Parcel(np.zeros(3, np.float32), (np.ones(9, bool),))
    assert pack(parcel).size == 14
    with pytest.raises(ValueError, match="message: expected 14 bytes, given 13"):
        unpack(pack(parcel)[:-1], parcel)
