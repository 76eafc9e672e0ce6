"""Focus: the window of a map that holds the cheapest way between two ends, and what a device is shown of a task.

    |x − s| + |x − g| ≤ C        for every point x of a way from s to g that costs no more than C

as no metre costs less than 1. So a way that leaves a box around both ends crosses one of its faces, and costs at least

    bound = min over the faces of |s' − g|,    s' = s mirrored at the face

A face beyond which the map ends, or holds nothing but occupied voxels, is crossed by no way and does not count. A path
of cost C ≤ bound, found in the box, proves that the cheapest way of the whole map lies in it. Until there is one the
box grows, from the ellipsoid of a guess of C to that of the cost that was found, and at last to the whole map. What a
part of a map cannot show (that nothing joins the ends, or no smaller exemption) is left to the whole map as well.

Boxes come in few shapes, for which programs are compiled, and which serve every map: along an axis where the map is
smaller, the box reaches beyond its *rim*, where nothing is flown. Distances to walls are read beyond the box, in a
*halo*.

Positions are index coordinates of the map (whole numbers at voxel centres), costs and bounds [voxels].
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32, Int64

from maxjax.core.grid import Grid, Index3
from maxjax.core.status import Status
from maxjax.planning.plan import Plan
from maxjax.planning.route import Route
from maxjax.planning.surroundings import halo_of
from maxjax.planning.task import Rows, Task
from maxjax.programs.stage_timer import added

# Shapes of windows, flat as cities are [voxels].
SHAPES: tuple[Index3, ...] = (
    (32, 32, 24),
    (48, 48, 24),
    (64, 64, 32),
    (80, 80, 40),
    (128, 128, 32),
    (128, 128, 64),
    (192, 192, 32),
    (192, 192, 64),
)
# To multiples of what shapes of whole maps are rounded up, where their programs are to serve others.
_ROUNDED = 32, 32, 16
# What the cheapest way is taken to cost, in terms of the straight line, and by what that grows where ends are not
# joined.
_GUESS, _GROWTH = 1.25, 1.6
# Such faults of an end are plain in any window that holds it.
_LOCAL = (Status.START_OCCUPIED, Status.GOAL_OCCUPIED)


# By name.
Maps = dict[str, Bool[np.ndarray, "..."]]


@dataclasses.dataclass(frozen=True)
class Window:
    """A box of a map.

    Attributes:
        corner: its lowest voxel, of the map.
        shape: voxels; those beyond the map hold nothing.
        bound: least cost of a way between the ends that leaves it [voxels].
    """

    corner: Index3
    shape: Index3
    bound: float

    def cut(self, volume: Bool[np.ndarray, "nx ny nz"], halo: int, shown: Bool[np.ndarray, "hx hy hz"]) -> None:
        """Show, in an array of zeros, what it holds of a map and, so wide, around it; beyond the map nothing."""
        of_map, of_cut = [], []
        for corner, n, most in zip(self.corner, self.shape, volume.shape, strict=True):
            low, high = max(corner - halo, 0), min(corner + n + halo, most)
            of_map.append(slice(low, high))
            of_cut.append(slice(low - corner + halo, high - corner + halo))
        shown[tuple(of_cut)] = volume[tuple(of_map)]


def straight(ends: Float[np.ndarray, "2 3"]) -> float:
    """A first guess of what the cheapest way costs."""
    return _GUESS * float(np.linalg.norm(ends[1].astype(np.float64) - ends[0]))


def window_around(occupied: Bool[np.ndarray, "nx ny nz"], ends: Float[np.ndarray, "2 3"], cost: float) -> Window | None:
    """The smallest window that no way of this cost leaves.

    Args:
        occupied: the map.
        ends: start and goal.
        cost: of the way, at least the straight line.

    Returns:
        The window. None: the whole map, since there is none smaller, or an end is not inside it.
    """
    limits = np.array(occupied.shape)
    whole = np.floor(np.where(np.isfinite(ends), ends, -1) + 0.5)
    if (whole < 0).any() or (whole >= limits).any() or (ends[0] == ends[1]).all():
        return None
    low, high = ellipsoid_box(ends.astype(np.float64), cost, limits)
    low[2] = _floor(occupied, low, high)
    for shape in SHAPES:
        size = np.array(shape)
        if (high - low < size).all() and 2 * size.prod() < limits.prod():
            last = np.maximum(limits - size, 0)
            corner = np.minimum(np.maximum((low + high + 1 - size) // 2, 0), last)
            corner[2] = min(_floor(occupied, corner, np.append((corner + size)[:2] - 1, low[2])), last[2])
            return Window(_index(corner), _index(size), _bound(occupied, ends, corner, size))
    return None


def _floor(occupied: Bool[np.ndarray, "nx ny nz"], low: Int64[np.ndarray, " 3"], high: Int64[np.ndarray, " 3"]) -> int:
    """The lowest layer of a box that is not all occupied, as a city is below its ground; the highest if all are."""
    x, y, z = (slice(a, b + 1) for a, b in zip(low.tolist(), high.tolist(), strict=True))
    # Axis by axis: over two at once NumPy reduces voxel by voxel.
    solid: Bool[np.ndarray, " layers"] = np.logical_and.reduce(np.logical_and.reduce(occupied[x, y, z], axis=0), axis=0)
    return int(low[2]) + (int(np.argmin(solid)) if not solid.all() else len(solid) - 1)


def _index(numbers: Int64[np.ndarray, " 3"]) -> Index3:
    x, y, z = numbers.tolist()
    return x, y, z


def ellipsoid_box(
    ends: Float64[np.ndarray, "2 3"], cost: float, limits: Int64[np.ndarray, " 3"]
) -> tuple[Int64[np.ndarray, " 3"], Int64[np.ndarray, " 3"]]:
    """The lowest and the highest voxels of a map of this shape that an ellipsoid with these foci meets."""
    middle, chord = ends.mean(axis=0), ends[1] - ends[0]
    across = max(cost**2 - float(chord @ chord), 0.0) / 4
    # Along each axis: a² u² + b² (1 − u²) with the half axes a² = b² + |chord|²/4 and b, u the chord's direction.
    half = np.sqrt(across + chord**2 / 4)
    low, high = np.floor(middle - half).astype(np.int64), np.ceil(middle + half).astype(np.int64)
    # Not `clip`, which asks for the limits of integers each time.
    low, high = (np.minimum(np.maximum(corner, 0), limits - 1) for corner in (low, high))
    return low, high


def _bound(
    occupied: Bool[np.ndarray, "nx ny nz"],
    ends: Float[np.ndarray, "2 3"],
    corner: Int64[np.ndarray, " 3"],
    size: Int64[np.ndarray, " 3"],
) -> float:
    """The least cost of a way that leaves a window by the centres of its outermost voxels."""
    start, goal = ends.astype(np.float64)
    inside = tuple(slice(a, a + n) for a, n in zip(corner.tolist(), size.tolist(), strict=True))
    bound = math.inf
    for axis in range(3):
        last = int(corner[axis] + size[axis]) - 1
        for face, beyond in ((int(corner[axis]), int(corner[axis]) - 1), (last, last + 1)):
            if not 0 <= beyond < occupied.shape[axis]:
                continue
            layer = tuple(beyond if k == axis else part for k, part in enumerate(inside))
            if not occupied[layer].all():
                mirrored = start.copy()
                mirrored[axis] = 2 * face - start[axis]
                bound = min(bound, float(np.linalg.norm(mirrored - goal)))
    return bound


@dataclasses.dataclass(frozen=True)
class View:
    """What a device is shown of a task.

    Attributes:
        task: whose maps are whole.
        windows: of one shape, one for each problem; None: it is shown the whole maps.
    """

    task: Task
    windows: tuple[Window, ...] | None = None

    def __len__(self) -> int:
        return len(self.task)

    @property
    def grid(self) -> Grid:
        """Of the voxels that are planned in, with its origin at zero."""
        grid = self.task.grid.local
        return grid if self.windows is None else Grid(self.windows[0].shape, grid.spacing, grid.origin)

    @property
    def halo(self) -> int:
        """How far the maps that are shown reach beyond the grid."""
        return 0 if self.windows is None else halo_of(self.task.distances, self.task.grid)

    @property
    def _volumes(self) -> Maps:
        return {"occupied": self.task.occupied, "ground": self.task.ground}

    @property
    def shared(self) -> Maps:
        """`occupied` and `ground`, each if all problems are shown the same."""
        return {name: volume for name, volume in self._volumes.items() if self.windows is None and volume.ndim == 3}

    def own(self, rows: Rows) -> Maps:
        """Those that are not shared, for some of the problems."""
        volumes = {name: volume for name, volume in self._volumes.items() if name not in self.shared}
        if self.windows is None:
            return {name: self.task.some(rows).maps(volume) for name, volume in volumes.items()}
        which, halo = np.arange(len(self))[rows].tolist(), self.halo
        seen = [n + 2 * halo for n in self.grid.shape]
        shown = {name: np.zeros((len(which), *seen), bool) for name in volumes}
        for name, volume in volumes.items():
            for row, k in enumerate(which):
                self.windows[k].cut(self.task.map(volume, k), halo, shown[name][row])
        return shown

    def rim(self, rows: Rows) -> Int32[np.ndarray, "b 3"]:
        """How many voxels of the windows of some of the problems belong to the map, along each axis."""
        left = np.array(self.task.grid.shape) - self._corners[rows].astype(np.int64)
        filled: Int32[np.ndarray, "b 3"] = np.minimum(left, self.grid.shape).astype(np.int32)
        return filled

    def ends(self, rows: Rows) -> Float[np.ndarray, "b 2 3"]:
        """Starts and goals of some of the problems, in index coordinates of the grid."""
        index = self.task.index[rows]
        return (index if self.windows is None else index - self._corners[rows][:, None]).astype(np.float32)

    def placed(self, route: Route, k: int) -> Route:
        """A route of the k-th problem on the host, in index coordinates of the whole map."""
        if self.windows is None:
            return route
        return dataclasses.replace(route, path=np.asarray(route.path) + self._corners[k])

    @property
    def _corners(self) -> Float64[np.ndarray, "b 3"]:
        assert self.windows is not None
        return np.array([window.corner for window in self.windows], np.float64)

    def some(self, rows: Rows) -> View:
        """Some of the problems."""
        kept: Any = None if self.windows is None else np.arange(len(self))[rows].tolist()
        return View(self.task.some(rows), kept and tuple(self.windows[k] for k in kept))  # type: ignore[index]


def rounded(task: Task) -> View:
    """Whole maps, in windows of a rounded shape, so that their programs serve other maps as well."""
    x, y, z = (-(-n // step) * step for n, step in zip(task.grid.shape, _ROUNDED, strict=True))
    return View(task, (Window((0, 0, 0), (x, y, z), math.inf),) * len(task))


# Views, in each windows of one shape, ↦ the plans of each.
PlanViews = Callable[[list[View]], list[list[Plan]]]


def in_windows(task: Task, plan: PlanViews, whole: Callable[[Task], list[Plan]]) -> list[Plan]:
    """Plans of a task by windows that grow until they prove what they show, at last by whole maps.

    Args:
        task: what to plan.
        plan: plans of what a device is shown.
        whole: plans of what no window answers.

    Returns:
        One plan a problem, with the timings of all its windows.
    """
    plans: dict[int, Plan] = {}
    costs = {k: straight(ends) for k, ends in enumerate(task.index)}
    while costs:
        groups: dict[Index3, dict[int, Window]] = {}
        rest: list[int] = []
        for k, cost in costs.items():
            window = window_around(task.map(task.occupied, k), task.index[k], cost)
            if window is None:
                rest.append(k)
            else:
                groups.setdefault(window.shape, {})[k] = window
        views = [View(task.some(np.array(list(group))), tuple(group.values())) for group in groups.values()]
        answers = plan(views) + ([whole(task.some(np.array(rest)))] if rest else [])
        asked: list[Mapping[int, Window | None]] = [*groups.values(), *([dict.fromkeys(rest)] if rest else [])]
        for some, answer in zip(asked, answers, strict=True):
            for (k, window), found in zip(some.items(), answer, strict=True):
                before = plans[k].timings if k in plans else {}
                plans[k] = dataclasses.replace(found, timings=added(before, found.timings))
                following = _next_cost(found, window, costs.pop(k), task.grid.spacing)
                if following is not None:
                    costs[k] = following
    return [plans[k] for k in range(len(task))]


def _next_cost(plan: Plan, window: Window | None, cost: float, spacing: float) -> float | None:
    """The cost whose window is the next to look at; None where this one, of a lower cost, proves what it shows."""
    if window is None or plan.status in _LOCAL:
        return None
    if plan.status != Status.OK:
        return _GROWTH * cost
    found = plan.cost / spacing
    return None if found <= window.bound else max(found, cost)
