"""The paper's protocol, and its own figures.

Every method plans in one map, dilated by one margin; the margin is lowered by a voxel at a time where it joins no ends:

    margin, margin − spacing, …, 0        the ladder; SciPy's distance transform and labels decide

Obstacles are dilated between centres of voxels, the ground by one voxel at most. A plan in the dilated map has neither
radius nor price (`Distances(0, 0)`); its clearance is measured from the obstacles themselves.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

import maxjax
from benchmarks.common.oracle import blocked_at, distance
from maxjax import VoxelMap
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.ui.methods import planner_named


@dataclasses.dataclass(frozen=True)
class Dilated:
    """Problems of a task, each in a map of its own.

    Attributes:
        task: on the dilated maps, without ground.
        margins: by which they are dilated [m]; the least one where none joins the ends.
        asked: the task as it was asked.
    """

    task: Task
    margins: tuple[float, ...]
    asked: Task

    def measured(self, plans: Sequence[maxjax.Plan]) -> list[maxjax.Plan]:
        """Plans of `task`, with their margins, and their clearance in the maps that are not dilated."""

        def one(k: int, plan: maxjax.Plan, margin: float) -> maxjax.Plan:
            if plan.status != maxjax.Status.OK:
                return dataclasses.replace(plan, margin=margin)
            found = maxjax.verify(plan.path, self.asked.map_at(k))
            return dataclasses.replace(
                plan,
                margin=margin,
                clearance=found.clearance,
                cruise_clearance=found.cruise_clearance,
                clearance_at=found.clearance_at,
            )

        return [one(k, plan, margin) for k, (plan, margin) in enumerate(zip(plans, self.margins, strict=True))]


def ladder(margin: float, spacing: float) -> tuple[float, ...]:
    """The margins to try, largest first, 0 last."""
    return (*(margin - k * spacing for k in range(math.ceil(margin / spacing - 1e-9))), 0.0)


def dilated(task: Task) -> Dilated:
    """The maps of a task, dilated by the largest margin of the ladder below its own that joins start and goal."""
    found = [_dilated(task.one(task.barred, k), task.one(task.kept_off, k), task, k) for k in range(len(task))]
    maps, margins = np.stack([blocked for blocked, _ in found]), tuple(margin for _, margin in found)
    return Dilated(Task.of(VoxelMap.on(task.grid, maps), task.starts, task.goals, Distances(0.0, 0.0)), margins, task)


def _dilated(occupied: np.ndarray, ground: np.ndarray, task: Task, k: int) -> tuple[np.ndarray, float]:
    near, low = distance(occupied & ~ground), distance(ground)
    start, goal = np.floor(task.ends[k] + 0.5).astype(int)
    inside = all((x >= 0).all() and (x < task.grid.shape).all() for x in (start, goal))
    blocked, margin = occupied | ground, 0.0
    for margin in ladder(task.distances.margin, task.grid.spacing):
        blocked = blocked_at(near, low, margin / task.grid.spacing)
        if not inside or blocked[tuple(start)] or blocked[tuple(goal)]:
            continue
        labels, _ = ndimage.label(~blocked)
        if labels[tuple(start)] == labels[tuple(goal)]:
            break
    return blocked, margin


def planned(task: Task, *methods: str) -> tuple[maxjax.Plan, ...]:
    """The plans of one problem in one dilated map, by the names of methods."""
    given = dilated(task)
    found = [given.measured(plan_task(given.task, planner_named(name))) for name in methods]
    return tuple(plan for (plan,) in found)


# By the map that stands for its city, then by method: mean length [m], its standard deviation [m], run time [s]
# (Bong and Beltrame, arXiv:2605.10880, Table I, offline: on its own cities, problems and machine).
PAPER: dict[str, dict[str, tuple[float, float, float]]] = {
    "downtown": {
        "astar": (54.6, 17.8, 0.155),
        "rrtstar": (57.5, 19.6, 17.2),
        "3DMaxConvNet": (58.5, 17.8, 0.089),
    },
    "suburb": {
        "astar": (57.6, 19.8, 0.17),
        "rrtstar": (59.8, 21.8, 17.5),
        "3DMaxConvNet": (59.3, 19.4, 0.087),
    },
}

# Likewise in the closed loop, 50 trials a map, all arrived: flown length [m] and plans, means ± standard deviations.
FLOWN = {
    "downtown": {"3DMaxConvNet": ("109.0 ± 60.2", "31.0 ± 20.5"), "A\\*": ("81.7 ± 68.4", "25.2 ± 25.9")},
    "suburb": {"3DMaxConvNet": ("74.1 ± 10.6", "19.9 ± 2.8"), "A\\*": ("73.4 ± 8.1", "20.6 ± 3.3")},
}
