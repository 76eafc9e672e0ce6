"""City scale: one conductivity field over many devices.

    device d of n holds the slab  d N/n ≤ x < (d + 1) N/n  of every volume

There is no second solver: `solve_potential` takes the sharded field as it takes any other. It consists of shifts by one
voxel, of sums over aggregates of two, and of sums and maxima over the whole grid. XLA's partitioner leaves each of them
on its slab: a shift fetches one layer of voxels from the neighbour, a sum over the grid exchanges one number, and an
aggregate lies on one device as long as every slab consists of whole aggregates on every level. Hence the one condition,
that N is a multiple of n · 2^`halvings` along x; along y and z any size will do. φ comes back in the same slabs.

    mesh = city_mesh()
    with jax.set_mesh(mesh):
        potential = jax.jit(solve_potential)(shard_sigma(sigma, mesh), goal_index)

Where the mesh is set, the solver knows of the slabs and exchanges less often (`compile.sharded_volume`): the flood
fetches a word of voxels for every eight rounds, if slabs consist of whole words, and small levels are relaxed by every
device alone.

Many hosts: call `jax.distributed.initialize()` first, in each process; then `jax.devices()` are those of all hosts, and
each process reads and builds its own slabs only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import jax
import numpy as np
import numpy.typing as npt
from jax.sharding import Mesh, NamedSharding
from jaxtyping import Array, Float

from maxjax.compile.sharded_volume import AXIS, SPEC
from maxjax.solvers.aggregation import halvings

Window = tuple[slice, slice, slice]


@runtime_checkable
class Windowed(Protocol):
    """A volume that is read window by window: a NumPy array, a memory map, or an object that computes the window."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Voxels along x, y, z."""

    def __getitem__(self, window: Window, /) -> npt.ArrayLike:
        """The values in this window."""


def city_mesh(devices: Sequence[jax.Device] | None = None) -> Mesh:
    """A row of devices, neighbours along x; by default all there are."""
    return Mesh(np.array(jax.devices() if devices is None else devices), (AXIS,))


def shard_sigma(sigma: Windowed, mesh: Mesh) -> Float[Array, "nx ny nz"]:
    """Conductivity in slabs along x, built slab by slab: no device ever holds the whole, nor does the host have to.

    Args:
        sigma: conductivity (nx, ny, nz), floating; asked once for each slab that this process holds.
        mesh: of `city_mesh`.

    Raises:
        ValueError: for a sigma that is not three-dimensional, or whose slabs are not whole aggregates.
    """
    if len(sigma.shape) != 3:
        raise ValueError(f"sigma: expected shape (nx, ny, nz), given {tuple(sigma.shape)}")
    devices, halved = mesh.shape[AXIS], halvings(sigma.shape)[0]
    if sigma.shape[0] % (devices * 2**halved):
        raise ValueError(
            f"sigma: expected nx a multiple of {devices * 2**halved} ({devices} devices · 2^{halved}), "
            f"given shape {tuple(sigma.shape)}; pad with zeros, which are obstacles"
        )
    slabs = NamedSharding(mesh, SPEC)

    def slab(window: tuple[slice, ...] | None) -> npt.NDArray[np.floating]:
        x, y, z = window or (slice(None),) * 3
        return np.asarray(sigma[x, y, z])

    return jax.make_array_from_callback(tuple(sigma.shape), slabs, slab)
