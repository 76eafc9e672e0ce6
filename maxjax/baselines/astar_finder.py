"""A* as a path finder: between the voxels of start and goal, joined to the exact ends.

    search             on the host: start, the centre of every voxel on the way, goal; at the least price
    search_in_flight   the same, called from inside a compiled flight

Searched is by the compiled A* where there is one (`baselines.astar_compiled`), and else by the one in Python: the path
is the same. A plan's `timings` say which: "search" or "search in Python", and "compile" where it was built first.

In flight, points inside straight runs are left out, which changes no point of the line, and the last point is repeated
until the array has the length of an ascent. The centre of the voxel that the vehicle is in is left out as well: it may
lie behind the vehicle, which would have to brake and turn back for it at every plan. From the exact start the path
leads to the end of the first straight run where that is clear, and else to the run's second voxel, which a legal step
of A* guarantees. A flight differs in nothing else: same scans, map, margin, verification and controller.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32, Num

from maxjax.baselines import astar_compiled
from maxjax.baselines.astar import astar
from maxjax.core.grid import Grid, Index3
from maxjax.core.status import Status
from maxjax.planning.ascent import Ascent
from maxjax.planning.line_of_sight import clear, sight_of
from maxjax.planning.problem import Problem
from maxjax.planning.route import Route, failed, found
from maxjax.programs.stage_timer import timed

# Paths of both planners have one length, so that a flight's arrays do.
POINTS = Ascent().steps + 1


def search(problem: Problem, grid: Grid) -> Route:
    """A* through the dilated grid; it counts in voxels and needs no more of the grid."""
    with timed("compile"):
        compiled = astar_compiled.available()
    with timed("search" if compiled else "search in Python"):
        start, goal = np.asarray(problem.start), np.asarray(problem.goal)
        price = None if problem.price is None else np.asarray(problem.price)
        find = astar_compiled.astar if compiled else astar
        result = find(np.asarray(problem.blocked), voxel_of(start), voxel_of(goal), price)
        if result.status != Status.OK:
            return failed(result.status)
        return found(np.concatenate([start[None], result.path, goal[None]]), certified=False)


def search_in_flight(problem: Problem, grid: Grid) -> Route:
    """`search` under `jit` and `vmap`; nothing is searched for a problem whose status is not OK.

    Returns:
        A route of `POINTS` points; PATH_STALLED where the path has more corners than the array holds.
    """
    shapes = (jax.ShapeDtypeStruct((POINTS, 3), jnp.float32), jax.ShapeDtypeStruct((), jnp.int32))
    path, status = jax.pure_callback(_corners_on_host, shapes, problem, vmap_method="sequential")
    straight = clear(sight_of(problem.blocked, problem.room), path[0], path[2])
    path = path.at[1].set(jnp.where(straight, path[0], path[1]))
    return Route(path, status, jnp.array(False))


def _corners_on_host(problem: Problem) -> tuple[Float[np.ndarray, "n 3"], Int32[np.ndarray, ""]]:
    route = search(problem, Grid()) if problem.status == Status.OK else failed(problem.status)
    whole = np.asarray(route.path)
    centres = whole[1:-1]
    corners = corners_of(centres)
    if route.status == Status.OK and len(corners) + 2 > POINTS:
        route = failed(Status.PATH_STALLED)
    start = np.asarray(problem.start, np.float32)
    if route.status != Status.OK:
        return np.broadcast_to(start, (POINTS, 3)), np.asarray(route.status, np.int32)
    path = np.concatenate([whole[:1], centres[1:2], corners[1:], whole[-1:]])
    return np.pad(path, ((0, POINTS - len(path)), (0, 0)), mode="edge"), np.asarray(Status.OK, np.int32)


def voxel_of(x: Float[np.ndarray, " 3"]) -> Index3:
    """The voxel that holds a point in index coordinates."""
    i, j, k = np.floor(x + 0.5)
    return int(i), int(j), int(k)


def corners_of(path: Num[np.ndarray, "t 3"]) -> Num[np.ndarray, "c 3"]:
    """The points of a path on voxels at which it turns, its ends included."""
    step = np.diff(path, axis=0)
    turns = np.any(step[1:] != step[:-1], axis=1)
    return path[np.concatenate([[True], turns, [True]])] if len(path) > 2 else path
