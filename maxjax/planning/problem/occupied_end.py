"""Occupied ends: what stands there, and where a free place is; found on the host, before anything is compiled.

top       upper face of the stack of occupied voxels that holds the end
free from the least height above it at which the radius is kept
nearest   the nearest centre of a voxel at which the radius is kept
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.plan import Plans, no_plans
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task

_INSIDE = 1e-3  # so far within its voxel an end is in it for sure [voxels]
_STANDING = 0.5  # so near to the ground an end stands on it [m]
_AROUND = 16  # voxels to each side in which a free place is looked for
_HALF_DIAGONAL = 0.5 * math.sqrt(3.0)


@dataclasses.dataclass(frozen=True)
class OccupiedEnd:
    """An end in an occupied voxel, all in the map's coordinates [m].

    Attributes:
        point: the end.
        ground: whether it lies in the ground, rather than in an obstacle.
        top: upper face of what it lies in.
        free_from: least height of its column above, from which on the radius is kept; None: none within 16 voxels.
        nearest: nearest centre of a voxel where the radius is kept; None: none within 16 voxels.
    """

    point: Point3
    ground: bool
    top: float
    free_from: float | None
    nearest: Point3 | None

    @property
    def sentence(self) -> str:
        """The obstacle, its overlap and a free place, in the map's coordinates."""
        return self.describe(PlaceFormat())

    def describe(self, places: PlaceFormat) -> str:
        """The obstacle, its overlap and a free place, in the frame in which the end was given."""
        x, y, z = self.point
        if self._on_ground(places):
            said = f"{places.place(self.point)} stands on the ground, from which a vehicle takes off"
            if self.free_from is not None:
                said += f": give a height that it takes off to, from {places.height((x, y, self.free_from))} on"
            return f"{said}; --takeoff-and-landing adds the take-off and the landing to .plan and .waypoints"
        what = "the ground" if self.ground else "an obstacle"
        top = places.height((x, y, self.top))
        said = f"{places.place(self.point)} lies in {what}, {self.top - z:.1f} m below its top at {top}"
        if self.free_from is not None:
            said += f"; free from {places.height((x, y, self.free_from))}"
        if self.nearest is not None:
            shown = tuple(round(number, 1) for number in self.nearest)
            near = f"({', '.join(f'{number:.1f}' for number in shown)})"
            said += f"; nearest free place {near if places.frame == 'map' else places.place(self.nearest)}"
        if self.ground and 0.0 <= z < self.top and places.frame == "map":
            said += f"; did you mean {z:g} m above ground, z = {self.top + z:.1f}?"
        return said

    def _on_ground(self, places: PlaceFormat) -> bool:
        """Whether the end is the ground itself, of which the voxels may reach higher."""
        ground = places.ground(self.point)
        return self.ground and math.isfinite(ground) and abs(self.point[2] - ground) <= _STANDING


def find_occupied_end(where: VoxelMap, point: Point3, radius: float) -> OccupiedEnd | None:
    """The obstacle at a point of a map, and a free place beside it; None where the point is free.

    Args:
        where: one map.
        point: [m].
        radius: that a free place keeps from everything but the ground, of which it keeps a voxel off [m].
    """
    grid, barred = where.grid, np.asarray(where.occupied)
    index = (np.array(point, np.float64) - np.array(grid.origin)) / grid.spacing
    if not inside(index, barred):
        return None
    i, j, k = np.floor(index + 0.5).astype(int).tolist()
    above = ~barred[i, j, k:]
    top = k + int(above.argmax()) if above.any() else barred.shape[2]
    low = np.maximum(np.array([i, j, k]) - _AROUND, 0)
    high = np.array([i + _AROUND, j + _AROUND, max(k, top) + _AROUND]) + 1
    room = _room(barred, np.asarray(where.ground), low, high, radius / grid.spacing)
    column = np.flatnonzero(room[i - low[0], j - low[1], max(top - low[2], 0) :])
    free_from = None if not column.size else grid.origin[2] + grid.spacing * float(max(top, low[2]) + column[0])
    places = np.argwhere(room) + low
    nearest: Point3 | None = None
    if len(places):
        x, y, z = places[np.argmin(((places - index) ** 2).sum(axis=1))].tolist()
        nearest = (
            grid.origin[0] + grid.spacing * x,
            grid.origin[1] + grid.spacing * y,
            grid.origin[2] + grid.spacing * z,
        )
    face = grid.lower[2] + grid.spacing * top
    return OccupiedEnd(point, bool(where.ground[i, j, k]), face, free_from, nearest)


