"""A map of voxels as a world to fly in: solids around a flight, free columns, the open air.

    solids = ground plane + boxes, whose union is the map's occupied voxels above it

Rays and exact distances are those to the solids. The plane lies at the upper face of the lowest ground voxel, and is
z = 0 of the flights' frame; higher ground is boxes. Where the map tells no ground, the plane lies at the lower face of
its lowest voxel. Beyond the map there is the plane alone.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Bool, Float, Int64

from maxjax.core.grid import Grid, Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.fields.occupancy import dilate
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.real_city import city
from maxjax.sim.worlds.voxel_boxes import box_rows

Columns = Bool[np.ndarray, "nx ny"]
Vector = Float[np.ndarray, "3"]

REACH = 100.0
"""Around both ends of a flight, in which solids are: as far as a LiDAR sees [m]."""
# Boxes at least; with more there are 2^k or 3 · 2^k, so that cities of about one size share programs.
_LEAST = 512


@dataclasses.dataclass(frozen=True, eq=False)
class VoxelCity:
    """A map of voxels in the frame of flights.

    Attributes:
        voxels: the map; its lowest layer lies below z = 0, and all of it is ground.
        origin: where the frame's (0, 0, 0) lies in the map's own coordinates [m].
        tells_ground: whether the map told its ground.
    """

    voxels: VoxelMap
    origin: Point3
    tells_ground: bool

    @classmethod
    def of(cls, given: VoxelMap, within: Columns) -> VoxelCity:
        """The city of a map.

        Args:
            given: one map.
            within: its columns in which the lowest ground is looked for, unless there is none.
        """
        occupied, ground = np.asarray(given.occupied), np.asarray(given.ground)
        known = ground.any(axis=2)
        inside = known & within if (known & within).any() else known
        lowest = np.flatnonzero(occupied.any(axis=(0, 1)))
        layer = int(_tops(ground)[inside].min()) if inside.any() else int(lowest[0]) if len(lowest) else 0
        nx, ny, nz = occupied.shape
        floor, edge = np.ones((nx, ny, 1), bool), given.grid.spacing
        above = [np.concatenate([floor, volume[:, :, layer:]], axis=2) for volume in (occupied, ground)]
        x, y, z = (np.array(given.grid.lower) + edge * np.array([nx // 2, ny // 2, layer])).tolist()
        middle = edge * (0.5 - nx // 2), edge * (0.5 - ny // 2)
        grid = Grid((nx, ny, nz - layer + 1), edge, (*middle, -0.5 * edge))
        return cls(VoxelMap.on(grid, *above), (x, y, z), bool(known.any()))

    @property
    def grid(self) -> Grid:
        """Where the voxels lie."""
        return self.voxels.grid

    @property
    def above_plane(self) -> VoxelMap:
        """The voxels above z = 0."""
        (nx, ny, nz), (x, y, z) = self.grid.shape, self.grid.origin
        volumes = (np.asarray(volume)[:, :, 1:] for volume in (self.voxels.occupied, self.voxels.ground))
        return VoxelMap.on(Grid((nx, ny, nz - 1), self.grid.spacing, (x, y, -z)), *volumes)

    @functools.cached_property
    def boxes(self) -> Float[np.ndarray, "n 7"]:
        """All solids above the plane, as rows of `solids.upright_boxes`."""
        above = self.above_plane
        return box_rows(np.asarray(above.occupied), above.grid)

    def solids(self, start: Vector, goal: Vector, slots: int) -> Geoms:
        """The ground plane and the boxes around the ends of a flight.

        Args:
            start, goal: of the flight [m].
            slots: boxes in all, with padding; raises a ValueError for fewer than there are.
        """
        return city(self._around(start, goal), slots)

    def slots_for(self, start: Vector, goal: Vector) -> int:
        """Boxes around the ends of a flight, with padding."""
        return _padded(len(self._around(start, goal)))

    def slots_within(self, apart: float) -> int:
        """Boxes around any ends in the map that are so far apart [m] at most, with padding; no fewer than there are."""
        half, sides = REACH + apart, []
        for axis in range(2):
            # Of the middle of a box, from which any point of its surroundings is less far than this.
            for side, way in ((math.floor, -1.0), (math.ceil, 1.0)):
                edges = self.boxes[:, axis] + way * (self.boxes[:, 2 + axis] + half)
                places = (edges - self.grid.lower[axis]) / self.grid.spacing
                sides.append(np.clip([side(place) for place in places], 0, self.grid.shape[axis]).astype(np.int64))
        changes = np.zeros((self.grid.shape[0] + 1, self.grid.shape[1] + 1), np.int64)
        x0, x1, y0, y1 = sides
        for x, y, sign in ((x0, y0, 1), (x1, y0, -1), (x0, y1, -1), (x1, y1, 1)):
            np.add.at(changes, (x, y), sign)
        return _padded(int(changes.cumsum(0).cumsum(1).max(initial=0)))

    def _around(self, start: Vector, goal: Vector) -> Float[np.ndarray, "m 7"]:
        """The boxes that reach into the box around both ends, with as much room as a LiDAR sees."""
        low, high = np.minimum(start, goal)[:2] - REACH, np.maximum(start, goal)[:2] + REACH
        middle, half = self.boxes[:, :2], self.boxes[:, 2:4]
        return self.boxes[np.all((middle - half < high) & (middle + half > low), axis=1)]

    def columns(self, xy: Float[np.ndarray, "*batch 2"]) -> Int64[np.ndarray, "*batch 2"]:
        """Indices of the columns of places [m]; some may lie outside of the map."""
        index: Int64[np.ndarray, "*batch 2"] = np.floor(
            (xy - np.array(self.grid.lower[:2])) / self.grid.spacing
        ).astype(np.int64)
        return index

    @functools.cached_property
    def ground_top(self) -> Float[np.ndarray, "nx ny"]:
        """Height of the ground's highest voxel's upper face in each column [m]."""
        return np.asarray(self.grid.spacing * (_tops(np.asarray(self.voxels.ground)) - 1.0))

    def ground_at(self, place: Vector) -> float:
        """Height of the ground in the column of a place, 0 outside of the map [m]."""
        x, y = self.columns(np.asarray(place, np.float64)[:2]).tolist()
        inside = 0 <= x < self.grid.shape[0] and 0 <= y < self.grid.shape[1]
        return float(self.ground_top[x, y]) if inside else 0.0

    def columns_beside(self, least: float, most: float) -> Columns:
        """Columns that are so far, horizontally, from what stands in the map: all of each at least, its middle at most.

        What stands is occupied, is no ground, and reaches above the ground of its column. Where nothing does, all are.
        Between two columns that are i and j apart lie |i| - 1 and |j| - 1 columns.

        Args:
            least, most: distances [m].
        """
        from scipy import ndimage  # a quarter of a second that most commands can do without

        occupied, ground = np.asarray(self.voxels.occupied), np.asarray(self.voxels.ground)
        above = np.arange(occupied.shape[2]) >= _tops(ground)[:, :, None]
        stands = np.asarray((occupied & ~ground & above).any(axis=2))
        if not stands.any():
            return np.ones(stands.shape, bool)
        reach = math.ceil(least / self.grid.spacing) + 1
        gap = self.grid.spacing * np.maximum(np.abs(np.arange(-reach, reach + 1)) - 1, 0)
        clear = ~ndimage.binary_dilation(stands, np.hypot(gap[:, None], gap) < least)
        return np.asarray(clear & (self.grid.spacing * ndimage.distance_transform_edt(~stands) <= most))

    def open_air(self, dilation: float) -> Bool[np.ndarray, "nx ny nz"]:
        """The largest component of voxels that are free after dilation [m], of the ground by one voxel."""
        from scipy import ndimage  # see above

        free = ~np.asarray(dilate(self.voxels.occupied, dilation, self.grid, self.voxels.ground))
        parts, count = ndimage.label(free)
        return np.asarray(parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])) if count else free


def _padded(count: int) -> int:
    slots = _LEAST
    while slots < count:
        slots = slots * 3 // 2 if slots.bit_count() == 1 else slots * 4 // 3
    return slots


def _tops(ground: Bool[np.ndarray, "nx ny nz"]) -> Int64[np.ndarray, "nx ny"]:
    """Layers up to the highest ground voxel of each column, that one included; all where there is none."""
    return np.asarray(ground.shape[2] - ground[:, :, ::-1].argmax(axis=2))
