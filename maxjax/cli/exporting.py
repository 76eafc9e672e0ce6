"""`--export FILE …`: a plan and its trajectory as files of other programs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from maxjax.api import trajectory
from maxjax.cli.options import PlanOptions
from maxjax.cli.task import MapTask
from maxjax.missions.earth import Earth, Projected, TangentPlane
from maxjax.missions.export import check_export, export
from maxjax.planning.limits import PX4
from maxjax.planning.plan import Plan


def check(options: PlanOptions) -> None:
    """Find out before the work whether what is asked for can be written.

    Raises:
        ValueError: for a file, a place, a reference system or a speed that cannot be used.
        ImportError: where a package is missing that a format needs.
    """
    if options.export:
        earth = _earth(options)
        dataclasses.replace(PX4, speed=options.speed)
        for file in options.export:
            check_export(file, on_earth=earth is not None)


def write(options: PlanOptions, given: MapTask, plan: Plan) -> list[Path]:
    """Write a plan that is OK to every file asked for.

    Home lies on the ground: at --ground, or where the map's own ground is highest below the start.
    """
    task = given.task
    flown = trajectory(
        plan, dataclasses.replace(PX4, speed=options.speed), task.occupied, task.grid, ground=task.ground
    )
    for file in options.export:
        export(file, plan, flown, _earth(options), _ground(options, given))
    return list(options.export)


def _earth(options: PlanOptions) -> Earth | None:
    if options.place is not None and options.crs is not None:
        raise ValueError("--crs: expected one of --place and --crs, given both; leave one out")
    if options.crs is not None:
        return Projected(options.crs)
    return None if options.place is None else TangentPlane(*options.place)


def _ground(options: PlanOptions, given: MapTask) -> float:
    if options.ground is not None:
        return options.ground
    task = given.task
    index = np.floor((task.starts[0] - np.array(task.grid.lower)) / task.grid.spacing).astype(int)
    below = np.flatnonzero(task.ground[index[0], index[1], : index[2] + 1])
    return float(task.grid.lower[2] + task.grid.spacing * (below[-1] + 1)) if below.size else 0.0