def open_heights(where: VoxelMap, point: Point3) -> tuple[float, float] | None:
    """Lowest and highest centre of the open voxels of a point's column that lie nearest to it [m]; None: none is.

    Open is what holds nothing and what no rule of the air closes.
    """
    grid, barred = where.grid, np.asarray(where.barred)
    i, j, k = np.floor((np.array(point, np.float64) - np.array(grid.lower)) / grid.spacing).astype(int).tolist()
    if not (0 <= i < barred.shape[0] and 0 <= j < barred.shape[1]) or barred[i, j].all():
        return None
    steps = np.diff(np.r_[True, barred[i, j], True].astype(np.int8))
    runs = np.column_stack([np.flatnonzero(steps < 0), np.flatnonzero(steps > 0) - 1])
    apart = np.maximum(runs[:, 0] - k, k - runs[:, 1])
    low, high = runs[int(apart.argmin())].tolist()
    return grid.origin[2] + grid.spacing * low, grid.origin[2] + grid.spacing * high


def open_sentence(where: VoxelMap, point: Point3, places: PlaceFormat) -> str:
    """Which heights of a point's column the rules of the air leave open."""
    found = open_heights(where, point)
    if found is None:
        return "no height is open there"
    low, high = (places.height((point[0], point[1], z)) for z in found)
    return f"there {low} to {high} is open" if low != high else f"there {low} is open"


def inside(index: Float64[np.ndarray, " 3"], barred: Bool[np.ndarray, "nx ny nz"]) -> bool:
    """Whether a place [index coordinates] lies within occupied voxels alone, off their faces."""
    if not np.isfinite(index).all():
        return False
    low, high = (np.floor(index + 0.5 + side * _INSIDE).astype(int) for side in (-1, 1))
    if (low < 0).any() or (high >= barred.shape).any():
        return False
    return bool(barred[tuple(slice(a, b + 1) for a, b in zip(low.tolist(), high.tolist(), strict=True))].all())


def plans_of_occupied_ends(task: Task, method: str) -> Plans | None:
    """Plans without a path, where each problem has an end in something: nothing is compiled then; None otherwise."""
    status = np.zeros(len(task), np.int32)
    for k, (start, goal) in enumerate(task.index):
        barred = task.one(task.barred, k)
        fault = Status.START_OCCUPIED if inside(start, barred) else Status.GOAL_OCCUPIED
        if fault == Status.GOAL_OCCUPIED and not inside(goal, barred):
            return None
        both = np.stack([start, goal])
        if not np.isfinite(both).all() or (start == goal).all() or _outside(both, barred.shape):
            return None
        status[k] = fault
    return dataclasses.replace(no_plans(task, Status.START_OCCUPIED, method), status=status)


def _outside(index: Float64[np.ndarray, "n 3"], shape: tuple[int, ...]) -> bool:
    return bool((index < -0.5).any() or (index > np.array(shape) - 0.5).any())


def _room(
    occupied: Bool[np.ndarray, "nx ny nz"],
    ground: Bool[np.ndarray, "nx ny nz"],
    low: np.ndarray,
    high: np.ndarray,
    radius: float,
) -> Bool[np.ndarray, "bx by bz"]:
    """Voxels of a box whose centre keeps the radius from the cubes of obstacles, and a voxel from the ground."""
    from scipy import ndimage  # a quarter of a second that a plan can do without

    high = np.minimum(high, occupied.shape)
    box = tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))
    walls, floor = occupied[box] & ~ground[box], ground[box]
    # From centre to centre at least the radius and half a diagonal: then from centre to cube at least the radius.
    far = ndimage.distance_transform_edt(~walls) if walls.any() else np.full(walls.shape, np.inf)
    off = ndimage.distance_transform_cdt(~floor, "chessboard") if floor.any() else np.full(floor.shape, 2)
    free: Bool[np.ndarray, "bx by bz"] = (far >= radius + _HALF_DIAGONAL) & (off > (1 if radius > 0 else 0)) & ~walls
    return free
