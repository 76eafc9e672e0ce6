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
import itertools
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32, Int64

from maxjax.compile.threads import in_parts
from maxjax.core.grid import Grid, Index3
from maxjax.core.status import Status
from maxjax.planning.path.route import Route, Routes, without_padding
from maxjax.planning.problem.surroundings import halo_of
from maxjax.planning.problem.task import Rows, Task
from maxjax.planning.windows.subvolumes import Boxes, lowest_open, voxels_in

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
# Windows that a thread chooses in one go: of fewer, NumPy's calls would cost more than what they find.
_TOGETHER = 64
# What the cheapest way is taken to cost, in terms of the straight line, and by what that grows where ends are not
# joined.
GUESS, GROWTH = 1.25, 1.6
# Such faults of an end are plain in any window that holds it.
LOCAL = (Status.START_OCCUPIED, Status.GOAL_OCCUPIED)


# By name.
Volumes = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True, eq=False)
class Windows:
    """Boxes of maps, one for each of several problems.

    Attributes:
        corners: the lowest voxel of each, of the map.
        sizes: voxels along the axes; those beyond the map hold nothing.
        bounds: least cost of a way between the ends that leaves it [voxels]; NaN: it is no window, but the whole map.
    """

    corners: Int64[np.ndarray, "b 3"]
    sizes: Int64[np.ndarray, "b 3"]
    bounds: Float64[np.ndarray, " b"]

    @property
    def shape(self) -> Index3:
        """Of all of them, where they have one shape."""
        x, y, z = self.sizes[0].tolist()
        return x, y, z

    def some(self, rows: Rows) -> Windows:
        """Those of some of the problems."""
        return Windows(self.corners[rows], self.sizes[rows], self.bounds[rows])


def worthwhile(shapes: Index3 | Int64[np.ndarray, "n 3"], whole: Index3) -> Bool[np.ndarray, "*n"]:
    """Whether windows of such shapes, each three numbers, have less than half of the voxels of a whole map."""
    return np.asarray(2 * np.prod(np.asarray(shapes), axis=-1) < math.prod(whole))


def straight(ends: Float64[np.ndarray, "b 2 3"]) -> Float64[np.ndarray, " b"]:
    """First guesses of what the cheapest ways cost."""
    first: Float64[np.ndarray, " b"] = GUESS * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return first


def windows_around(task: Task, costs: Float64[np.ndarray, " b"]) -> Windows:
    """The smallest window of each problem that no way of its cost leaves.

    Args:
        task: maps and ends.
        costs: of the ways, at least the straight lines.

    Returns:
        The windows; none where there is no smaller one than the whole map, or an end is not inside it.
    """
    limits, shapes = np.array(task.grid.shape), np.array(SHAPES)
    voxels = np.floor(np.where(np.isfinite(task.index), task.index, -1) + 0.5)
    inside = ((voxels >= 0) & (voxels < limits)).all(axis=(1, 2)) & (task.index[:, 0] != task.index[:, 1]).any(axis=1)
    rows = np.flatnonzero(inside)
    some = task.some(rows)
    low, high = ellipsoid_box(some.index, costs[rows], limits)
    low[:, 2] = np.minimum(lowest_open(Boxes(*some.stacked(task.barred), low, high)), high[:, 2])
    fits = (high - low < shapes[:, None]).all(axis=2) & worthwhile(shapes, task.grid.shape)[:, None]
    sizes, fitting = shapes[fits.argmax(axis=0)], fits.any(axis=0)
    rows, low, high, sizes = rows[fitting], low[fitting], high[fitting], sizes[fitting]
    none = np.zeros((len(task), 3), np.int64)
    found = Windows(none, none.copy(), np.full(len(task), math.nan))
    found.sizes[rows], found.corners[rows] = sizes, _corners(task.some(rows), low, high, sizes)
    found.bounds[rows] = ways_out(task.some(rows), found.corners[rows], sizes)
    return found


