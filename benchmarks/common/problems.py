"""Random problems of the offline protocol on the three maps, open and sealed, and the case that judges take.

Start and goal lie 20 to 50 voxels apart, 3 to 15 m above ground, in free voxels of the exact occupancy of a city. A
problem is a `Task` of one start and one goal.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool
from scipy import ndimage

import maxjax
from benchmarks.common.oracle import Case
from benchmarks.common.paper import ladder
from maxjax import VoxelMap
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import MAPS, make_scene, occupancy
from maxjax.ui.methods import planner_named

EACH = 10  # problems a city


def problems(name: str, count: int, seed: int, grid: maxjax.Grid, margin: float = 8.0) -> list[Task]:
    """`count` problems of a map, ten a city; the same for the same seed, whatever the count.

    Args:
        name: of the map.
        count: problems.
        seed: of the cities and problems.
        grid: of the occupancy.
        margin: of the tasks [m].
    """
    found: list[Task] = []
    city = 0
    while len(found) < count:
        rng = np.random.default_rng([seed, MAPS.index(name), city])
        occupied, ground = occupancy(make_scene(name, seed + city).geoms, grid)
        for _ in range(EACH):
            start, goal = draw_ends(rng, occupied, grid)
            found.append(
                Task.of(
                    VoxelMap.on(grid, occupied, ground), start[None], goal[None], Distances(min(1.0, margin), margin)
                )
            )
        city += 1
    return found[:count]


def problems_in_one_city(name: str, count: int, seed: int, grid: maxjax.Grid, margin: float = 8.0) -> Task:
    """`count` problems in the first city of a map, as one task; arguments as of `problems`."""
    rng = np.random.default_rng([seed, MAPS.index(name), 0])
    occupied, ground = occupancy(make_scene(name, seed).geoms, grid)
    ends = np.stack([draw_ends(rng, occupied, grid) for _ in range(count)])
    return Task.of(VoxelMap.on(grid, occupied, ground), ends[:, 0], ends[:, 1], Distances(min(1.0, margin), margin))


def draw_ends(rng: np.random.Generator, occupied: np.ndarray, grid: maxjax.Grid) -> tuple[np.ndarray, np.ndarray]:
    """Two free points [m], 20 to 50 voxels apart, 3 to 15 m high."""
    (west, south, _), (east, north, _) = grid.lower, grid.upper
    low, high = (west + 2, south + 2, 3.0), (east - 2, north - 2, 15.0)
    while True:
        ends = rng.uniform(low, high, (2, 3)).astype(np.float32)
        apart = np.linalg.norm(ends[0] - ends[1]) / grid.spacing
        if 20 <= apart <= 50 and not occupied[tuple(voxels_of(ends, grid).T)].any():
            return ends[0], ends[1]


def voxels_of(points: np.ndarray, grid: maxjax.Grid) -> np.ndarray:
    """The voxel of each point [m]; points lie on the map."""
    return np.asarray(np.floor((points - np.array(grid.origin)) / grid.spacing + 0.5).astype(int))


def seal(task: Task, end: str) -> Task:
    """The problem with a closed cube of voxels, one thick, around its start or goal."""
    index = voxels_of((task.starts if end == "start" else task.goals)[0], task.grid)
    occupied, room = task.barred.copy(), 3
    low, high = np.maximum(index - room, 0), index + room + 1
    cube = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    inner = tuple(slice(a + 1, b - 1) for a, b in zip(low, high, strict=True))
    kept = occupied[inner].copy()
    occupied[cube] = True
    occupied[inner] = kept
    return dataclasses.replace(task, map=VoxelMap.on(task.grid, occupied, task.map.ground))


def moved(task: Task, origin: tuple[float, float, float]) -> Task:
    """The task where the world's origin came to lie at `origin` [m]: the same in index coordinates."""
    x, y, z = np.array(task.grid.origin) + origin
    grid = dataclasses.replace(task.grid, origin=(float(x), float(y), float(z)))
    where = dataclasses.replace(task.map, grid=grid)
    return dataclasses.replace(task, map=where, starts=task.starts + origin, goals=task.goals + origin)


def joined(tasks: Sequence[Task]) -> Task:
    """One task of several with one problem each, on the same grid with the same distances."""
    occupied, ground = (
        np.stack([np.asarray(getattr(task.map, name)) for task in tasks]) for name in ("occupied", "ground")
    )
    starts, goals = (np.concatenate([getattr(task, name) for task in tasks]) for name in ("starts", "goals"))
    return Task.of(VoxelMap.on(tasks[0].grid, occupied, ground), starts, goals, tasks[0].distances)


def solvable(task: Task) -> Bool[np.ndarray, " b"]:
    """Whether free voxels of the task's one map join its ends, by SciPy; margins only take voxels away."""
    labels, _ = ndimage.label(~task.barred)
    start, goal = (labels[tuple(voxels_of(ends, task.grid).T)] for ends in (task.starts, task.goals))
    return np.asarray((start == goal) & (start != 0))


def planned(task: Task, method: str) -> maxjax.Plan:
    """`maxjax.plan` of a problem."""
    planner = planner_named(method)
    return maxjax.plan(task.map, task.starts[0], task.goals[0], planner=planner, distances=task.distances)


def case_of(task: Task, plan: maxjax.Plan) -> Case:
    """What the judges need of a problem and its plan in the map dilated by its margin (`benchmarks.common.paper`)."""
    grid = task.grid

    def to_index(x: np.ndarray) -> np.ndarray:
        return np.asarray((x.astype(np.float64) - np.array(grid.origin)) / grid.spacing)

    return Case(
        np.packbits(task.barred),
        np.packbits(task.kept_off),
        grid.shape,
        to_index(task.starts[0]),
        to_index(task.goals[0]),
        tuple(m / grid.spacing for m in ladder(task.distances.margin, grid.spacing)),
        plan.margin / grid.spacing,
        to_index(plan.path),
    )
