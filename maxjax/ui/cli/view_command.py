"""`maxjax view`: a page in the browser to plan on, or to play flights on; with --share, one file of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from maxjax.io import Contents, Window, map_of
from maxjax.io.geo.earth import Earth
from maxjax.io.kinds.point_cloud import PointCloud
from maxjax.planning.mission import Waypoint
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import Scene
from maxjax.trajectories.limits import PX4
from maxjax.ui.cli import report, viewing_flights
from maxjax.ui.cli.map_task import (
    MapTask,
    airspace_of,
    check_options,
    distances_of,
    earth_in,
    load_source,
    price_of,
    reading_of,
    task_in,
)
from maxjax.ui.cli.mission_command import locate_waypoints
from maxjax.ui.cli.options import PlanOptions, ViewOptions
from maxjax.ui.cli.page import wait, write_page
from maxjax.ui.cli.progress import progress
from maxjax.ui.cli.viewing_source import Opened, common_options, open_source
from maxjax.ui.figures.drawable import drawable
from maxjax.ui.page.page_map import City, first_ends
from maxjax.ui.page.question import Question, answer, describe_answer
from maxjax.ui.page.server import need_viser

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
    shown = open_source(options)
    options = shown.options
    with progress(f"Reading {options.map}"):
        city, question, earth = first_asked(shown)
    if options.share is not None:
        return _share(options, options.share, city, question)
    from maxjax.ui.page.download import file_of
    from maxjax.ui.page.plan_page import PlanPage
    from maxjax.ui.page.server import serve

    server = serve(city, host=options.host, port=options.port, dark=options.dark)
    page = PlanPage(
        server,
        city,
        question,
        lambda ending, found: file_of(city, earth, ending, found),
        on_earth=earth is not None,
        dark=options.dark,
    )
    wait(server)
    page.worker.close()
    return 0


def _share(options: ViewOptions, path: Path, city: City, question: Question) -> int:
    from maxjax.ui.page.download import page_of

    with progress("Planning"):
        found = answer(city, question)
    if not found.ok:
        report.complain(describe_answer(found).replace("### ", "").replace("**", "").replace("\n\n", ". "))
        return 1
    with progress("Writing the page"):
        page = page_of(city, found, dark=options.dark)
    write_page(path, page)
    return 0


def first_asked(shown: Opened) -> tuple[City, Question, Earth | None]:
    """The map, the first question, and where the map lies on Earth."""
    options = shown.options
    if (options.start is None) != (options.goal is None):
        raise ValueError("--start and --goal: expected both or none, given one")
    source = load_source(options.map, reading_of(options))
    waypoints: tuple[Waypoint, ...] = ()
    speed = PX4.speed
    if options.start is None:
        given = _without_ends(source, options)
    else:
        asked = shown.asked()
        check_options(asked.options)
        given = task_in(source, asked.options)
        waypoints, speed = locate_waypoints(asked, given), asked.options.speed
    given = _small_enough(given)
    for remark in given.remarks:
        report.complain(f"Note: {Path(options.map).name}: {remark}.")
    city = _city_of(given, source, options)
    band = (options.floor, options.ceiling)
    ends = tuple(waypoint.position for waypoint in waypoints) or first_ends(city)
    question = Question(
        ends,
        options.method,
        options.radius,
        options.margin,
        band=None if band == (None, None) else band,
        details=waypoints if shown.waypoints else (),
        speed=speed,
        price=price_of(options.price),
    )
    return city, question, given.earth


def _without_ends(source: Scene | Contents, options: ViewOptions) -> MapTask:
    """A map with the rules of the air that do not depend on the ends."""
    if options.via or options.frame != "map":
        raise ValueError("--via and --frame: expected with --start and --goal, given without")
    given = PlanOptions(start=_MIDDLE, goal=_MIDDLE, **common_options(options))
    check_options(given)
    if isinstance(source, Scene):
        return task_in(source, dataclasses.replace(given, center=options.center or _MIDDLE))
    window = Window(options.spacing, options.bounds, options.center, (), options.ground)
    found, earth = map_of(source, window, reading_of(options)), earth_in(source, given)
    ends = np.array([found.grid.origin])
    task = Task.of(found, ends, ends, distances_of(options))
    bare = MapTask(task, found.terrain, {}, found.file.remarks, earth, within=found.file.within)
    airspace = airspace_of(given, bare)
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


def _city_of(given: MapTask, source: Scene | Contents, options: ViewOptions) -> City:
    """The map of a page; what its rules of the air close is no obstacle of it."""
    task, grid = given.task, given.task.grid
    points = None
    if isinstance(source, PointCloud):
        points = np.asarray(source.points, np.float64) + source.offset
        points = points[((points >= np.array(grid.lower)) & (points <= np.array(grid.upper))).all(axis=1)]
    return City(
        Path(options.map).name,
        dataclasses.replace(task.map, closed=None),
        points,
        () if given.airspace is None else given.airspace.areas,
        options.ceiling_above_start,
        given.terrain,
    )
