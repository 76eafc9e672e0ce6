"""Plans in windows beside plans in whole maps: the same statuses, the same paths, and how much sooner.

    MAXJAX_DATA=... python -m experiments.focus                        # 3,000 random problems, 646 crops: 3 hours
    MAXJAX_DATA=... python -m experiments.focus --problems 100 --every 10

Random problems are those of `experiments.problem_sets`, crops the scenarios of `experiments.warframe_crops` (radius and
margin 0). Each problem is planned twice in a row, in windows and in its whole map, after a first problem of each set
that compiles. Expected: the same status everywhere, all plans certified; lengths over those of whole maps at most 1.002
on average and 1.02 at worst.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, number, table
from experiments.problem_sets import problem_set
from maxjax.sim.worlds.scenes import MAPS

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: of the random problems.
        problems: of each map.
        half: half extent of their maps [m]; voxels of 2 m.
        every: plan every n-th scenario of a crop; 0: none.
        data: folder of public inputs.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = MAPS
    problems: int = 1000
    half: float = 100.0
    every: int = 1
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    out: Path = RESULTS


TINY = Config(maps=("suburb",), problems=3, half=50.0, every=0)


class Pair(NamedTuple):
    """One problem: its plan in windows and in the whole map, and what each took [s]."""

    windows: maxjax.Plan
    whole: maxjax.Plan
    seconds: tuple[float, float]


def main(config: Config) -> list[Row]:
    """Plan everything twice; save and return one row a set."""
    rows = [_row(name, _pairs(_random(name, config.problems, config.half))) for name in config.maps]
    for name in ("Complex", "Simple") if config.every and (config.data / "warframe").exists() else ():
        rows.append(_row(f"Warframe {name}", _pairs(_scenarios(config.data, name, config.every))))
    save("focus", config, rows, config.out)
    return rows


def _random(name: str, count: int, half: float) -> Iterator[dict[str, Any]]:
    for one in problem_set(name, count, half=half):
        yield {"where": one.map, "start": one.start, "goal": one.goal}


def _scenarios(data: Path, name: str, every: int) -> Iterator[dict[str, Any]]:
    crop = np.load(data / "warframe" / f"crop101_{name}.npz", allow_pickle=False)
    occupied = crop["occupancy"]
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.0, 0.0, 0.0))
    problem = {"where": where, "distances": maxjax.Distances(0.0, 0.0)}
    for start, goal in zip(crop["start"][::every], crop["goal"][::every], strict=True):
        yield problem | {"start": start, "goal": goal}


def _pairs(problems: Iterable[dict[str, Any]]) -> list[Pair]:
    return [_pair(problem) for problem in problems]


def _pair(problem: dict[str, Any]) -> Pair:
    plans, seconds = [], []
    for focus in (True, False):
        before = time.perf_counter()
        plans.append(maxjax.plan(**problem, planner=maxjax.Field(focus=focus)))
        seconds.append(time.perf_counter() - before - plans[-1].timings["compile"])
    return Pair(plans[0], plans[1], (seconds[0], seconds[1]))


def _row(name: str, pairs: list[Pair]) -> Row:
    both = [pair for pair in pairs if pair.windows.status == pair.whole.status == maxjax.Status.OK]
    length, cost = (
        np.array([getattr(pair.windows, what) / getattr(pair.whole, what) for pair in both])
        for what in ("length", "cost")
    )
    windows, whole = (1e3 * np.array([pair.seconds[k] for pair in pairs]) for k in range(2))
    return {
        "set": name,
        "problems": len(pairs),
        "same_status": sum(pair.windows.status == pair.whole.status for pair in pairs),
        "ok": len(both),
        "certified": sum(pair.windows.certified for pair in both),
        "length_mean": round(float(length.mean()), 5),
        "length_worst": round(float(length.max()), 5),
        "cost_mean": round(float(cost.mean()), 5),
        "cost_worst": round(float(cost.max()), 5),
        "windows_ms_median": round(float(np.median(windows)), 1),
        "windows_ms_p99": round(float(np.percentile(windows, 99)), 1),
        "whole_ms_median": round(float(np.median(whole)), 1),
        "times_median": round(float(np.median(whole / windows)), 2),
    }


def section(document: Document) -> str:
    """RESULTS.md: windows beside whole maps."""
    lines = [
        [
            row["set"],
            *(str(row[key]) for key in ("problems", "same_status", "ok", "certified")),
            *(f"{row[key]:.4f}" for key in ("length_mean", "length_worst", "cost_worst")),
            *(number(row[key]) for key in ("windows_ms_median", "windows_ms_p99", "whole_ms_median")),
            f"{row['times_median']:.1f}",
        ]
        for row in document["rows"]
    ]
    heads = ["set", "problems", "same status", "OK", "certified", "length", "worst", "cost, worst"]
    heads += ["ms", "99th percentile", "whole map, ms", "times"]
    return (
        f"### Windows beside whole maps, {sum(row['problems'] for row in document['rows']):,} problems "
        f"({device(document)})\n\n"
        "Plans in the window that provably holds the cheapest way, and of the same problems in whole maps: lengths\n"
        "and costs over those of whole maps, mean and worst, and the median time of a plan.\n\n"
        + table(heads, lines, left=1)
    )


if __name__ == "__main__":
    main(configured(TINY))
