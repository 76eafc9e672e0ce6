"""`maxjax view`: a page in the browser to plan on, or to play flights on; with --share, one file of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from maxjax.io import Contents, Window, map_of
from maxjax.io.geo.earth import Earth
from maxjax.io.kinds.point_cloud import PointCloud
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import Waypoint
from maxjax.sim.worlds.scenes import Scene
from maxjax.ui.cli import report, viewing_flights
from maxjax.ui.cli.load_request import tell_notes, tell_remarks
from maxjax.ui.cli.map_task import MapTask, airspace_of, earth_in, load_source, task_in
from maxjax.ui.cli.options import ViewOptions
from maxjax.ui.cli.page import wait, write_page
from maxjax.ui.cli.progress import progress
from maxjax.ui.figures.drawable import drawable
from maxjax.ui.page.answer import answer, describe_answer
from maxjax.ui.page.page_map import City, first_ends
from maxjax.ui.page.server import need_viser
from maxjax.ui.request import Request, reading_of
from maxjax.ui.request_files import load_mission, read_plan

# Of the middle of a simulated city's grid, so that it holds roofs and little underground [m].
_MIDDLE = (0.0, 0.0, 40.0)


def run_view(options: ViewOptions) -> int:
    """Show a page until Ctrl-C, or write it. Returns 0, or 1 where there is no path to share.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    need_viser()
    if options.share is not None and not options.share.absolute().parent.is_dir():
        raise ValueError(f"--share {options.share}: expected a folder {options.share.absolute().parent}; make it first")
    if Path(options.map).is_dir():
        return viewing_flights.view_flights(options)
    with progress(f"Reading {options.map}"):
        city, request, earth = open_request(request_shown(options))
    if options.share is not None:
        return _share(options.share, city, request, dark=options.dark)
    from maxjax.ui.page.plan_page import PlanPage
    from maxjax.ui.page.server import serve

    server = serve(city, host=options.host, port=options.port, dark=options.dark)
    page = PlanPage(server, city, request, earth, dark=options.dark)
    wait(server)
    page.close()
    return 0


def _share(path: Path, city: City, request: Request, *, dark: bool) -> int:
    from maxjax.ui.page.download import page_of

    with progress("Planning"):
        found = answer(city, request)
    if not found.ok:
        report.complain(describe_answer(found).replace("### ", "").replace("**", "").replace("\n\n", ". "))
        return 1
    with progress("Writing the page"):
        page = page_of(city, found, dark=dark)
    write_page(path, page)
    return 0


def request_shown(options: ViewOptions) -> Request:
    """What the page begins with: a map's options, or a file's but for options that are given and not their defaults.

    Raises:
        ValueError, OSError: for a file that cannot be used.
    """
    path, own, shown = Path(options.map), Request.of(options), None
    if path.suffix.lower() == ".toml":
        shown = load_mission(path)
    elif path.suffix.lower() == ".json" and path.is_file():
        shown = read_plan(path)
    if shown is None:
        return own
    if own.waypoints and shown.waypoints:
        raise ValueError(f"--start: {options.map} has its own waypoints; drag them on the page")
    changed = {
        field.name: getattr(own, field.name)
        for field in dataclasses.fields(Request)
        if field.name != "map" and getattr(own, field.name) != field.default
    }
    return dataclasses.replace(shown, **changed)


def open_request(request: Request) -> tuple[City, Request, Earth | None]:
    """The map of a request, its first stops in it, and where the map lies on Earth."""
    request.check()
    request.supply  # noqa: B018 (raises)
    source = load_source(request.map, reading_of(request))
    bare = not request.waypoints
    given = _small_enough(_without_ends(source, request) if bare else task_in(source, request))
    tell_notes(request)
    tell_remarks(request.map, given)
    city = _city_of(given, source, request)
    stops = map(Waypoint, first_ends(city)) if bare else given.through(request).waypoints
    # On the page a waypoint is one place, above a roof as elsewhere.
    alone = (dataclasses.replace(stop, alternatives=(), touchdown=None) for stop in stops)
    return city, request.visiting(alone), given.earth


def _without_ends(source: Scene | Contents, request: Request) -> MapTask:
    """A map with the rules of the air that do not depend on the ends."""
    if request.frame != "map":
        raise ValueError("--frame: expected with --start and --goal, given without")
    if isinstance(source, Scene):
        where = dataclasses.replace(request, center=request.center or _MIDDLE, waypoints=(Waypoint(_MIDDLE),) * 2)
        return task_in(source, where)
    window = Window(request.spacing, request.bounds, request.center, (), request.ground)
    found, earth = map_of(source, window, reading_of(request)), earth_in(source, request)
    ends = np.array([found.grid.origin])
    task = Task.of(found, ends, ends, request.distances)
    bare = MapTask(task, found.terrain, {}, found.file.remarks, earth, within=found.file.within)
    airspace = airspace_of(request, bare)
    return bare if airspace is None else dataclasses.replace(bare, airspace=airspace)


def _small_enough(given: MapTask) -> MapTask:
    """The same in larger voxels, where a page cannot show all of its map; a remark says so."""
    task = given.task
    where, within, remark = drawable(task.map, given.within)
    if not remark:
        return given
    coarse = Task.of(where, task.starts, task.goals, task.distances)
    terrain = given.terrain.on(where.grid)
    return dataclasses.replace(
        given, task=coarse, terrain=terrain, within=within, remarks=(*given.remarks, f"the map is {remark}")
    )


def _city_of(given: MapTask, source: Scene | Contents, request: Request) -> City:
    """The map of a page; what its rules of the air close is no obstacle of it."""
    task, grid = given.task, given.task.grid
    points = None
    if isinstance(source, PointCloud):
        points = np.asarray(source.points, np.float64) + source.offset
        points = points[((points >= np.array(grid.lower)) & (points <= np.array(grid.upper))).all(axis=1)]
    return City(
        Path(request.map).name,
        dataclasses.replace(task.map, closed=None),
        points,
        () if given.airspace is None else given.airspace.areas,
        request.ceiling_above_start,
        given.terrain,
    )
