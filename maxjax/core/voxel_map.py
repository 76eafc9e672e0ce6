"""The map as a value: which voxels hold something, which are ground, which the rules of the air close, and where.

    map = VoxelMap.of(occupied, spacing=2.0, origin=(-100.0, -100.0, 0.0), ground=ground)

    barred   = occupied or closed       what no path enters
    kept off = ground or closed         what a path keeps off by one voxel, without a radius and without a price

A pytree: arrays are data, the grid is static, so that maps pass through `jit` and `vmap`; batch axes lead.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool, UInt8

from maxjax.core.grid import Grid, Index3, Point3
from maxjax.core.status import Closure
from maxjax.core.terrain import Terrain

Volume = Bool[Array | np.ndarray, "*maps nx ny nz"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class VoxelMap:
    """A map as voxels, or a batch of maps on one grid.

    `VoxelMap.of` and `VoxelMap.on` make one and check it; this constructor takes what it is given.

    Attributes:
        occupied: obstacles and the ground, as seen, not dilated.
        ground: the voxels of `occupied` that are ground.
        closed: `Closure` of voxels that hold nothing; None: the rules of the air close none.
        grid: where the voxels lie. Static.
    """

    occupied: Volume
    ground: Volume
    closed: UInt8[Array | np.ndarray, "*maps nx ny nz"] | None
    grid: Grid = dataclasses.field(metadata={"static": True})

    @classmethod
    def of(
        cls,
        occupied: Any,
        *,
        spacing: float,
        origin: Point3,
        ground: Any = None,
    ) -> VoxelMap:
        """A map of occupied voxels.

        Args:
            occupied: (nx, ny, nz) bool, or (b, nx, ny, nz) for a batch of maps.
            spacing: edge of a voxel [m].
            origin: position of the centre of voxel (0, 0, 0) [m], ENU.
            ground: those that are ground, of occupied's shape, or of one map for all of a batch. None: no voxel is.

        Raises:
            ValueError: if an array is not bool or of another shape, with the expected and the given one; as `Grid`.
        """
        volume = _volume("occupied", occupied)
        nx, ny, nz = volume.shape[-3:]
        return cls.on(Grid((nx, ny, nz), spacing, origin), volume, ground)

    @classmethod
    def on(cls, grid: Grid, occupied: Any, ground: Any = None) -> VoxelMap:
        """A map of occupied voxels on a grid; arguments and errors as those of `of`."""
        if not isinstance(grid, Grid):
            raise ValueError(f"grid: expected a maxjax.Grid, given {type(grid).__name__}")
        volume = _volume("occupied", occupied)
        grid.check_volume("occupied", volume)
        if ground is None:
            return cls(volume, np.broadcast_to(np.zeros(grid.shape, bool), volume.shape), None, grid)
        floor = _volume("ground", ground)
        if floor.shape not in (volume.shape, grid.shape):
            raise ValueError(f"ground: expected shape {volume.shape}, given {floor.shape}")
        if floor.ndim < volume.ndim:
            floor = np.broadcast_to(floor, volume.shape) if isinstance(floor, np.ndarray) else floor[None] & True
        return cls(volume | floor, floor, None, grid)

    @property
    def barred(self) -> Volume:
        """Voxels that no path enters."""
        return self.occupied if self.closed is None else self.occupied | (self.closed != Closure.OPEN)

    @property
    def kept_off(self) -> Volume:
        """Voxels that a path keeps off by one voxel, without a radius and without a price."""
        return self.ground if self.closed is None else self.ground | (self.closed != Closure.OPEN)

    @property
    def shut(self) -> Bool[Array | np.ndarray, "*maps nx ny nz"]:
        """Free voxels that the rules of the air close."""
        return np.zeros_like(self.occupied) if self.closed is None else self.closed != Closure.OPEN

    @property
    def terrain(self) -> Terrain:
        """How high the ground is, as far as its voxels tell.

        Raises:
            ValueError: for a batch of maps.
        """
        if self.batch is not None:
            raise ValueError(f"terrain: expected one map, given a batch of {self.batch}; take one, as map[0]")
        return Terrain.of(np.asarray(self.ground), self.grid)

    @property
    def batch(self) -> int | None:
        """How many maps there are along the leading axis; None for a single map."""
        return None if self.occupied.ndim == 3 else self.occupied.shape[0]

    def __getitem__(self, k: int) -> VoxelMap:
        """The k-th map of a batch.

        Raises:
            IndexError: if there is none.
        """
        if self.batch is None or not -self.batch <= k < self.batch:
            raise IndexError(f"map {k}: expected one of {self.batch or 'a batch of'} maps, given {self.occupied.shape}")
        return VoxelMap(self.occupied[k], self.ground[k], None if self.closed is None else self.closed[k], self.grid)

    def coarser(self, factor: int) -> VoxelMap:
        """One map in voxels `factor` times as wide: occupied, or closed, where any voxel is; ground where only that is.

        Args:
            factor: at least 1.

        Raises:
            ValueError: for a batch of maps, or a factor below 1.
        """
        if self.batch is not None or factor < 1:
            raise ValueError(f"coarser: expected one map and a factor from 1 on, given {self.occupied.shape}, {factor}")
        occupied, ground = np.asarray(self.occupied), np.asarray(self.ground)
        obstacle, floor = (_blocks(np.logical_or, volume, factor) for volume in (occupied & ~ground, ground))
        nx, ny, nz = obstacle.shape
        edge = self.grid.spacing
        x, y, z = (low + 0.5 * edge * (factor - 1) for low in self.grid.origin)
        closed = None if self.closed is None else _blocks(np.maximum, np.asarray(self.closed), factor)
        coarse = VoxelMap(obstacle | floor, floor & ~obstacle, None, Grid((nx, ny, nz), factor * edge, (x, y, z)))
        return coarse if closed is None else coarse.closing(closed)

    def closing(self, reasons: UInt8[np.ndarray, "*maps nx ny nz"]) -> VoxelMap:
        """The map under rules of the air; what holds something stays what it is.

        Args:
            reasons: `Closure` of each voxel.
        """
        closed = np.where(np.asarray(self.occupied), np.uint8(Closure.OPEN), reasons)
        return dataclasses.replace(self, closed=closed)

    def closure_of(self, index: Index3) -> Closure:
        """Why a voxel is closed; OPEN outside the map."""
        inside = all(0 <= i < n for i, n in zip(index, self.grid.shape, strict=True))
        return Closure.OPEN if self.closed is None or not inside else Closure(int(self.closed[index]))

    def on_host(self) -> VoxelMap:
        """The same map in NumPy's arrays."""
        return jax.tree.map(np.asarray, self)  # type: ignore[no-any-return]


