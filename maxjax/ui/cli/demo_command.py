"""`maxjax demo`: around a street corner in downtown, from one LiDAR scan, by the field and by A*.

The sensor hovers at a crossing. Start and goal lie in two streets that it looks into; towers stand on the straight
line between them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax.compile.stage_timer import recording
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.io import PointCloud
from maxjax.planning.plan import Plan
from maxjax.planning.problem.task import Task
from maxjax.sim.sensors.level_scan import Returns, measure
from maxjax.sim.worlds.scenes import Scene, make_scene
from maxjax.sim.worlds.street_corners import Corner, corners
from maxjax.ui.cli import plan_command, report
from maxjax.ui.cli.map_task import MapTask, city_task, task_in
from maxjax.ui.cli.options import DemoOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.figures.figures import Overlay
from maxjax.ui.figures.planned import figure_plans
from maxjax.ui.methods import label_of, planner_named
from maxjax.ui.request import Request
from maxjax.verification.verifier import verify

_AROUND = 25.0  # map shown around the paths [m]


def look(scene: Scene, corner: Corner) -> tuple[MapTask, Returns]:
    """The task of one scan from the corner's sensor: flat ground at z = 0 is known, unseen voxels count as free."""
    returns = measure(scene, corner.sensor)
    none = np.zeros(len(returns.points), bool)
    cloud = PointCloud(returns.points, np.zeros(3), none, none, scene.name)
    x, y, z = (0.5 * a + 0.5 * b for a, b in zip(corner.start, corner.goal, strict=True))
    request = Request.between(scene.name, corner.start, corner.goal, center=(x, y, z), ground=0.0)
    return task_in(cloud, request), returns


def choose(scene: Scene, seed: int) -> Corner:
    """The first corner whose way by the scan is free in the city as well.

    One scan sees the fronts of the buildings only. A first plan may lead through their unseen backs, which a vehicle
    would find out on the way and plan again; the demo shows a single plan.
    """
    true = scene.voxels(Grid())
    found = corners(np.asarray(true.occupied & ~true.ground), Grid(), seed)
    for corner in found:
        given, _ = look(scene, corner)
        plan = plan_command.plan_in(given, planner_named("field"))
        if plan.status == Status.OK and plan.exemptions == (0.0, 0.0):
            city = city_task(scene, corner.start, corner.goal)
            if _clearance_in(city, plan) > 0.5 * given.task.distances.margin:
                return corner
    return found[0]


def run_demo(options: DemoOptions) -> int:
    """Scan, plan twice, compare, draw. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments that cannot be used.
    """
    report.check_output(options.out)
    name = f"downtown:{options.seed}"
    with progress(f"Building {name} and scanning it"):
        scene = make_scene("downtown", options.seed)
        corner = choose(scene, options.seed)
        with recording() as recorder:
            given, returns = look(scene, corner)
    city = city_task(scene, corner.start, corner.goal)
    plans: dict[str, Plan] = {}
    for method in ("field", "astar"):
        with progress(f"Planning, method {method}"):
            plans[method] = plan_command.plan_in(given, planner_named(method), recorder)
    plan = plans["field"]
    message = report.explain(plan, given)
    configuration = {"map": name, **_distances(given.task), "ground": 0.0, **dataclasses.asdict(corner)}
    content = report.document(plan, given, message, configuration)
    figure = None
    if plan.status == Status.OK:
        with progress("Drawing"):
            overlay = Overlay(points=returns.points, title=f"{name}, planned from one scan", around=_AROUND)
            figure = figure_plans(given.task, plans, overlay, city.map)
    files = report.write_plan(options.out, content, figure)
    columns = {}
    for method, found in plans.items():
        rows = report.describe(found, given.task)
        if found.status == Status.OK:
            rows["clearance in the true city"] = f"{_clearance_in(city, found):.2f} m"
        columns[label_of(method)] = rows
    report.show(report.table(f"{name}, {len(returns.points)} returns of one scan", columns))
    print(f"start {corner.start}, goal {corner.goal}, sensor {corner.sensor} [m]")
    print(*files, sep="\n")
    if plan.status == Status.OK:
        report.warn(plan, given.task)
        return 0
    report.complain(message)
    return 1


def _distances(task: Task) -> dict[str, float]:
    return {"radius": task.distances.radius, "margin": task.distances.margin}


def _clearance_in(city: Task, plan: Plan) -> float:
    """Least distance from a path to a building, seen by the scan or not [m]."""
    return verify(plan.path, city.map).clearance
