"""A city of one's own to fly in: a map file's voxels as solids (`sim.worlds.voxel_city`), and ends in its free air.

Ends of trial i are the first pair, in a fixed order, of 4,096 that are drawn by a key of file, seed and i: a start that
is uniform over all clear columns, and a goal that is uniform around it, such that

- both stand in clear columns: within what the file covers, 10 m or more, horizontally, from every column in which
  something stands, and 40 m or less from the nearest one;
- both are 3 to 15 m above the ground of their column, and 50 to 80 m apart (straight line in 3D);
- they are connected in the map dilated by 2 m, the ground by one voxel: both in its largest component of free voxels.
  Pairs that are not are rejected and counted, before any flight.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int64

from maxjax.core.grid import Point3
from maxjax.core.rng_streams import named_key
from maxjax.io import Window, map_of, read_map
from maxjax.io.load import LoadedMap
from maxjax.io.reading import PLAIN, Reading
from maxjax.sim.trials.trials import APART, CLEARANCE, DILATION, HEIGHT, Trial
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.voxel_city import Columns, VoxelCity

Ends = tuple[Point3, Point3]
Vector = Float[np.ndarray, "3"]

MOST_VOXELS = 2**24
_BESIDE = 40.0  # of what stands: far out in the fields flights would meet nothing [m]
_PAIRS = 4096  # drawn for a trial
_TICKS = 64  # a metre
_PIECE = 2**20  # of a file that is read at a time [B]


@dataclasses.dataclass(frozen=True, eq=False)
class GivenCity:
    """A city of a file, to fly in.

    Attributes:
        name: of the file.
        identity: digests of its content and of the voxels that it is flown in as, where the frame of flights lies, and
            the ends, as JSON holds them.
        world: its solids, in the frame of flights.
        within: columns that lie within what the file covers.
        ends: start and goal of all trials, in the frame of flights [m]; None: they are drawn.
        remarks: sentences on the map that a user should know.
    """

    name: str
    identity: Mapping[str, Any]
    world: VoxelCity
    within: Columns
    ends: Ends | None = None
    remarks: tuple[str, ...] = ()

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        window: Window | None = None,
        reading: Reading = PLAIN,
        ends: Ends | None = None,
    ) -> GivenCity:
        """The city of a map file, or of a folder of meshes.

        Args:
            path: of any format that `maxjax.load_map` reads.
            window: what of it becomes voxels, and how fine; None: all of it, in voxels of 2 m or of its own.
            reading: of what the file leaves open.
            ends: start and goal of all trials, in the file's coordinates [m]; None: they are drawn.

        Raises:
            FileError: if the file cannot be used.
            ValueError: if the window is none or takes too many voxels, an end lies outside of the map, or the map has
                no place for ends that are to be drawn.
        """
        window = dataclasses.replace(Window() if window is None else window, most=MOST_VOXELS, ends=ends or ())
        loaded = map_of(read_map(path, reading), window, reading)
        found = cls.of(loaded, Path(path).name, digest_of(Path(path)), ends)
        if ends is None and not len(found.clear_columns):
            raise ValueError(
                f"{path}: expected places {CLEARANCE:g} to {_BESIDE:g} m from what stands there, for starts and goals, "
                "given none: is its floor told as ground (--ground Z)? Give --start and --goal to fly anyway"
            )
        return found

    @classmethod
    def of(cls, given: LoadedMap, name: str, digest: str, ends: Ends | None = None) -> GivenCity:
        """The city of a map that was read; arguments and errors as of `load`, with the digest of its file."""
        world, remarks = VoxelCity.of(given, np.asarray(given.file.within)), list(given.file.remarks)
        local = None if ends is None else _in_frame(ends, world)
        identity: dict[str, Any] = {"file": digest, "voxels": _digest(world), "origin": list(world.origin)}
        identity |= {} if local is None else {"start": list(local[0]), "goal": list(local[1])}
        if not world.tells_ground:
            height = world.origin[2]
            remarks.append(
                f"it tells no ground: flat ground is taken at its lowest voxel, z = {height:g} m; --ground Z "
                "takes another"
            )
        return cls(name, identity, world, np.asarray(given.file.within), local, tuple(remarks))

    @property
    def beyond(self) -> tuple[str, ...]:
        """Remarks on given ends where the file tells nothing."""
        last = np.array(self.within.shape) - 1
        columns = (np.minimum(self.world.columns(np.array(end[:2])), last) for end in self.ends or ())
        known = [bool(self.within[x, y]) for x, y in columns]
        beyond = [name for name, inside in zip(("start", "goal"), known, strict=False) if not inside]
        return (f"{' and '.join(beyond)}: beyond what the file covers; it is flown as if nothing stood there",) * bool(
            beyond
        )

    @property
    def stream(self) -> str:
        """Name of its random streams: by what the file holds, wherever it lies."""
        return str(self.identity["file"])[:16]

    @functools.cached_property
    def slots(self) -> int:
        """Boxes of any of its trials, with padding, so that all are one program."""
        if self.ends is None:
            return self.world.slots_within(0.5 * APART[1])
        return self.world.slots_for(*map(np.array, self.ends))

    def solids(self, start: Vector, goal: Vector) -> Geoms:
        """The ground plane and the solids around the ends of a trial."""
        return self.world.solids(start, goal, self.slots)

    def ground_below(self, start: Vector, goal: Vector) -> float:
        """Height of the ground beneath both ends, the lower one's [m]."""
        return min(self.world.ground_at(start), self.world.ground_at(goal))

    @functools.cached_property
    def clear_columns(self) -> Int64[np.ndarray, "n 2"]:
        """Indices of the columns in which ends may stand."""
        return np.argwhere(self._clear)

    @functools.cached_property
    def _clear(self) -> Columns:
        return np.asarray(self.within & self.world.columns_beside(CLEARANCE, _BESIDE))

    @functools.cached_property
    def _air(self) -> Bool[np.ndarray, "nx ny nz"]:
        return self.world.open_air(DILATION)

    def draw(self, seed: int, indices: Sequence[int]) -> Trial:
        """Trials of a seed, stacked in the order of the indices; each depends on file, seed and its index alone.

        Raises:
            ValueError: for a negative seed or index, or no indices.
        """
        wanted = np.asarray(indices, np.int64)
        if wanted.ndim != 1 or wanted.size == 0:
            raise ValueError(f"indices: expected a sequence of at least one, given {indices}")
        if not 0 <= seed < 2**31 or wanted.min() < 0 or wanted.max() >= 2**31:
            raise ValueError(f"trial: expected seed and indices from 0 to 2^31 - 1, given seed {seed} and {indices}")
        if self.ends is not None:
            start, goal = map(np.array, self.ends)
            found = [(start, goal, True, 0)] * len(wanted)
        else:
            key = named_key(jax.random.key(seed), f"trials {self.stream}")
            bits = jax.jit(lambda k: jax.random.bits(jax.random.fold_in(key, k), (_PAIRS, 7), jnp.uint32))
            found = [self._pair(np.asarray(bits(index)) / 2.0**32) for index in wanted.astype(np.int32)]
        starts, goals, valid, excluded = zip(*found, strict=True)
        return Trial(
            jnp.asarray(np.stack(starts), jnp.float32),
            jnp.asarray(np.stack(goals), jnp.float32),
            jnp.zeros(len(wanted), jnp.int32),
            jnp.asarray(np.array(valid)),
            jnp.asarray(np.array(excluded), jnp.int32),
        )

    def _pair(self, u: Float[np.ndarray, "n 7"]) -> tuple[Vector, Vector, bool, int]:
        """Start, goal, valid and excluded of one trial, from uniform numbers."""
        grid, columns, nowhere = self.world.grid, self.clear_columns, np.full(3, np.nan)
        if not len(columns):
            return nowhere, nowhere, False, 0
        chosen = columns[(u[:, 0] * len(columns)).astype(np.int64)]
        near, far = APART
        # Of a pair at different heights the horizontal distance may be less than that of the pair.
        least = near**2 - (HEIGHT[1] - HEIGHT[0]) ** 2
        reach, turn = np.sqrt(least + u[:, 3] * (far**2 - least)), 2.0 * np.pi * u[:, 4]
        start_xy = np.array(grid.lower[:2]) + grid.spacing * (chosen + u[:, 1:3])
        goal_xy = start_xy + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
        start, start_fits = self._end(start_xy, u[:, 5])
        goal, goal_fits = self._end(goal_xy, u[:, 6])
        apart = np.linalg.norm(goal - start, axis=1)
        candidate = start_fits & goal_fits & (apart >= near) & (apart <= far)
        solvable = candidate & self._in_air(start) & self._in_air(goal)
        if not solvable.any():
            return nowhere, nowhere, False, int(candidate.sum())
        first = int(np.argmax(solvable))
        return start[first], goal[first], True, int(candidate[:first].sum())

    def _end(
        self, xy: Float[np.ndarray, "n 2"], u: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
        """Ends above the ground, and whether each stands in a clear column."""
        xy = np.round(xy * _TICKS) / _TICKS
        index = self.world.columns(xy)
        inside = np.asarray(((index >= 0) & (index < self._clear.shape)).all(axis=1))
        x, y = np.where(inside[:, None], index, 0).T
        above = np.round((HEIGHT[0] + u * (HEIGHT[1] - HEIGHT[0])) * _TICKS) / _TICKS
        return np.column_stack([xy, self.world.ground_top[x, y] + above]), inside & self._clear[x, y]

    def _in_air(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether points lie in the open air; above the map they do where its topmost layer does."""
        grid = self.world.grid
        index = np.floor((points - np.array(grid.lower)) / grid.spacing).astype(np.int64)
        index[:, 2] = np.minimum(index[:, 2], grid.shape[2] - 1)
        inside = np.asarray(((index >= 0) & (index < grid.shape)).all(axis=1))
        x, y, z = np.where(inside[:, None], index, 0).T
        return np.asarray(inside & self._air[x, y, z])


def _in_frame(ends: Ends, world: VoxelCity) -> Ends:
    """Ends of the file's coordinates in the frame of flights; raises a ValueError for one outside of the map."""
    points = np.asarray(ends, np.float64) - np.array(world.origin)
    low, high = np.array(world.grid.lower), np.array(world.grid.upper)
    for name, end, point in zip(("start", "goal"), ends, points, strict=True):
        if not np.isfinite(point).all() or ((point < low) | (point > high)).any():
            corners = [np.round(np.array(world.origin) + side, 3).tolist() for side in (low, high)]
            raise ValueError(
                f"{name}: expected a place in the map, between {corners[0]} and {corners[1]} m, given {list(end)}; "
                "--bounds takes in more of it"
            )
    (a, b, c), (d, e, f) = points.tolist()
    return (a, b, c), (d, e, f)


def _digest(world: VoxelCity) -> str:
    """Digest of voxels and where they lie in the frame of flights."""
    told = hashlib.sha256(repr((world.grid.shape, world.grid.spacing)).encode())
    for volume in (world.voxels.occupied, world.voxels.ground):
        told.update(np.packbits(np.asarray(volume)).tobytes())
    return told.hexdigest()


def digest_of(path: Path) -> str:
    """Digest of a file's content; of a folder's files and their names."""
    told = hashlib.sha256()
    for file in sorted(place for place in path.rglob("*") if place.is_file()) if path.is_dir() else [path]:
        if path.is_dir():
            told.update(f"{file.relative_to(path).as_posix()}\0{file.stat().st_size}\0".encode())
        with open(file, "rb") as content:
            while piece := content.read(_PIECE):
                told.update(piece)
    return told.hexdigest()