def _blocks(join: np.ufunc, volume: np.ndarray, factor: int) -> np.ndarray:
    """A volume joined over blocks of `factor`³ voxels, the last along each axis perhaps smaller."""
    for axis in range(3):
        volume = join.reduceat(volume, np.arange(0, volume.shape[axis], factor), axis=axis)
    return volume


def check_map(given: Any, name: str = "map") -> VoxelMap:
    """The map itself.

    Raises:
        ValueError: if it is no `VoxelMap`, with the call that makes one.
    """
    if not isinstance(given, VoxelMap):
        what = f"an array of shape {np.shape(given)}" if hasattr(given, "shape") else type(given).__name__
        raise ValueError(
            f"{name}: expected a maxjax.VoxelMap, given {what}; make one: "
            "maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(x, y, z), ground=None), or maxjax.load_map(file)"
        )
    return given


def check_single_map(given: Any) -> VoxelMap:
    """The map itself.

    Raises:
        ValueError: as `check_map`, and for a batch.
    """
    where = check_map(given)
    if where.batch is not None:
        raise ValueError(f"map: expected one map, given a batch of {where.batch}; take one, as map[0]")
    return where


def _volume(name: str, given: Any) -> Any:
    """Bool voxels of one map or several; arrays of JAX stay where they are."""
    try:
        volume = given if isinstance(given, jax.Array) else np.asarray(given)
    except (ValueError, TypeError) as error:  # ragged lists
        reason = str(error).splitlines()[0]
        raise ValueError(f"{name}: expected an array, given {type(given).__name__}: {reason}") from error
    if volume.dtype != bool:
        raise ValueError(f"{name}: expected dtype bool, given {volume.dtype}; compare with a threshold first")
    if volume.ndim not in (3, 4):
        raise ValueError(f"{name}: expected shape (nx, ny, nz) or (b, nx, ny, nz), given {volume.shape}")
    return volume
