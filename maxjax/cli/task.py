"""From the argument MAP to a task: a map by name or file, as voxels on a grid in the map's own coordinates.

The grid lies about the middle of start and goal, in whole voxels above flat ground; a voxel map brings its own.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from maxjax.cli.options import PlanOptions
from maxjax.core.grid import Grid, Point3
from maxjax.fields.occupancy import voxelize
from maxjax.maps import MapError, Mesh, PointCloud, VoxelMap, ground_mask, load_map, solidify
from maxjax.planning.program import Program
from maxjax.planning.task import Distances, Task
from maxjax.worlds.scenes import MAPS, Scene, make_scene, occupancy

Source = Scene | PointCloud | VoxelMap | Mesh
Volume = Bool[np.ndarray, "nx ny nz"]

_CITIES = ", ".join(f"{name}:SEED" for name in MAPS)
_FARTHEST = 1e8  # [m]; beyond, even float64 leaves little of a voxel
MOST_VOXELS = 2**24  # 256³: a plan that takes the whole map takes 3 GB
_MOST_FOCUSED = 2**27  # 512³: one in windows takes 1 GB beyond the map
_TOUCH = 1e-9  # [m]

_VOXELIZE = Program("voxelise", voxelize, static=("grid",))


@dataclasses.dataclass(frozen=True)
class MapTask:
    """One problem in a map.

    Attributes:
        task: the problem, in the map's coordinates.
        returns: points by what became of them; empty where the map is not made of points.
    """

    task: Task
    returns: Mapping[str, int]

    @property
    def ends(self) -> tuple[Point3, Point3]:
        """Start and goal [m]."""
        (start,), (goal,) = self.task.starts.tolist(), self.task.goals.tolist()
        return tuple(start), tuple(goal)


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


def task_in(source: Source, options: PlanOptions) -> MapTask:
    """Start, goal and distances of some options in a map; making voxels from points is timed (`planning.recorder`).

    Args:
        source: from `load_source`.
        options: start, goal, radius, margin, middle of the grid, and height of flat ground.

    Raises:
        ValueError: for a centre, a ground or distances that the map cannot have, or too large a voxel map.
    """
    if options.ground is not None and not np.isfinite(options.ground):
        raise ValueError(f"--ground: expected a height in metres, given {options.ground}")
    if isinstance(source, VoxelMap):
        return _of_voxels(source, options)
    if isinstance(source, Scene) and options.ground is not None:
        raise ValueError("--ground: a simulated city has its own ground (z = 0); leave the option out")
    middle = _middle(options)
    grid = _about(middle)
    if isinstance(source, Scene):
        occupied, below = occupancy(source.geoms, grid)
        return _task(occupied, below, grid, options)
    if isinstance(source, Mesh):
        below = np.zeros(grid.shape, bool) if options.ground is None else _flat(options.ground, grid)
        return _task(source.voxels(grid), below, grid, options)
    # Voxels are found in the cloud's frame, where (0, 0, 0) still means a missed beam.
    frame = _about(middle - source.offset)
    found = _VOXELIZE(jnp.asarray(source.points), grid=frame)
    counts = {"inside": int(found.kept), "outside": int(found.outside), "missing": int(found.missing)}
    below = ground_mask(source, frame) if options.ground is None else _flat(options.ground, grid)
    return _task(np.asarray(found.occupied) | solidify(source, frame), below, grid, options, counts)


def city_task(scene: Scene, start: Point3, goal: Point3) -> Task:
    """A problem in the true city, its grid about start and goal."""
    return task_in(scene, PlanOptions(scene.name, start, goal)).task


def _task(
    obstacle: Volume, ground: Volume, grid: Grid, options: PlanOptions, returns: Mapping[str, int] | None = None
) -> MapTask:
    ends = np.asarray([options.start], np.float64), np.asarray([options.goal], np.float64)
    distances = Distances.of(options.radius, options.margin)
    return MapTask(Task.of(obstacle | ground, *ends, grid, distances, ground), returns or {})


def _of_voxels(source: VoxelMap, options: PlanOptions) -> MapTask:
    if options.center is not None:
        raise ValueError("--center: a voxel map brings its own grid; leave the option out")
    most = _MOST_FOCUSED if options.method == "solver" else MOST_VOXELS
    if source.occupied.size > most:
        raise ValueError(
            f"{source.source}: expected at most {most} voxels, given {source.occupied.size} "
            f"{source.occupied.shape}; crop it around start and goal"
        )
    below = np.zeros_like(source.occupied) if options.ground is None else _flat(options.ground, source.grid)
    return _task(source.occupied, below, source.grid, options)


def _middle(options: PlanOptions) -> Float[np.ndarray, "3"]:
    """Middle of the grid, in whole voxels above the ground: flat ground then fills whole layers of voxels."""
    center = options.center
    # Halves first, as the sum of two large numbers could overflow.
    halfway = 0.5 * np.asarray(options.start) + 0.5 * np.asarray(options.goal)
    wanted = halfway if center is None else np.asarray(center, np.float64)
    if center is not None and not np.isfinite(wanted).all():
        raise ValueError(f"--center: expected three finite coordinates [m], given {center}")
    # Start or goal is then not finite, which the planner has a status for.
    wanted = np.where(np.isfinite(wanted), wanted, 0.0)
    if np.abs(wanted).max() > _FARTHEST:
        raise ValueError(f"middle of the grid: expected coordinates within {_FARTHEST:.0e} m of 0, given {wanted}")
    spacing, base = Grid().spacing, np.array([0.0, 0.0, options.ground or 0.0])
    return np.asarray(base + spacing * np.round((wanted - base) / spacing))


def _about(middle: Float[np.ndarray, "3"]) -> Grid:
    x, y, z = map(float, middle)
    return Grid.centered((x, y, z))


def _flat(height: float, grid: Grid) -> Volume:
    """Voxels that reach below flat ground at `height` [m]."""
    bottom = grid.lower[2] + grid.spacing * np.arange(grid.shape[2])
    return np.broadcast_to(bottom < height - _TOUCH, grid.shape).copy()
