"""Figures of plans (extra `viz`): paths by method, over the potential that the first one climbed."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.plan import Plan
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import formulate_view
from maxjax.planning.run.stages import potential_field
from maxjax.planning.windows.corridor import coarsen_task
from maxjax.planning.windows.focus_window import View, round_up
from maxjax.solvers.potential import solve_potential
from maxjax.ui.figures.figures import Nearness, Overlay, figure_plan
from maxjax.ui.methods import climbs, label_of
from maxjax.verification.verifier import verify

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Voxels of the largest map whose field is solved as it is, for its level lines.
_FINE = 2**20


def figure_plans(task: Task, plans: Mapping[str, Plan], overlay: Overlay, city: VoxelMap | None = None) -> Figure:
    """The figure of one or more plans of a task.

    Args:
        task: one problem, on one map.
        plans: by method; those without a path are left out.
        overlay: title, returns, and width of the map around the paths.
        city: the map to show, if another one, on the same grid; None: that of the task.
    """
    shown = task.map if city is None else city
    paths = {label_of(name): plan.path for name, plan in plans.items() if plan.status == Status.OK}
    first = next(iter(plans.values()))
    if climbs(first.method):
        overlay = dataclasses.replace(overlay, log_potential=_log_potential(task))
    if first.status == Status.OK:
        overlay = dataclasses.replace(overlay, nearness=_nearness(task, first))
    return figure_plan(shown, paths, task.starts[0], task.goals[0], overlay)


def _nearness(task: Task, plan: Plan) -> Nearness:
    """Distances along a plan's path, every half voxel."""
    steps = np.ceil(np.linalg.norm(np.diff(plan.path, axis=0), axis=1) / (0.5 * task.grid.spacing)).astype(int)
    ends = zip(plan.path[:-1], plan.path[1:], np.maximum(steps, 1).tolist(), strict=True)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in ends]
    points = np.concatenate([*pieces, plan.path[-1:]])
    verdict = verify(points, task.map, exemptions=plan.exemptions)
    return Nearness(points, verdict.clearance_at, verdict.cruise_nearest)


def _log_potential(task: Task) -> Float[np.ndarray, "nx ny nz"]:
    """Logarithm of φ of a plan's own problem, −inf where no current flows; of a large map in coarse voxels."""
    factor = math.ceil((math.prod(task.grid.shape) / _FINE) ** (1 / 3))
    if factor == 1:
        return _field_in(View(task))
    view = round_up(coarsen_task(task, 0.5, factor))
    return refine_field(_field_in(view)[tuple(map(slice, view.task.grid.shape))], factor, task.grid.shape)


def _field_in(view: View) -> Float[np.ndarray, "nx ny nz"]:
    problem = formulate_view(view)
    return np.asarray(potential_field(problem.blocked, problem.price, problem.goal_index, solve_potential).log_phi)


def refine_field(values: Float[np.ndarray, "mx my mz"], factor: int, shape: Index3) -> Float[np.ndarray, "nx ny nz"]:
    """Values in voxels of `factor`³ voxels, linearly in between; −inf where a voxel lies in or beside none finite."""
    from scipy import ndimage

    inside = tuple(map(slice, shape))
    away, nearest = ndimage.distance_transform_edt(~np.isfinite(values), return_indices=True)
    fine = ndimage.zoom(values[tuple(nearest)], factor, order=1, mode="nearest", grid_mode=True)[inside]
    near = functools.reduce(lambda volume, axis: volume.repeat(factor, axis), range(3), away <= math.sqrt(3))[inside]
    return np.where(near, fine, -np.inf)
