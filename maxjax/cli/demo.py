"""`maxjax demo`: around a street corner in downtown, from one LiDAR scan, by the field and by A*.

The sensor hovers at a crossing. Start and goal lie in two streets that it looks into; towers stand on the straight
line between them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax import verify
from maxjax.cli import planning, report
from maxjax.cli.options import DemoOptions
from maxjax.cli.placed_map import PlacedMap, place_map
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.maps import PointCloud
from maxjax.methods import METHODS
from maxjax.planning.plan import Plan
from maxjax.planning.recorder import Recorder, recording
from maxjax.sim.level_scan import Returns, measure
from maxjax.viz.figures import Overlay
from maxjax.worlds.corners import Corner, corners
from maxjax.worlds.scenes import Scene, make_scene, occupancy

MARGIN = 8.0
_AROUND = 25.0  # map shown around the paths [m]


def look(scene: Scene, corner: Corner) -> tuple[PlacedMap, Returns]:
    """What one scan from the corner's sensor tells: flat ground at z = 0 known, what no beam met taken as free."""
    returns = measure(scene, corner.sensor)
    none = np.zeros(len(returns.points), bool)
    cloud = PointCloud(returns.points, np.zeros(3), none, none, scene.name)
    return place_map(cloud, corner.start, corner.goal, None, 0.0), returns


def choose(scene: Scene, seed: int) -> Corner:
    """The first corner whose shortest way in the scan is free in the city as well.

    One scan sees the fronts of the buildings only. A first plan may lead through their unseen backs, which a vehicle
    would find out on the way and plan again; the demo shows a single plan.
    """
    occupied, ground = occupancy(scene.geoms, Grid())
    found = corners(occupied & ~ground, Grid(), seed)
    for corner in found:
        placed, _ = look(scene, corner)
        plan = planning.plan_in(placed, corner.start, corner.goal, "astar", MARGIN, Recorder())
        if plan.status == Status.OK and plan.margin == MARGIN:
            city = place_map(scene, corner.start, corner.goal, None, None)
            if true_clearance(plan, city) > 0.5 * MARGIN:
                return corner
    return found[0]


def run(options: DemoOptions) -> int:
    """Scan, plan twice, compare, draw. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments that cannot be used.
    """
    out, seed = options.out, options.seed
    report.check_output(out)
    with report.progress(f"Building downtown:{seed} and scanning it; {report.FIRST_RUN}"):
        scene = make_scene("downtown", seed)
        corner = choose(scene, seed)
        start, goal = corner.start, corner.goal
        with recording() as recorder:
            placed, returns = look(scene, corner)
    city = place_map(scene, start, goal, None, None)
    plans: dict[str, Plan] = {}
    for method in ("solver", "astar"):
        with report.progress(f"Planning, method {method}; {report.FIRST_RUN}"):
            plans[method] = planning.plan_in(placed, start, goal, method, MARGIN, recorder)
    plan = plans["solver"]
    message = report.explain(plan, placed, start, goal) if plan.status != Status.OK else plan.status.advice
    configuration = {"map": f"downtown:{seed}", "margin": MARGIN, "ground": 0.0, **dataclasses.asdict(corner)}
    content = report.document(plan, placed, message, configuration)
    figure = None
    if plan.status == Status.OK:
        with report.progress("Drawing"):
            title = f"downtown:{seed}, planned from one scan"
            overlay = Overlay(points=returns.points, title=title, around=_AROUND)
            figure = planning.draw(placed, plans, start, goal, overlay, city)
    files = report.write_plan(out, content, figure)
    columns = {}
    for method, found in plans.items():
        rows = report.describe(found, MARGIN, start, goal)
        if found.status == Status.OK:
            rows["clearance in the true city"] = f"{true_clearance(found, city):.2f} m"
        columns[METHODS[method].label] = rows
    report.show(report.table(f"downtown:{seed}, {len(returns.points)} returns of one scan", columns))
    print(f"start {corner.start}, goal {corner.goal}, sensor {corner.sensor} [m]")
    print(*files, sep="\n")
    if plan.status == Status.OK:
        return 0
    report.complain(message)
    return 1


def true_clearance(plan: Plan, city: PlacedMap) -> float:
    """Least distance from a path to a building, seen by the scan or not [m]."""
    return verify(plan.path, city.occupied, city.occupied, city.grid, ground=city.ground).clearance
