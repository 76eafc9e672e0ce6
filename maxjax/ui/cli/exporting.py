"""`--export FILE …`: a plan and its trajectory as files of other programs."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from maxjax.api import trajectory
from maxjax.io.export.as_flown import AsFlown
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.endings import ON_EARTH, ending_of
from maxjax.io.export.export import check_export, export, place_for, write_parameters
from maxjax.io.export.home_ground import counts_from_home
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.cli.map_task import MapTask
from maxjax.ui.cli.report import complain
from maxjax.ui.request import Request


def check_exports(request: Request) -> None:
    """Find out before the work whether what is asked for can be written.

    Raises:
        ValueError: for a file, a place, a reference system or a speed that cannot be used.
        ImportError: where a package is missing that a format needs.
    """
    if request.autopilot is not None:
        Autopilot.named(request.autopilot)
    if request.export:
        request.limits  # noqa: B018 (raises)
        for file in request.export:
            check_export(file, on_earth=True)


def check_place(request: Request, given: MapTask) -> None:
    """Raise a ValueError where a file to write needs a place on Earth or the ground at home, and nothing says it."""
    needed = [file for file in request.export if ending_of(file) in ON_EARTH]
    if needed and given.earth is None:
        raise ValueError(
            f"{needed[0]}: expected a place on Earth for {ending_of(needed[0])}, which the map does not name: "
            "give --place LAT LON H, or --crs"
        )
    for file in needed:
        if given.earth is not None:
            place_for(file, given.earth)
    counted = [file for file in request.export if counts_from_home(file)]
    if counted and math.isnan(given.terrain.at(*given.task.starts[0, :2].tolist())):
        raise ValueError(
            f"{counted[0]}: expected a map with ground below the start, from which its heights count; "
            "give the ground's height, as --ground 0"
        )


def write(request: Request, given: MapTask, plan: Plan) -> list[Exported]:
    """Write a plan that is OK to every file asked for."""
    return write_all(request, given, trajectory(plan, request.limits))


@dataclasses.dataclass(frozen=True)
class Exported:
    """A file that was written, what it makes a vehicle fly, and files of the parameters that it relies on."""

    file: Path
    flown: AsFlown
    parameters: tuple[Path, ...] = ()

    def __str__(self) -> str:
        return "\n".join([f"{self.file}: {self.flown}", *map(str, self.parameters)])


def write_all(request: Request, given: MapTask, flown: Trajectory) -> list[Exported]:
    """Write a trajectory, and the plan or the mission that it times, to every file asked for, and judge each.

    Raises:
        ValueError: for a file that would lead elsewhere (`io.export.as_flown`); it is not written.
    """
    height = given.terrain.at(*given.task.starts[0, :2].tolist())
    # What only voxels tell is left to the judgement, which then takes the ground for up to a voxel lower.
    ground = None if math.isnan(height) or given.terrain.doubt > 0.0 else height
    autopilot = None if request.autopilot is None else Autopilot.named(request.autopilot)
    done, told = list[Exported](), {str(one) for one in _mission_of(flown).near}
    for file in request.export:
        found = export(
            file,
            flown,
            earth=given.earth,
            ground=ground,
            airspace=given.airspace,
            takeoff_and_landing=request.takeoff_and_landing or None,
            autopilot=autopilot,
        )
        for remark in found.remarks:
            if remark not in told:
                complain(f"Note: {file}: {remark}.")
        told.update(found.remarks)
        done.append(Exported(file, found, tuple(write_parameters(file, found)) if request.params else ()))
        if request.json:
            complain(str(done[-1]))
    return done


def _mission_of(flown: Trajectory) -> Mission:
    return flown.plan if isinstance(flown.plan, Mission) else Mission.of_plan(flown.plan)
