"""`--export FILE …`: a plan and its trajectory as files of other programs."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from maxjax.api import trajectory
from maxjax.io.export.as_flown import AsFlown
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.export import ON_EARTH, check_export, counts_from_home, export, write_parameters
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.trajectories.limits import PX4
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.cli.map_task import MapTask
from maxjax.ui.cli.options import PlanOptions
from maxjax.ui.cli.report import complain


def check_exports(options: PlanOptions) -> None:
    """Find out before the work whether what is asked for can be written.

    Raises:
        ValueError: for a file, a place, a reference system or a speed that cannot be used.
        ImportError: where a package is missing that a format needs.
    """
    if options.autopilot is not None:
        Autopilot.named(options.autopilot)
    if options.export:
        dataclasses.replace(PX4, speed=options.speed)
        for file in options.export:
            check_export(file, on_earth=True)


def check_place(options: PlanOptions, given: MapTask) -> None:
    """Raise a ValueError where a file to write needs a place on Earth or the ground at home, and nothing says it."""
    needed = [file for file in options.export if file.suffix.lower() in ON_EARTH]
    if needed and given.earth is None:
        raise ValueError(
            f"{needed[0]}: expected a place on Earth for {needed[0].suffix}, which the map does not name: "
            "give --place LAT LON H, or --crs"
        )
    counted = [file for file in options.export if counts_from_home(file)]
    if counted and math.isnan(given.terrain.at(*given.task.starts[0, :2].tolist())):
        raise ValueError(
            f"{counted[0]}: expected a map with ground below the start, from which its heights count; "
            "give the ground's height, as --ground 0"
        )


def write(options: PlanOptions, given: MapTask, plan: Plan) -> list[Exported]:
    """Write a plan that is OK to every file asked for."""
    return write_all(options, given, trajectory(plan, dataclasses.replace(PX4, speed=options.speed)))


@dataclasses.dataclass(frozen=True)
class Exported:
    """A file that was written, what it makes a vehicle fly, and files of the parameters that it relies on."""

    file: Path
    flown: AsFlown
    parameters: tuple[Path, ...] = ()

    def __str__(self) -> str:
        return "\n".join([f"{self.file}: {self.flown}", *map(str, self.parameters)])


def write_all(options: PlanOptions, given: MapTask, flown: Trajectory) -> list[Exported]:
    """Write a trajectory, and the plan or the mission that it times, to every file asked for, and judge each.

    Raises:
        ValueError: for a file that would lead elsewhere (`io.export.as_flown`); it is not written.
    """
    height = given.terrain.at(*given.task.starts[0, :2].tolist())
    # What only voxels tell is left to the judgement, which then takes the ground for up to a voxel lower.
    ground = None if math.isnan(height) or given.terrain.doubt > 0.0 else height
    autopilot = None if options.autopilot is None else Autopilot.named(options.autopilot)
    done, told = list[Exported](), {str(one) for one in _mission_of(flown).near}
    for file in options.export:
        found = export(
            file,
            flown,
            earth=given.earth,
            ground=ground,
            airspace=given.airspace,
            takeoff_and_landing=options.takeoff_and_landing,
            autopilot=autopilot,
        )
        for remark in found.remarks:
            if remark not in told:
                complain(f"Note: {file}: {remark}.")
        told.update(found.remarks)
        done.append(Exported(file, found, tuple(write_parameters(file, found)) if options.params else ()))
        if options.json:
            complain(str(done[-1]))
    return done


def _mission_of(flown: Trajectory) -> Mission:
    return flown.plan if isinstance(flown.plan, Mission) else Mission.of_plan(flown.plan)
