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
import tyro

import maxjax
from benchmarks.harness import Row, save

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
            maxjax.plan(occupied, start, goal, grid, method=method, margin=0.0)
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
                    maxjax.verify(plan.path, occupied, occupied, grid).ok for plan in plans if len(plan.path)
                ),
                "over_optimum_mean": round(float(ratio.mean()), 4),
                "over_optimum_worst": round(float(ratio.max()), 4),
                "off_optimum": int(np.sum(np.abs(ratio - 1) > 1e-6)),
                "ms_median": round(1e3 * float(np.median(seconds)), 1),
                "ms_max": round(1e3 * float(seconds.max()), 1),
            }
        )
    return rows


if __name__ == "__main__":
    main(tyro.cli(Config))
