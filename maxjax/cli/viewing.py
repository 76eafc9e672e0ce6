"""`maxjax view`: a page in the browser to plan on, or to play flights on; with --share, one file of it."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.cli import report, viewing_flights
from maxjax.cli.options import PlanOptions, ViewOptions
from maxjax.cli.progress import progress
from maxjax.cli.task import MOST_VOXELS, earth_of, load_source, task_in
from maxjax.core.serialize import atomic_write
from maxjax.maps import Contents, Window, map_of
from maxjax.maps.earth import Earth
from maxjax.maps.model import PointCloud
from maxjax.view.asking import Question, answer, told
from maxjax.view.city import City, first_ends
from maxjax.view.server import need_viser
from maxjax.worlds.scenes import Scene

# Of the middle of a simulated city's grid, so that it holds roofs and little underground [m].
_MIDDLE = (0.0, 0.0, 40.0)
# What a plan.json says of how it was made.
_TAKEN = (
    "map",
    "start",
    "goal",
    "spacing",
    "bounds",
    "center",
    "method",
    "radius",
    "margin",
    "ground",
    "floor",
    "ceiling",
)


def run(options: ViewOptions) -> int:
    """Show a page until Ctrl-C, or write it. Returns 0, or 1 where there is no path to share.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    need_viser()
    if options.share is not None and not options.share.absolute().parent.is_dir():
        raise ValueError(f"--share {options.share}: expected a folder {options.share.absolute().parent}; make it first")
    if Path(options.map).is_dir():
        return viewing_flights.run(options)
    options = _from_plan(options)
    with progress(f"Reading {options.map}"):
        city, question, earth = _city(options)
    if options.share is not None:
        return _share(options, city, question)
    from maxjax.view.plan_page import PlanPage
    from maxjax.view.server import serve
    from maxjax.view.taking import file_of

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


def wait(server: Any) -> None:
    """Say where the page is, and serve it until Ctrl-C."""
    print(f"http://{server.get_host()}:{server.get_port()}   Ctrl-C ends it", flush=True)
    try:
        while True:
            time.sleep(3600.0)
    finally:
        server.stop()


def write_page(options: ViewOptions, page: str) -> None:
    """Write what is shared, whole or not at all, and say how large it is."""
    assert options.share is not None
    atomic_write(options.share, page)
    print(f"{options.share}   {len(page.encode()) / 1e6:.1f} MB")


def _share(options: ViewOptions, city: City, question: Question) -> int:
    from maxjax.view.taking import page_of

    with progress("Planning"):
        found = answer(city, question)
    if not found.ok:
        report.complain(told(found).replace("### ", "").replace("**", "").replace("\n\n", ". "))
        return 1
    with progress("Writing the page"):
        page = page_of(city, found, dark=options.dark)
    write_page(options, page)
    return 0


def _from_plan(options: ViewOptions) -> ViewOptions:
    """The options of a plan.json, where MAP is one; its map is looked for where it was, then beside the file."""
    path = Path(options.map)
    if path.suffix.lower() != ".json" or not path.is_file():
        return options
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return options  # the reader of maps says what is wrong
    if not isinstance(content, dict) or not isinstance(content.get("configuration"), dict):
        return options
    taken = {name: content["configuration"].get(name) for name in _TAKEN}
    if not isinstance(taken["map"], str):
        raise ValueError(f"{path}: expected the plan of a map, given one without configuration.map")
    beside = path.parent / Path(taken["map"]).name
    if not Path(taken["map"]).exists() and beside.is_file():
        taken["map"] = str(beside)
    kept = {name: _tuples(value) for name, value in taken.items()}
    given: dict[str, Any] = {name: value for name, value in kept.items() if value is not None}
    return dataclasses.replace(options, **given)


def _tuples(value: Any) -> Any:
    """Lists of JSON as tuples, those within them as well."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _city(options: ViewOptions) -> tuple[City, Question, Earth | None]:
    """The map, the first question, and where the map lies on Earth."""
    source = load_source(options.map)
    if (options.start is None) != (options.goal is None):
        raise ValueError("--start and --goal: expected both or none, given one")
    if (options.floor is None) != (options.ceiling is None):
        raise ValueError("--floor and --ceiling: expected both or none, given one")
    city, earth = _simulated(source, options) if isinstance(source, Scene) else _read(source, options)
    ends = first_ends(city) if options.start is None or options.goal is None else (options.start, options.goal)
    band = None if options.floor is None or options.ceiling is None else (options.floor, options.ceiling)
    waypoints = (ends[0], *options.via, ends[1])
    return city, Question(waypoints, options.method, options.radius, options.margin, band=band), earth


def _simulated(scene: Scene, options: ViewOptions) -> tuple[City, Earth | None]:
    center = options.center if options.center is not None or options.start is not None else _MIDDLE
    start, goal = (options.start or _MIDDLE), (options.goal or _MIDDLE)
    given = {name: getattr(options, name) for name in ("spacing", "bounds", "ground")}
    task = task_in(scene, PlanOptions(options.map, start, goal, center=center, **given)).task
    return City(options.map, task.occupied, task.ground, task.grid), _earth(options, None, None)


def _read(source: Contents, options: ViewOptions) -> tuple[City, Earth | None]:
    ends = () if options.start is None or options.goal is None else (options.start, options.goal)
    window = Window(options.spacing, options.bounds, options.center, ends, options.ground, MOST_VOXELS)
    found = map_of(source, window)
    for remark in found.remarks:
        report.complain(f"Note: {found.source}: {remark}.")
    points = None
    if isinstance(source, PointCloud):
        points = np.asarray(source.points, np.float64) + source.offset
        lower, upper = np.array(found.grid.lower), np.array(found.grid.upper)
        points = points[((points >= lower) & (points <= upper)).all(axis=1)]
    city = City(found.source, found.occupied, found.ground, found.grid, points)
    return city, _earth(options, found.crs, found.origin)


def _earth(options: ViewOptions, crs: str | None, origin: tuple[float, float] | None) -> Earth | None:
    given = PlanOptions(options.map, _MIDDLE, _MIDDLE, place=options.place)
    return earth_of(given, crs, origin)
