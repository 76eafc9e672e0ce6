"""What a user asks to be planned: a map, starts, goals and distances to keep, checked once.

    u = (x − origin) / spacing        world frame [m] ↦ index coordinates

Ends are taken as float64 and become index coordinates on the host, before anything is rounded to float32: what a device
computes, and hence the path in the map, does not depend on where the map lies in the world.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8

from maxjax.core.grid import Grid
from maxjax.core.status import Closure
from maxjax.fields.price import Price

# Of one map or several.
Volume = Bool[np.ndarray, "..."]
# `Closure` of each voxel of a map.
Reasons = UInt8[np.ndarray, "*closed nx ny nz"]
# Which problems of a task.
Rows = slice | Int64[np.ndarray, " rows"]

# Index coordinates of an end that is farther away than this are cut off, which leaves it outside the map: float32 would
# make them infinite.
_FAR = 1e6


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Distances:
    """How far a path keeps from obstacles, true distances to their cubes; static under `jit`.

    Attributes:
        radius: nothing on the path is nearer than this [m], but around an end that itself stands nearer, where it keeps
            that end's distance; at 0 the path may graze obstacles, and the ground, too.
        margin: from where on a metre costs no more than its length [m].
        price: what it costs below the margin.

    Raises:
        ValueError: for what is not a number, is negative or not finite, or for a margin below the radius.
    """

    radius: float = 1.0
    margin: float = 8.0
    price: Price = Price()  # noqa: RUF009 (frozen)

    def __post_init__(self) -> None:
        for name, given in (("radius", self.radius), ("margin", self.margin)):
            if not 0 <= given < np.inf:
                raise ValueError(f"{name}: expected a finite number of metres, at least 0, given {given}")
        if self.margin < self.radius:
            raise ValueError(f"margin: expected at least the radius, {self.radius:g} m, given {self.margin:g}")

    @classmethod
    def of(cls, radius: Any, margin: Any, price: Any = Price()) -> Distances:  # noqa: B008 (frozen)
        """Distances of what a user gave; raises as the class."""
        if not isinstance(price, Price):
            raise ValueError(f"price: expected a maxjax.Price, given {price!r}")
        return cls(_metres("radius", radius), _metres("margin", margin), price)

    @property
    def room(self) -> float:
        """Half the width of the box around each point of a path that meets free voxels only [voxels]."""
        return 0.5 if self.radius > 0 else 0.0

    def within(self, grid: Grid) -> Distances:
        """The distances themselves.

        Raises:
            ValueError: where one is longer than the map.
        """
        longest = grid.spacing * max(grid.shape)
        for name, given in (("radius", self.radius), ("margin", self.margin)):
            if given > longest:
                raise ValueError(f"{name}: expected at most {longest:g} m, the longest edge of the map, given {given}")
        return self


@dataclasses.dataclass(frozen=True)
class Task:
    """One planning problem or several, on one grid; made by `Task.of`, which checks everything.

    Attributes:
        occupied: occupied voxels, not dilated, and those that are closed to flight; several maps, or one for all
            problems (three axes).
        ground: voxels that a path keeps off without a price, occupied as well: ground, and what is closed; likewise.
        map_of: which of several maps each problem is in.
        starts, goals: [m], in the world frame of `grid`.
        grid: of the maps.
        distances: to keep from obstacles.
        closed: `Closure` of voxels that hold nothing, likewise; None: all is open.
    """

    occupied: Bool[np.ndarray, "*maps nx ny nz"]
    ground: Bool[np.ndarray, "*grounds nx ny nz"]
    map_of: Int64[np.ndarray, " b"]
    starts: Float64[np.ndarray, "b 3"]
    goals: Float64[np.ndarray, "b 3"]
    grid: Grid
    distances: Distances
    closed: UInt8[np.ndarray, "*closed nx ny nz"] | None = None

    @classmethod
    def of(cls, occupied: Any, starts: Any, goals: Any, grid: Any, distances: Distances, ground: Any = None) -> Task:
        """A task of what a user gave.

        Args:
            occupied, grid, distances: as the attributes.
            starts: (b, 3) [m].
            goals: (b, 3) [m], or one goal (3,) for all starts.
            ground: as the attribute. None: no voxel is ground.

        Raises:
            ValueError: for anything that cannot be used, with what was expected and what was given.
        """
        grid = checked_grid(grid)
        distances = distances.within(grid)
        starts = points_of("starts", starts, ("n", 3))
        goals = points_of("goals", goals, (3,) if np.ndim(goals) == 1 else starts.shape)
        return cls(
            _volume("occupied", occupied, grid, len(starts)),
            _volume("ground", np.zeros(grid.shape, bool) if ground is None else ground, grid, len(starts)),
            np.arange(len(starts)),
            starts,
            np.broadcast_to(goals, starts.shape),
            grid,
            distances,
        )

    def closing(self, closed: Reasons) -> Task:
        """The task where some voxels are closed to flight, in each map or in all of them."""
        # What holds something stays what it is.
        held = self.occupied | self.ground
        closed = np.where(held, np.uint8(Closure.OPEN), closed)
        kept_off = self.ground | (closed != Closure.OPEN)
        return dataclasses.replace(self, occupied=held | kept_off, ground=kept_off, closed=closed)

    def __len__(self) -> int:
        """How many problems there are."""
        return len(self.starts)

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
        return dataclasses.replace(self, **some)

    def closures(self) -> list[tuple[Closure, Closure]]:
        """Of the voxels that the starts and the goals lie in; open for an end outside the map."""

        def closure(k: int, end: Float32[np.ndarray, " 3"]) -> Closure:
            index = np.floor(np.where(np.isfinite(end), end, -1) + np.float32(0.5)).astype(np.int64)
            if self.closed is None or not ((index >= 0) & (index < np.array(self.grid.shape))).all():
                return Closure.OPEN
            closed = self.closed if self.closed.ndim == 3 else self.closed[self.map_of[k]]
            return Closure(int(closed[tuple(index)]))

        return [(closure(k, start), closure(k, goal)) for k, (start, goal) in enumerate(self.ends)]

    @property
    def terrain(self) -> Volume:
        """The voxels of `ground` that are ground."""
        return self.ground if self.closed is None else self.ground & (self.closed == Closure.OPEN)

    def map(self, volumes: Volume, k: int) -> Bool[np.ndarray, "nx ny nz"]:
        """That of `occupied` or `ground` which the k-th problem is in."""
        return volumes if volumes.ndim == 3 else volumes[self.map_of[k]]

    def maps(self, volumes: Volume) -> Bool[np.ndarray, "b nx ny nz"]:
        """Those of `occupied` or `ground`, one for each problem; views where they are a shared one or in a row."""
        if volumes.ndim == 3:
            return np.broadcast_to(volumes, (len(self), *volumes.shape))
        first, count = int(self.map_of[0]), len(self)
        in_a_row = np.array_equal(self.map_of, np.arange(first, first + count))
        return volumes[first : first + count] if in_a_row else volumes[self.map_of]


def checked_grid(grid: Any) -> Grid:
    """The grid.

    Raises:
        ValueError: unless it is one.
    """
    if not isinstance(grid, Grid):
        raise ValueError(f"grid: expected a maxjax.Grid, given {grid!r}")
    return grid


def _metres(name: str, given: Any) -> float:
    number = _array(name, given)
    if number.shape != () or number.dtype.kind not in "iuf":
        raise ValueError(f"{name}: expected a number of metres, given {given!r}")
    return float(number)


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
    points = _array(name, given)
    fits = len(points.shape) == len(shape) and all(
        n >= least if isinstance(asked, str) else n == asked for n, asked in zip(points.shape, shape, strict=True)
    )
    if not fits or points.dtype.kind not in "iuf":
        letters = [asked for asked in shape if isinstance(asked, str)]
        expected = "(" + ", ".join(map(str, shape)) + (",)" if len(shape) == 1 else ")")
        expected += f" with {letters[0]} >= {least}" if letters and least else ""
        raise ValueError(f"{name}: expected numbers of shape {expected} [m], given {points.dtype} {points.shape}")
    return points.astype(np.float64)


def _volume(name: str, given: Any, grid: Grid, count: int) -> Bool[np.ndarray, "*batch nx ny nz"]:
    volume = _array(name, given)
    if volume.dtype != bool:
        raise ValueError(f"{name}: expected dtype bool, given {volume.dtype}; compare with a threshold first")
    expected = (count, *grid.shape) if volume.ndim == 4 else grid.shape
    if volume.shape != expected:
        raise ValueError(f"{name}: expected shape {expected}, given {volume.shape}")
    return volume


def _array(name: str, given: Any) -> np.ndarray:
    try:
        return np.asarray(given)
    except (ValueError, TypeError) as error:  # ragged lists; arrays that are traced
        reason = str(error).splitlines()[0]
        raise ValueError(f"{name}: expected an array, given {type(given).__name__}: {reason}") from error
