"""The problem that a figure shows: its plan, conductivity and potential."""

from __future__ import annotations

import dataclasses
import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import maxjax
from benchmarks.common.paper import dilated
from benchmarks.common.paper import planned as plan_of
from benchmarks.common.problems import problems
from maxjax.planning.problem.task import Task
from maxjax.planning.run.stages import potential_field
from maxjax.ui.figures import plan_view


@dataclasses.dataclass(frozen=True)
class Planned:
    """A planned problem and its fields.

    Attributes:
        task: one start and one goal.
        plan: by the solver.
        blocked: within the margin of the plan.
        sigma, phi: conductivity and potential outside it.
    """

    task: Task
    plan: maxjax.Plan
    blocked: Bool[np.ndarray, "nx ny nz"]
    sigma: Float[np.ndarray, "nx ny nz"]
    phi: Float[np.ndarray, "nx ny nz"]

    @property
    def grid(self) -> maxjax.Grid:
        """The grid of all volumes."""
        return self.task.grid

    @property
    def city(self) -> maxjax.VoxelMap:
        """The map that was planned in."""
        return self.task.map_at(0)

    @property
    def obstacle(self) -> Bool[np.ndarray, "nx ny nz"]:
        """Occupied voxels, ground left out."""
        return np.asarray(self.task.barred & ~self.task.kept_off)

    @property
    def log_potential(self) -> Float[np.ndarray, "nx ny nz"]:
        """Its logarithm; NaN where no current flows."""
        return np.asarray(np.log(np.where(self.phi > 0, self.phi, np.nan)))

    @property
    def normalised(self) -> Float[np.ndarray, "nx ny nz"]:
        """The log-potential from 0, the least of the map, to 1 at the goal."""
        return np.asarray(1 - self.log_potential / np.nanmin(self.log_potential))


@dataclasses.dataclass(frozen=True)
class Choice:
    """What a problem is chosen from.

    Attributes:
        candidates: problems of a map.
        shape: of the grid, voxels of 2 m around the origin.
        margin: [m].
        seed: of the cities.
    """

    candidates: int
    shape: tuple[int, int, int]
    margin: float
    seed: int


@functools.lru_cache(maxsize=4)
def planned(name: str, choice: Choice) -> Planned:
    """A solved problem: of those with the largest margin, in free space at the goal's height, the longest detour.

    Raises:
        ValueError: if no problem of the map is solvable.
    """
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), choice.shape, 2.0)
    best: tuple[tuple[float, ...], Task, maxjax.Plan, np.ndarray] | None = None
    for task in problems(name, choice.candidates, choice.seed, grid, choice.margin):
        (plan,) = plan_of(task, "solver")
        if plan.status != maxjax.Status.OK:
            continue
        (blocked,) = dilated(task).task.barred
        sampled = dense(plan.path.astype(np.float64), 0.5)[:, :2]
        x, y = np.floor((sampled - np.array(grid.lower[:2])) / grid.spacing).astype(int).T
        clear = float(np.mean(~blocked[x, y, plan_view.level_of(grid, float(task.goals[0, 2]))]))
        rank = (plan.margin, min(clear, 0.95), plan.length / math.dist(task.starts[0], task.goals[0]))
        if best is None or rank > best[0]:
            best = rank, task, plan, blocked
    if best is None:
        raise ValueError(f"candidates: expected one of {choice.candidates} problems of {name} to be solvable")
    _, task, plan, blocked = best
    goal = grid.index_of(jnp.asarray(task.goals[0], jnp.float32))
    sigma = maxjax.conductivity(jnp.asarray(blocked), goal, grid)
    # The program that the plan was made by.
    field = potential_field(jnp.asarray(blocked), None, goal, maxjax.solve_potential)
    return Planned(task, plan, blocked, np.asarray(sigma), np.exp(np.asarray(field.log_phi)))


def ends(found: Planned) -> tuple[np.ndarray, np.ndarray]:
    """X and y of start and goal [m]."""
    x, y, _ = np.concatenate([found.task.starts, found.task.goals]).T
    return x, y


def dense(path: np.ndarray, step: float) -> np.ndarray:
    """A point every `step` metres."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / step)))
    return np.stack([np.interp(at, along, path[:, axis]) for axis in range(3)], axis=-1)
