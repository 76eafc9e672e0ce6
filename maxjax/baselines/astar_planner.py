"""A* as a planner: between the voxels of start and goal, joined to the exact ends.

Searched is by the compiled A* where there is one (`planning.search.astar_compiled`), and else by the one in Python: the
path is the same. A plan's `timings` say which: "search" or "search in Python", and "compile" where it was built first.

A flight differs in nothing: same scans, map, margin, verification and controller (`planning.planner.pure_route`).
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from maxjax.compile.stage_timer import time_stage
from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.planning.path.route import Route, no_route, route_of
from maxjax.planning.problem.problem import Problem
from maxjax.planning.search import astar_compiled
from maxjax.planning.search.astar import astar


@dataclasses.dataclass(frozen=True)
class AStar:
    """The planner that searches the inflated grid: start, centres of voxels, goal, at the least price."""

    name: ClassVar[str] = "astar"
    batched: ClassVar[bool] = False

    def route(self, problem: Problem) -> Route:
        """The cheapest route on the lattice; it counts in voxels and needs no more of the grid."""
        with time_stage("compile"):
            compiled = astar_compiled.available()
        with time_stage("search" if compiled else "search in Python"):
            start, goal = np.asarray(problem.start), np.asarray(problem.goal)
            price = None if problem.price is None else np.asarray(problem.price)
            find = astar_compiled.astar_in_cpp if compiled else astar
            result = find(np.asarray(problem.blocked), voxel_of(start), voxel_of(goal), price)
            if result.status != Status.OK:
                return no_route(result.status)
            return route_of(np.concatenate([start[None], result.path, goal[None]]), certified=False)


def voxel_of(x: Float[np.ndarray, " 3"]) -> Index3:
    """The voxel that holds a point in index coordinates."""
    i, j, k = np.floor(x + 0.5)
    return int(i), int(j), int(k)
