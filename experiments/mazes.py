"""Maps that are hard to solve: noise up to the density where it closes, doors in a row, a folded corridor.

    python -m experiments.mazes                      # two CPU cores: 15 minutes
    python -m experiments.mazes --noise 12

Voxels are occupied at random, each by itself, at densities from 40 to 69 %; start and goal are two free voxels that
faces join. `doors`: walls across the map, each with one free voxel. `snake`: a corridor one voxel wide. Ways are one
voxel wide, so that they keep 1 m at 2 m a voxel: the default radius. Each problem is planned with the default price, in
101³ voxels (the snake in 101 x 101 x 1); SciPy's labels say that its ends are joined. `solve` is the time of the field,
in terms of the median of ten downtown maps of the same shape, planned in whole maps as well.

Expected: every problem OK and certified, by Maxwell's field or by the flood's own distance; a solve at most 20 times a
city's.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy import ndimage

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from experiments.problem_sets import problem_set

RESULTS = Path(__file__).parent / "results"
DENSITIES = (0.40, 0.50, 0.60, 0.65, 0.68, 0.69)


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        noise: maps of noise, taken in turn from all densities.
        doors: numbers of walls.
        edge: of a map [voxels].
        cities: maps to compare solves with.
        seed: of the noise and the ends.
        out: where the JSON goes.
    """

    noise: int = 200
    doors: tuple[int, ...] = (10, 34)
    edge: int = 101
    cities: int = 10
    seed: int = 0
    out: Path = RESULTS


TINY = Config(noise=2, doors=(3,), edge=25, cities=1)


class Maze(NamedTuple):
    """A map and two ends that are joined, in voxels."""

    name: str
    occupied: Bool[np.ndarray, "nx ny nz"]
    ends: Int64[np.ndarray, "2 3"]


class Found(NamedTuple):
    """A plan, and what it took altogether [s]."""

    plan: maxjax.Plan
    seconds: float


def main(config: Config) -> list[Row]:
    """Plan everything; save and return one row a kind."""
    half = float(config.edge - 1)
    waiting = problem_set("downtown", config.cities, config.seed, half=half)
    count = config.noise + len(config.doors) + 1
    cities: list[Found] = []
    mazes: dict[str, list[Found]] = {}
    for k, maze in enumerate(itertools.chain(_noise(config), _doors(config), [_snake(config.edge)])):
        # Cities in between, so that a machine that is busy for a while is so for both.
        while len(cities) < len(waiting) and len(cities) * count <= k * len(waiting):
            one = waiting[len(cities)]
            cities.append(_planned(one.map, np.stack([one.start, one.goal])))
        grid = maxjax.Grid(maze.occupied.shape, 2.0, (0.0, 0.0, 0.0))
        mazes.setdefault(maze.name, []).append(_planned(maxjax.VoxelMap.on(grid, maze.occupied), 2.0 * maze.ends))
    city = float(np.median([found.plan.timings["solve"] for found in cities]))
    rows = [_row("downtown", cities, city)] + [_row(name, found, city) for name, found in mazes.items()]
    save("mazes", config, rows, config.out)
    return rows


def _noise(config: Config) -> Iterator[Maze]:
    for k in range(config.noise):
        density = DENSITIES[k % len(DENSITIES)]
        rng = np.random.default_rng([config.seed, k])
        occupied = rng.random((config.edge,) * 3) < density
        labels, _ = ndimage.label(~occupied)
        largest = np.argwhere(labels == 1 + np.argmax(np.bincount(labels.reshape(-1))[1:]))
        yield Maze(f"noise, {density:.0%}", occupied, rng.choice(largest, 2, replace=False))


def _doors(config: Config) -> Iterator[Maze]:
    for count in config.doors:
        rng = np.random.default_rng([config.seed, count])
        occupied = np.zeros((config.edge,) * 3, bool)
        for x in np.linspace(2, config.edge - 3, count).astype(int).tolist():
            occupied[x] = True
            y, z = rng.integers(0, config.edge, 2).tolist()
            occupied[x, y, z] = False
        middle, last = config.edge // 2, config.edge - 1
        yield Maze(f"{count} doors", occupied, np.array([[0, middle, middle], [last, middle, middle]]))


def _snake(edge: int) -> Maze:
    occupied = np.zeros((edge, edge, 1), bool)
    for turn, x in enumerate(range(1, edge, 2)):
        occupied[x] = True
        occupied[x, -1 if turn % 2 == 0 else 0] = False
    return Maze("snake", occupied, np.argwhere(~occupied)[[0, -1]])


def _planned(where: maxjax.VoxelMap, ends: Float64[np.ndarray, "2 3"] | Int64[np.ndarray, "2 3"]) -> Found:
    before = time.perf_counter()
    plan = maxjax.plan(where, ends[0], ends[1], planner=maxjax.Field(focus=False))
    return Found(plan, time.perf_counter() - before - plan.timings["compile"])


def _row(name: str, found: list[Found], city: float) -> Row:
    plans = [one.plan for one in found]
    solves = [plan.timings["solve"] for plan in plans]
    return {
        "map": name,
        "problems": len(plans),
        "ok": sum(plan.status == maxjax.Status.OK for plan in plans),
        "certified": sum(plan.certified for plan in plans),
        "geodesic": sum(plan.potential == "geodesic" for plan in plans),
        "other": ", ".join(sorted({plan.status.name for plan in plans if plan.status != maxjax.Status.OK})) or None,
        "length_m_max": round(float(np.nanmax([plan.length for plan in plans])), 1),
        "solve_median": round(float(np.median(solves)) / city, 2),
        "solve_max": round(max(solves) / city, 2),
        "plan_s_median": round(float(np.median([one.seconds for one in found])), 3),
        "plan_s_max": round(max(one.seconds for one in found), 3),
    }


def section(document: Document) -> str:
    """RESULTS.md: one line a kind of map."""
    lines = [
        [
            row["map"],
            *(str(row[key]) for key in ("problems", "ok", "certified", "geodesic")),
            f"{row['length_m_max']:,.0f}",
            *(f"{row[key]:.1f}" for key in ("solve_median", "solve_max")),
            *(f"{row[key]:.2f}" for key in ("plan_s_median", "plan_s_max")),
        ]
        for row in document["rows"]
    ]
    heads = ["map", "problems", "OK", "certified", "by the flood", "longest, m"]
    heads += ["solve, cities", "at most", "plan, s", "at most"]
    return (
        f"### Maps that are hard to solve ({device(document)})\n\n"
        "Plans in whole maps: noise of single voxels, walls with one door of a voxel each, a folded corridor. Solves\n"
        "in terms of a downtown map's, median and most.\n\n" + table(heads, lines, left=1)
    )


if __name__ == "__main__":
    main(configured(TINY))
