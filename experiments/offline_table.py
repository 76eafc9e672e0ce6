"""Table I of the paper, offline: every planner on the same problems, grids and margins, before the same judge.

    python -m experiments.offline_table                                  # 50 problems a map; two CPU cores: 22 minutes
    python -m experiments.offline_table --own --methods solver network "network alone" astar apf

Both unseen maps, offline protocol (`experiments.random_problems`): start and goal 20 to 50 voxels apart, 3 to 15 m
high, margin 8 m or the largest that joins them. Problems that no margin solves are left out (SciPy's labels decide).
Each problem is planned by one method after the other; what takes time is the plan from map to verified path, after a
warm-up, compilation apart. `find` is the time between dilation and verification, which all methods share.

Methods: those of `maxjax.plan`, the solver on whole maps, as networks answer; `fast marching`, the travel time from the
goal by scikit-fmm (second order), climbed and tightened as ours is, so that only the field differs; and networks, where
weights exist: `network` (maxjax's, with positive sweeps until certified), `network alone`, or a name of
`maxjax.nn.architecture.CONFIGS`, alone or not.

Lengths are compared over the problems that solver and A* both solve (`shared`), and given over each method's own
successes too. `turning` is the sum of the absolute angles between consecutive segments, per metre; the paper measures
no smoothness. With `--own` the same problems are planned at the planner's own distances: in the map as it is, nothing
nearer than the radius, by a price that falls to 1 at the margin.

Expected: solver 100 % on both maps and certified, 0.91 to 0.92 of A*'s length, shorter than RRT*; fast marching at most
1 % shorter still, later and without a certificate; on CPU, A* is quicker by far; APF stalls in about every second
problem. A network that stalls does so late: its ascent is made again with up to 1,024 times as many steps.
"""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.paper import PAPER, Dilated, dilated
from benchmarks.common.problems import problems, solvable
from experiments.offline_methods import finder
from maxjax.planning.planner import Planner
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task

RESULTS = Path(__file__).parent / "results"
_NAMES = {"solver": "solver", "astar": "A*", "rrtstar": "RRT*(3k)", "apf": "APF"}
_CITY = {"downtown": "LA Night City", "suburb": "London White City"}


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        problems: a map.
        maps: nothing was ever tuned or trained on them.
        methods: planners; one that is not installed, or has no weights, is left out and named.
        shape: of the grid, voxels of 2 m around the origin.
        margin: [m].
        own: plan at radius, margin and price, instead of the paper's dilated maps.
        seed: of cities and problems.
        out: where the JSON goes.
    """

    problems: int = 50
    maps: tuple[str, ...] = ("downtown", "suburb")
    methods: tuple[str, ...] = (
        "solver",
        "network",
        "network alone",
        "paper alone",
        "paper_difference alone",
        "astar",
        "rrtstar",
        "fast marching",
        "apf",
    )
    shape: tuple[int, int, int] = (101, 101, 101)
    margin: float = 8.0
    own: bool = False
    seed: int = 0
    out: Path = RESULTS


# RRT* alone would take as long as the rest.
TINY = Config(
    problems=2,
    maps=("suburb",),
    methods=("solver", "paper alone", "astar", "fast marching", "apf"),
    shape=(51, 51, 33),
)


def main(config: Config) -> list[Row]:
    """Plan, judge, save; one row a map and method."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    finders: dict[str, Planner] = {}
    rows: list[Row] = []
    for method in config.methods:
        one = finder(method)
        if isinstance(one, str):
            rows.append({"map": "", "method": method, "left_out": one})
        else:
            finders[method] = one
    for name in config.maps:
        rows += _rows(name, finders, config, grid)
    save("offline_table_own" if config.own else "offline_table", config, rows, config.out)
    return rows


def turning(path: np.ndarray) -> float:
    """Sum of the absolute angles between consecutive segments over the length [degrees/m]."""
    moves = np.diff(path.astype(np.float64), axis=0)
    sizes = np.linalg.norm(moves, axis=1)
    moves, sizes = moves[sizes > 0], sizes[sizes > 0]
    along = moves / sizes[:, None]
    # The angle by its half: exact for small ones, where the arc cosine is not.
    apart, together = (np.linalg.norm(along[1:] + sign * along[:-1], axis=1) for sign in (-1, 1))
    return float(np.degrees(2 * np.arctan2(apart, together)).sum() / sizes.sum())


