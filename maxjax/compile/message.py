"""A pytree of arrays as one row of bytes, and back.

Every array that is sent to a device or fetched from it costs as much as a short program, hence one for all.

    pack(tree) = bytes of its leaves, one after the other        unpack(pack(tree), tree) = tree

NumPy's arrays are packed on the host, JAX's on their device, to the same bytes; either side reads what the other wrote.
Leading axes that a batch adds stay rows. Booleans go as bits, eight a byte in the order of `numpy.packbits`.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Shaped, UInt8

Tree = TypeVar("Tree")
# Of NumPy or of JAX.
AnyArray = Any


def pack(tree: Any, *, axes: int = 0) -> UInt8[AnyArray, "*batch bytes"]:
    """The message that holds a pytree.

    Args:
        tree: of arrays, all on the host or all on a device.
        axes: leading axes that all leaves share, one message for each entry. Static.
    """
    parts = [_bytes_of(leaf, axes) for leaf in jax.tree.leaves(tree)]
    if not parts:
        return np.zeros(0, np.uint8)
    on_device = any(isinstance(part, jax.Array) for part in parts)
    message: UInt8[AnyArray, "*batch bytes"] = (jnp if on_device else np).concatenate(parts, axis=-1)
    return message


def unpack(message: UInt8[AnyArray, "*batch bytes"], like: Tree) -> Tree:
    """The pytree that a message holds; where the message has leading axes, so have its leaves.

    Args:
        message: from `pack`.
        like: the pytree without leading axes: arrays, or `jax.ShapeDtypeStruct`. Only shapes and dtypes are read.

    Raises:
        ValueError: unless the message is as long as `like` is.
    """
    leaves, structure = jax.tree.flatten(like)
    ends = [0, *itertools.accumulate(_size_of(leaf) for leaf in leaves)]
    if message.shape[-1] != ends[-1]:
        raise ValueError(f"message: expected {ends[-1]} bytes, given {message.shape[-1]}")
    parts = (message[..., a:b] for a, b in itertools.pairwise(ends))
    tree: Tree = jax.tree.unflatten(structure, [_leaf_of(part, leaf) for part, leaf in zip(parts, leaves, strict=True)])
    return tree


def size_of(like: Any) -> int:
    """Bytes of the message that holds a pytree, of which only shapes and dtypes are read."""
    return sum(map(_size_of, jax.tree.leaves(like)))


def _size_of(like: Any) -> int:
    """Bytes of a leaf."""
    count: int = math.prod(like.shape)
    return -(-count // 8) if like.dtype == bool else count * int(np.dtype(like.dtype).itemsize)


def _bytes_of(leaf: Shaped[AnyArray, "..."], axes: int) -> UInt8[AnyArray, "*batch bytes"]:
    on_device = isinstance(leaf, jax.Array)
    rows, count = leaf.shape[:axes], math.prod(leaf.shape[axes:])
    if leaf.dtype == bool:
        flat = leaf.reshape(*rows, count)
        return (jnp if on_device else np).packbits(flat, axis=-1)
    size = np.dtype(leaf.dtype).itemsize
    if not on_device:
        return np.ascontiguousarray(leaf).reshape(*rows, count).view(np.uint8)
    if jnp.iscomplexobj(leaf):
        leaf = jnp.stack([leaf.real, leaf.imag], axis=-1)
    return lax.bitcast_convert_type(leaf, jnp.uint8).reshape(*rows, count * size)


def _leaf_of(part: UInt8[AnyArray, "*batch bytes"], like: Any) -> Shaped[AnyArray, "..."]:
    on_device = isinstance(part, jax.Array)
    shape, dtype = (*part.shape[:-1], *like.shape), np.dtype(like.dtype)
    if dtype.kind == "b":
        unpacked = (jnp if on_device else np).unpackbits(part, axis=-1, count=math.prod(like.shape))
        return (unpacked > 0 if on_device else unpacked.view(bool)).reshape(shape)
    if not on_device:
        return np.ascontiguousarray(part).view(dtype).reshape(shape)
    if dtype.kind == "c":
        real, imaginary = jnp.moveaxis(_floats(part, np.dtype(f"f{dtype.itemsize // 2}")).reshape(*shape, 2), -1, 0)
        return lax.complex(real, imaginary)
    return _floats(part, dtype).reshape(shape)


def _floats(part: UInt8[Array, "*batch bytes"], dtype: np.dtype[Any]) -> Shaped[Array, "*batch numbers"]:
    """Bytes as numbers of a type."""
    *rows, count = part.shape
    words = part.reshape(*rows, count // dtype.itemsize, dtype.itemsize) if dtype.itemsize > 1 else part
    return lax.bitcast_convert_type(words, dtype)
