"""Focus: the window of a map that holds the cheapest way between two ends, and what a device is shown of a task.

A way that leaves a box around both ends crosses one of its faces, and costs at least the bound of
`planning.windows.geometry`. A face beyond which the map ends, or holds nothing but occupied voxels, is crossed by no
way and does not count. A path of cost C ≤ bound, found in the box, proves that the cheapest way of the whole map lies
in it. Until there is one the box grows, from the ellipsoid of a guess of C to that of the cost that was found, and at
last to the whole map. What a part of a map cannot show (that nothing joins the ends, or no smaller exemption) is left
to the whole map as well.

Boxes come in few shapes, for which programs are compiled, and which serve every map: along an axis where the map is
smaller, the box reaches beyond its *rim*, where nothing is flown. Distances to walls are read beyond the box, in a
*halo*. Shapes are longer along x than along y: a box that is longer along y is shown *turned*, with x and y exchanged,
which changes no distance and no price.

Positions are index coordinates of the map (whole numbers at voxel centres), costs and bounds [voxels].
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32, Int64, Shaped

from maxjax.core.grid import Grid, Index3
from maxjax.planning.path.route import Route, trim_padding
from maxjax.planning.problem.surroundings import halo_of
from maxjax.planning.problem.task import Rows, Task
from maxjax.planning.windows.choice import Choice, LowestOpen, choose
from maxjax.planning.windows.subvolumes import Boxes, lowest_open, voxels_in

# Shapes of windows, flat as cities are [voxels]. Of five small ones these take the fewest voxels a problem of the
# offline protocol, until one proves the path: 83,000 in the mean, where four squares took 107,000.
SHAPES: tuple[Index3, ...] = (
    (40, 32, 24),
    (56, 40, 24),
    (64, 48, 32),
    (72, 64, 32),
    (80, 64, 40),
    (128, 128, 32),
    (128, 128, 64),
    (192, 192, 32),
    (192, 192, 64),
)
# To multiples of what shapes of whole maps are rounded up, where their programs are to serve others.
_ROUNDED = 32, 32, 16
# By name.
Volumes = dict[str, np.ndarray]


class Windows(NamedTuple):
    """Boxes of maps, one for each of several problems.

    Attributes:
        corners: the lowest voxel of each, of the map.
        sizes: voxels along the axes of the map; those beyond it hold nothing.
        bounds: least cost of a way between the ends that leaves it [voxels]; NaN: it is no window, but the whole map.
        turned: whether it is shown with x and y exchanged.
    """

    corners: Int64[np.ndarray, "b 3"]
    sizes: Int64[np.ndarray, "b 3"]
    bounds: Float64[np.ndarray, " b"]
    turned: Bool[np.ndarray, " b"]

    @classmethod
    def upright(
        cls, corners: Int64[np.ndarray, "b 3"], sizes: Int64[np.ndarray, "b 3"], bounds: Float64[np.ndarray, " b"]
    ) -> Windows:
        """Windows that are shown as they lie."""
        return cls(corners, sizes, bounds, np.zeros(len(bounds), bool))

    @classmethod
    def of(cls, chosen: Choice) -> Windows:
        """Windows that were chosen, turned where they are longer along y; none where there is none."""
        corners, sizes, bounds = (np.asarray(x) for x in chosen)
        return cls(
            corners.astype(np.int64), sizes.astype(np.int64), bounds.astype(np.float64), sizes[:, 0] < sizes[:, 1]
        )

    @property
    def shapes(self) -> Int64[np.ndarray, "b 3"]:
        """Voxels along the axes of what is shown."""
        return _exchange(self.sizes, self.turned)

    @property
    def shape(self) -> Index3:
        """Of what is shown of all of them, where they have one shape."""
        x, y, z = self.shapes[0].tolist()
        return x, y, z

    def cut(
        self, maps: Shaped[np.ndarray, "m nx ny nz"], map_of: Int64[np.ndarray, " b"], halo: int, beyond: float
    ) -> Shaped[np.ndarray, "b hx hy hz"]:
        """Volumes of maps as the windows show them, with so much around them and `beyond` where a map ends."""
        found = np.empty((len(self.bounds), *(n + 2 * halo for n in self.shape)), maps.dtype)
        for rows in (np.flatnonzero(~self.turned), np.flatnonzero(self.turned)):
            if rows.size:
                low = self.corners[rows] - halo
                shown = voxels_in(Boxes(maps, map_of[rows], low, low + self.sizes[rows] + 2 * halo - 1), beyond)
                found[rows] = shown.swapaxes(1, 2) if self.turned[rows[0]] else shown
        return found

    def some(self, rows: Rows) -> Windows:
        """Those of some of the problems."""
        return Windows(*(numbers[rows] for numbers in self))


def _exchange(rows: Shaped[np.ndarray, "b *n 3"], turned: Bool[np.ndarray, " b"]) -> Shaped[np.ndarray, "b *n 3"]:
    """Triples, of the turned ones with x and y exchanged."""
    return np.where(turned.reshape(-1, *[1] * (rows.ndim - 1)), rows[..., [1, 0, 2]], rows)


def windows_around(task: Task, costs: Float64[np.ndarray, " b"]) -> Windows:
    """The smallest window of each problem that no way of its cost leaves.

    Args:
        task: maps and ends.
        costs: of the ways, at least the straight lines.

    Returns:
        The windows; none where there is no smaller one than the whole map, or an end is not inside it.
    """
    return Windows.of(choose(task.index, costs, task.grid.shape, SHAPES, search_maps(task), np))


def search_maps(task: Task) -> LowestOpen:
    """How the lowest open layers of boxes are found in the maps of a task."""
    maps, map_of = task.stacked(task.barred)

    def lowest(low: Int64[np.ndarray, "b k 3"], high: Int64[np.ndarray, "b k 3"]) -> Int64[np.ndarray, "b k"]:
        boxes = Boxes(maps, np.repeat(map_of, low.shape[1]), low.reshape(-1, 3), high.reshape(-1, 3))
        return lowest_open(boxes).reshape(low.shape[:2])

    return lowest


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """The part of a task that a device gets: the task in windows, or whole.

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
        # A price ends with a window, and beyond the map a metre costs 1.
        around = {name: (0, 1.0) if name == "price" else (self.halo, 0.0) for name in volumes}
        return {
            name: some.windows.cut(*some.task.stacked(volumes[name]), halo, beyond)
            for name, (halo, beyond) in around.items()
        }

    def rim(self, rows: Rows) -> Int32[np.ndarray, "b 3"]:
        """How many voxels of the windows of some of the problems belong to the map, along each axis."""
        left = np.array(self.task.grid.shape) - self.corners[rows].astype(np.int64)
        filled: Int32[np.ndarray, "b 3"] = np.minimum(_exchange(left, self._turned[rows]), self.grid.shape)
        return filled.astype(np.int32)

    def ends(self, rows: Rows) -> Float[np.ndarray, "b 2 3"]:
        """Starts and goals of some of the problems, in index coordinates of the grid."""
        ends: Float[np.ndarray, "b 2 3"] = self.task.index[rows] - self.corners[rows][:, None]
        return _exchange(ends, self._turned[rows]).astype(np.float32)

    def in_map(self, route: Route) -> Route:
        """Routes of all problems on the host, in index coordinates of the whole map."""
        route = trim_padding(route)
        if self.windows is None:
            return route
        path = _exchange(np.asarray(route.path, np.float64), self._turned) + self.corners[:, None]
        return dataclasses.replace(route, path=path)

    @property
    def _turned(self) -> Bool[np.ndarray, " b"]:
        """Whether what is shown has x and y exchanged."""
        return np.zeros(len(self), bool) if self.windows is None else self.windows.turned

    @property
    def corners(self) -> Float64[np.ndarray, "b 3"]:
        """Lowest voxels of what each problem is shown."""
        return np.zeros((len(self), 3)) if self.windows is None else self.windows.corners.astype(np.float64)

    def some(self, rows: Rows) -> View:
        """Some of the problems."""
        return View(self.task.some(rows), None if self.windows is None else self.windows.some(rows))


def round_up(task: Task) -> View:
    """Whole maps, in windows of a rounded shape, so that their programs serve other maps as well."""
    x, y, z = (-(-n // step) * step for n, step in zip(task.grid.shape, _ROUNDED, strict=True))
    corners = np.zeros((len(task), 3), np.int64)
    return View(task, Windows.upright(corners, corners + np.array([x, y, z]), np.full(len(task), math.inf)))