def _rows(name: str, finders: dict[str, Planner], config: Config, grid: maxjax.Grid) -> list[Row]:
    tasks: list[Task] = []
    asked = config.problems
    while len(tasks) < config.problems:
        drawn = problems(name, asked, config.seed, grid, config.margin)
        tasks = [task for task in drawn if solvable(task).all()][: config.problems]
        asked += 10

    def run(task: Dilated, method: str) -> maxjax.Plan:
        return task.measured(plan_task(task.task, finders[method]))[0]

    maps = [Dilated(task, (config.margin,), task) if config.own else dilated(task) for task in tasks]
    compile_s = {method: run(maps[0], method).timings["compile"] for method in finders}
    plans: dict[str, list[maxjax.Plan]] = {method: [] for method in finders}
    for k, task in enumerate(maps):
        for method in finders:
            plans[method].append(run(task, method))
        print(f"{name}: {k + 1} of {len(tasks)}", file=sys.stderr, flush=True)
    judges = [plans[method] for method in ("solver", "astar") if method in plans]
    shared = [all(one[k].status == maxjax.Status.OK for one in judges) for k in range(len(tasks))]
    rows: list[Row] = []
    for method in finders:
        row: dict[str, Any] = {"map": name, "method": method, "shared": sum(shared)}
        row |= _figures(plans[method], shared, plans.get("astar", plans[method]))
        rows.append(row | {"compile_s": round(compile_s[method], 2)})
    return rows


def _figures(plans: Sequence[maxjax.Plan], shared: Sequence[bool], rivals: Sequence[maxjax.Plan]) -> dict[str, Any]:
    """Figures of a method's plans; lengths also beside A*'s, problem by problem."""
    own = [p for p in plans if p.status == maxjax.Status.OK]
    both = [p for p, s in zip(plans, shared, strict=True) if s and p.status == maxjax.Status.OK]
    pairs = [
        p.length / q.length for p, q in zip(plans, rivals, strict=True) if p.status == q.status == maxjax.Status.OK
    ]
    total = np.array([p.timings["total"] for p in plans])
    apart = np.array([p.timings.get("formulate", 0.0) + p.timings.get("verify", 0.0) for p in plans])
    return {
        "problems": len(plans),
        "ok": len(own),
        "certified": sum(p.certified for p in plans),
        "failures": failures(plans),
        "shared_solved": len(both),
        "length_m": _rounded(np.mean, [p.length for p in both], 2),
        "length_std_m": _rounded(np.std, [p.length for p in both], 2),
        "over_astar": _rounded(np.mean, pairs, 4),
        "own_length_m": _rounded(np.mean, [p.length for p in own], 2),
        "own_length_std_m": _rounded(np.std, [p.length for p in own], 2),
        "clearance_m": _rounded(np.mean, [p.clearance for p in own], 2),
        "clearance_least_m": _rounded(np.min, [p.clearance for p in own], 3),
        "turning_deg_m": _rounded(np.mean, [turning(p.path) for p in own], 2),
        "ms_median": _rounded(np.median, 1e3 * total, 1),
        "ms_min": _rounded(np.min, 1e3 * total, 1),
        "ms_max": _rounded(np.max, 1e3 * total, 1),
        "find_ms_median": _rounded(np.median, 1e3 * (total - apart), 1),
    }


def failures(plans: Sequence[maxjax.Plan]) -> str:
    """How many plans ended with which status other than OK."""
    counts = Counter(p.status.name for p in plans if p.status != maxjax.Status.OK)
    return ", ".join(f"{status}: {count}" for status, count in sorted(counts.items()))


def _rounded(statistic: Any, values: Sequence[float] | np.ndarray, digits: int) -> float | None:
    return round(float(statistic(values)), digits) if len(values) else None


def section(document: dict[str, Any]) -> str:
    """RESULTS.md: the table and what follows from it."""
    rows = [row for row in document["rows"] if row["map"]]
    config, device = document["config"], document["provenance"]["device"]
    own = document["name"] == "offline_table_own"
    how = (
        "The same problems as in the paper's protocol, at the planner's own distances: in the map as it is, nothing on "
        "a path within the radius of 1 m (around an end that stands nearer, within its own distance), by a price that "
        f"falls to 1 at {config['margin']:g} m. Clearance is bought with length: A*, which pays the same price, is the "
        "measure here, not the paper's lengths."
        if own
        else "The paper has other cities; its figures stand beside ours for scale, not as the same problems."
    )
    lines = [
        f"### Table I, offline{', at our own distances and prices' * own}",
        "",
        f"{config['problems']} solvable problems a map, run on {device} ({document['provenance']['cpus']} CPU cores). "
        "Every path passed the same verification; run times are from map to verified path, compilation apart (what "
        "methods share is compiled with the first). The solver answers for the whole map here, as networks do. Lengths "
        "are means over the problems that solver and A* both solve (their number in brackets where a method solves "
        f"fewer of them), clearance and turning over a method's own successes. {how}",
        "",
        "| map | method | OK | length [m] | / A* | own length [m] | clearance [m] | least [m] | turning [°/m] "
        "| run time [ms] | min to max | find | compile [s] | paper: length [m] | paper: time [s] |",
        "|---" * 15 + "|",
    ]
    for name in config["maps"]:
        here = [row for row in rows if row["map"] == name]
        lines += [_line(row, None if own else PAPER.get(name, {}).get(row["method"])) for row in here]
        if name in PAPER and not own:
            theirs = _theirs(PAPER[name]["3DMaxConvNet"])
            lines.append(f"| {name} | 3DMaxConvNet (the paper, {_CITY[name]}) |{' – |' * 11}{theirs}")
    lines += [""] + [_summary(name, [row for row in rows if row["map"] == name], own) for name in config["maps"]]
    left = [f"{_NAMES.get(r['method'], r['method'])} ({r['left_out']})" for r in document["rows"] if not r["map"]]
    if left:
        lines += ["", f"Not measured: {', '.join(left)}."]
    return "\n".join([*lines, ""])


