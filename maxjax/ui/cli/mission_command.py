"""`maxjax mission FILE` and `maxjax plan … --via X Y Z`: a mission, its trajectory, and its files.

Where a leg fails, it is named, and nothing is written; with `--partial` the legs before it are.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from maxjax.api import trajectory
from maxjax.compile.stage_timer import recording, sum_reports
from maxjax.core.status import Status
from maxjax.planning.mission import Mission, first_legs, plan_mission
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.cli import exporting, report
from maxjax.ui.cli.load_request import load_request
from maxjax.ui.cli.map_task import MapTask
from maxjax.ui.cli.options import MissionOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.looks import table_of
from maxjax.ui.methods import planner_named
from maxjax.ui.request import Request
from maxjax.ui.request_files import load_mission, options_as_keys

# Statuses of a leg for its goal, and of the next one, which starts there.
_ENDS = {
    Status.GOAL_OCCUPIED: Status.START_OCCUPIED,
    Status.GOAL_OUTSIDE_MAP: Status.START_OUTSIDE_MAP,
    Status.GOAL_IN_CLOSED_AREA: Status.START_IN_CLOSED_AREA,
    Status.GOAL_OUTSIDE_BAND: Status.START_OUTSIDE_BAND,
}
# What is in a plan's JSON and stands only once in that of a mission.
_ONCE = ("configuration", "versions", "device", "timings")


def run_mission(options: MissionOptions) -> int:
    """Read a mission's file, and run it. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    asked = load_mission(options.file)
    flags = ("takeoff_and_landing", "params", "keep_radius")
    given = {name: getattr(options, name) or getattr(asked, name) for name in (*flags, "autopilot")}
    outputs = {name: getattr(options, name) for name in ("out", "json", "export", "partial")}
    with options_as_keys(options.file):
        return run_request(dataclasses.replace(asked, **given, **outputs))


def run_request(request: Request) -> int:
    """Plan a mission, show and write it. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    report.check_output(request.out)
    exporting.check_exports(request)
    planner, limits = planner_named(request.method), request.limits
    with recording() as recorder:
        given = load_request(request)
    exporting.check_place(request, given)
    with progress(f"Planning, method {request.method}"):
        mission = plan_mission(given.task, given.through(request).flown, planner)
    mission = dataclasses.replace(mission, timings=sum_reports(recorder.report(), mission.timings))
    shown: Mission | None = mission
    if mission.failed:
        shown = first_legs(mission, given.task) if request.partial else None
    if request.keep_radius and shown is not None and shown.near:
        return report.refuse_near(shown.near, given.places, request.out, "mission")
    flown = None
    if shown is not None and shown.status == Status.OK:
        with progress("Timing"):
            flown = trajectory(shown, limits)
    content = _document(mission, shown, flown, given, request)
    files: list[object] = []
    if request.out is not None:
        files += _written(request.out, content, (shown, flown), given, Path(request.map).name)
    if shown is not None and flown is not None:
        files += exporting.write_all(request, given, flown)
    if request.json:
        sys.stdout.write(report.dumps(content))
    else:
        report.show(_table(mission, flown, Path(request.map).name))
        if files:
            print(*files, sep="\n")
    if shown is not None and flown is not None:
        report.warn_near(shown, given.places)
        report.warn_outside(shown.path, given)
    return _told(mission, content, request)


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


def _document(
    mission: Mission, shown: Mission | None, flown: Trajectory | None, given: MapTask, request: Request
) -> dict[str, Any]:
    """Content of mission.json: the mission, a plan for each leg, and what is needed to run it again."""
    legs = []
    for k, leg in enumerate(mission.legs):
        one = dataclasses.replace(given, task=given.task.some(slice(k, k + 1)))
        full = report.document(leg, one, report.explain(leg, one), {})
        own = {name: getattr(mission.waypoints[k + 1], name) for name in ("speed", "hover", "heading", "look_at")}
        legs.append({"leg": k + 1, **own, **{n: full[n] for n in full if n not in _ONCE}})
    whole = mission if shown is None else shown
    times = None if flown is None else np.round(flown.passes, 6).tolist()
    last = report.document(
        mission.legs[0],
        given,
        "",
        {**request.configuration, "waypoints": [table_of(waypoint) for waypoint in request.waypoints]},
    )
    content = {
        "status": mission.status.name,
        "message": mission.status.advice,
        "path": np.round(whole.path, 6).tolist(),
        **report.places_of(whole, given.earth),
        "length": whole.length,
        "clearance": whole.clearance,
        "duration": None if flown is None else flown.duration,
        "waypoints": [list(waypoint.position) for waypoint in mission.waypoints],
        "times": times,
        "near_waypoints": [vars(one) for one in whole.near],
        "legs": legs,
        "timings": mission.timings,
        **{name: last[name] for name in ("configuration", "versions", "device")},
    }
    filled: dict[str, Any] = report.plain(content)
    return filled


def _table(mission: Mission, flown: Trajectory | None, title: str) -> Table:
    """One row a leg, and one for all."""
    heads = ("leg", "to", "status", "length\n[m]", "clearance\n[m]", "speed\n[m/s]", "arrives\n[s]", "hovers\n[s]")
    rows = []
    for k, leg in enumerate(mission.legs):
        waypoint, ok = mission.waypoints[k + 1], leg.status == Status.OK
        lengths = [f"{x:.1f}" if ok else "" for x in (leg.length, leg.clearance)]
        arrives = f"{flown.passes[k + 1]:.1f}" if flown is not None and k + 1 < len(flown.passes) else ""
        hover = "" if waypoint.hover is None else f"{waypoint.hover:g}"
        place = ", ".join(f"{round(x, 2):.10g}" for x in waypoint.position)
        rows.append([str(k + 1), place, leg.status.name, *lengths, f"{waypoint.speed:g}", arrives, hover])
    if mission.status == Status.OK and flown is not None:
        lengths = [f"{x:.1f}" for x in (mission.length, mission.clearance)]
        rows.append(["all", "", mission.status.name, *lengths, "", f"{flown.duration:.1f}", ""])
    # Columns in which nothing stands are left out, and places break between coordinates: so 80 columns hold the rest.
    shown = [k for k in range(len(heads)) if any(row[k] for row in rows)]
    table = Table(title=title, title_justify="left")
    for k in shown:
        table.add_column(heads[k], justify="left" if heads[k] == "status" else "right", no_wrap=heads[k] != "to")
    for row in rows:
        table.add_row(*(row[k] for k in shown), style="bold" if row[0] == "all" else None)
    return table


def _written(
    out: Path, content: dict[str, Any], shown: tuple[Mission | None, Trajectory | None], given: MapTask, title: str
) -> list[Path]:
    """The files of a mission in a folder; without a mission to show none, and those of an earlier one go."""
    mission, flown = shown
    if mission is None or flown is None:
        report.remove_plans(out, "mission")
        return []
    from maxjax.ui.figures.missions import figure_mission

    with progress("Drawing"):
        figure = figure_mission(mission, flown, title, given.within)
    return report.write_plan(out, content, figure, "mission")
