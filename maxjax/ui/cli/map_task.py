"""From a request to a task: a map by name or file, as voxels on a grid in the map's own coordinates.

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
from maxjax.inspection.landing_place import LandingPlace
from maxjax.io import Contents, Window, map_of, read_map
from maxjax.io.airspace.airspace import Airspace, Reasons
from maxjax.io.airspace.zone_files import load_airspace
from maxjax.io.geo.earth import Earth, earth_of
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.io.kinds.contents import facts
from maxjax.io.kinds.point_cloud import FARTHEST
from maxjax.io.load import locate, map_with
from maxjax.io.places import points_at
from maxjax.io.reading import PLAIN, Reading
from maxjax.io.window import MOST_VOXELS as MOST_FOCUSED
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import MAPS, Scene, make_scene
from maxjax.ui.cli.roofs import Roof, hints_of, land_on, roof_targets
from maxjax.ui.methods import method_named
from maxjax.ui.request import Request, reading_of

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
        frame: what places are given in, as the request says.
        landings: places on roofs that it may end on, the first of which the last problem leads to; none: no roof.
    """

    task: Task
    terrain: Terrain
    returns: Mapping[str, int] = dataclasses.field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    earth: Earth | None = None
    airspace: Airspace | None = None
    within: Bool[np.ndarray, "nx ny"] | None = None
    frame: str = "map"
    landings: tuple[LandingPlace, ...] = ()

    @property
    def places(self) -> PlaceFormat:
        """How places are given."""
        return PlaceFormat(self.frame, self.earth, self.terrain)

    @property
    def stops(self) -> tuple[Point3, ...]:
        """Start of the first problem, and goals of all, which are those of a mission [m]."""
        places = np.concatenate([self.task.starts[:1], self.task.goals])
        return tuple((x, y, z) for x, y, z in places.tolist())

    def through(self, request: Request) -> Request:
        """A request with its stops, their alternatives and points of interest in the coordinates of the map [m].

        Raises:
            ValueError: for one of these that is nowhere, in the frame of the request.
        """
        first = request.places[0]

        def placed(given: Point3) -> Point3:
            return points_at((first, given), request.frame, self.earth, self.terrain)[1]

        stops = [
            dataclasses.replace(
                stop,
                position=place,
                look_at=None if stop.look_at is None else placed(stop.look_at),
                alternatives=tuple(placed(other.position) for other in stop.choices[1:]),
            )
            for stop, place in zip(request.stops, self.stops, strict=False)
        ]
        roofs = [landing.waypoint for landing in self.landings]
        if roofs:
            stops.append(dataclasses.replace(roofs[0], alternatives=tuple(roofs[1:])))
        return request.visiting(stops)

    @property
    def ends(self) -> tuple[Point3, Point3]:
        """Start and goal of the only problem [m]."""
        (start,), (goal,) = self.task.starts.tolist(), self.task.goals.tolist()
        return tuple(start), tuple(goal)


