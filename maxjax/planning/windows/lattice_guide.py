"""The cheapest lattice path across a large map, which tells a corridor the way (`planning.windows.corridor`).

    box ⊇ { |x − s| + |x − g| ≤ C }   →   A* in it, at the planner's own radius and price   →   cost c

Where c ≤ bound, the least cost of a way that leaves the box (`planning.windows.focus_window`), no lattice path of the
whole map is cheaper; else the box of C = c follows, and at last the whole map. Of a map of 23 million voxels that takes
half a second, and a byte, a bit and 16 bytes of every voxel that is reached. It needs the compiled A*
(`planning.search`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float64

from maxjax.compile.stage_timer import time_stage
from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.planning.problem.problem import Problem
from maxjax.planning.problem.task import Task
from maxjax.planning.search import astar_compiled
from maxjax.planning.windows.choice import ways_out
from maxjax.planning.windows.focus_window import View, Windows, search_maps
from maxjax.planning.windows.geometry import GROWTH, centre, ellipsoid_box, guess_costs

# Boxes are of multiples of these voxels, so that few shapes are compiled for.
_ROUNDED = 64, 64, 16

# The only problem of a view, formulated.
Show = Callable[[View], Problem]


@dataclasses.dataclass(frozen=True)
class LatticePath:
    """A path of voxels.

    Attributes:
        points: from the voxel of the start to that of the goal, index coordinates of the map.
        cost: ∫ n ds along it [voxels].
    """

    points: Float64[np.ndarray, "t 3"]
    cost: float


def lattice_path(task: Task, show: Show) -> LatticePath | None:
    """The cheapest lattice path of the only problem of a task; None where none was found, or A* is not compiled.

    Args:
        task: one map, one problem.
        show: formulates it in a box.
    """
    with time_stage("compile"):
        if not astar_compiled.available():
            return None
    costs = guess_costs(task.index, np)
    while True:
        window = _box(task, costs)
        path, bound = _search(show(View(task, window)), window), float(window.bounds[0])
        if bound == math.inf or (path is not None and path.cost <= bound):
            return path
        costs = GROWTH * costs if path is None else np.maximum(path.cost, costs)


def _box(task: Task, costs: Float64[np.ndarray, " 1"]) -> Windows:
    """The box around the ellipsoid of a cost, of a rounded shape within the map where the map is large enough."""
    limits, step = np.array(task.grid.shape), np.array(_ROUNDED)
    low, high = ellipsoid_box(task.index, costs, limits, np)
    low[:, 2] = 0  # the ground is its own bound
    sizes = -(-(high + 1 - low) // step) * step
    corners = centre(low, high, sizes, limits, np)
    return Windows.upright(corners, sizes, ways_out(task.index, corners, sizes, limits, search_maps(task), np))


def _search(problem: Problem, window: Windows) -> LatticePath | None:
    """The cheapest path of a problem in a box."""
    if int(problem.status) != Status.OK:
        return None
    ends = (np.floor(np.asarray(end) + 0.5).astype(int).tolist() for end in (problem.start, problem.goal))
    (a, b, c), (d, e, f) = ends
    start: Index3 = a, b, c
    with time_stage("search"):
        price = None if problem.price is None else np.asarray(problem.price)
        found = astar_compiled.astar_in_cpp(np.asarray(problem.blocked), start, (d, e, f), price)
    if found.status != Status.OK:
        return None
    return LatticePath(found.path + window.corners[0].astype(np.float64), found.cost)
