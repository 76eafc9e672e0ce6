"""Random problems on the three maps: does the field planner solve each solvable one, and how long are its paths?

    python -m experiments.random_problems                  # 1,000 problems a map; 4 minutes on an H200 with 16 cores
    python -m experiments.random_problems --problems 50
    python -m experiments.random_problems --origin 84888 447501 0    # the same in national coordinates

Problems follow the offline protocol: start and goal 20 to 50 voxels apart, 3 to 15 m above ground, in free voxels, on
the exact occupancy of a city (ten problems a city), margin 8 m. Sealed problems are the same with a closed shell of
voxels around one end. Judges are independent of maxjax (`benchmarks.common.oracle`). Expected: every solvable problem
OK and certified at the largest feasible margin, no unsafe path, mean length at most 1.03 of the eikonal geodesic, every
sealed problem NO_VALID_PATH. A* runs beside it on the same problems, grids and margins.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
import sys
from collections import Counter
from pathlib import Path

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, number, table
from benchmarks.common.oracle import Verdict, judge
from benchmarks.common.paper import planned
from benchmarks.common.problems import case_of, moved, problems, seal
from maxjax.core.grid import Index3
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import MAPS

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        problems: problems a map.
        sealed: sealed problems in all, half of them with a sealed start.
        margin: [m].
        measured: every so many problems the length is judged by fast marching, which takes longest.
        shape: of the maps; voxels of 2 m.
        origin: where the middle of each map lies [m], for problems in national coordinates.
        seed: of everything.
        workers: processes that judge.
        out: where the JSON goes.
    """

    problems: int = 1000
    sealed: int = 200
    margin: float = 8.0
    measured: int = 1
    shape: Index3 = (101, 101, 101)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 0
    workers: int = 2
    out: Path = RESULTS


TINY = Config(problems=20, sealed=6, measured=2, shape=(51, 51, 33), workers=1)


def row_of(
    name: str, plans: list[maxjax.Plan], rivals: list[maxjax.Plan], verdicts: list[Verdict], grid: maxjax.Grid
) -> Row:
    """The figures of one map.

    Args:
        name: of the map.
        plans, rivals: by the field and by A*.
        verdicts: of the judges.
        grid: of all problems.
    """
    solvable = [v.margin is not None for v in verdicts]
    solved = [p.status == maxjax.Status.OK for p in plans]
    solutions = [(p, q, v) for p, q, v, ok in zip(plans, rivals, verdicts, solved, strict=True) if ok]
    ratio = np.array([p.length / grid.spacing / v.geodesic for p, _, v in solutions if np.isfinite(v.geodesic)])
    rival = np.array([q.length / p.length for p, q, _ in solutions])
    kept = [
        s and abs(v.margin - p.margin / grid.spacing) < 1e-6
        for p, v, s in zip(plans, verdicts, solved, strict=True)
        if v.margin is not None
    ]

    def milliseconds(of: list[maxjax.Plan]) -> float:
        return round(1e3 * float(np.median([p.timings["total"] for p in of])), 2)

    margins = Counter(round(p.margin, 3) for p, _, _ in solutions)
    return {
        "map": name,
        "problems": len(plans),
        "solvable": sum(solvable),
        "solved": sum(solved),
        "certified": sum(p.certified for p in plans),
        "largest_margin": sum(kept),
        "proved_unsolvable": sum(p.status == maxjax.Status.NO_VALID_PATH for p in plans),
        "unsafe": sum(v.unsafe for v in verdicts),
        "length_over_geodesic_mean": round(float(ratio.mean()), 4),
        "length_over_geodesic_max": round(float(ratio.max()), 4),
        "astar_over_ours_mean": round(float(rival.mean()), 4),
        "length_m": round(float(np.mean([p.length for p, _, _ in solutions])), 2),
        "clearance_m": round(float(np.mean([p.clearance for p, _, _ in solutions])), 2),
        "clearance_least_m": round(float(np.min([p.clearance for p, _, _ in solutions])), 2),
        "margins_m": ", ".join(f"{m:g}: {c}" for m, c in sorted(margins.items(), reverse=True)),
        "plan_ms_median": milliseconds(plans),
        "astar_ms_median": milliseconds(rivals),
    }


