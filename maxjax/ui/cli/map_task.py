"""From the argument MAP to a task: a map by name or file, as voxels on a grid in the map's own coordinates.

The grid of a simulated city lies about the middle of start and goal, that of a file where its window says.
"""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool

from maxjax.compile.stage_timer import time_stage
from maxjax.core.files import FileError
from maxjax.core.grid import Grid, Point3
from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap
from maxjax.fields.price import Price
from maxjax.io import Contents, Window, map_of, read_map
from maxjax.io.airspace.airspace import Airspace, Reasons
from maxjax.io.airspace.zone_files import load_airspace
from maxjax.io.geo.earth import Degrees, Earth, Projected, TangentPlane
from maxjax.io.geo.reference_system import reference_system
from maxjax.io.kinds.contents import facts
from maxjax.io.kinds.point_cloud import FARTHEST
from maxjax.io.load import map_with
from maxjax.io.places import point_at
from maxjax.io.reading import PLAIN, Reading
from maxjax.io.window import MOST_VOXELS as MOST_FOCUSED
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import MAPS, Scene, make_scene
from maxjax.ui.cli.options import PlanOptions, ReadOptions, RouteOptions
from maxjax.ui.methods import method_named

Source = Scene | Contents

_CITIES = ", ".join(f"{name}:SEED" for name in MAPS)
_PLACE = "give --place LAT LON H or, for coordinates of a reference system, --crs CODE"
MOST_VOXELS = 2**24  # 256³: a plan that takes the whole map takes 3 GB; one in windows 1 GB beyond a map of 512³


@dataclasses.dataclass(frozen=True)
class MapTask:
    """One problem in a map, or one for each leg of a mission.

    Attributes:
        task: the problem or problems, in the map's coordinates.
        terrain: how high the ground is.
        returns: points by what became of them; empty where the map is not made of points.
        remarks: sentences on the map that a user should know.
        earth: where the map lies; None where that is unknown.
        airspace: the rules of the air; None where there are none.
        within: columns that lie within the map's data; None: all do.
        frame: what places are given in, as options say.
    """

    task: Task
    terrain: Terrain
    returns: Mapping[str, int] = dataclasses.field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    earth: Earth | None = None
    airspace: Airspace | None = None
    within: Bool[np.ndarray, "nx ny"] | None = None
    frame: str = "map"

    @property
    def places(self) -> PlaceFormat:
        """How places are given."""
        return PlaceFormat(self.frame, self.earth, self.terrain)

    @property
    def ends(self) -> tuple[Point3, Point3]:
        """Start and goal of the only problem [m]."""
        (start,), (goal,) = self.task.starts.tolist(), self.task.goals.tolist()
        return tuple(start), tuple(goal)


def load_source(text: str, reading: Reading = PLAIN) -> Source:
    """The city or the file that MAP names, read as options say (`reading_of`).

    Raises:
        ValueError: for a city that does not exist, or a file that cannot be used.
    """
    match = re.fullmatch(r"(\w+):(\d+)", text)
    if match and match[1] in MAPS:
        return make_scene(match[1], int(match[2]))
    if not os.path.exists(text) and (":" in text or text in MAPS):
        raise FileError(f"{text}: expected a file, or one of {_CITIES} with a whole number for SEED")
    return read_map(text, reading)


def load_scene(text: str) -> Scene:
    """The city that MAP names.

    Raises:
        ValueError: unless it is one.
    """
    source = load_source(text)
    if not isinstance(source, Scene):
        raise FileError(f"{text}: expected a simulated city ({_CITIES}), given a file")
    return source


def check_options(options: PlanOptions) -> None:
    """Find out before a map is read whether what is told about it can be used.

    Raises:
        ValueError: for a place, a reference system or heights that are none.
        ImportError: where a package is missing that reference systems need.
    """
    if options.place is not None and options.crs is not None:
        raise ValueError("--crs: expected one of --place and --crs, given both; leave one out")
    earth_of(options, None, None)
    if options.crs is not None:
        reference_system(options.crs)
    Airspace(options.floor, options.ceiling, options.ceiling_above_start)


def task_in(source: Source, options: PlanOptions) -> MapTask:
    """Start, goal and distances of some options in a map; making voxels from points is timed (`compile.stage_timer`).

    Args:
        source: from `load_source`.
        options: start, goal, radius, margin, what becomes of a file (`maps.load_map`), and the rules of the air.

    Raises:
        ValueError: for a window, a ground or distances that the map cannot have, places that are not in it, too many
            voxels, or rules of the air that it cannot have.
        ImportError: where a package is missing that reference systems need.
    """
    if options.ground is not None and not np.isfinite(options.ground):
        raise ValueError(f"--ground: expected a height in metres, given {options.ground}")
    given = _in_city(source, options) if isinstance(source, Scene) else _in_file(source, options)
    given = dataclasses.replace(given, frame=options.frame)
    airspace = airspace_of(options, given)
    if airspace is None:
        return given
    remarks = (*given.remarks, *airspace.remarks)
    return dataclasses.replace(
        given, task=closing(given.task, airspace.closed_over(given.terrain)), remarks=remarks, airspace=airspace
    )


def closing(task: Task, reasons: Reasons) -> Task:
    """The task in its map under rules of the air."""
    return dataclasses.replace(task, map=task.map.closing(reasons))