def load_source(text: str, reading: Reading = PLAIN) -> Source:
    """The city or the file that MAP names, read as a request says (`reading_of`).

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


def task_in(source: Source, request: Request) -> MapTask:
    """Stops and distances of a request in a map; making voxels from points is timed (`compile.stage_timer`).

    Args:
        source: from `load_source`.
        request: stops, distances, what becomes of a file (`maxjax.load_map`), and the rules of the air.

    Raises:
        ValueError: for a window, a ground or distances that the map cannot have, places that are not in it, too many
            voxels, or rules of the air that it cannot have.
        ImportError: where a package is missing that reference systems need.
    """
    if request.ground is not None and not np.isfinite(request.ground):
        raise ValueError(f"--ground: expected a height in metres, given {request.ground}")
    given = _in_city(source, request) if isinstance(source, Scene) else _in_file(source, request)
    given = dataclasses.replace(given, frame=request.frame)
    airspace = airspace_of(request, given)
    if airspace is None:
        return given
    remarks = (*given.remarks, *airspace.remarks)
    return dataclasses.replace(
        given, task=closing(given.task, airspace.closed_over(given.terrain)), remarks=remarks, airspace=airspace
    )


def closing(task: Task, reasons: Reasons) -> Task:
    """The task in its map under rules of the air."""
    return dataclasses.replace(task, map=task.map.closing(reasons))


def airspace_of(request: Request, given: MapTask) -> Airspace | None:
    """The rules of the air of a request in a map; None where they name none."""
    above = request.ceiling_above_start
    highest = None if above is None else float(given.task.starts[0, 2]) + above
    if request.airspace is not None:
        if given.earth is None:
            raise ValueError(f"--airspace {request.airspace}: the map does not say where it lies; {_PLACE}")
        return load_airspace(
            request.airspace,
            given.earth,
            given.task.grid,
            floor=request.floor,
            ceiling=request.ceiling,
            highest=highest,
        )
    airspace = Airspace(request.floor, request.ceiling, highest)
    return None if airspace == Airspace() else airspace


def _in_file(source: Contents, request: Request) -> MapTask:
    earth = earth_in(source, request)
    most = MOST_FOCUSED if method_named(request.method).name == "field" else MOST_VOXELS
    roofs = roof_targets(request, earth)
    around = (*request.every_place, *hints_of(source, roofs, request.frame, earth))
    window = Window(request.spacing, request.bounds, request.center, around, request.ground, most)
    with time_stage("voxelise"):
        if request.frame == "map":
            found, located = map_of(source, window, reading_of(request)), list(around)
        elif earth is None and request.frame != "local-agl":
            raise ValueError(f"--frame {request.frame}: the map does not say where it lies on Earth; {_PLACE}")
        else:
            found, located = map_with(source, window, around, request.frame, earth, reading_of(request))
    given, file = _task(found, request, located[: len(request.places)], earth, roofs), found.file
    return dataclasses.replace(given, returns=file.counts, remarks=(*file.remarks, *given.remarks), within=file.within)


def earth_in(source: Contents, request: Request) -> Earth | None:
    """Where a file's map lies on Earth, as a request or the file say it; raises as `Request.earth`."""
    return request.earth(locate(facts(source), reading_of(request))[0])


def city_task(scene: Scene, start: Point3, goal: Point3) -> Task:
    """A problem in the true city, its grid about start and goal."""
    return task_in(scene, Request.between(scene.name, start, goal)).task


def _in_city(scene: Scene, request: Request) -> MapTask:
    if request.ground is not None:
        raise ValueError("--ground: a simulated city has its own ground (z = 0); leave the option out")
    for name in (
        "spacing",
        "bounds",
        "below",
        "unknown",
        "unit",
        "vertical_unit",
        "band",
        "drop_class",
        "only",
        "height",
        "levels",
        "up",
        "offset",
        "inside",
    ):
        if getattr(request, name) not in (None, ()):
            raise ValueError(f"--{name}: a simulated city has its own grid; leave the option out, or use --center")
    earth = request.earth(earth_of(request.crs, None, VerticalZero(request.height_of_zero), request.accuracy))
    around = request.every_place
    if request.frame != "map":
        if earth is None and request.frame != "local-agl":
            raise ValueError(f"--frame {request.frame}: a simulated city lies nowhere on Earth; {_PLACE}")
        flat = Terrain.flat(0.0, Grid((1, 1, 1), 2e5))
        around = tuple(points_at(around, request.frame, earth, flat))
    grid, ends = Grid.centered(_middle(around, request.center)), around[: len(request.places)]
    found = _task(scene.voxels(grid), request, ends, earth, roof_targets(request, earth))
    return dataclasses.replace(found, terrain=Terrain.flat(0.0, grid))


def _task(
    where: VoxelMap, request: Request, ends: Sequence[Point3], earth: Earth | None, roofs: Sequence[Roof] = ()
) -> MapTask:
    """The task in a map, to the roof that it ends on; raises a ValueError for one far from its place on Earth."""
    landings, remarks = land_on(where, roofs, request.landing, request.radius)
    places = np.asarray([*ends, *(landing.waypoint.position for landing in landings[:1])], np.float64)
    starts, goals = places[:-1], places[1:]
    if earth is not None:
        earth.geodetic(np.array([where.grid.lower, where.grid.upper]))
    task = Task.of(where, starts, goals, request.distances)
    return MapTask(task, where.terrain, earth=earth, remarks=remarks, landings=landings)


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