def _corners(
    task: Task, low: Int64[np.ndarray, "b 3"], high: Int64[np.ndarray, "b 3"], sizes: Int64[np.ndarray, "b 3"]
) -> Int64[np.ndarray, "b 3"]:
    """Lowest voxels of windows around boxes: these in the middle, and below them only layers that are all occupied."""
    last = np.maximum(np.array(task.grid.shape) - sizes, 0)
    corners: Int64[np.ndarray, "b 3"] = np.clip((low + high + 1 - sizes) // 2, 0, last)
    top = corners + sizes - 1
    top[:, 2] = low[:, 2]
    floor = lowest_open(Boxes(*task.stacked(task.barred), corners, top))
    corners[:, 2] = np.minimum(np.minimum(floor, low[:, 2]), last[:, 2])
    return corners


def ellipsoid_box(
    ends: Float64[np.ndarray, "b 2 3"], costs: Float64[np.ndarray, " b"], limits: Int64[np.ndarray, " 3"]
) -> tuple[Int64[np.ndarray, "b 3"], Int64[np.ndarray, "b 3"]]:
    """The lowest and the highest voxels of a map of this shape that ellipsoids with these foci meet."""
    middle, chord = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    across = np.maximum(costs**2 - (chord**2).sum(axis=1), 0.0) / 4
    # Along each axis: a² u² + b² (1 − u²) with the half axes a² = b² + |chord|²/4 and b, u the chord's direction.
    half = np.sqrt(across[:, None] + chord**2 / 4)
    low, high = np.floor(middle - half).astype(np.int64), np.ceil(middle + half).astype(np.int64)
    return np.clip(low, 0, limits - 1), np.clip(high, 0, limits - 1)


def ways_out(
    task: Task, corners: Int64[np.ndarray, "b 3"], sizes: Int64[np.ndarray, "b 3"]
) -> Float64[np.ndarray, " b"]:
    """The least cost of a way that leaves each window, by the centres of its outermost voxels; infinite if none can."""
    limits, (start, goal) = np.array(task.grid.shape), np.moveaxis(task.index, 1, 0)
    maps, map_of = task.stacked(task.barred)
    lowest = np.repeat(corners[None], 6, axis=0)
    highest = np.repeat(np.minimum(corners + sizes, limits)[None] - 1, 6, axis=0)
    images = np.repeat(start[None], 6, axis=0)
    for k, (axis, step) in enumerate(itertools.product(range(3), (-1, 1))):
        face = corners[:, axis] if step < 0 else corners[:, axis] + sizes[:, axis] - 1
        lowest[k, :, axis] = highest[k, :, axis] = face + step
        images[k, :, axis] = 2 * face - start[:, axis]
    # The layers beyond the faces: those within the map that are not all occupied are crossed.
    inside = ((lowest >= 0) & (highest < limits)).all(axis=2)
    layers = Boxes(maps, np.tile(map_of, 6), lowest.reshape(-1, 3), highest.reshape(-1, 3))
    crossed = inside & (lowest_open(layers).reshape(inside.shape) <= highest[..., 2])
    ways: Float64[np.ndarray, "6 b"] = np.where(crossed, np.linalg.norm(images - goal, axis=2), math.inf)
    return np.asarray(ways.min(axis=0))


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """What a device is shown of a task.

    Attributes:
        task: whose maps are whole.
        windows: one for each problem; None: it is shown the whole maps.
    """

    task: Task
    windows: Windows | None = None

    def __len__(self) -> int:
        return len(self.task)

    @property
    def grid(self) -> Grid:
        """Of the voxels that are planned in, with its origin at zero."""
        grid = self.task.grid.local
        return grid if self.windows is None else Grid(self.windows.shape, grid.spacing, grid.origin)

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
        shared, some = self.shared, self.some(rows)
        volumes = {name: volume for name, volume in self._volumes.items() if name not in shared}
        if some.windows is None:
            return {name: some.task.each(volume) for name, volume in volumes.items()}
        low, high = some.windows.corners, some.windows.corners + some.windows.sizes - 1
        # A price ends with a window, and beyond the map a metre costs 1.
        around = {name: (0, 1.0) if name == "price" else (self.halo, 0.0) for name in volumes}
        return {
            name: voxels_in(Boxes(*some.task.stacked(volumes[name]), low - halo, high + halo), beyond)
            for name, (halo, beyond) in around.items()
        }

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
        return np.zeros((len(self), 3)) if self.windows is None else self.windows.corners.astype(np.float64)

    def some(self, rows: Rows) -> View:
        """Some of the problems."""
        return View(self.task.some(rows), None if self.windows is None else self.windows.some(rows))


def rounded(task: Task) -> View:
    """Whole maps, in windows of a rounded shape, so that their programs serve other maps as well."""
    x, y, z = (-(-n // step) * step for n, step in zip(task.grid.shape, _ROUNDED, strict=True))
    corners = np.zeros((len(task), 3), np.int64)
    return View(task, Windows(corners, corners + np.array([x, y, z]), np.full(len(task), math.inf)))


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
    costs, asked = straight(task.index), np.arange(len(task))
    while asked.size:
        windows = _windows_of_all(task.some(asked), costs[asked])
        groups = [rows for shape in SHAPES if (rows := np.flatnonzero((windows.sizes == shape).all(axis=1))).size]
        views = [View(task.some(asked[rows]), windows.some(rows)) for rows in groups]
        for rows, routes in zip(groups, find(views) if views else [], strict=True):
            found = found.put(asked[rows], routes)
        rest = asked[np.isnan(windows.bounds)]
        if rest.size:
            answers = whole(task.some(rest))
            # A path that a window did not prove the cheapest is better than none.
            better = answers.ok | ~found.ok[rest]
            found = found.put(rest[better], answers.some(better))
            found = found.spending(rest[~better], answers.some(~better).timings)
        costs[asked] = _next_costs(found.route, asked, windows.bounds, costs[asked], task.grid.spacing)
        asked = asked[~np.isnan(costs[asked])]
    return found


def _windows_of_all(task: Task, costs: Float64[np.ndarray, " b"]) -> Windows:
    """`windows_around`, on all cores."""
    parts = in_parts(lambda rows: windows_around(task.some(rows), costs[rows]), len(task), _TOGETHER)
    return Windows(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("corners", "sizes", "bounds"))
    )


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
    proved = np.isnan(bounds) | np.logical_or(*(status == fault for fault in LOCAL)) | (ok & (found <= bounds))
    following: Float64[np.ndarray, " r"] = np.where(ok, np.maximum(found, costs), GROWTH * costs)
    return np.where(proved, math.nan, following)
