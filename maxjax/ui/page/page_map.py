"""The map of a page: what the browser shows of it, and where a ray meets it."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid, Point3
from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.airspace.airspace import Area
from maxjax.ui.page.nodes import Frame, point3

Band = tuple[float | None, float | None]
"""Least and greatest height above ground [m]; None: any."""

# Around the middle of the map, between which the first start and goal lie [m], and above what is below them.
_APART, _ABOVE = 60.0, 10.0
_FREE = 3.0  # between the first ends and what is nearest [m]


@dataclasses.dataclass(frozen=True, eq=False)
class City:
    """A map to plan in.

    Attributes:
        name: of the map.
        voxels: occupied, ground included, and where they lie.
        points: of the scan or the file it was made of [m]; None: of none.
        areas: to keep out of, or to keep in.
        above_start: greatest height above the start [m]; None: any.
        measured: how high the ground is; None: as its voxels tell.
    """

    name: str
    voxels: VoxelMap
    points: Float[np.ndarray, "n 3"] | None = None
    areas: tuple[Area, ...] = ()
    above_start: float | None = None
    measured: Terrain | None = None

    @property
    def grid(self) -> Grid:
        """Where the voxels lie."""
        return self.voxels.grid

    @property
    def occupied(self) -> Bool[np.ndarray, "nx ny nz"]:
        """Occupied voxels, ground included."""
        return np.asarray(self.voxels.occupied)

    @property
    def ground(self) -> Bool[np.ndarray, "nx ny nz"]:
        """Those that are ground."""
        return np.asarray(self.voxels.ground)

    @functools.cached_property
    def terrain(self) -> Terrain:
        """How high the ground is."""
        return self.voxels.terrain if self.measured is None else self.measured

    def highest(self, start: Point3) -> float | None:
        """Greatest z above a start [m]; None: any."""
        return None if self.above_start is None else start[2] + self.above_start

    @functools.cached_property
    def frame(self) -> Frame:
        """The page's frame."""
        return Frame.of(self.grid)

    @functools.cached_property
    def floor(self) -> float:
        """Height of the ground's highest voxels' upper faces where most of it ends, else of the map's lowest [m]."""
        tops = self.ground.shape[2] - np.argmax(self.ground[:, :, ::-1], axis=2)
        with_ground = self.ground.any(axis=2)
        layers = int(np.median(tops[with_ground])) if with_ground.any() else 0
        return self.grid.lower[2] + self.grid.spacing * layers


def building_at(city: City, origin: Point3, direction: Point3) -> tuple[float, float] | None:
    """Where in plan a ray goes into what it first meets, half a voxel on [m]; None where it meets nothing."""
    met = hit(city, origin, direction)
    if met is None:
        return None
    way = np.asarray(direction, np.float64)
    x, y, _ = (np.array(met) + 0.5 * city.grid.spacing * way / np.linalg.norm(way)).tolist()
    return x, y


def hit(city: City, origin: Point3, direction: Point3) -> Point3 | None:
    """Where a ray first meets an occupied voxel, or the map's lowest layer [m]; None where it misses both."""
    grid = city.grid
    lower, upper = np.array(grid.lower), np.array(grid.upper)
    start, way = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
    way = way / np.linalg.norm(way)
    far = float(np.linalg.norm(upper - lower) + np.linalg.norm(start - 0.5 * (lower + upper)))
    along = np.arange(0.0, far, 0.25 * grid.spacing)
    points = start + along[:, None] * way
    index = np.floor((points - lower) / grid.spacing).astype(np.int64)
    inside = ((index >= 0) & (index < np.array(grid.shape))).all(axis=1)
    solid = np.zeros(len(points), bool)
    solid[inside] = city.occupied[tuple(index[inside].T)]
    below = np.flatnonzero((points[:, 2] <= city.floor) & ((index >= 0) & (index < np.array(grid.shape)))[:, :2].all(1))
    met = np.concatenate([np.flatnonzero(solid)[:1], below[:1]])
    # The last point before, so that what is put there stands free.
    return point3(points[max(met.min() - 1, 0)]) if met.size else None


def first_ends(city: City) -> tuple[Point3, Point3]:
    """A start and a goal in the open, on either side of the map's middle, low above the ground [m]."""
    from scipy.ndimage import distance_transform_edt

    grid = city.grid
    level = int(np.clip((city.floor + _ABOVE - grid.lower[2]) / grid.spacing, 0, grid.shape[2] - 1))
    room = grid.spacing * distance_transform_edt(~city.occupied[:, :, level])
    xy = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape[:2]), indexing="ij"), axis=-1)
    middle = 0.5 * np.array(grid.shape[:2])
    reach = min(0.5 * _APART, 0.35 * grid.spacing * min(grid.shape[:2]))
    ends = []
    for side in (-1.0, 1.0):
        wanted = middle + side * np.array([0.9, 0.45]) * reach / grid.spacing
        away = grid.spacing * np.linalg.norm(xy - wanted, axis=-1)
        away[room < _FREE] = np.inf
        if not np.isfinite(away).any():
            away = -room  # a narrow map: where most is free
        i, j = np.unravel_index(int(np.argmin(away)), away.shape)
        ends.append(point3(np.array(grid.origin) + grid.spacing * np.array([i, j, level])))
    return ends[0], ends[1]
