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
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32, Int64, Shaped

from maxjax.core.grid import Grid, Index3
from maxjax.core.status import Status
from maxjax.planning.route import Route, Routes, without_padding
from maxjax.planning.surroundings import halo_of
from maxjax.planning.task import Rows, Task

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
GUESS, GROWTH = 1.25, 1.6
# Such faults of an end are plain in any window that holds it.
LOCAL = (Status.START_OCCUPIED, Status.GOAL_OCCUPIED)


# By name.
Volumes = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class FocusWindow:
    """A box of a map.

    Attributes:
        corner: its lowest voxel, of the map.
        shape: voxels; those beyond the map hold nothing.
        bound: least cost of a way between the ends that leaves it [voxels].
    """

    corner: Index3
    shape: Index3
    bound: float

    def cut(self, volume: Shaped[np.ndarray, "nx ny nz"], halo: int, shown: Shaped[np.ndarray, "hx hy hz"]) -> None:
        """Show, in an array, what it holds of a map and, so wide, around it; what lies beyond the map stays."""
        of_map, of_cut = [], []
        for corner, n, most in zip(self.corner, self.shape, volume.shape, strict=True):
            low, high = max(corner - halo, 0), min(corner + n + halo, most)
            of_map.append(slice(low, high))
            of_cut.append(slice(low - corner + halo, high - corner + halo))
        shown[tuple(of_cut)] = volume[tuple(of_map)]


def straight(ends: Float[np.ndarray, "2 3"]) -> float:
    """A first guess of what the cheapest way costs."""
    return GUESS * float(np.linalg.norm(ends[1].astype(np.float64) - ends[0]))


def window_around(
    occupied: Bool[np.ndarray, "nx ny nz"], ends: Float[np.ndarray, "2 3"], cost: float
) -> FocusWindow | None:
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
            return FocusWindow(_index(corner), _index(size), way_out(occupied, ends, corner, size))
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


def way_out(
    occupied: Bool[np.ndarray, "nx ny nz"],
    ends: Float[np.ndarray, "2 3"],
    corner: Int64[np.ndarray, " 3"],
    size: Int64[np.ndarray, " 3"],
) -> float:
    """The least cost of a way that leaves a window, by the centres of its outermost voxels; infinite if none can."""
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


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """What a device is shown of a task.

    Attributes:
        task: whose maps are whole.
        windows: of one shape, one for each problem; None: it is shown the whole maps.
    """

    task: Task
    windows: tuple[FocusWindow, ...] | None = None

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
    def _volumes(self) -> Volumes:
        priced = {} if self.task.price is None else {"price": self.task.price}
        volumes = {"occupied": self.task.barred, "ground": self.task.kept_off} | priced
        # One volume for a batch of maps is a row of views.
        return {name: v[0] if v.ndim == 4 and v.strides[0] == 0 else v for name, v in volumes.items()}

    @property
    def shared(self) -> Volumes:
        """The volumes that all problems are shown alike, by name: `occupied`, `ground` and `price`."""
        return {name: volume for name, volume in self._volumes.items() if self.windows is None and volume.ndim == 3}

    def own(self, rows: Rows) -> Volumes:
        """Those that are not shared, for some of the problems."""
        shared = self.shared
        volumes = {name: volume for name, volume in self._volumes.items() if name not in shared}
        if self.windows is None:
            return {name: self.task.some(rows).each(volume) for name, volume in volumes.items()}
        which = np.arange(len(self))[rows].tolist()
        return {name: self._cut(volume, name, which) for name, volume in volumes.items()}

    def _cut(self, volume: Shaped[np.ndarray, "..."], name: str, which: list[int]) -> Shaped[np.ndarray, "b hx hy hz"]:
        """A volume in the windows of some problems; a price ends with them, and beyond the map a metre costs 1."""
        assert self.windows is not None
        halo = 0 if name == "price" else self.halo
        seen = [len(which), *(n + 2 * halo for n in self.grid.shape)]
        shown = np.ones(seen, np.float32) if name == "price" else np.zeros(seen, bool)
        for row, k in enumerate(which):
            self.windows[k].cut(self.task.one(volume, k), halo, shown[row])
        return shown

    def rim(self, rows: Rows) -> Int32[np.ndarray, "b 3"]:
        """How many voxels of the windows of some of the problems belong to the map, along each axis."""
        left = np.array(self.task.grid.shape) - self.corners[rows].astype(np.int64)
        filled: Int32[np.ndarray, "b 3"] = np.minimum(left, self.grid.shape).astype(np.int32)
        return filled

    def ends(self, rows: Rows) -> Float[np.ndarray, "b 2 3"]:
        """Starts and goals of some of the problems, in index coordinates of the grid."""
        ends: Float[np.ndarray, "b 2 3"] = (self.task.index[rows] - self.corners[rows][:, None]).astype(np.float32)
        return ends

    def placed(self, route: Route) -> Route:
        """Routes of all problems on the host, in index coordinates of the whole map."""
        route = without_padding(route)
        if self.windows is None:
            return route
        return dataclasses.replace(route, path=np.asarray(route.path, np.float64) + self.corners[:, None])

    @property
    def corners(self) -> Float64[np.ndarray, "b 3"]:
        """Lowest voxels of what each problem is shown."""
        if self.windows is None:
            return np.zeros((len(self), 3))
        return np.array([window.corner for window in self.windows], np.float64)

    def some(self, rows: Rows) -> View:
        """Some of the problems."""
        if self.windows is None:
            return View(self.task.some(rows))
        windows = tuple(self.windows[k] for k in np.arange(len(self))[rows].tolist())
        return View(self.task.some(rows), windows)


