"""From routes to plans: the verifier decides, and nothing that it refuses is handed out.

All of a batch is done on arrays: points are brought to metres and repeated ones left out, paths are verified together,
and each is put back into the world's frame.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.compile.stage_timer import time_stage
from maxjax.compile.threads import in_parts
from maxjax.core.status import Closure, Status
from maxjax.planning.path.route import Route
from maxjax.planning.plan import Plans, Seconds, no_plans
from maxjax.planning.problem.task import Task
from maxjax.verification.polylines import Paths
from maxjax.verification.verdicts import Verdicts
from maxjax.verification.verifier import verify_paths

# Paths that a thread verifies in one go: 2 ms by the compiled verifier, of which its Python is a fiftieth.
_TOGETHER = 32
# An end of a path this close to where it was asked for is put there [voxels].
_SAME = 1e-4


def verify_routes(routes: Route, task: Task, method: str, timings: Seconds | None = None) -> Plans:
    """Plans of completed routes: only a path that the verifier passes is handed out.

    Args:
        routes: on the host, one for each problem of the task; index coordinates of the map.
        task: what was asked.
        method: name of the planner.
        timings: seconds spent on each.
    """
    nothing = no_plans(task, Status.PATH_IN_COLLISION, method, timings)
    status = np.array(routes.status, np.int32)
    nothing = dataclasses.replace(nothing, status=status, certified=np.asarray(routes.certified, bool))
    which = np.flatnonzero(status == Status.OK)
    if not which.size:
        return nothing
    some = task.some(which)
    local, counts = _local(np.asarray(routes.path, np.float64)[which], some)
    exemptions = np.asarray(routes.exemptions, np.float64)[which]
    with time_stage("verify"):
        verdicts = _verdicts(local, counts, some, exemptions)
    status[which[~verdicts.ok]] = Status.PATH_IN_COLLISION

    def spread(values: np.ndarray, empty: float | int | bool = math.nan) -> np.ndarray:
        """Values of the paths that passed, among all problems."""
        filled = np.full((len(task), *values.shape[1:]), empty, values.dtype)
        filled[which[verdicts.ok]] = values[verdicts.ok]
        return filled

    cost = np.asarray(routes.cost, np.float64)[which]
    cost = np.where(cost > 0, cost, verdicts.length)  # 0 where nothing was priced
    return dataclasses.replace(
        nothing,
        points=spread(_world(local, some)),
        counts=spread(counts, 0),
        length=spread(verdicts.length),
        clearance=spread(verdicts.clearance),
        cruise_clearance=spread(verdicts.cruise_clearance),
        cost=spread(cost),
        clearance_at=spread(verdicts.clearance_at),
        exemptions=spread(exemptions, 0.0),
        geodesic=spread(np.asarray(routes.geodesic, bool)[which], False),
    )


def _local(
    path: Float64[np.ndarray, "b t 3"], task: Task
) -> tuple[Float64[np.ndarray, "b s 3"], Int64[np.ndarray, " b"]]:
    """Paths in the grid's local frame [m], without repeated points, and how many points each has.

    Each is filled up with its last point. Ends that `ends.placed` left alone are exact.
    """
    new = np.ones(path.shape[:2], bool)
    x, y, z = np.moveaxis(path[:, 1:] != path[:, :-1], 2, 0)
    new[:, 1:] = x | y | z
    counts = new.sum(axis=1)
    order = np.argsort(~new, axis=1, kind="stable")[:, : counts.max()]
    local = task.grid.spacing * np.take_along_axis(path, order[:, :, None], axis=1)
    local[:, :1] = _exact(local[:, :1], task.starts, task)
    beyond = np.arange(local.shape[1]) >= counts[:, None] - 1
    last = _exact(task.grid.spacing * path[:, -1:], task.goals, task)
    filled: Float64[np.ndarray, "b s 3"] = np.where(beyond[:, :, None], last, local)
    return filled, counts


def _exact(
    ends: Float64[np.ndarray, "b 1 3"], given: Float64[np.ndarray, "b 3"], task: Task
) -> Float64[np.ndarray, "b 1 3"]:
    """Ends of the local frame [m], where they were asked for if they are that close to it."""
    asked = (given - np.array(task.grid.origin))[:, None]
    same = np.abs(ends - asked).max(axis=2, keepdims=True) < _SAME * task.grid.spacing
    exact: Float64[np.ndarray, "b 1 3"] = np.where(same, asked, ends)
    return exact


def _world(local: Float64[np.ndarray, "b s 3"], task: Task) -> Float64[np.ndarray, "b s 3"]:
    """Paths of the local frame in the world's [m], their ends as given, to the bit."""
    origin = np.array(task.grid.origin)
    world: Float64[np.ndarray, "b s 3"] = origin + local
    for given in (task.starts, task.goals):
        given = given[:, None]
        world = np.where((local == given - origin).all(axis=2, keepdims=True), given, world)
    return world


def _verdicts(
    local: Float64[np.ndarray, "b s 3"],
    counts: Int64[np.ndarray, " b"],
    task: Task,
    exemptions: Float64[np.ndarray, "b 2"],
) -> Verdicts:
    """Verdicts on paths of the local frame, some at a time on all cores: NumPy lets several threads work."""
    where = dataclasses.replace(task.map, closed=None, grid=task.grid.local)
    where = dataclasses.replace(where, occupied=task.barred, ground=task.kept_off)
    paths = Paths(local, counts, task.map_of if where.batch is not None else np.zeros(len(counts), np.int64))

    def some(rows: slice) -> Verdicts:
        return verify_paths(paths.some(rows), where, radius=task.distances.radius, exemptions=exemptions[rows])

    return Verdicts.joined(in_parts(some, len(counts), _TOGETHER))


# What an end that lies in a voxel which is closed, but holds nothing, is told: (start, goal).
_CLOSED = {
    Closure.BAND: (Status.START_OUTSIDE_BAND, Status.GOAL_OUTSIDE_BAND),
    Closure.AREA: (Status.START_IN_CLOSED_AREA, Status.GOAL_IN_CLOSED_AREA),
}


def with_closures(plans: Plans) -> Plans:
    """The plans; an end that is taken for occupied where the airspace is closed has a status that says so."""
    if plans.task.map.closed is None:
        return plans
    status, closures = plans.status.copy(), plans.task.closures
    for end, occupied in enumerate((Status.START_OCCUPIED, Status.GOAL_OCCUPIED)):
        for closure, statuses in _CLOSED.items():
            status[(plans.status == occupied) & (closures[:, end] == closure)] = statuses[end]
    return dataclasses.replace(plans, status=status)
