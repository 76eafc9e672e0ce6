"""`maxjax demo`: around a street corner in downtown, from one LiDAR scan, by the field and by A*.

The sensor hovers at a crossing. Start and goal lie in two streets that it looks into; towers stand on the straight
line between them.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from scipy import ndimage

from maxjax import verify
from maxjax.cli import planning, report
from maxjax.cli.scanning import Returns, measure
from maxjax.cli.world import World, build_world
from maxjax.core.grid import Grid, Point3
from maxjax.core.status import Status
from maxjax.maps import PointCloud
from maxjax.planning.planner import Plan, Stopwatch
from maxjax.viz.figures import Overlay
from maxjax.worlds.scenes import Scene, make_scene, occupancy

MARGIN = 8.0
_STREET = (1.0, 17.0)  # heights that a flight in a street uses [m]
_TALL = 30.0  # what nobody flies over to save length [m]
_APART = (60.0, 90.0)
_REACH = 75.0  # of the corner from the middle of the city [m]
_CLEAR = 9.0  # of start, goal and sensor from buildings, horizontally [m]
_HEIGHTS = (4.0, 10.0)  # of start, goal and sensor [m]
_DRAWS = 50_000
_TRIALS = 12
_AROUND = 25.0  # map shown around the paths [m]


@dataclasses.dataclass(frozen=True)
class Corner:
    """A problem: where the sensor hovers, where the flight starts and ends [m]."""

    sensor: Point3
    start: Point3
    goal: Point3


def corners(occupied: Bool[np.ndarray, "nx ny nz"], grid: Grid, seed: int) -> list[Corner]:
    """Street corners, best first: of many drawn triples, those whose straight line runs through towers the longest.

    Args:
        occupied: the city without its ground.
        grid: its grid.
        seed: of the draws; equal seeds give equal corners.

    Raises:
        ValueError: if no triple qualifies.
    """
    height = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
    street = (height > _STREET[0]) & (height < _STREET[1])
    built = np.any(occupied[:, :, street], axis=2)
    tall = np.any(occupied[:, :, height > _TALL], axis=2)
    clearance = grid.spacing * ndimage.distance_transform_edt(~built)
    middle = np.asarray(grid.origin[:2])
    rng = np.random.default_rng(seed)
    places = np.argwhere(clearance >= _CLEAR) * grid.spacing + middle
    places = places[np.abs(places).max(axis=1) <= _REACH]
    if len(places) == 0:
        raise ValueError(f"--seed {seed}: this city has no open street; choose another seed")
    triples = places[rng.integers(0, len(places), (_DRAWS, 3))]
    sensor, start, goal = triples.swapaxes(0, 1)

    def along(values: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Values on the straight lines from a to b, at 64 points each."""
        x = a[:, None] + np.linspace(0.0, 1.0, 64)[:, None] * (b - a)[:, None]
        index = np.round((x - middle) / grid.spacing).astype(int)
        return np.asarray(values[index[..., 0], index[..., 1]])

    apart = np.linalg.norm(goal - start, axis=1)
    good = (apart >= _APART[0]) & (apart <= _APART[1])
    for end in (start, goal):
        good &= along(clearance, sensor, end).min(axis=1) >= 0.5 * _CLEAR
    walled = np.where(good, along(tall, start, goal).mean(axis=1), 0.0)
    heights = np.round(rng.uniform(*_HEIGHTS, (_DRAWS, 3)), 1)
    chosen: list[int] = []
    for i in np.argsort(-walled, kind="stable"):
        if walled[i] == 0 or len(chosen) == _TRIALS:
            break
        # Another view, not the last one a metre further.
        if all(np.abs(triples[i] - triples[j]).max() > _CLEAR for j in chosen):
            chosen.append(int(i))
    if not chosen:
        raise ValueError(f"--seed {seed}: this city has no street corner with a tower; choose another seed")

    def point(i: int, k: int) -> Point3:
        x, y = triples[i, k]
        return (float(x), float(y), float(heights[i, k]))

    return [Corner(point(i, 0), point(i, 1), point(i, 2)) for i in chosen]


def look(scene: Scene, corner: Corner, watch: Stopwatch) -> tuple[World, Returns]:
    """What one scan from the corner's sensor tells: flat ground at z = 0 known, what no beam met taken as free."""
    returns = measure(scene, corner.sensor)
    none = np.zeros(len(returns.points), bool)
    cloud = PointCloud(returns.points, np.zeros(3), none, none, scene.name)
    return build_world(cloud, corner.start, corner.goal, None, 0.0, watch), returns


def choose(scene: Scene, seed: int) -> Corner:
    """The first corner whose shortest way in the scan is free in the city as well.

    One scan sees the fronts of the buildings only. A first plan may lead through their unseen backs, which a vehicle
    would find out on the way and plan again; the demo shows a single plan.
    """
    occupied, ground = occupancy(scene.geoms, Grid())
    found = corners(occupied & ~ground, Grid(), seed)
    for corner in found:
        world, _ = look(scene, corner, Stopwatch())
        plan = planning.plan_in(world, corner.start, corner.goal, "astar", MARGIN, Stopwatch())
        if plan.status == Status.OK and plan.margin == MARGIN:
            city = build_world(scene, corner.start, corner.goal, None, None, Stopwatch())
            if true_clearance(plan, city) > 0.5 * MARGIN:
                return corner
    return found[0]


def run(out: Path, seed: int) -> int:
    """Scan, plan twice, compare, draw; arguments as on the command line. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments that cannot be used.
    """
    report.check_output(out)
    with report.progress(f"Building downtown:{seed} and scanning it; {report.FIRST_RUN}"):
        scene = make_scene("downtown", seed)
        corner = choose(scene, seed)
        start, goal = corner.start, corner.goal
        watch = Stopwatch()
        world, returns = look(scene, corner, watch)
    city = build_world(scene, start, goal, None, None, Stopwatch())
    plans: dict[str, Plan] = {}
    for method in ("solver", "astar"):
        with report.progress(f"Planning, method {method}; {report.FIRST_RUN}"):
            plans[method] = planning.plan_in(world, start, goal, method, MARGIN, watch)
    plan = plans["solver"]
    message = report.explain(plan, world, start, goal) if plan.status != Status.OK else plan.status.advice
    configuration = {"map": f"downtown:{seed}", "margin": MARGIN, "ground": 0.0, **dataclasses.asdict(corner)}
    content = report.document(plan, world, message, configuration)
    figure = None
    if plan.status == Status.OK:
        with report.progress("Drawing"):
            title = f"downtown:{seed}, planned from one scan"
            overlay = Overlay(points=returns.points, title=title, around=_AROUND)
            figure = planning.draw(world, plans, start, goal, overlay, city)
    files = report.write_plan(out, content, figure)
    columns = {}
    for method, found in plans.items():
        rows = report.describe(found, MARGIN, start, goal)
        if found.status == Status.OK:
            rows["clearance in the true city"] = f"{true_clearance(found, city):.2f} m"
        columns[planning.NAMES[method]] = rows
    report.show(report.table(f"downtown:{seed}, {len(returns.points)} returns of one scan", columns))
    print(f"start {corner.start}, goal {corner.goal}, sensor {corner.sensor} [m]")
    print(*files, sep="\n")
    if plan.status == Status.OK:
        return 0
    report.complain(message)
    return 1


def true_clearance(plan: Plan, city: World) -> float:
    """Least distance from a path to a building, seen by the scan or not [m]."""
    return verify(plan.path, city.occupied, city.occupied, city.grid, ground=city.ground).clearance
