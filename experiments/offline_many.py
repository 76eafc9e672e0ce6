r"""Offline by the thousand: how many problems end in a verified path, and on a certified field.

    python -m experiments.offline_many --problems 10000 --workers 15     # the solver; one H200 with 16 cores
    python -m experiments.offline_many --methods solver network "network alone" "paper alone" \
        "paper_difference alone" --name offline_networks --workers 15    # 1,000 problems a map

Both unseen maps, offline protocol (`experiments.random_problems`), ten problems a city, margin 8 m or the largest that
joins the ends. Methods are those of `experiments.offline_methods` that climb a field; each plans the same problems in
batches (`planning.run.execution`). Problems that no margin solves stay in, and are to be proved so (SciPy's labels
decide). Every `measured`-th solvable problem is judged by `benchmarks.common.oracle`; for these, lengths are compared
with the eikonal geodesic of the dilated grid. Time a plan is that of its batch, from arrays on the host to verified
paths.

Expected: the solver solves and certifies every solvable problem, and so do networks with sweeps, at 0.98 of that
geodesic; networks alone do not: the paper's by its own recipe seldom arrives.
"""

from __future__ import annotations

import dataclasses
import itertools
import multiprocessing
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, number, table
from benchmarks.common.oracle import judge
from benchmarks.common.paper import dilated
from benchmarks.common.problems import EACH, case_of, joined, problems, solvable
from experiments.offline_methods import network
from experiments.offline_table import failures
from maxjax.planning.plan import Plan
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.stages import PotentialFn
from maxjax.solvers.potential import solve_potential

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        problems: a map.
        maps: nothing was ever tuned or trained on them.
        methods: `solver`, or networks as `experiments.offline_methods` names them.
        batch: problems a call.
        measured: every so many problems the way is measured by fast marching, which takes longest.
        margin: [m].
        shape: of the grid, voxels of 2 m around the origin.
        seed: of cities and problems.
        workers: processes that draw and judge.
        name: of the result file.
        out: where the JSON goes.
    """

    problems: int = 1000
    maps: tuple[str, ...] = ("downtown", "suburb")
    methods: tuple[str, ...] = ("solver",)
    batch: int = 200
    measured: int = 10
    margin: float = 8.0
    shape: tuple[int, int, int] = (101, 101, 101)
    seed: int = 0
    workers: int = 2
    name: str = "offline_many"
    out: Path = RESULTS


TINY = Config(problems=4, maps=("suburb",), batch=2, measured=2, shape=(51, 51, 17))


def cities_of(name: str, config: Config, grid: maxjax.Grid) -> list[tuple[str, int, maxjax.Grid, float]]:
    """What to ask `draw` for: as many cities as the problems take."""
    return [(name, config.seed + city, grid, config.margin) for city in range(-(-config.problems // EACH))]


def draw(asked: tuple[str, int, maxjax.Grid, float]) -> list[tuple[Task, bool]]:
    """The problems of a city (map, seed), and whether SciPy's labels join their ends."""
    name, seed, grid, margin = asked
    return [(task, bool(solvable(task).all())) for task in problems(name, EACH, seed, grid, margin)]


def _without_accelerator() -> None:
    """In a worker, before JAX looks for devices: cities are drawn on the CPU."""
    jax.config.update("jax_platforms", "cpu")


@dataclasses.dataclass
class _Tally:
    """What is kept of a method's plans: numbers, no paths."""

    plans: list[Plan] = dataclasses.field(default_factory=list)
    seconds: float = 0.0
    compile_s: float = 0.0


