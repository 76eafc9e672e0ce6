"""Scenes that solvers are compared on: a city or a window of a Warframe maze, one goal, several starts.

scene = (occupied, ground, goal, starts) dilated by one margin ↦ sigma
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage

import maxjax
from benchmarks.common.problems import problems
from maxjax.planning.problem import Problem, formulate
from maxjax.worlds.scenes import make_scene, occupancy

_WIDTH = 200.0  # of the city of `city_at` [m]

_formulate = jax.jit(formulate, static_argnames=("margin", "grid"))


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
class Scene:
    """One map and goal.

    Attributes:
        name: map or crop.
        grid: its grid.
        occupied, ground: voxels.
        goal: [m].
        starts: the same distance from walls can be kept from each of them [m].
        problems: one a start, all at the same margin; the first gives the system.
    """

    name: str
    grid: maxjax.Grid
    occupied: Bool[np.ndarray, "nx ny nz"]
    ground: Bool[np.ndarray, "nx ny nz"]
    goal: Float[np.ndarray, " 3"]
    starts: list[Float[np.ndarray, " 3"]]
    problems: list[Problem]

    @property
    def sigma(self) -> Float[Array, "nx ny nz"]:
        """Conductivity of the first problem."""
        return maxjax.conductivity(self.problems[0].blocked, self.problems[0].goal_index, self.grid)


def scenes_of(selection: Selection) -> list[Scene]:
    """A scene of each map, and of the window.

    Raises:
        ValueError: if no start of a scene is joined to its goal.
    """
    scenes = []
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), selection.shape, 2.0)
    for name in selection.maps:
        # Ten problems share a city: the goal is the first one's, the starts are those of all.
        drawn = problems(name, 10, selection.seed, grid)
        starts = [problem.start for problem in drawn]
        scene = Scene(name, grid, drawn[0].occupied, drawn[0].ground, drawn[0].goal, starts, [])
        scenes.append(_joined(scene, selection.starts, selection.margin))
    file = selection.data / "warframe" / f"crop101_{selection.crop}.npz"
    if selection.crop and file.is_file():
        crop = np.load(file, allow_pickle=False)
        occupied = crop["occupancy"]
        grid = maxjax.Grid(occupied.shape, 1.0, (0.0, 0.0, 0.0))
        goal, starts = crop["goal"][0].astype(np.float32), list(crop["start"].astype(np.float32))
        scene = Scene(selection.crop, grid, occupied, np.zeros_like(occupied), goal, starts, [])
        scenes.append(_joined(scene, selection.starts, 0.0))
    return scenes


def _joined(scene: Scene, count: int, margin: float) -> Scene:
    """The scene with the first `count` starts that are joined to the goal at one margin, and their problems."""
    found: list[Problem] = []
    starts: list[np.ndarray] = []
    for start in scene.starts:
        ends = scene.grid.fractional_index(jnp.stack([jnp.asarray(start), jnp.asarray(scene.goal)]))
        maps = jnp.asarray(scene.occupied), jnp.asarray(scene.ground)
        problem = _formulate(*maps, ends, margin=margin, grid=scene.grid)
        if problem.status == maxjax.Status.OK and (not found or problem.margin == found[0].margin):
            found.append(problem)
            starts.append(start)
        if len(found) == count:
            break
    if not found:
        raise ValueError(f"{scene.name}: expected a start joined to the goal, given none among {len(scene.starts)}")
    return dataclasses.replace(scene, starts=starts, problems=found)


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
