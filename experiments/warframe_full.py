"""Every scenario of two whole Warframe maps: 20,000 mazes of others against their optimal lengths.

    MAXJAX_DATA=... python -m experiments.warframe_full                  # 20,000 scenarios, on a GPU
    MAXJAX_DATA=... python -m experiments.warframe_full --every 50       # 200 a map; 1 minute on two cores

The maps Simple and Complex of the Moving AI 3D benchmark (Brewer and Sturtevant, 2018), with all their scenarios. Each
map is one grid: the box of its obstacles and of every scenario's ends with `border` free voxels around. Nothing shorter
lies outside: a path that leaves the box can be clamped onto its free outer layer, coordinate by coordinate, and neither
gets longer nor meets anything. (`--border 1000` takes the map as it is, 7 and 150 times as many voxels, free air all.)

The stated optimum is that of a 26-neighbour grid path without corner cutting; an any-angle path may be shorter. Margin
0, voxels of 1. Almost every scenario of Complex has a goal of its own (9,803 goals), so a field is solved for each;
on a GPU in batches. A* runs beside it on every `check`-th scenario, whose paths are verified once more, on the map as
the file gives it. Expected: every plan OK and certified, 0.93 of the optimum or less on average; one in two hundred
longer than it, where the short way leads through a narrow door; A* equal to the optimum everywhere.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from maxjax.io.readers.moving_ai import load_3dmap

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        data: folder of public inputs.
        maps: names.
        every: plan every n-th scenario.
        check: of those, A* and the verification on the whole map take every n-th; the first always.
        batch: scenarios at a time; None: 64, on a CPU one by one.
        border: free voxels around obstacles and ends.
        out: where the JSON goes.
    """

    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    maps: tuple[str, ...] = ("Complex", "Simple")
    every: int = 1
    check: int = 20
    batch: int | None = None
    border: int = 2
    out: Path = RESULTS


TINY = Config(maps=("Simple",), every=2500, check=2)