def rounded(task: Task) -> View:
    """Whole maps, in windows of a rounded shape, so that their programs serve other maps as well."""
    x, y, z = (-(-n // step) * step for n, step in zip(task.grid.shape, _ROUNDED, strict=True))
    return View(task, (FocusWindow((0, 0, 0), (x, y, z), math.inf),) * len(task))


# Views, in each windows of one shape, ↦ the routes of each, in index coordinates of the whole map.
RouteViews = Callable[[list[View]], list[Routes]]


def in_windows(task: Task, find: RouteViews, whole: Callable[[Task], Routes]) -> Routes:
    """Routes of a task by windows that grow until they prove what they show, at last by whole maps.

    Args:
        task: what to plan.
        find: routes of what a device is shown.
        whole: routes of what no window answers.

    Returns:
        One route a problem, with the timings of all its windows.
    """
    found = Routes.blank(len(task))
    costs = np.array([straight(ends) for ends in task.index])
    asked = np.arange(len(task))
    while asked.size:
        windows = {k: window_around(task.one(task.barred, k), task.index[k], costs[k]) for k in asked.tolist()}
        groups: dict[Index3 | None, list[int]] = {}
        for k, window in windows.items():
            groups.setdefault(None if window is None else window.shape, []).append(k)
        rest = np.array(groups.pop(None, []), np.int64)
        rows = [np.array(group) for group in groups.values()]
        views = [View(task.some(group), tuple(windows[k] for k in group.tolist())) for group in rows]  # type: ignore[misc]
        for group, routes in zip(rows, find(views) if views else [], strict=True):
            found = found.put(group, routes)
        if rest.size:
            answers = whole(task.some(rest))
            # A path that a window did not prove the cheapest is better than none.
            better = answers.ok | ~found.ok[rest]
            found = found.put(rest[better], answers.some(better))
            found = found.spending(rest[~better], answers.some(~better).timings)
        bounds = np.array([math.nan if windows[k] is None else windows[k].bound for k in asked.tolist()])  # type: ignore[union-attr]
        costs[asked] = _next_costs(found.route, asked, bounds, costs[asked], task.grid.spacing)
        asked = asked[~np.isnan(costs[asked])]
    return found


def _next_costs(
    route: Route,
    asked: Int64[np.ndarray, " r"],
    bounds: Float64[np.ndarray, " r"],
    costs: Float64[np.ndarray, " r"],
    spacing: float,
) -> Float64[np.ndarray, " r"]:
    """The costs whose windows are the next to look at; NaN where the last one proves what it shows.

    Args:
        route: what was found for all problems.
        asked: which of them were looked at.
        bounds: of their windows; NaN for the whole map.
        costs: by which these were chosen.
        spacing: of the grid [m].
    """
    status, path = np.asarray(route.status)[asked], np.asarray(route.path)[asked]
    found = np.asarray(route.cost, np.float64)[asked] / spacing
    # Without a price a metre costs 1.
    lengths = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(axis=1)
    found = np.where(found > 0, found, lengths)
    ok = status == Status.OK
    proved = np.isnan(bounds) | np.isin(status, LOCAL) | (ok & (found <= bounds))
    following: Float64[np.ndarray, " r"] = np.where(ok, np.maximum(found, costs), GROWTH * costs)
    return np.where(proved, math.nan, following)
