"""Volumes in slabs along x, one a device, where a mesh of devices is set (`jax.set_mesh`).

XLA's partitioner needs no help to leave a stencil on its slab, but it knows no other way than to fetch a layer of
voxels from the neighbours before every step. What is here lets a program exchange less often: compute small volumes on
every device, or fetch many layers at once and compute the neighbours' part as well for as long as they last.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.sharding import PartitionSpec
from jaxtyping import Array, Bool, Shaped

AXIS = "slabs"
SPEC = PartitionSpec(AXIS, None, None)

Result = TypeVar("Result")
Slab = Shaped[Array, "sx sy sz"]


def slabs() -> int:
    """How many there are; 1 where no mesh with slabs is set, and in `jax.shard_map`, where a device is on its own."""
    mesh = jax.sharding.get_abstract_mesh()
    return 1 if AXIS in mesh.manual_axes else int(mesh.shape.get(AXIS, 1))


def on_every_device(function: Callable[..., Result], *arguments: Any) -> Result:
    """function(*arguments), of whole arrays, on each device alike."""
    if slabs() == 1:
        return function(*arguments)
    # XLA's partitioner would cut up again what is only annotated to lie on each device.
    alone = jax.shard_map(function, in_specs=PartitionSpec(), out_specs=PartitionSpec(), check_vma=False)
    result: Result = alone(*arguments)
    return result


def add_halo(slab: Slab, layers: int) -> Slab:
    """In `jax.shard_map`: the slab between layers of its neighbours; zeros beyond the grid.

    Args:
        slab: no thinner than `layers`.
        layers: from each neighbour. Static.
    """
    return _between(slab[-layers:], slab, slab[:layers])


def refresh_halo(slab: Slab, layers: int) -> Slab:
    """In `jax.shard_map`: a `add_halo` slab whose neighbours' layers are fetched anew."""
    inner = inside(slab, layers)
    return _between(inner[-layers:], inner, inner[:layers])


def inside(slab: Slab, layers: int) -> Slab:
    """A `add_halo` slab without its neighbours' layers."""
    return slab[layers:-layers]


def anywhere(here: Bool[Array, ""]) -> Bool[Array, ""]:
    """In `jax.shard_map`: whether it is so on any device."""
    return jnp.asarray(lax.psum(here.astype(jnp.int32), AXIS) > 0)


def _between(up: Slab, slab: Slab, down: Slab) -> Slab:
    """The slab between what its neighbours hand up and down."""
    pairs = [(i, i + 1) for i in range(lax.axis_size(AXIS) - 1)]
    below = lax.ppermute(up, AXIS, pairs)
    above = lax.ppermute(down, AXIS, [(j, i) for i, j in pairs])
    return jnp.concatenate([below, slab, above])
