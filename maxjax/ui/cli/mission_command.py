"""`maxjax mission FILE` and `maxjax plan … --via X Y Z`: a mission, its trajectory, and its files.

Where a leg fails, it is named, and nothing is written; with `--partial` the legs before it are.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

from maxjax.compile.stage_timer import recording, sum_reports
from maxjax.core.status import Status
from maxjax.energy.last_place import end_within_battery, ends_there
from maxjax.energy.split_flights import weigh_flight
from maxjax.planning.mission import Mission, first_legs, plan_mission
from maxjax.planning.waypoint import legs_of
from maxjax.ui.cli import exporting, report
from maxjax.ui.cli.flights_command import run_flights
from maxjax.ui.cli.load_request import load_request
from maxjax.ui.cli.map_task import MapTask
from maxjax.ui.cli.mission_answer import MissionAnswer, table_of, warn_of, write_answer
from maxjax.ui.cli.options import MissionOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.methods import planner_named
from maxjax.ui.option_groups import LandingOptions
from maxjax.ui.request import Request
from maxjax.ui.request_files import load_mission, options_as_keys

# Statuses of a leg for its goal, and of the next one, which starts there.
_ENDS = {
    Status.GOAL_OCCUPIED: Status.START_OCCUPIED,
    Status.GOAL_OUTSIDE_MAP: Status.START_OUTSIDE_MAP,
    Status.GOAL_IN_CLOSED_AREA: Status.START_IN_CLOSED_AREA,
    Status.GOAL_OUTSIDE_BAND: Status.START_OUTSIDE_BAND,
}


def run_mission(options: MissionOptions) -> int:
    """Read a mission's file, and run it. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    asked = load_mission(options.file)
    flags = ("takeoff_and_landing", "params", "keep_radius")
    given = {name: getattr(options, name) or getattr(asked, name) for name in (*flags, "autopilot")}
    outputs = {name: getattr(options, name) for name in ("out", "json", "export", "partial")}
    roof = {
        field.name: getattr(options, field.name)
        for field in dataclasses.fields(LandingOptions)
        if getattr(options, field.name) != field.default
    }
    with options_as_keys(options.file):
        return run_request(dataclasses.replace(asked, **given, **outputs, **roof).or_ending(options.or_goal))


def run_request(request: Request) -> int:
    """Plan a mission, show and write it. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    report.check_output(request.out)
    exporting.check_exports(request)
    planner, limits, supply = planner_named(request.method), request.limits, request.supply
    with recording() as recorder:
        given = load_request(request)
    exporting.check_place(request, given)
    stops = given.through(request).flown
    with progress(f"Planning, method {request.method}"):
        mission = plan_mission(given.task, stops, planner)
    own_end = supply is not None and ends_there(stops)
    if supply is not None and own_end:
        mission = end_within_battery(mission, given.task, planner, limits, supply).mission
    given = dataclasses.replace(given, task=given.task.with_ends(*legs_of(mission.waypoints)))
    mission = dataclasses.replace(mission, timings=sum_reports(recorder.report(), mission.timings))
    shown: Mission | None = mission
    if mission.failed:
        shown = first_legs(mission, given.task) if request.partial else None
    if request.keep_radius and shown is not None and shown.near:
        return report.refuse_near(shown.near, given.places, request.out, "mission")
    with progress("Timing"):
        flight = None if shown is None else weigh_flight(shown, limits, supply)
    answer = MissionAnswer(mission, flight, given, request)
    if flight is not None and flight.status == Status.CANNOT_RETURN and supply is not None:
        if own_end:
            return _too_far(answer)
        return run_flights(answer, planner, supply)
    content, files = write_answer(answer)
    if request.json:
        sys.stdout.write(report.dumps(content))
    else:
        report.show(table_of(answer, Path(request.map).name))
        if files:
            print(*files, sep="\n")
    warn_of(answer)
    return _told(mission, content, request)


def _too_far(answer: MissionAnswer) -> int:
    """Say on stderr that the battery lasts to no end of a mission; returns the exit code."""
    told = Status.CANNOT_RETURN.advice
    if answer.flight is not None and answer.flight.verdict is not None:
        told = f"{answer.flight.verdict.describe(answer.given.places)}. {told}"
    report.complain(f"{Status.CANNOT_RETURN.name}: to no place that it may end at: {told} Nothing was written.")
    if answer.request.json:
        sys.stdout.write(report.dumps({"status": Status.CANNOT_RETURN.name, "message": Status.CANNOT_RETURN.advice}))
    return 1


def plan_request(request: Request) -> tuple[Mission, MapTask]:
    """Plan a mission, with nothing written, and what it was planned in; `maxjax fly` flies it.

    Raises:
        ValueError, OSError, ImportError: as `run_request`.
    """
    planner = planner_named(request.method)
    given = load_request(request)
    with progress(f"Planning, method {request.method}"):
        mission = plan_mission(given.task, given.through(request).flown, planner)
    if request.keep_radius and mission.near:
        raise ValueError(
            f"{'; '.join(one.describe(given.places) for one in mission.near)}; move it, or leave out keep_radius"
        )
    report.warn_near(mission, given.places)
    return mission, given


def _told(mission: Mission, content: dict[str, Any], request: Request) -> int:
    """Say on stderr what went wrong; returns the exit code."""
    if mission.status == Status.OK:
        return 0
    before = Status.OK
    for leg, plan in zip(content["legs"], mission.legs, strict=True):
        if plan.status != Status.OK:
            told = f"Leg {leg['leg']} of {len(mission.legs)}: "
            same = before in _ENDS and plan.status == _ENDS[before]
            reason = f"{plan.status.name}: it starts where leg {leg['leg'] - 1} is to end." if same else leg["message"]
            report.complain(told + reason)
        before = plan.status
    if not mission.failed:
        report.complain(content["message"])
    elif request.out is not None or request.export:
        written = "the legs before it were written" if request.partial and mission.failed[0] else "nothing was written"
        hint = "" if request.partial else "; --partial writes the legs before it"
        report.complain(f"Leg {mission.failed[0] + 1} failed, and {written}{hint}.")
    return 1
