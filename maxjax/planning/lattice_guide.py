"""The cheapest lattice path across a large map, which tells a corridor the way (`planning.corridor`).

    box ⊇ { |x − s| + |x − g| ≤ C }   →   A* in it, at the planner's own radius and price   →   cost c

Where c ≤ bound, the least cost of a way that leaves the box (`planning.focus_window`), no lattice path of the whole map
is cheaper; else the box of C = c follows, and at last the whole map. Of a map of 23 million voxels that takes half a
second, and a byte, a bit and 16 bytes of every voxel that is reached. It needs the compiled A* (`planning.search`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.planning.focus_window import FocusWindow, View, ellipsoid_box, straight, way_out
from maxjax.planning.problem import Problem
from maxjax.planning.search import astar_compiled
from maxjax.planning.task import Task
from maxjax.programs.stage_timer import timed

# Boxes are of multiples of these voxels, so that few shapes are compiled for; and by what C grows without a path.
_ROUNDED, _GROWTH = (64, 64, 16), 1.6

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
    with timed("compile"):
        if not astar_compiled.available():
            return None
    ends, cost = task.index[0].astype(np.float64), straight(task.index[0])
    while True:
        window = _box(task, ends, cost)
        path = _search(show(View(task, (window,))), window)
        if window.bound == math.inf or (path is not None and path.cost <= window.bound):
            return path
        cost = _GROWTH * cost if path is None else max(path.cost, cost)


def _box(task: Task, ends: Float64[np.ndarray, "2 3"], cost: float) -> FocusWindow:
    """The box around the ellipsoid of a cost, of a rounded shape within the map where the map is large enough."""
    limits = np.array(task.grid.shape)
    low, high = ellipsoid_box(ends, cost, limits)
    low[2] = 0  # the ground is its own bound
    step = np.array(_ROUNDED)
    size = -(-(high + 1 - low) // step) * step
    corner = np.maximum(np.minimum((low + high + 1 - size) // 2, limits - size), 0)
    (i, j, k), (x, y, z) = corner.tolist(), size.tolist()
    return FocusWindow((i, j, k), (x, y, z), way_out(task.one(task.barred, 0), ends, corner, size))


def _search(problem: Problem, window: FocusWindow) -> LatticePath | None:
    """The cheapest path of a problem in a box."""
    if int(problem.status) != Status.OK:
        return None
    ends = (np.floor(np.asarray(end) + 0.5).astype(int).tolist() for end in (problem.start, problem.goal))
    (a, b, c), (d, e, f) = ends
    start: Index3 = a, b, c
    with timed("search"):
        price = None if problem.price is None else np.asarray(problem.price)
        found = astar_compiled.compiled_astar(np.asarray(problem.blocked), start, (d, e, f), price)
    if found.status != Status.OK:
        return None
    return LatticePath(found.path + np.array(window.corner, np.float64), found.cost)
