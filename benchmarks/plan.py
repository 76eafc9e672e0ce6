"""A whole plan at 101³, from the map to the verified path on the host, alone and in batches.

    python -m benchmarks.plan                      # two CPU cores: 2 minutes
    python -m benchmarks.plan --batches 64 256     # one GPU: 3 minutes

Random problems of the three maps (offline protocol, margin 8 m), after a warm-up; compilation apart.

`plan` rows: `maxjax.plan`, and A* on the same problems in the same run; where an accelerator answers in one program,
`stages` rows say what each stage takes when it is waited for. `batch` rows: `plan_batch`, wall-clock time a plan from
arrays on the host to verified plans on the host, and the stages' shares of it (means over the batch): of problems that
have a map each, and of as many in the first city of the first map. Each batch is planned twice before it is timed.
"""

from __future__ import annotations

import dataclasses
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import jax

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, keep, save
from benchmarks.common.problems import joined, planned, problems, problems_in_one_city
from maxjax.core.grid import Index3
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import find_one_by_one, plans_of
from maxjax.planning.windows.focus_window import View
from maxjax.sim.worlds.scenes import MAPS
from maxjax.ui.methods import planner_named

_PROBE = """
import resource, sys, numpy as np, maxjax
grid = maxjax.Grid.centered((0.0, 0.0, 0.0), tuple(map(int, sys.argv[1:])), 2.0)
nx, ny, nz = grid.shape
occupied = np.zeros(grid.shape, bool)
occupied[2 * nx // 5 : 3 * nx // 5, 2 * ny // 5 : 3 * ny // 5, : 4 * nz // 5] = True
end = 0.6 * grid.upper[0]
assert maxjax.plan(maxjax.VoxelMap.on(grid, occupied), (-end, 0, 9), (end, 0, 9)).status == maxjax.Status.OK
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: maps to take problems from.
        problems: problems a map for the `plan` rows.
        shape: of the maps; voxels of 2 m around the origin.
        batches: plans a call of the `batch` rows.
        repeats: timed calls of a batch.
        margin: [m].
        seed: of the problems.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = MAPS
    problems: int = 10
    shape: Index3 = (101, 101, 101)
    batches: tuple[int, ...] = ()
    repeats: int = 5
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS


TINY = Config(maps=("suburb",), problems=1, shape=(51, 51, 33), batches=(2,), repeats=1)


def main(config: Config) -> list[Row]:
    """Time plans; save and return the rows."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    rows = _plan_rows(_drawn(config.problems, config, grid))
    for size in config.batches:
        keep("plan", config, rows, config.out)  # compiling the next may take long
        each = joined(_drawn(-(-size // len(config.maps)), config, grid)[:size])
        rows += _batch_rows(f"batch of {size}", each, config.repeats)
        one = problems_in_one_city(config.maps[0], size, config.seed, grid, config.margin)
        rows += _batch_rows(f"batch of {size} in one city", one, config.repeats)
    rows.append(
        {"what": "peak memory of a process that plans once", "unit": "MB", "median": _peak_memory(config.shape)}
    )
    save("plan", config, rows, config.out)
    return rows


def _drawn(count: int, config: Config, grid: maxjax.Grid) -> list[Task]:
    return [task for name in config.maps for task in problems(name, count, config.seed, grid, config.margin)]


def _milliseconds(what: str, seconds: Sequence[float]) -> dict[str, str | float | int | None]:
    return {
        "what": what,
        "unit": "ms",
        "median": round(1e3 * statistics.median(seconds), 3),
        "min": round(1e3 * min(seconds), 3),
        "max": round(1e3 * max(seconds), 3),
        "n": len(seconds),
    }


def _plan_rows(tasks: list[Task]) -> list[Row]:
    def run_in_stages(task: Task, method: str) -> maxjax.Plan:
        return plans_of(find_one_by_one(View(task), planner_named(method)), task, method)[0]

    rows: list[Row] = []
    ways = [("plan, solver", "solver", planned), ("plan, astar", "astar", planned)]
    if jax.default_backend() != "cpu":
        ways.insert(1, ("stages, solver", "solver", run_in_stages))
    for what, method, way in ways:
        compile_s = way(tasks[0], method).timings["compile"]
        plans = [way(task, method) for task in tasks]
        for stage in [name for name in plans[0].timings if name != "compile"]:
            row = _milliseconds(f"{what}: {stage}", [plan.timings[stage] for plan in plans])
            if stage == "total":
                row["compile_s"] = round(compile_s, 2)
                row["solved"] = sum(plan.status == maxjax.Status.OK for plan in plans)
            rows.append(row)
    return rows


def _batch_rows(what: str, task: Task, repeats: int) -> list[Row]:
    def run() -> maxjax.Plans:
        return maxjax.plan_batch(task.map, task.starts, task.goals, distances=task.distances)

    compile_s = sum(plan.timings["compile"] for plan in run())
    run()
    walls, plans = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        plans.append(run())
        walls.append((time.perf_counter() - start) / len(task))
    stages = [
        _milliseconds(f"{what}: {stage}", [statistics.fmean(plan.timings[stage] for plan in batch) for batch in plans])
        for stage in plans[0][0].timings
        if stage not in ("compile", "total")
    ]
    total = _milliseconds(f"{what}: a plan", walls) | {"compile_s": round(compile_s, 2)}
    rate = round(1 / statistics.median(walls), 1)
    return [*stages, total | {"solved": int(sum(plans[-1].status == maxjax.Status.OK)), "plans_per_second": rate}]


def _peak_memory(shape: Index3) -> float:
    """Largest resident set of a fresh process that plans once, imports and compilation included [MB]."""
    here = {**os.environ, "JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS", "cpu")}
    command = [sys.executable, "-c", _PROBE, *map(str, shape)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=here)
    return round(int(done.stdout.split()[-1]) / 1024, 1)


if __name__ == "__main__":
    main(configured(TINY))
