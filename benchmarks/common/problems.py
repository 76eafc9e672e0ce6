"""Random problems of the offline protocol on the three maps, open and sealed, and the case that judges take.

Start and goal lie 20 to 50 voxels apart, 3 to 15 m above ground, in free voxels of the exact occupancy of a city.
"""

from __future__ import annotations

import dataclasses

import numpy as np

import maxjax
from benchmarks.common.oracle import Case
from maxjax.fields.occupancy import rungs
from maxjax.worlds.scenes import MAPS, make_scene, occupancy


@dataclasses.dataclass(frozen=True)
class Problem:
    """One problem: voxels and metres."""

    occupied: np.ndarray
    ground: np.ndarray
    start: np.ndarray
    goal: np.ndarray


def problems(name: str, count: int, seed: int, grid: maxjax.Grid) -> list[Problem]:
    """`count` problems of a map, ten a city; the same for the same seed, whatever the count."""
    found: list[Problem] = []
    city = 0
    while len(found) < count:
        rng = np.random.default_rng([seed, MAPS.index(name), city])
        occupied, ground = occupancy(make_scene(name, seed + city).geoms, grid)
        for _ in range(10):
            start, goal = draw_ends(rng, occupied, grid)
            found.append(Problem(occupied, ground, start, goal))
        city += 1
    return found[:count]


def draw_ends(rng: np.random.Generator, occupied: np.ndarray, grid: maxjax.Grid) -> tuple[np.ndarray, np.ndarray]:
    """Two free points, 20 to 50 voxels apart, 3 to 15 m high."""
    (west, south, _), (east, north, _) = grid.lower, grid.upper
    low, high = (west + 2, south + 2, 3.0), (east - 2, north - 2, 15.0)
    while True:
        ends = rng.uniform(low, high, (2, 3)).astype(np.float32)
        index = np.floor((ends - np.array(grid.origin)) / grid.spacing + 0.5).astype(int)
        apart = np.linalg.norm(ends[0] - ends[1]) / grid.spacing
        if 20 <= apart <= 50 and not occupied[tuple(index.T)].any():
            return ends[0], ends[1]


def seal(problem: Problem, grid: maxjax.Grid, end: str) -> Problem:
    """The problem with a closed cube of voxels, one thick, around its start or goal."""
    point = problem.start if end == "start" else problem.goal
    index = np.floor((point - np.array(grid.origin)) / grid.spacing + 0.5).astype(int)
    shell, room = problem.occupied.copy(), 3
    low, high = np.maximum(index - room, 0), index + room + 1
    block = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    inner = tuple(slice(a + 1, b - 1) for a, b in zip(low, high, strict=True))
    kept = shell[inner].copy()
    shell[block] = True
    shell[inner] = kept
    return dataclasses.replace(problem, occupied=shell)


def case_of(problem: Problem, plan: maxjax.Plan, margin: float, grid: maxjax.Grid) -> Case:
    """What the judges need of a problem and its plan."""

    def to_index(x: np.ndarray) -> np.ndarray:
        return np.asarray((x.astype(np.float64) - np.array(grid.origin)) / grid.spacing)

    return Case(
        np.packbits(problem.occupied),
        np.packbits(problem.ground),
        grid.shape,
        to_index(problem.start),
        to_index(problem.goal),
        tuple(m / grid.spacing for m in rungs(margin, grid)),
        plan.margin / grid.spacing,
        to_index(plan.path),
    )
