"""`--export FILE …`: a plan and its trajectory as files of other programs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from maxjax.api import trajectory
from maxjax.cli.options import PlanOptions
from maxjax.cli.task import MapTask
from maxjax.missions.earth import Degrees, Earth, Projected, TangentPlane
from maxjax.missions.export import ON_EARTH, check_export, export
from maxjax.planning.limits import PX4
from maxjax.planning.plan import Plan


def check(options: PlanOptions) -> None:
    """Find out before the work whether what is asked for can be written.

    Raises:
        ValueError: for a file, a place, a reference system or a speed that cannot be used.
        ImportError: where a package is missing that a format needs.
    """
    if options.place is not None and options.crs is not None:
        raise ValueError("--crs: expected one of --place and --crs, given both; leave one out")
    if options.export:
        _named(options)
        dataclasses.replace(PX4, speed=options.speed)
        for file in options.export:
            check_export(file, on_earth=True)


def place_of(options: PlanOptions, given: MapTask) -> Earth | None:
    """Where the map lies on Earth: as the options say, else as its file does.

    Raises:
        ValueError: where a file to write needs it and nothing says so, or for a reference system without metres.
        ImportError: where the file names a reference system, and pyproj is missing.
    """
    found = _named(options)
    needed = [file for file in options.export if file.suffix.lower() in ON_EARTH]
    if found is None and needed:
        if given.origin is not None:
            found = Degrees(*given.origin)
        elif given.crs is not None:
            found = Projected(given.crs)
        else:
            raise ValueError(
                f"{needed[0]}: expected a place on Earth for {needed[0].suffix}, which the map does not name: "
                "give --place LAT LON H, or --crs"
            )
    return found


def write(options: PlanOptions, given: MapTask, plan: Plan, earth: Earth | None) -> list[Path]:
    """Write a plan that is OK to every file asked for.

    Home lies on the ground: at --ground, or where the map's own ground is highest below the start.
    """
    task, limits = given.task, dataclasses.replace(PX4, speed=options.speed)
    flown = trajectory(plan, limits, task.occupied, task.grid, ground=task.ground)
    for file in options.export:
        export(file, plan, flown, earth, _ground(options, given))
    return list(options.export)


def _named(options: PlanOptions) -> Earth | None:
    if options.crs is not None:
        return Projected(options.crs)
    return None if options.place is None else TangentPlane(*options.place)


def _ground(options: PlanOptions, given: MapTask) -> float:
    if options.ground is not None:
        return options.ground
    task = given.task
    index = np.floor(task.index[0, 0] + 0.5).astype(int)
    below = np.flatnonzero(task.ground[index[0], index[1], : index[2] + 1])
    return float(task.grid.lower[2] + task.grid.spacing * (below[-1] + 1)) if below.size else 0.0
