"""From the argument MAP to voxels.

    x_file = offset + x_grid

Planning happens in the grid's own frame: about its middle, or for a voxel map from its first voxel. There float32 is
finest, and one compiled program serves every place on Earth. `offset` leads back, in float64.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid, Point3
from maxjax.fields.occupancy import voxelize
from maxjax.maps import MapError, PointCloud, VoxelMap, ground_mask, load_map, solidify
from maxjax.planning.program import Program
from maxjax.worlds.scenes import MAPS, Scene, make_scene, occupancy

Source = Scene | PointCloud | VoxelMap
Volume = Bool[np.ndarray, "nx ny nz"]

_CITIES = ", ".join(f"{name}:SEED" for name in MAPS)
_FARTHEST = 1e8  # [m]; beyond, even float64 leaves little of a voxel
_MOST_VOXELS = 2**24  # 256³: a plan takes 3 GB
_TOUCH = 1e-9  # [m]

_VOXELIZE = Program("voxelise", voxelize, static=("grid",))


@dataclasses.dataclass(frozen=True)
class PlacedMap:
    """A map on a grid.

    Attributes:
        occupied: obstacles and ground.
        ground: the part of it that is ground.
        grid: where the voxels lie in the frame of planning.
        offset: position of that frame's origin in the map's own coordinates [m].
        returns: points by what became of them; empty where the map is not made of points.
    """

    occupied: Volume
    ground: Volume
    grid: Grid
    offset: Float[np.ndarray, "3"]
    returns: Mapping[str, int]

    def localize(self, point: Point3) -> Float[np.ndarray, "3"]:
        """A point of the map [m] in the frame of planning; NaN and infinity stay."""
        local: Float[np.ndarray, "3"] = np.asarray(point, np.float64) - self.offset
        # float32 would turn a far point into an infinite one; outside it stays either way.
        return np.asarray(np.where(np.isfinite(local), np.clip(local, -_FARTHEST, _FARTHEST), local))

    def globalize(self, path: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t 3"]:
        """A path of the planner in the map's coordinates [m], float64 rounded to micrometres."""
        # Below the resolution of float32 at 100 m, so that nothing but its digits is rounded away.
        return np.asarray(np.round(path.astype(np.float64) + self.offset, 6))

    @property
    def file_grid(self) -> Grid:
        """The grid in the map's coordinates."""
        x, y, z = np.asarray(self.grid.origin) + self.offset
        return dataclasses.replace(self.grid, origin=(float(x), float(y), float(z)))


def load_source(text: str) -> Source:
    """The city or the file that MAP names.

    Raises:
        ValueError: for a city that does not exist, or a file that cannot be used.
    """
    match = re.fullmatch(r"(\w+):(\d+)", text)
    if match and match[1] in MAPS:
        return make_scene(match[1], int(match[2]))
    if not Path(text).exists() and (":" in text or text in MAPS):
        raise MapError(f"{text}: expected a file, or one of {_CITIES} with a whole number for SEED")
    return load_map(text)


def load_scene(text: str) -> Scene:
    """The city that MAP names.

    Raises:
        ValueError: unless it is one.
    """
    source = load_source(text)
    if not isinstance(source, Scene):
        raise MapError(f"{text}: expected a simulated city ({_CITIES}), given a file")
    return source


def place_map(source: Source, start: Point3, goal: Point3, center: Point3 | None, ground: float | None) -> PlacedMap:
    """Voxels of a map, on a grid about start and goal; making them from points is timed (`planning.recorder`).

    Args:
        source: from `load_source`.
        start, goal: [m], in the map's coordinates.
        center: middle of the grid [m]; None: half-way between start and goal.
        ground: height of flat ground [m]; None: the map's own, if it has one.

    Raises:
        ValueError: for a centre or ground that the map cannot have, or too large a voxel map.
    """
    if ground is not None and not np.isfinite(ground):
        raise ValueError(f"--ground: expected a height in metres, given {ground}")
    if isinstance(source, VoxelMap):
        return _place_voxels(source, center, ground)
    if isinstance(source, Scene) and ground is not None:
        raise ValueError("--ground: a simulated city has its own ground (z = 0); leave the option out")
    middle = _middle(start, goal, center, 0.0 if ground is None else ground)
    grid = Grid()
    if isinstance(source, Scene):
        occupied, below = occupancy(source.geoms, _about(middle))
        return PlacedMap(occupied, below, grid, middle, {})
    # Voxels are found in the cloud's frame, since there (0, 0, 0) still means a missed beam.
    frame = _about(middle - source.offset)
    found = _VOXELIZE(jnp.asarray(source.points), grid=frame)
    counts = {"inside": int(found.kept), "outside": int(found.outside), "missing": int(found.missing)}
    below = ground_mask(source, frame) if ground is None else _flat(ground, _about(middle))
    occupied = np.asarray(found.occupied) | solidify(source, frame) | below
    return PlacedMap(occupied, below, grid, middle, counts)


def _place_voxels(source: VoxelMap, center: Point3 | None, ground: float | None) -> PlacedMap:
    if center is not None:
        raise ValueError("--center: a voxel map brings its own grid; leave the option out")
    if source.occupied.size > _MOST_VOXELS:
        raise ValueError(
            f"{source.source}: expected at most {_MOST_VOXELS} voxels, given {source.occupied.size} "
            f"{source.occupied.shape}; crop it around start and goal"
        )
    below = np.zeros_like(source.occupied) if ground is None else _flat(ground, source.grid)
    grid = Grid(source.grid.shape, source.spacing, (0.0, 0.0, 0.0))
    return PlacedMap(source.occupied | below, below, grid, np.asarray(source.origin, np.float64), {})


def _middle(start: Point3, goal: Point3, center: Point3 | None, ground: float) -> Float[np.ndarray, "3"]:
    """Middle of the grid, in whole voxels above `ground`: flat ground then fills whole layers of voxels."""
    # Halves first, as the sum of two large numbers could overflow.
    wanted = 0.5 * np.asarray(start) + 0.5 * np.asarray(goal) if center is None else np.asarray(center, np.float64)
    if center is not None and not np.isfinite(wanted).all():
        raise ValueError(f"--center: expected three finite coordinates [m], given {center}")
    # Start or goal is then not finite, which the planner has a status for.
    wanted = np.where(np.isfinite(wanted), wanted, 0.0)
    if np.abs(wanted).max() > _FARTHEST:
        raise ValueError(f"middle of the grid: expected coordinates within {_FARTHEST:.0e} m of 0, given {wanted}")
    spacing, base = Grid().spacing, np.array([0.0, 0.0, ground])
    return np.asarray(base + spacing * np.round((wanted - base) / spacing))


def _about(middle: Float[np.ndarray, "3"]) -> Grid:
    x, y, z = map(float, middle)
    return Grid.centered((x, y, z))


def _flat(height: float, grid: Grid) -> Volume:
    """Voxels that reach below flat ground at `height` [m]."""
    bottom = grid.lower[2] + grid.spacing * np.arange(grid.shape[2])
    return np.broadcast_to(bottom < height - _TOUCH, grid.shape).copy()