def main(config: Config) -> list[Row]:
    """Plan, judge, save; one row a map and one for the sealed problems."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    rows: list[Row] = []

    def drawn(name: str, count: int) -> list[Task]:
        return [moved(task, config.origin) for task in problems(name, count, config.seed, grid, config.margin)]

    with multiprocessing.get_context("spawn").Pool(config.workers) as pool:
        for name in MAPS:
            tasks = drawn(name, config.problems)
            plans, rivals, judged = [], [], []
            for k, task in enumerate(tasks):
                plan, rival = planned(task, "solver", "astar")
                case = dataclasses.replace(case_of(task, plan), measured=k % config.measured == 0)
                judged.append(pool.apply_async(judge, (case,)))
                plans.append(plan)
                rivals.append(rival)
            rows.append(row_of(name, plans, rivals, [verdict.get() for verdict in judged], grid))
            print(rows[-1], file=sys.stderr, flush=True)
        share = -(-config.sealed // len(MAPS))
        open_ones = [task for name in MAPS for task in drawn(name, share)][: config.sealed]
        tasks = [seal(task, ("start", "goal")[k % 2]) for k, task in enumerate(open_ones)]
        plans = [plan for task in tasks for plan in planned(task, "solver")]
        verdicts = pool.map(judge, [case_of(task, plan) for task, plan in zip(tasks, plans, strict=True)])
        rows.append(
            {
                "map": "sealed",
                "problems": len(plans),
                "solvable": sum(v.margin is not None for v in verdicts),
                "solved": sum(p.status == maxjax.Status.OK for p in plans),
                "certified": sum(p.certified for p in plans),
                "proved_unsolvable": sum(p.status == maxjax.Status.NO_VALID_PATH for p in plans),
            }
        )
    save("random_problems", config, rows, config.out)
    return rows


def section(document: Document) -> str:
    """RESULTS.md: plans before their judges, margins, and the sealed problems."""
    *maps, sealed = document["rows"]
    config = document["config"]
    lines = [
        [
            row["map"],
            *(str(row[key]) for key in ("problems", "solvable", "solved", "certified", "unsafe")),
            f"{row['length_over_geodesic_mean']:.3f} ({row['length_over_geodesic_max']:.3f})",
            f"{row['astar_over_ours_mean']:.3f}",
            f"{number(row['plan_ms_median'])} / {number(row['astar_ms_median'])}",
        ]
        for row in maps
    ]
    heads = ["map", "problems", "solvable", "solved", "certified", "unsafe", "length / geodesic", "A\\* / ours", "ms"]
    used = [dict(entry.split(": ") for entry in row["margins_m"].split(", ")) for row in maps]
    rungs = sorted({rung for counts in used for rung in counts}, key=float, reverse=True)
    kept = [
        [
            row["map"],
            str(row["largest_margin"]),
            f"{row['clearance_m']:.1f}",
            f"{row['clearance_least_m']:.1f}",
            *(counts.get(rung, "0") for rung in rungs),
        ]
        for row, counts in zip(maps, used, strict=True)
    ]
    below = ["map", "largest margin", "mean clearance", "least", *(f"at {rung} m" for rung in rungs)]
    return (
        f"### Random problems ({device(document)})\n\n"
        f"Start and goal 20 to 50 voxels apart, 3 to 15 m above ground, margin asked {config['margin']:g} m. Judged\n"
        "by SciPy's labels and distance transform, dense sampling, and the eikonal geodesic of scikit-fmm on the\n"
        "dilated grid: mean and, in brackets, largest length over it. A\\* / ours: length of A\\* over that of the\n"
        "field, mean. ms: median of a whole plan, field / A\\*.\n\n" + table(heads, lines) + "\n"
        "How many were solved at the largest margin that joins start and goal; clearance of the paths to the cubes of\n"
        "occupied voxels, ground left out [m]; and how many flights had which margin. A start or goal beside a wall\n"
        "lowers it.\n\n" + table(below, kept) + "\n"
        f"Of {sealed['problems']} problems with a sealed start or goal, {sealed['proved_unsolvable']} were proved"
        f" unsolvable and {sealed['certified']} certified.\n"
    )


if __name__ == "__main__":
    main(configured(TINY))
