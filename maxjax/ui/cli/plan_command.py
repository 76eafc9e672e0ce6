"""`maxjax plan`: a path through a city, a scan or a voxel map; with waypoints on the way a mission."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path

from maxjax.compile.stage_timer import Recorder, recording, sum_reports
from maxjax.core.status import Status
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan, no_plans
from maxjax.planning.planner import Planner
from maxjax.planning.run.execution import plan_task
from maxjax.ui.cli import exporting, report
from maxjax.ui.cli import mission_command as mission
from maxjax.ui.cli.load_request import load_request
from maxjax.ui.cli.map_task import MOST_VOXELS, MapTask
from maxjax.ui.cli.options import PlanOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.figures.figures import Overlay
from maxjax.ui.figures.planned import figure_plans
from maxjax.ui.methods import climbs, label_of, planner_named
from maxjax.ui.request import Request

_AROUND = 45.0  # [m]; enough of a town to recognise it


def run_plan(options: PlanOptions) -> int:
    """Plan, show and write. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    request = Request.of(options)
    if request.is_mission or request.supply is not None:
        return mission.run_request(request)
    report.check_output(options.out)
    exporting.check_exports(request)
    planner = planner_named(options.method)
    method = planner.name
    with recording() as recorder:
        given = load_request(request)
    exporting.check_place(request, given)
    with progress(f"Planning, method {options.method}"):
        plan = plan_in(given, planner, recorder)
    message = report.explain(plan, given)
    if options.keep_radius and (near := Mission.of_plan(plan).near):
        return report.refuse_near(near, given.places, options.out, "plan")
    content = report.document(
        plan, given, message, {**request.configuration, "start": options.start, "goal": options.goal}
    )
    plans, figure, files = {method: plan}, None, list[object]()
    if options.out is not None and plan.status == Status.OK:
        with progress("Drawing"):
            if climbs(method) and math.prod(given.task.grid.shape) <= MOST_VOXELS:
                plans["astar"] = plan_in(given, planner_named("astar"))
            overlay = Overlay(title=Path(options.map).name, around=_AROUND, within=given.within)
            figure = figure_plans(given.task, plans, overlay)
    if options.out is not None:
        files += report.write_plan(options.out, content, figure)
    if options.export and plan.status == Status.OK:
        with progress("Timing and exporting"):
            files += exporting.write(request, given, plan)
    if options.json:
        sys.stdout.write(report.dumps(content))
    else:
        columns = {label_of(name): report.describe(found, given.task) for name, found in plans.items()}
        report.show(report.table(Path(options.map).name, columns))
        if files:
            print(*files, sep="\n")
    if plan.status == Status.OK:
        report.warn(plan, given.task, given.places)
        report.warn_outside(plan.path, given)
        return 0
    report.complain(message)
    return 1


def plan_in(given: MapTask, planner: Planner, before: Recorder | None = None) -> Plan:
    """Plan a problem.

    Args:
        given: the problem; where no return of its scan lies inside the grid, the status is EMPTY_SCAN.
        planner: as in `maxjax.plan`.
        before: time already spent on making voxels, added to the plan's.
    """
    if given.returns and given.returns["inside"] == 0:
        nothing = no_plans(given.task, Status.EMPTY_SCAN, planner.name)[0]
        found = dataclasses.replace(nothing, timings=Recorder().report())
    else:
        found = plan_task(given.task, planner)[0]
    return found if before is None else dataclasses.replace(found, timings=sum_reports(before.report(), found.timings))
