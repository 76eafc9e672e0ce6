"""From routes to plans: the judge decides, and nothing that it refuses is handed out.

    Route (index coordinates, a claim) → judge → Plan (world coordinates, verified)

Judged is the polyline in the local frame of the grid, whose origin is zero, in float64: u · spacing. The world's
coordinates are that plus the grid's origin, in float64 as well.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float, Float64

from maxjax.core.status import Closure, Status
from maxjax.planning.route import NO_PATH, Route
from maxjax.planning.task import Distances, Task
from maxjax.programs.stage_timer import timed
from maxjax.verification.verifier import Verification, verify_batch

# Paths that are verified in one go: most of what one costs is the same for several.
_TOGETHER = 16
# An end of a path this close to where it was asked for is put there [voxels].
_SAME = 1e-4


@dataclasses.dataclass(frozen=True)
class Plan:
    """A verified path, or why there is none.

    Attributes:
        status: OK only for a path that passed `verify`.
        path: (t, 3) float64 [m], ENU, start first, goal last; empty unless OK. An end that lies on the face of an
            occupied voxel is moved off it by less than a thousandth of a voxel (1 mm at 2 m).
        length: length of the path [m]; NaN unless OK.
        clearance: least distance from the path to the cube of an occupied voxel [m], ground left out; NaN unless OK.
        cruise_clearance: the least such distance more than 10 m from the ends, and outside `balls`;
            `clearance` where the path does not leave them; NaN unless OK.
        clearance_at: (t,) float64 [m], such a distance at each point of the path.
        radius: distance [m] that the path keeps outside `balls`; with NO_SAFE_PATH one that joins the ends.
        balls: radii [m] of the exemptions around start and goal in which it keeps their own distances, since they stand
            nearer, or beside the ground; 0: none.
        cost: the price paid, ∫ n ds [m]; the length where nothing was priced; NaN unless OK.
        certified: whether the field it climbed had no local maximum but the goal (always False for graph searches).
        potential: the certified field that it climbed, "maxwell" or, where that was the flood's own distance,
            "geodesic"; "" where it climbed none.
        margin: distance from which on a metre costs no more than its length [m].
        timings: seconds by stage (`formulate`, `solve`, `ascend`, `tighten`, `verify`, …; `transfer` is the way to the
            device and back; `device` is all of that in one program), `compile` apart, and `total` without it.
        method: name of the planner.
    """

    status: Status
    path: Float64[np.ndarray, "t 3"]
    length: float
    clearance: float
    cruise_clearance: float
    clearance_at: Float64[np.ndarray, " t"]
    radius: float
    balls: tuple[float, float]
    cost: float
    certified: bool
    potential: str
    margin: float
    timings: Mapping[str, float]
    method: str


def no_plan(status: Status, method: str, distances: Distances, *, certified: bool = False) -> Plan:
    """A plan without a path."""
    return Plan(
        status,
        NO_PATH.astype(np.float64),
        length=math.nan,
        clearance=math.nan,
        cruise_clearance=math.nan,
        clearance_at=np.zeros(0),
        radius=distances.radius,
        balls=(0.0, 0.0),
        cost=math.nan,
        certified=certified,
        potential="",
        margin=distances.margin,
        timings={},
        method=method,
    )


def judged(routes: Sequence[Route], task: Task, method: str) -> list[Plan]:
    """Turn completed routes into plans: only a path that the judge passes is handed out.

    Args:
        routes: one for each problem of the task, on the host.
        task: what was asked.
        method: name of the planner.

    Returns:
        One plan a route; their `timings` are empty.
    """
    local: dict[int, Float64[np.ndarray, "_ 3"]] = {}
    for k, route in enumerate(routes):
        if route.status == Status.OK:
            local[k] = _local(np.asarray(route.path), task, k)
    with timed("verify"):
        verdicts = _verdicts(local, routes, task)
    plans = []
    for k, route in enumerate(routes):
        nothing = no_plan(Status.PATH_IN_COLLISION, method, task.distances, certified=bool(route.certified))
        if k not in verdicts:
            plans.append(dataclasses.replace(nothing, status=Status(int(route.status))))
        elif verdicts[k].ok:
            plans.append(_passed(nothing, _world(local[k], task, k), verdicts[k], route))
        else:
            plans.append(nothing)
    return plans


# What an end that lies in a voxel which is closed, but holds nothing, is told: (start, goal).
_CLOSED = {
    Closure.BAND: (Status.START_OUTSIDE_BAND, Status.GOAL_OUTSIDE_BAND),
    Closure.AREA: (Status.START_IN_CLOSED_AREA, Status.GOAL_IN_CLOSED_AREA),
}


def with_closures(plans: list[Plan], task: Task) -> list[Plan]:
    """The plans of a task; an end that is taken for occupied where the airspace is closed has a status that says so."""
    if task.closed is None:
        return plans

    def named(plan: Plan, closures: tuple[Closure, Closure]) -> Plan:
        for end, (status, closure) in enumerate(
            zip((Status.START_OCCUPIED, Status.GOAL_OCCUPIED), closures, strict=True)
        ):
            if plan.status == status and closure != Closure.OPEN:
                return dataclasses.replace(plan, status=_CLOSED[closure][end])
        return plan

    return [named(plan, closures) for plan, closures in zip(plans, task.closures(), strict=True)]


def _passed(nothing: Plan, path: Float64[np.ndarray, "t 3"], verdict: Verification, route: Route) -> Plan:
    """The plan of a path that the judge passed, from the one that there would be without it."""
    start, goal = np.asarray(route.balls, np.float64).tolist()
    return dataclasses.replace(
        nothing,
        status=Status.OK,
        path=path,
        length=verdict.length,
        clearance=verdict.clearance,
        cruise_clearance=verdict.cruise_clearance,
        clearance_at=verdict.clearance_at,
        balls=(start, goal),
        cost=float(route.cost) or verdict.length,
        potential="geodesic" if route.geodesic else "maxwell" if route.certified else "",
    )


def _local(path: Float[np.ndarray, "t 3"], task: Task, k: int) -> Float64[np.ndarray, "s 3"]:
    """A path in the grid's local frame [m], without repeated points; ends that `placed` left alone are exact."""
    x, y, z = (path[1:] != path[:-1]).T
    local: Float64[np.ndarray, "s 3"] = task.grid.spacing * path[np.concatenate([[True], x | y | z])].astype(np.float64)
    for end, given in ((0, task.starts[k]), (-1, task.goals[k])):
        exact = given - np.array(task.grid.origin)
        if np.abs(local[end] - exact).max() < _SAME * task.grid.spacing:
            local[end] = exact
    return local


