"""Tasks: a map, starts, goals and distances to keep, checked once.

    u = (x − origin) / spacing        world frame [m] ↦ index coordinates

Ends are taken as float64 and become index coordinates on the host, before anything is rounded to float32: what a device
computes, and hence the path in the map, does not depend on where the map lies in the world.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Shaped, UInt8

from maxjax.core.grid import Grid
from maxjax.core.status import Closure
from maxjax.core.voxel_map import VoxelMap, check_map
from maxjax.planning.problem.distances import Distances, numbers_of

# Of one map or several.
Volume = Bool[np.ndarray, "..."]
# Which problems of a task.
Rows = slice | Int64[np.ndarray, " rows"]

# Index coordinates of an end that is farther away than this are cut off, which leaves it outside the map: float32 would
# make them infinite.
_FAR = 1e6


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """One planning problem or several, on one grid; made by `Task.of`, which checks everything.

    Attributes:
        map: that all problems share, or a batch of maps; on the host.
        map_of: which of several maps each problem is in.
        starts, goals: [m], in the world frame of the map.
        distances: to keep from obstacles.
        price: n ≥ 1 of each voxel, what a metre costs in it, in place of a law of distance; None: there is none.
    """

    map: VoxelMap
    map_of: Int64[np.ndarray, " b"]
    starts: Float64[np.ndarray, "b 3"]
    goals: Float64[np.ndarray, "b 3"]
    distances: Distances
    price: Float32[np.ndarray, "nx ny nz"] | None = None

    @classmethod
    def of(cls, given: Any, starts: Any, goals: Any, distances: Distances | None = None) -> Task:
        """A task of what a user gave.

        Args:
            given: the map, or one map for each problem.
            starts: (b, 3) [m].
            goals: (b, 3) [m], or one goal (3,) for all starts.
            distances: to keep; None: the default ones.

        Raises:
            ValueError: for anything that cannot be used, with what was expected and what was given.
        """
        where = check_map(given).on_host()
        kept = (Distances() if distances is None else distances).within(where.grid)
        starts = points_of("starts", starts, ("n", 3))
        goals = points_of("goals", goals, (3,) if np.ndim(goals) == 1 else starts.shape)
        if where.batch not in (None, len(starts)):
            raise ValueError(f"map: expected one map, or {len(starts)} maps for as many starts, given {where.batch}")
        law, price = kept.split(where.grid)
        return cls(where, np.arange(len(starts)), starts, np.broadcast_to(goals, starts.shape), law, price)

    def __len__(self) -> int:
        """How many problems there are."""
        return len(self.starts)

    @property
    def grid(self) -> Grid:
        """Of the maps."""
        return self.map.grid

    @functools.cached_property
    def barred(self) -> Volume:
        """Voxels that no path enters, of one map or of several."""
        return np.asarray(self.map.barred)

    @functools.cached_property
    def kept_off(self) -> Volume:
        """Voxels that paths keep off by one voxel, of one map or of several."""
        return np.asarray(self.map.kept_off)

    @functools.cached_property
    def index(self) -> Float64[np.ndarray, "b 2 3"]:
        """Starts and goals in index coordinates; NaN and infinity stay."""
        world = np.stack([self.starts, self.goals], axis=1)
        index = (world - np.array(self.grid.origin)) / self.grid.spacing
        finite: Float64[np.ndarray, "b 2 3"] = np.where(np.isfinite(index), np.clip(index, -_FAR, _FAR), index)
        return finite

    @property
    def ends(self) -> Float32[np.ndarray, "b 2 3"]:
        """`index`, as a device takes it."""
        return self.index.astype(np.float32)

    def some(self, rows: Rows) -> Task:
        """Some of the problems, with the maps as they are: no volume is copied."""
        some = {name: getattr(self, name)[rows] for name in ("map_of", "starts", "goals")}
        found = dataclasses.replace(self, **some)
        # What is known of the map and of the ends holds for the part as well.
        found.__dict__.update(barred=self.barred, kept_off=self.kept_off, index=self.index[rows])
        return found

    def with_ends(self, starts: Float64[np.ndarray, "c 3"], goals: Float64[np.ndarray, "c 3"]) -> Task:
        """Other problems in the same map, at the same distances; of one map.

        Raises:
            ValueError: for a task of several maps, or ends that are no places.
        """
        if self.map.batch is not None:
            raise ValueError(f"task: expected one map, given a batch of {self.map.batch}")
        starts, goals = points_of("starts", starts, ("n", 3)), points_of("goals", goals, starts.shape)
        found = dataclasses.replace(self, map_of=np.zeros(len(starts), np.int64), starts=starts, goals=goals)
        found.__dict__.update(barred=self.barred, kept_off=self.kept_off)
        return found

    @property
    def closures(self) -> UInt8[np.ndarray, "b 2"]:
        """`Closure` of the voxels that the starts and the goals lie in; open for an end outside the map."""
        closed = self.map.closed
        if closed is None:
            return np.zeros((len(self), 2), np.uint8)
        finite = np.isfinite(self.ends).all(axis=2, keepdims=True)
        index = np.floor(np.where(finite, self.ends, -1) + np.float32(0.5)).astype(np.int64)
        inside = np.logical_and.reduce((index >= 0) & (index < np.array(self.grid.shape)), axis=2)
        x, y, z = np.moveaxis(np.where(inside[..., None], index, 0), 2, 0)
        volume: UInt8[np.ndarray, "..."] = np.asarray(closed)
        found = volume[x, y, z] if volume.ndim == 3 else volume[self.map_of[:, None], x, y, z]
        reasons: UInt8[np.ndarray, "b 2"] = np.where(inside, found, np.uint8(Closure.OPEN))
        return reasons

    def map_at(self, k: int) -> VoxelMap:
        """The map that the k-th problem is in."""
        return self.map if self.map.batch is None else self.map[int(self.map_of[k])]

    def one(self, volumes: Volume, k: int) -> Bool[np.ndarray, "nx ny nz"]:
        """That of `barred` or `kept_off` which the k-th problem is in."""
        return volumes if volumes.ndim == 3 else volumes[self.map_of[k]]

    def stacked(
        self, volumes: Shaped[np.ndarray, "..."]
    ) -> tuple[Shaped[np.ndarray, "m nx ny nz"], Int64[np.ndarray, " b"]]:
        """A volume of one map or of several as a row of maps, and which of them each problem is in."""
        return (volumes[None], np.zeros_like(self.map_of)) if volumes.ndim == 3 else (volumes, self.map_of)

    def each(self, volumes: Volume) -> Bool[np.ndarray, "b nx ny nz"]:
        """Those of `barred` or `kept_off`, one for each problem; views where they are a shared one or in a row."""
        if volumes.ndim == 3:
            return np.broadcast_to(volumes, (len(self), *volumes.shape))
        first, count = int(self.map_of[0]), len(self)
        in_a_row = np.array_equal(self.map_of, np.arange(first, first + count))
        return volumes[first : first + count] if in_a_row else volumes[self.map_of]


def points_of(name: str, given: Any, shape: tuple[int | str, ...], *, least: int = 1) -> Float64[np.ndarray, "*n 3"]:
    """Points [m] as float64; NaN and infinity stay.

    Args:
        name: of the argument, for the message.
        given: what should be points.
        shape: that it must have; a letter stands for any number from `least` on.
        least: the smallest number that a letter stands for.

    Raises:
        ValueError: for another shape, or for what are not real numbers.
    """
    points = numbers_of(name, given)
    fits = len(points.shape) == len(shape) and all(
        n >= least if isinstance(asked, str) else n == asked for n, asked in zip(points.shape, shape, strict=True)
    )
    if not fits or points.dtype.kind not in "iuf":
        letters = [asked for asked in shape if isinstance(asked, str)]
        expected = "(" + ", ".join(map(str, shape)) + (",)" if len(shape) == 1 else ")")
        expected += f" with {letters[0]} >= {least}" if letters and least else ""
        raise ValueError(f"{name}: expected numbers of shape {expected} [m], given {points.dtype} {points.shape}")
    return points.astype(np.float64)
