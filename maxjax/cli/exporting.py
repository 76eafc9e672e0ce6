"""`--export FILE …`: a plan and its trajectory as files of other programs."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from maxjax.api import trajectory
from maxjax.cli.options import PlanOptions
from maxjax.cli.task import MapTask
from maxjax.missions.export import ON_EARTH, check_export, export
from maxjax.planning.plan import Plan
from maxjax.trajectories.limits import PX4
from maxjax.trajectories.trajectory import Trajectory


def check(options: PlanOptions) -> None:
    """Find out before the work whether what is asked for can be written.

    Raises:
        ValueError: for a file, a place, a reference system or a speed that cannot be used.
        ImportError: where a package is missing that a format needs.
    """
    if options.export:
        dataclasses.replace(PX4, speed=options.speed)
        for file in options.export:
            check_export(file, on_earth=True)


def check_place(options: PlanOptions, given: MapTask) -> None:
    """Raise a ValueError where a file to write needs a place on Earth and nothing says it."""
    needed = [file for file in options.export if file.suffix.lower() in ON_EARTH]
    if needed and given.earth is None:
        raise ValueError(
            f"{needed[0]}: expected a place on Earth for {needed[0].suffix}, which the map does not name: "
            "give --place LAT LON H, or --crs"
        )


def write(options: PlanOptions, given: MapTask, plan: Plan) -> list[Path]:
    """Write a plan that is OK to every file asked for."""
    return write_all(options, given, trajectory(plan, dataclasses.replace(PX4, speed=options.speed)))


def write_all(options: PlanOptions, given: MapTask, flown: Trajectory) -> list[Path]:
    """Write a trajectory, and the plan or the mission that it times, to every file asked for.

    Home lies on the ground: at --ground, or where the map's own ground is highest below the start.
    """
    for file in options.export:
        export(file, flown, earth=given.earth, ground=_ground(given))
    return list(options.export)


def _ground(given: MapTask) -> float:
    height = given.terrain.at(*given.task.starts[0, :2].tolist())
    return 0.0 if math.isnan(height) else height