def _world(local: Float64[np.ndarray, "s 3"], task: Task, k: int) -> Float64[np.ndarray, "s 3"]:
    """A path of the local frame in the world's [m], its ends as given, to the bit."""
    origin = np.array(task.grid.origin)
    world: Float64[np.ndarray, "s 3"] = origin + local
    for end, given in ((0, task.starts[k]), (-1, task.goals[k])):
        if np.array_equal(local[end], given - origin):
            world[end] = given
    return world


def _verdicts(
    paths: Mapping[int, Float64[np.ndarray, "_ 3"]], routes: Sequence[Route], task: Task
) -> dict[int, Verification]:
    volumes = task.occupied, task.ground
    several = [len(maps) for maps in volumes if maps.ndim == 4]
    map_of = task.map_of if several else np.zeros(len(routes), np.int64)
    occupied, ground = (np.broadcast_to(maps, (max(several, default=1), *task.grid.shape)) for maps in volumes)

    def some(keys: list[int]) -> list[tuple[int, Verification]]:
        found = verify_batch(
            [paths[key] for key in keys],
            map_of[keys],
            None,
            occupied,
            task.grid.local,
            ground=ground,
            radius=task.distances.radius,
            balls=np.stack([routes[key].balls for key in keys]),
        )
        return list(zip(keys, found, strict=True))

    keys = sorted(paths)
    parts = [keys[k : k + _TOGETHER] for k in range(0, len(keys), _TOGETHER)]
    if len(parts) < 2:
        return dict(verdict for part in parts for verdict in some(part))
    # NumPy lets several threads work at a time.
    with ThreadPoolExecutor() as pool:
        return dict(verdict for part in pool.map(some, parts) for verdict in part)
