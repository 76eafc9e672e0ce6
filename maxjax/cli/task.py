"""From the argument MAP to a task: a map by name or file, as voxels on a grid in the map's own coordinates.

The grid of a simulated city lies about the middle of start and goal, that of a file where its window says.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from maxjax.cli.options import PlanOptions
from maxjax.core.grid import Grid, Point3
from maxjax.maps import Contents, MapError, Window, map_of, read_map
from maxjax.maps.model import FARTHEST
from maxjax.maps.window import MOST_VOXELS as MOST_FOCUSED
from maxjax.planning.recorder import timed
from maxjax.planning.task import Distances, Task
from maxjax.worlds.scenes import MAPS, Scene, make_scene, occupancy

Source = Scene | Contents
Volume = Bool[np.ndarray, "nx ny nz"]

_CITIES = ", ".join(f"{name}:SEED" for name in MAPS)
MOST_VOXELS = 2**24  # 256³: a plan that takes the whole map takes 3 GB; one in windows 1 GB beyond a map of 512³


@dataclasses.dataclass(frozen=True)
class MapTask:
    """One problem in a map.

    Attributes:
        task: the problem, in the map's coordinates.
        returns: points by what became of them; empty where the map is not made of points.
        remarks: sentences on the map that a user should know.
        crs, origin: where the map lies on Earth, as in `maps.Map`; None where it does not say so.
    """

    task: Task
    returns: Mapping[str, int]
    remarks: tuple[str, ...] = ()
    crs: str | None = None
    origin: tuple[float, float] | None = None

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
    return read_map(text)


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
        options: start, goal, radius, margin, and what becomes of a file (`maps.load_map`).

    Raises:
        ValueError: for a window, a ground or distances that the map cannot have, or too many voxels.
    """
    if options.ground is not None and not np.isfinite(options.ground):
        raise ValueError(f"--ground: expected a height in metres, given {options.ground}")
    if isinstance(source, Scene):
        return _in_city(source, options)
    most = MOST_FOCUSED if options.method == "solver" else MOST_VOXELS
    ends = (options.start, options.goal)
    window = Window(options.spacing, options.bounds, options.center, ends, options.ground, most)
    with timed("voxelise"):
        found = map_of(source, window, options.below, options.unknown)
    given = _task(found.occupied, found.ground, found.grid, options, found.counts, found.remarks)
    return dataclasses.replace(given, crs=found.crs, origin=found.origin)


def city_task(scene: Scene, start: Point3, goal: Point3) -> Task:
    """A problem in the true city, its grid about start and goal."""
    return task_in(scene, PlanOptions(scene.name, start, goal)).task


def _in_city(scene: Scene, options: PlanOptions) -> MapTask:
    if options.ground is not None:
        raise ValueError("--ground: a simulated city has its own ground (z = 0); leave the option out")
    for name in ("spacing", "bounds", "below", "unknown"):
        if getattr(options, name) is not None:
            raise ValueError(f"--{name}: a simulated city has its own grid; leave the option out, or use --center")
    grid = Grid.centered(_middle(options))
    return _task(*occupancy(scene.geoms, grid), grid, options)


# arguments: what a map is made of
def _task(
    obstacle: Volume,
    ground: Volume,
    grid: Grid,
    options: PlanOptions,
    returns: Mapping[str, int] | None = None,
    remarks: tuple[str, ...] = (),
) -> MapTask:
    ends = np.asarray([options.start], np.float64), np.asarray([options.goal], np.float64)
    distances = Distances.of(options.radius, options.margin)
    return MapTask(Task.of(obstacle | ground, *ends, grid, distances, ground), returns or {}, remarks)


def _middle(options: PlanOptions) -> Point3:
    """Middle of the grid, a whole number of voxels above the ground."""
    center = options.center
    # Halves first, as the sum of two large numbers could overflow.
    halfway = 0.5 * np.asarray(options.start) + 0.5 * np.asarray(options.goal)
    wanted = halfway if center is None else np.asarray(center, np.float64)
    if center is not None and not np.isfinite(wanted).all():
        raise ValueError(f"--center: expected three finite coordinates [m], given {center}")
    # Start or goal is then not finite, which the planner has a status for.
    wanted = np.where(np.isfinite(wanted), wanted, 0.0)
    if np.abs(wanted).max() > FARTHEST:
        raise ValueError(f"middle of the grid: expected coordinates within {FARTHEST:.0e} m of 0, given {wanted}")
    spacing = Grid().spacing
    x, y, z = (spacing * np.round(wanted / spacing)).tolist()
    return x, y, z
