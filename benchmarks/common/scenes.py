"""Scenes that solvers are compared on: a city or a window of a Warframe maze, one goal, several starts.

scene = (occupied, ground, goal, starts) ↦ inflated obstacles ↦ sigma
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32
from scipy import ndimage

import maxjax
from benchmarks.common.problems import EACH, problems
from maxjax import VoxelMap
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import make_scene, occupancy

_WIDTH = 200.0  # of the city of `city_at` [m]

_formulate = jax.jit(formulate, static_argnames=("distances", "grid"))


@dataclasses.dataclass(frozen=True)
class Selection:
    """Which scenes.

    Attributes:
        shape: of the grid of the maps, voxels of 2 m around the origin.
        maps: maps to take problems from.
        crop: Warframe window; empty for none. Left out where its file does not exist.
        data: folder of public inputs.
        starts: paths a scene.
        margin: [m]; the Warframe window has none.
        seed: of the cities and problems.
    """

    shape: tuple[int, int, int]
    maps: tuple[str, ...]
    crop: str
    data: Path
    starts: int
    margin: float
    seed: int


@dataclasses.dataclass(frozen=True)
class Instance:
    """One map and goal, with its problems.

    Attributes:
        name: map or crop.
        task: its map, its goal and some starts.
        problems: one a start, all with the same voxels blocked, which is the system.
    """

    name: str
    task: Task
    problems: list[Problem]

    @property
    def sigma(self) -> Float[Array, "nx ny nz"]:
        """Conductivity of the first problem."""
        return maxjax.conductivity(self.problems[0].blocked, self.problems[0].goal_index, self.task.grid)


def scenes_of(selection: Selection) -> list[Instance]:
    """A scene of each map, and of the window.

    Raises:
        ValueError: if no start of a scene is joined to its goal.
    """
    scenes = []
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), selection.shape, 2.0)
    for name in selection.maps:
        # Ten problems share a city: the goal is the first one's, the starts are those of all.
        first, *others = problems(name, EACH, selection.seed, grid, selection.margin)
        starts = np.concatenate([first.starts, *(other.starts for other in others)])
        task = Task.of(first.map, starts, first.goals[0], first.distances)
        scenes.append(_scene(name, task, selection.starts))
    file = selection.data / "warframe" / f"crop101_{selection.crop}.npz"
    if selection.crop and file.is_file():
        crop = np.load(file, allow_pickle=False)
        occupied = crop["occupancy"]
        grid = maxjax.Grid(occupied.shape, 1.0, (0.0, 0.0, 0.0))
        task = Task.of(
            VoxelMap.on(grid, occupied),
            crop["start"].astype(np.float32),
            crop["goal"][0].astype(np.float32),
            Distances(0.0, 0.0),
        )
        scenes.append(_scene(selection.crop, task, selection.starts))
    return scenes


def _scene(name: str, task: Task, count: int) -> Instance:
    """The first `count` starts of a task that are joined to its goal and open no voxel, and their problems."""
    maps = jnp.asarray(task.barred), jnp.asarray(task.kept_off)
    found: dict[int, Problem] = {}
    for k, ends in enumerate(task.ends):
        problem = _formulate(*maps, jnp.asarray(ends), distances=task.distances, grid=task.grid.local)
        if problem.status == maxjax.Status.OK and not problem.levels.any():
            found[k] = problem
        if len(found) == count:
            break
    if not found:
        raise ValueError(f"{name}: expected a start joined to the goal, given none among {len(task)}")
    return Instance(name, task.some(np.array(list(found))), list(found.values()))


def city_at(edge: int, margin: float, seed: int) -> tuple[Float[Array, "nx ny nz"], Int32[Array, " 3"]]:
    """Sigma of downtown on edge³ voxels, and its goal: the voxel of the largest component nearest to (40, 40, 9) m.

    Args:
        edge: voxels along an axis; the city is 200 m wide whatever their number.
        margin: [m].
        seed: of the city.
    """
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), (edge, edge, edge), _WIDTH / (edge - 1))
    occupied, ground = occupancy(make_scene("downtown", seed).geoms, grid)
    blocked = maxjax.dilate(jnp.asarray(occupied), margin, grid, jnp.asarray(ground))
    labels, _ = ndimage.label(~np.asarray(blocked))
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    free = np.argwhere(labels == largest)
    away = np.linalg.norm(free * grid.spacing + np.array(grid.origin) - np.array([40.0, 40.0, 9.0]), axis=1)
    goal = jnp.asarray(free[np.argmin(away)], jnp.int32)
    return maxjax.conductivity(blocked, goal, grid), goal