def main(config: Config) -> list[Row]:
    """Draw, plan, judge, save; one row a map and method."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    potentials = {method: _potential(method) for method in config.methods}
    rows: list[Row] = []
    with multiprocessing.get_context("spawn").Pool(config.workers, _without_accelerator) as pool:
        for name in config.maps:
            cities = pool.imap(draw, cities_of(name, config, grid))
            for row in _rows(name, itertools.chain.from_iterable(cities), potentials, config, grid, pool):
                rows.append(row)
                print(row, file=sys.stderr, flush=True)
                keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _potential(method: str) -> PotentialFn:
    found = solve_potential if method == "solver" else network(method)
    if isinstance(found, str):
        raise ValueError(f"{method}: {found}; `maxjax train` makes some")
    return found


def _rows(
    name: str,
    drawn: Iterator[tuple[Task, bool]],
    potentials: dict[str, PotentialFn],
    config: Config,
    grid: maxjax.Grid,
    pool: multiprocessing.pool.Pool,
) -> Iterator[Row]:
    tallies = {method: _Tally() for method in potentials}
    joins: list[bool] = []
    judged = []
    drawn = itertools.islice(drawn, config.problems)
    while chunk := list(itertools.islice(drawn, config.batch)):
        tasks = [task for task, _ in chunk]
        batch = dilated(joined(tasks))
        for place, (method, potential) in enumerate(potentials.items()):
            plans = batch.measured(plan_task(batch.task, FieldPlanner(potential, name=method)))
            tally = tallies[method]
            tally.compile_s += sum(plan.timings["compile"] for plan in plans)
            tally.seconds += sum(plan.timings["total"] for plan in plans)
            tally.plans += [
                dataclasses.replace(plan, path=plan.path[:0], clearance_at=plan.clearance_at[:0]) for plan in plans
            ]
            if place == 0:
                for k, plan in enumerate(plans):
                    if (len(joins) + k) % config.measured == 0 and plan.status == maxjax.Status.OK:
                        judged.append((len(joins) + k, pool.apply_async(judge, (case_of(tasks[k], plan),))))
        joins += [possible for _, possible in chunk]
        print(f"{name}: {len(joins)} of {config.problems}", file=sys.stderr, flush=True)
    verdicts = {k: verdict.get() for k, verdict in judged}
    geodesics = {k: verdict.geodesic * grid.spacing for k, verdict in verdicts.items() if np.isfinite(verdict.geodesic)}
    first = next(iter(tallies.values())).plans
    for place, (method, tally) in enumerate(tallies.items()):
        unsafe = {} if place else {"unsafe": sum(verdict.unsafe for verdict in verdicts.values())}
        yield {"map": name, "method": method, **_figures(tally, first, joins, geodesics), **unsafe}


def _figures(tally: _Tally, first: Sequence[Plan], joins: Sequence[bool], geodesics: dict[int, float]) -> Row:
    """Figures of a method's plans; lengths over those of the first method and over geodesics, problem by problem."""
    plans = tally.plans
    own = [p for p in plans if p.status == maxjax.Status.OK]
    pairs = [p.length / q.length for p, q in zip(plans, first, strict=True) if p.status == q.status == maxjax.Status.OK]
    ways = [plans[k].length / way for k, way in geodesics.items() if plans[k].status == maxjax.Status.OK]

    def mean(values: Sequence[float], digits: int) -> float | None:
        return round(float(np.mean(values)), digits) if values else None

    return {
        "problems": len(plans),
        "solvable": sum(joins),
        "ok": len(own),
        "certified": sum(p.certified for p in own),
        "proved_unsolvable": sum(p.status == maxjax.Status.NO_VALID_PATH for p in plans),
        "failures": failures(plans),
        "length_m": mean([p.length for p in own], 2),
        "over_first": mean(pairs, 4),
        "over_geodesic": mean(ways, 4),
        "measured": len(ways),
        "clearance_m": mean([p.clearance for p in own], 2),
        "ms_a_plan": round(1e3 * tally.seconds / len(plans), 2),
        "compile_s": round(tally.compile_s, 1),
    }


def section(document: Document) -> str:
    """RESULTS.md: one line a map and method, and what is without a path."""
    rows, config = document["rows"], document["config"]
    one = len(config["methods"]) == 1

    def ratio(value: float | None) -> str:
        return "–" if value is None else f"{value:.3f}"

    lines = [
        [
            row["map"],
            row["method"],
            f"{row['problems']:,}",
            f"{row['solvable']:,}",
            f"{row['ok']:,}",
            f"{row['certified']:,}",
            f"{row['proved_unsolvable']:,}",
            ratio(row["over_geodesic"]),
            *([] if one else [ratio(row["over_first"])]),
            "–" if row["clearance_m"] is None else f"{row['clearance_m']:.2f}",
            "–" if row["ms_a_plan"] is None else number(row["ms_a_plan"]),
        ]
        for row in rows
    ]
    heads = ["map", "method", "problems", "solvable", "OK", "certified", "proved unsolvable", "length / geodesic"]
    heads += [] if one else [f"length / {config['methods'][0]}'s"]
    heads += ["clearance [m]", "ms a plan"]
    missing = [f"- {row['map']}, {row['method']}: {row['failures']}\n" for row in rows if row["failures"]]
    judged, unsafe = (sum(row[key] for row in rows if "unsafe" in row) for key in ("measured", "unsafe"))
    title = "Offline, by the thousand" if one else "Plans by network, by the thousand"
    return (
        f"### {title} ({device(document)})\n\n"
        "Solvable by SciPy's labels. Lengths over the eikonal geodesic of the dilated grid, over every\n"
        f"{config['measured']}th problem. `alone`: nothing but the network's own field is climbed; otherwise positive\n"
        f"sweeps certify it first. Batches of {config['batch']}, compilation apart.\n\n"
        + table(heads, lines, left=2)
        + f"\nOf {judged} paths of the {config['methods'][0]} that an independent judge sampled densely, {unsafe} "
        "were unsafe.\n" + ("\nWithout a path:\n\n" + "".join(missing) if missing else "")
    )


if __name__ == "__main__":
    main(configured(TINY))
