"""Every scenario of the Warframe crops: mazes and optimal lengths that nobody here made.

    MAXJAX_DATA=... python -m experiments.warframe_crops     # 646 plans by field and by A*; 9 minutes on two cores

The crops are 101³ windows of the Moving AI 3D benchmark (Brewer and Sturtevant, 2018), walls one voxel thick, hundreds
of sealed pockets. The stated optimum is that of a 26-neighbour grid path without corner cutting; an any-angle path may
be shorter. Margin 0. Expected: every plan OK, certified and verified; length over the optimum 0.98 or less on average,
1.05 or less at worst; A* equal to the optimum everywhere.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, number, table
from maxjax.ui.methods import planner_named

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        data: folder of public inputs.
        every: plan every n-th scenario.
        out: where the JSON goes.
    """

    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    every: int = 1
    out: Path = RESULTS


TINY = Config(every=60)


def main(config: Config) -> list[Row]:
    """Plan, compare, save; one row a crop and method."""
    rows = [row for name in ("Complex", "Simple") for row in _rows(name, config)]
    save("warframe_crops", config, rows, config.out)
    return rows


def _rows(name: str, config: Config) -> list[Row]:
    crop = np.load(config.data / "warframe" / f"crop101_{name}.npz", allow_pickle=False)
    occupied = crop["occupancy"]
    grid = maxjax.Grid(occupied.shape, 1.0, (0.0, 0.0, 0.0))
    chosen = slice(None, None, config.every)
    starts, goals, optimum = (crop[key][chosen] for key in ("start", "goal", "optimal_length"))
    rows: list[Row] = []
    for method in ("solver", "astar"):
        plans = [
            maxjax.plan(
                maxjax.VoxelMap.on(grid, occupied),
                start,
                goal,
                planner=planner_named(method),
                distances=maxjax.Distances(radius=0.0, margin=0.0),
            )
            for start, goal in zip(starts, goals, strict=True)
        ]
        ratio = np.array([plan.length for plan in plans]) / optimum
        seconds = np.array([plan.timings["total"] for plan in plans])
        rows.append(
            {
                "crop": name,
                "method": method,
                "scenarios": len(plans),
                "ok": sum(plan.status == maxjax.Status.OK for plan in plans),
                "certified": sum(plan.certified for plan in plans),
                "verified": sum(
                    maxjax.verify(plan.path, maxjax.VoxelMap.on(grid, occupied)).ok for plan in plans if len(plan.path)
                ),
                "over_optimum_mean": round(float(ratio.mean()), 4),
                "over_optimum_worst": round(float(ratio.max()), 4),
                "off_optimum": int(np.sum(np.abs(ratio - 1) > 1e-6)),
                "ms_median": round(1e3 * float(np.median(seconds)), 1),
                "ms_max": round(1e3 * float(seconds.max()), 1),
            }
        )
    return rows


def section(document: Document) -> str:
    """RESULTS.md: lengths over the stated optima."""
    methods = {"solver": "field", "astar": "A\\*"}
    lines = [
        [
            row["crop"],
            methods[row["method"]],
            *(str(row[key]) for key in ("scenarios", "ok", "verified")),
            str(row["certified"]) if row["method"] == "solver" else "",
            f"{row['over_optimum_mean']:.3f}",
            f"{row['over_optimum_worst']:.3f}",
            number(row["ms_median"]),
        ]
        for row in document["rows"]
    ]
    rivals = [row for row in document["rows"] if row["method"] == "astar"]
    exact, total = sum(row["scenarios"] - row["off_optimum"] for row in rivals), sum(row["scenarios"] for row in rivals)
    heads = ["crop", "method", "scenarios", "OK", "verified", "certified", "mean", "worst", "ms"]
    return (
        f"### Warframe crops of the Moving AI benchmark ({device(document)})\n\n"
        "Margin 0. Length over the optimum that the benchmark states for 26-neighbour grid paths, mean and worst, and\n"
        "the median time of a whole plan. Below 1 is possible, since paths at any angle need not follow the grid.\n"
        f"A\\* meets the stated optimum in {exact} of {total} scenarios.\n\n" + table(heads, lines, left=2)
    )


if __name__ == "__main__":
    main(configured(TINY))