@dataclasses.dataclass(frozen=True)
class Maze:
    """One map of the benchmark: voxels, scenarios, optimal lengths [voxels]."""

    occupied: Bool[np.ndarray, "nx ny nz"]
    starts: Int[np.ndarray, "n 3"]
    goals: Int[np.ndarray, "n 3"]
    optimum: Float[np.ndarray, " n"]

    @property
    def grid(self) -> maxjax.Grid:
        """The whole map, voxels of 1."""
        nx, ny, nz = self.occupied.shape
        return maxjax.Grid((nx, ny, nz), 1.0, (0.0, 0.0, 0.0))

    def cropped(self, border: int) -> tuple[Bool[np.ndarray, "mx my mz"], maxjax.Grid]:
        """The box of all that is in it, and where that lies in the map."""
        inside = np.concatenate([np.argwhere(self.occupied), self.starts, self.goals])
        low = np.maximum(inside.min(0) - border, 0)
        high = np.minimum(inside.max(0) + border + 1, self.occupied.shape)
        occupied = self.occupied[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
        (nx, ny, nz), (x, y, z) = occupied.shape, low.tolist()
        return occupied, maxjax.Grid((nx, ny, nz), 1.0, (float(x), float(y), float(z)))


def load(folder: Path, name: str) -> Maze:
    """A map and its scenarios: a line per scenario after two of header."""
    occupied = load_3dmap(folder / f"{name}.3dmap").occupied
    table = np.loadtxt(folder / f"{name}.3dmap.3dscen", skiprows=2, ndmin=2)
    ends = table[:, :6].astype(int)
    return Maze(occupied, ends[:, :3], ends[:, 3:], table[:, 6])


def main(config: Config) -> list[Row]:
    """Plan, compare, save; one row a map and method."""
    rows = [row for name in config.maps for row in _rows(name, config)]
    save("warframe_full", config, rows, config.out)
    return rows


def _rows(name: str, config: Config) -> list[Row]:
    whole = load(config.data / "warframe", name)
    occupied, grid = whole.cropped(config.border)
    chosen = slice(None, None, config.every)
    maze = Maze(whole.occupied, whole.starts[chosen], whole.goals[chosen], whole.optimum[chosen])
    plans = _plans(occupied, maze, grid, config)
    some = slice(None, None, config.check)
    checked = [
        maxjax.verify(p.path, maxjax.VoxelMap.on(maze.grid, maze.occupied)).ok for p in plans[some] if len(p.path)
    ]
    rivals = [
        maxjax.plan(
            maxjax.VoxelMap.on(grid, occupied),
            start,
            goal,
            planner=maxjax.AStar(),
            distances=maxjax.Distances(radius=0.0, margin=0.0),
        )
        for start, goal in zip(maze.starts[some], maze.goals[some], strict=True)
    ]
    first: dict[str, Any] = {"map": name, "grid": " x ".join(map(str, grid.shape))}
    rows: list[Row] = [
        {**first, "method": "solver", "goals": len(np.unique(maze.goals, axis=0)), **_row(plans, maze.optimum)}
        | {"checked": len(plans[some]), "passed_on_whole_map": sum(checked)},
        {**first, "method": "astar", **_row(rivals, maze.optimum[some])},
    ]
    for row in rows:
        print(row, file=sys.stderr, flush=True)
    return rows


def _plans(occupied: np.ndarray, maze: Maze, grid: maxjax.Grid, config: Config) -> list[maxjax.Plan]:
    size = config.batch or (1 if jax.default_backend() == "cpu" else 64)
    count = len(maze.starts)
    plans: list[maxjax.Plan] = []
    for at in range(0, count, size):
        # The last batch is filled up with copies: one program.
        some = np.minimum(np.arange(at, at + size), count - 1)
        starts, goals = maze.starts[some], maze.goals[some]
        if size == 1:
            plans.append(
                maxjax.plan(
                    maxjax.VoxelMap.on(grid, occupied),
                    starts[0],
                    goals[0],
                    distances=maxjax.Distances(radius=0.0, margin=0.0),
                )
            )
        else:
            plans += maxjax.plan_batch(
                maxjax.VoxelMap.on(grid, occupied), starts, goals, distances=maxjax.Distances(radius=0.0, margin=0.0)
            )
    return plans[:count]


def _row(plans: list[maxjax.Plan], optimum: np.ndarray) -> dict[str, Any]:
    solved = np.array([plan.status == maxjax.Status.OK for plan in plans])
    ratio = np.array([plan.length for plan in plans])[solved] / optimum[solved]
    seconds = np.array([plan.timings["total"] for plan in plans])
    other = Counter(plan.status.name for plan in plans if plan.status != maxjax.Status.OK)
    figures: dict[str, Any] = {
        "scenarios": len(plans),
        "ok": int(solved.sum()),
        "certified": sum(plan.certified for plan in plans),
        "failures": ", ".join(f"{status}: {count}" for status, count in other.items()) or None,
    }
    if solved.any():
        figures |= {
            "over_optimum_mean": round(float(ratio.mean()), 4),
            "over_optimum_worst": round(float(ratio.max()), 4),
            "longer": int(np.sum(ratio > 1 + 1e-6)),
            "off_optimum": int(np.sum(np.abs(ratio - 1) > 1e-6)),
        }
    return figures | {
        "ms_median": round(1e3 * float(np.median(seconds)), 1),
        "ms_max": round(1e3 * float(seconds.max()), 1),
    }


def section(document: dict[str, Any]) -> str:
    """RESULTS.md: the table, and what it says."""
    rows = document["rows"]
    lines = [
        "| map | grid | method | scenarios | OK | certified | mean / optimum | worst | longer | median [ms] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        certified = row["certified"] if row["method"] == "solver" else "–"
        mean, worst = (f"{row[key]:.4f}" if key in row else "–" for key in ("over_optimum_mean", "over_optimum_worst"))
        lines.append(
            f"| {row['map']} | {row['grid']} | {row['method']} | {row['scenarios']} | {row['ok']} | {certified} "
            f"| {mean} | {worst} | {row.get('longer', '–')} | {row['ms_median']:g} |"
        )
    ours = [row for row in rows if row["method"] == "solver"]
    rivals = [row for row in rows if row["method"] == "astar"]
    total, solved = (sum(row[key] for row in ours) for key in ("scenarios", "ok"))
    exact = sum(row["scenarios"] - row.get("off_optimum", 0) for row in rivals)
    longer = sum(row.get("longer", 0) for row in ours)
    door = ": a narrow door costs φ as much as a few voxels of way, so that the way round it wins where both are short"
    why = door if longer else ""
    text = (
        f"Of {total:,} scenarios that others made, {solved:,} are solved and verified, "
        f"{sum(row['certified'] for row in ours):,} of them on a certified field. "
        f"The optimum is that of a grid path of 26 neighbours, so that an any-angle path may be shorter; "
        f"{longer:,} of ours are longer{why}. "
        f"{sum(row['passed_on_whole_map'] for row in ours)} of {sum(row['checked'] for row in ours)} paths passed a "
        f"second verification on the map as the file gives it. A* meets the stated optimum in {exact} of "
        f"{sum(row['scenarios'] for row in rivals)} scenarios."
    )
    faster = [
        f"on {a['map']} by {a['ms_median'] / b['ms_median']:.1f} times"
        for a, b in zip(ours, rivals, strict=True)
        if b["ms_median"] < a["ms_median"]
    ]
    if faster:
        text += f" A* is the quicker one {' and '.join(faster)} (median)."
    return "\n".join(["### Whole Warframe maps", "", *lines, "", text, ""])


if __name__ == "__main__":
    main(configured(TINY))