def airspace_of(options: PlanOptions, given: MapTask) -> Airspace | None:
    """The rules of the air of some options in a map; None where they name none."""
    above = options.ceiling_above_start
    highest = None if above is None else float(given.task.starts[0, 2]) + above
    if options.airspace is not None:
        if given.earth is None:
            raise ValueError(f"--airspace {options.airspace}: the map does not say where it lies; {_PLACE}")
        return load_airspace(
            options.airspace,
            given.earth,
            given.task.grid,
            floor=options.floor,
            ceiling=options.ceiling,
            highest=highest,
        )
    airspace = Airspace(options.floor, options.ceiling, highest)
    return None if airspace == Airspace() else airspace


def _in_file(source: Contents, options: PlanOptions) -> MapTask:
    earth = earth_in(source, options)
    most = MOST_FOCUSED if method_named(options.method).name == "field" else MOST_VOXELS
    ends = _ends(options)
    window = Window(options.spacing, options.bounds, options.center, ends, options.ground, most)
    with time_stage("voxelise"):
        if options.frame == "map":
            found = map_of(source, window, reading_of(options))
        elif earth is None and options.frame != "local-agl":
            raise ValueError(f"--frame {options.frame}: the map does not say where it lies on Earth; {_PLACE}")
        else:
            found, ends = map_with(source, window, ends, options.frame, earth, reading_of(options))
    given, file = _task(found, options, ends, earth), found.file
    return dataclasses.replace(given, returns=file.counts, remarks=file.remarks, within=file.within)


def reading_of(options: ReadOptions) -> Reading:
    """Options for what a file leaves open."""
    return Reading(
        below=options.below,
        unknown=options.unknown,
        crs=options.crs,
        unit=options.unit,
        vertical_unit=options.vertical_unit,
        band=options.band,
        drop_classes=options.drop_class,
        only=options.only,
    )


def earth_in(source: Contents, options: PlanOptions) -> Earth | None:
    """Where a file's map lies on Earth, as options or the file say it; raises as `earth_of`."""
    known = facts(source)
    return earth_of(options, known.crs, known.origin)


def earth_of(options: PlanOptions, crs: str | None, origin: tuple[float, float] | None) -> Earth | None:
    """Where a map lies on Earth: at the place of some options, else where its file, read as they say, has it.

    Raises:
        ValueError: if the place is none.
    """
    if options.place is not None:
        return TangentPlane(*options.place)
    if origin is not None:
        return Degrees(*origin)
    return None if crs is None else Projected(crs)


def city_task(scene: Scene, start: Point3, goal: Point3) -> Task:
    """A problem in the true city, its grid about start and goal."""
    return task_in(scene, PlanOptions(scene.name, start, goal)).task


def _in_city(scene: Scene, options: PlanOptions) -> MapTask:
    if options.ground is not None:
        raise ValueError("--ground: a simulated city has its own ground (z = 0); leave the option out")
    for name in ("spacing", "bounds", "below", "unknown", "unit", "vertical_unit", "band", "drop_class", "only"):
        if getattr(options, name) not in (None, ()):
            raise ValueError(f"--{name}: a simulated city has its own grid; leave the option out, or use --center")
    earth, ends = earth_of(options, options.crs, None), _ends(options)
    if options.frame != "map":
        if earth is None and options.frame != "local-agl":
            raise ValueError(f"--frame {options.frame}: a simulated city lies nowhere on Earth; {_PLACE}")
        flat = Terrain.flat(0.0, Grid((1, 1, 1), 2e5))
        ends = [point_at(place, options.frame, earth, flat) for place in ends]
    grid = Grid.centered(_middle(ends, options.center))
    return dataclasses.replace(_task(scene.voxels(grid), options, ends, earth), terrain=Terrain.flat(0.0, grid))


def _ends(options: PlanOptions) -> list[Point3]:
    """Start, places on the way and goal, in order; again the start if asked."""
    return [options.start, *options.via, options.goal, *([options.start] if options.return_to_start else [])]


def _task(where: VoxelMap, options: PlanOptions, ends: Sequence[Point3], earth: Earth | None) -> MapTask:
    """The task in a map; raises a ValueError for one that is far from its place on Earth."""
    places = np.asarray(ends, np.float64)
    starts, goals = places[:-1], places[1:]
    if earth is not None:
        earth.geodetic(np.array([where.grid.lower, where.grid.upper]))
    task = Task.of(where, starts, goals, distances_of(options))
    return MapTask(task, where.terrain, earth=earth)


def distances_of(options: RouteOptions) -> Distances:
    """The distances to keep that options ask for.

    Raises:
        ValueError: if they are none.
    """
    return Distances(options.radius, options.margin, price_of(options.price))


def price_of(text: str) -> Price:
    """The price that `SHAPE`, `SHAPE:HEIGHT` or `none` names; raises a ValueError where it names none."""
    shape, _, height = text.partition(":")
    try:
        if shape == "none":
            return Price(height=0.0)
        return Price(shape, float(height)) if height else Price(shape)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(
            "--price: expected none, quadratic, exponential or speed, with a height of at least 0 as in quadratic:3.5, "
            f"given {text!r}"
        ) from error


def _middle(ends: Sequence[Point3], center: Point3 | None) -> Point3:
    """Middle of the grid, a whole number of voxels above the ground."""
    # Halves first, as the sum of two large numbers could overflow.
    places = 0.5 * np.asarray(ends, np.float64)
    halfway = places.min(axis=0) + places.max(axis=0)
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