def _theirs(figures: tuple[float, float, float] | None) -> str:
    return " – | – |" if figures is None else f" {figures[0]} ± {figures[1]} | {figures[2]:g} |"


def _line(row: dict[str, Any], paper: tuple[float, float, float] | None) -> str:
    def number(key: str, digits: int) -> str:
        return "–" if row[key] is None else f"{row[key]:.{digits}f}"

    def mean(prefix: str) -> str:
        known = row[f"{prefix}length_m"] is not None
        return f"{number(f'{prefix}length_m', 1)} ± {number(f'{prefix}length_std_m', 1)}" if known else "–"

    fewer = "" if row["shared_solved"] == row["shared"] else f" ({row['shared_solved']} of {row['shared']})"
    cells = [
        row["map"],
        _NAMES.get(row["method"], row["method"]),
        f"{row['ok']}/{row['problems']}",
        mean("") + fewer,
        number("over_astar", 3),
        mean("own_"),
        number("clearance_m", 2),
        number("clearance_least_m", 2),
        number("turning_deg_m", 2),
        number("ms_median", 0),
        f"{number('ms_min', 0)} to {number('ms_max', 0)}",
        number("find_ms_median", 0),
        number("compile_s", 0),
    ]
    return f"| {' | '.join(cells)} |{_theirs(paper)}"


def _summary(name: str, rows: list[dict[str, Any]], own: bool) -> str:
    """Who beats the solver on a map, in what, and how ours stands to the paper's figures."""
    by = {row["method"]: row for row in rows}
    if "solver" not in by:
        return ""
    ours = by.pop("solver")
    text = f"**{name}**: the solver arrives in {ours['ok']} of {ours['problems']}, {ours['certified']} certified"
    if "astar" in by and ours["length_m"] is not None:
        text += f", at {ours['over_astar']:.3f} of A*'s length"
    text += "."
    measures = (
        ("Shorter where both solve", "length_m", 1, "{:.1f} m against {:.1f} m"),
        ("Quicker (median)", "ms_median", 1, "{:.0f} ms against {:.0f} ms"),
        ("More clearance on average", "clearance_m", -1, "{:.2f} m against {:.2f} m"),
        ("Straighter", "turning_deg_m", 1, "{:.2f} °/m against {:.2f} °/m"),
        ("More successes", "ok", -1, "{:.0f} against {:.0f}"),
    )
    for claim, key, sign, form in measures:
        better = [
            f"{_NAMES.get(method, method)} ({form.format(row[key], ours[key])})"
            for method, row in by.items()
            if None not in (row[key], ours[key])
            and sign * row[key] < sign * ours[key]
            # A mean over fewer, easier problems is no comparison.
            and (key in ("ms_median", "ok") or row["shared_solved"] == ours["shared_solved"])
        ]
        if better:
            text += f" {claim} than ours: {', '.join(better)}."
    fewer = [
        f"{_NAMES.get(method, method)} solves {row['ok']} of {row['problems']} ({row['failures']})"
        for method, row in by.items()
        if row["ok"] < row["problems"]
    ]
    if fewer:
        text += f" {'; '.join(fewer)}."
    if name in PAPER and not own:
        length, _, seconds = PAPER[name]["3DMaxConvNet"]
        text += (
            f" The paper's planner needs {1e3 * seconds:.0f} ms for {length} m in {_CITY[name]}: "
            f"{1e3 * seconds / ours['ms_median']:.2g} times the solver's run time here."
        )
    return text + "\n"


if __name__ == "__main__":
    main(configured(TINY))
