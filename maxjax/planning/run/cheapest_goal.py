"""What several goals cost to reach from a start, and which of them costs least.

A way costs the same in both directions, so that one field, that of the start, tells it of all of them. In a map that is
too large to be solved as a whole, and by planners that climb no field, each is planned to by itself.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Point3
from maxjax.planning.planner import Planner, field_climber
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.shared_goal import plan_to_goal

LARGEST_SHARED = 2**22
"""Voxels of the largest map in which legs of one goal share a field, which is one of the whole map."""


def costs_to(
    task: Task, start: Point3, goals: Float64[np.ndarray, "n 3"], planner: Planner
) -> Float64[np.ndarray, " n"]:
    """What ways to goals cost by the certified field [m at their price]; NaN where there is none.

    Args:
        task: of one map, with the distances; its own ends are not looked at.
        start: [m].
        goals: [m].
        planner: as in `execution.plan_task`.
    """
    begin = np.broadcast_to(np.asarray(start, np.float64), goals.shape)
    climber = field_climber(planner) if math.prod(task.grid.shape) <= LARGEST_SHARED else None
    if climber is None:
        found = plan_task(task.with_ends(begin, goals), planner)
    else:
        found = plan_to_goal(task.with_ends(goals, begin), climber)
    paid = np.where(found.cost > 0.0, found.cost, found.length)
    return np.asarray(np.where(found.ok, paid, np.nan), np.float64)


def cheapest(costs: Float64[np.ndarray, " n"], start: Point3, goals: Float64[np.ndarray, "n 3"]) -> int:
    """Number of the goal that costs least; where none is reached, of the nearest in a straight line."""
    straight = np.linalg.norm(goals - np.asarray(start, np.float64), axis=1)
    return int(np.nanargmin(costs) if np.isfinite(costs).any() else np.argmin(straight))
