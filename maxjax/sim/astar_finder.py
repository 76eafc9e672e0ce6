"""A* in the loop: the search on the host, called from inside the compiled flight.

    find(problem, grid) -> (path, status, certified)    as `flight_state.climb_field`: a flight takes either

A flight differs in nothing else: same scans, map, margin, verification and controller. The path is A*'s polyline
through voxel centres, joined to the exact ends; points inside its straight runs are left out, which changes no point of
the line, and the last point is repeated until the array has the length of an ascent.

The centre of the voxel that the vehicle is in is left out as well: it may lie behind the vehicle, which would have to
brake and turn back for it at every plan. From the exact start the path leads to the end of the first straight run where
that is clear, and else to the run's second voxel, which a legal step of A* guarantees.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.ascent import Ascent
from maxjax.planning.baselines.astar import astar
from maxjax.planning.problem import Problem
from maxjax.planning.sight import clear, span_codes

# Paths of both planners have one length, so that a flight's arrays do.
POINTS = Ascent().steps + 1


def search(problem: Problem, grid: Grid) -> tuple[Float[Array, "n 3"], Int32[Array, ""], Bool[Array, ""]]:
    """A* between the voxels of start and goal; nothing is searched for a problem whose status is not OK.

    Args:
        problem: what to plan.
        grid: where the voxels lie; A* counts in voxels and needs no more.

    Returns:
        The path in index coordinates, its status, and False: A* has no field to certify. PATH_STALLED where the path
        has more corners than the array holds.
    """
    shapes = (jax.ShapeDtypeStruct((POINTS, 3), jnp.float32), jax.ShapeDtypeStruct((), jnp.int32))
    inputs = (problem.blocked, problem.start, problem.goal, problem.status)
    path, status = jax.pure_callback(_on_host, shapes, *inputs, vmap_method="sequential")
    straight = clear(span_codes(problem.blocked), path[0], path[2])
    return path.at[1].set(jnp.where(straight, path[0], path[1])), status, jnp.array(False)


def _on_host(*arrays: Array | np.ndarray) -> tuple[Float[np.ndarray, "n 3"], Int32[np.ndarray, ""]]:
    blocked, start, goal, status = map(np.asarray, arrays)
    stay = np.broadcast_to(start, (POINTS, 3)).astype(np.float32)
    if status != Status.OK:
        return stay, np.asarray(status, np.int32)
    ends = [tuple(int(i) for i in np.floor(x + 0.5)) for x in (start, goal)]
    found = astar(blocked, *ends)  # type: ignore[arg-type]
    corners = corners_of(found.path)
    if found.status != Status.OK:
        return stay, np.asarray(found.status, np.int32)
    if len(corners) + 2 > POINTS:
        return stay, np.asarray(Status.PATH_STALLED, np.int32)
    path = np.concatenate([start[None], found.path[1:2], corners[1:], goal[None]]).astype(np.float32)
    return np.pad(path, ((0, POINTS - len(path)), (0, 0)), mode="edge"), np.asarray(Status.OK, np.int32)


def corners_of(path: Int32[np.ndarray, "t 3"]) -> Int32[np.ndarray, "c 3"]:
    """The points of a path on voxels at which it turns, its ends included."""
    step = np.diff(path, axis=0)
    turns = np.any(step[1:] != step[:-1], axis=1)
    return path[np.concatenate([[True], turns, [True]])] if len(path) > 2 else path
