"""Where a vehicle may hover: places that keep the radius, in air that is joined.

A place is free if all corners of the cell of voxel centres around it are free of the inflated obstacles: then it, and
any straight line in such cells, keeps the radius (`planning.problem.inflation`).
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float64

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.fields.distance import cube_distance
from maxjax.fields.occupancy import squared_distance
from maxjax.planning.problem.inflation import inflate, least_quarters

_CORNERS = np.stack(np.meshgrid(*((0, 1),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclasses.dataclass(frozen=True, eq=False)
class FreeSpace:
    """Voxels whose centres keep the radius.

    Attributes:
        free: of the map, closed ones left out, as far as they are joined to each other.
        open: of the map, closed ones among them: what would be free without rules of the air.
        grid: of the map.
        radius: that is kept [m].
    """

    free: Bool[np.ndarray, "nx ny nz"]
    open: Bool[np.ndarray, "nx ny nz"]
    grid: Grid
    radius: float

    @classmethod
    def of(cls, where: VoxelMap, radius: float, around: Float64[np.ndarray, "3"] | None = None) -> FreeSpace:
        """That of a map.

        Args:
            where: one map.
            radius: to keep [m].
            around: a place in the part that is meant; None: the largest part [m].

        Raises:
            ValueError: if no voxel is free, or none around the place.
        """
        occupied, ground = np.asarray(where.occupied), np.asarray(where.ground)
        least = radius / where.grid.spacing
        keeps = ~np.asarray(_inflated(occupied, ground, least))
        allowed = keeps
        if where.closed is not None:
            allowed = ~np.asarray(_inflated(np.asarray(where.barred), np.asarray(where.kept_off), least))
        if not allowed.any():
            why = "all of it is closed by the rules of the air" if keeps.any() else f"nothing in it keeps {radius:g} m"
            raise ValueError(f"map: expected air to fly in, and {why}")
        return cls(_joined(allowed, where.grid, around), keeps, where.grid, radius)

    def holds(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which places are free [m]."""
        return self._all(self.free, points)

    def closed(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which places would keep the radius but for the rules of the air [m]."""
        return np.asarray(self._all(self.open, points) & ~self._all(self.free, points))

    def _all(self, volume: Bool[np.ndarray, "nx ny nz"], points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether all corners of the cells around places are in a set."""
        index = (points - np.array(self.grid.origin)) / self.grid.spacing
        base = np.floor(index).astype(np.int64)
        # On a plane of centres only those on it count.
        corners = base[:, None] + _CORNERS * (index > base).astype(np.int64)[:, None]
        inside = ((corners >= 0) & (corners < self.grid.shape)).all(axis=(1, 2))
        i, j, k = np.moveaxis(np.where(inside[:, None, None], corners, 0), 2, 0)
        return np.asarray(inside & volume[i, j, k].all(axis=1))


def _joined(
    allowed: Bool[np.ndarray, "nx ny nz"], grid: Grid, around: Float64[np.ndarray, "3"] | None
) -> Bool[np.ndarray, "nx ny nz"]:
    """The largest part of a set that is joined by faces, or that in which a place lies."""
    from scipy import ndimage  # a quarter of a second that most commands can do without

    label, _ = ndimage.label(allowed)
    if around is None:
        return np.asarray(label == 1 + np.argmax(np.bincount(label.ravel())[1:]))
    index = np.round((around - np.array(grid.origin)) / grid.spacing).astype(np.int64)
    inside = bool(((index >= 0) & (index < grid.shape)).all())
    part = int(label[tuple(index)]) if inside else 0
    if part == 0:
        place = ", ".join(f"{x:g}" for x in around.tolist())
        raise ValueError(f"home: expected a place in the map that keeps the radius, given ({place})")
    return np.asarray(label == part)


def _inflated(
    barred: Bool[np.ndarray, "nx ny nz"], kept_off: Bool[np.ndarray, "nx ny nz"], radius: float
) -> Bool[Array, "nx ny nz"]:
    blocked: Bool[Array, "nx ny nz"] = _inflate(jnp.asarray(barred), jnp.asarray(kept_off), radius)
    return blocked


@functools.partial(jax.jit, static_argnames="radius")
def _inflate(
    barred: Bool[Array, "nx ny nz"], kept_off: Bool[Array, "nx ny nz"], radius: float
) -> Bool[Array, "nx ny nz"]:
    quarters = cube_distance(barred & ~kept_off, radius)
    return inflate(quarters, squared_distance(kept_off, 1), least_quarters(radius)) | barred
