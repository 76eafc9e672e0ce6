"""The measured part of the README, written from the result files and from nothing else.

    python -m benchmarks.readme

rewrites what stands between `<!-- measured -->` and `<!-- /measured -->`. A test compares both, so that no figure there
can differ from the run that it names.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.markdown import device, number, sources, table
from experiments import random_problems, warframe_crops

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
BEGIN, END = "<!-- measured -->\n", "<!-- /measured -->\n"

# File: the command that writes it, for the reader of the message that it is missing.
_FILES = {
    "benchmarks/results/plan.json": "python -m benchmarks.plan",
    "benchmarks/results/plan_h200.json": "python -m benchmarks.plan",
    "benchmarks/results/potential.json": "python -m benchmarks.potential",
    "benchmarks/results/potential_h200.json": "python -m benchmarks.potential",
    "benchmarks/results/lidar.json": "python -m benchmarks.lidar",
    "benchmarks/results/lidar_h200.json": "python -m benchmarks.lidar",
    "experiments/results/random_problems.json": "python -m experiments.random_problems",
    "experiments/results/warframe_crops.json": "python -m experiments.warframe_crops",
}
_STAGES = {
    "dilate": "dilate, choose the margin",
    "solve": "solve, certify",
    "ascend": "ascend",
    "tighten": "tighten",
    "verify": "verify",
}

Row = dict[str, Any]


def block(root: Path = ROOT) -> str:
    """The text between the markers.

    Raises:
        FileNotFoundError: if a result file is missing; names the command that writes it.
    """
    found: dict[str, Row] = {}
    for name, command in _FILES.items():
        if not (root / name).is_file():
            raise FileNotFoundError(f"{name} is missing; run: {command}")
        found[name] = json.loads((root / name).read_text(encoding="utf-8"))
    plan, plan_gpu, potential, potential_gpu, lidar, lidar_gpu, problems, crops = found.values()
    parts = [
        _plans(plan, plan_gpu),
        _solves(potential, potential_gpu),
        random_problems.section(problems),
        warframe_crops.section(crops),
    ]
    return "\n".join([*parts, _lidar(lidar, lidar_gpu), "### Where these figures come from\n\n" + sources(found)])


def rewritten(text: str, measured: str) -> str:
    """The README's text with its measured part replaced.

    Raises:
        ValueError: unless both markers are there, once and in order.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end) or BEGIN in rest or END in after:
        raise ValueError(f"README.md: expected one {BEGIN.strip()} and, after it, one {END.strip()}")
    return before + BEGIN + measured + END + after


def _pick(document: Row, key: str, value: str) -> Row | None:
    return next((row for row in document["rows"] if row[key] == value), None)


def _cell(document: Row, what: str, key: str = "median") -> str:
    row = _pick(document, "what", what)
    return "" if row is None else number(row[key])


def _plans(*documents: Row) -> str:
    def line(label: str, what: str, key: str = "median") -> list[str]:
        return [label, *(_cell(document, what, key) for document in documents)]

    lines = [line(label, f"plan, solver: {stage}") for stage, label in _STAGES.items()]
    lines += [
        line("**whole plan**", "plan, solver: total"),
        line("whole plan, slowest", "plan, solver: total", "max"),
        line("compilation, once [s]", "plan, solver: total", "compile_s"),
        line("A\\*: search", "plan, astar: search"),
        line("**A\\*: whole plan**", "plan, astar: total"),
    ]
    totals = [row for d in documents if (row := _pick(d, "what", "plan, solver: total"))]
    solved = " and ".join(f"{row['solved']} of {row['n']}" for row in totals)
    batches = [
        f"{row['what'].removesuffix(': a plan').capitalize()}, {device(document)}: "
        f"{row['plans_per_second']:,.0f} plans a second."
        for document in documents
        for row in document["rows"]
        if "plans_per_second" in row
    ]
    memory = _cell(documents[0], "peak memory of a process that plans once")
    return (
        "### A plan, stage by stage\n\n"
        "Random problems on the three maps, 101³ voxels, margin asked 8 m: median [ms], compilation apart. Each stage\n"
        f"has its own median. Solved: {solved} problems. A process that plans once peaks at {memory} MB.\n\n"
        + table(["", *map(device, documents)], lines)
        + "".join(f"\n{batch}\n" for batch in batches)
    )


# Rows of `solve, MAP: …`, and their heads.
_PEERS = {
    "SciPy CG, Jacobi, component": "SciPy",
    "SciPy CG, Jacobi, whole grid": "SciPy, whole grid",
    "PyAMG smoothed aggregation + CG, component": "PyAMG",
    "JAX, Jacobi-PCG, whole grid": "JAX",
    "CuPy CG, Jacobi, component": "CuPy",
}


def _solves(*documents: Row) -> str:
    lines = []
    for document in documents:
        for name in [*document["config"]["maps"], document["config"]["crop"]]:
            ours = _pick(document, "what", f"solve, {name}: maxjax")
            if ours is not None:
                peers = [_peer(_pick(document, "what", f"solve, {name}: {peer}"), ours) for peer in _PEERS]
                angle = f"{100 * ours['within_1deg']:.2f} %"
                lines.append([name, device(document), number(ours["median"]), *peers, angle])
    heads = ["map", "maxjax on", "maxjax", *_PEERS.values(), "within 1°"]
    return (
        "### The solve beside its peers\n\n"
        "From conductivity to certified potential, 101³ voxels: median [ms]. Peers: conjugate gradients with\n"
        "Jacobi's preconditioner by SciPy (on the free voxels of the goal's component, or on the whole grid), JAX and\n"
        "CuPy, and PyAMG's smoothed aggregation, set-up included; in brackets how many times ours. They are handed\n"
        "the assembled matrix and stopped, with hindsight, as soon as their gradient directions are as good as ours.\n"
        "Last column: voxels whose gradient of log φ from maxjax lies within 1° of a float64 reference.\n\n"
        + table(heads, lines, left=2)
    )


def _peer(row: Row | None, ours: Row) -> str:
    if row is None or "median" not in row:
        return ""
    return f"{number(row['median'])} ({number(row['times_ours'])})" + ("" if row["as_good"] else ", not as good")


def _lidar(*documents: Row) -> str:
    methods = ("fused kernel", "scan: fused kernel, noise, dropout", "vmapped mjx.ray", "C mj_multiRay")
    lines = []
    for document in documents:
        for name in document["config"]["maps"]:
            rows = {row["method"]: row for row in document["rows"] if row["map"] == name}
            off = " / ".join(str(rows[method]["rays_off_by_1mm"]) for method in (methods[0], methods[2]))
            times = [number(rows[method]["median_ms"]) for method in methods]
            lines.append([name, device(document), str(rows[methods[0]]["geoms"]), *times, off])
    rays = documents[0]["config"]["rays"]
    heads = ["map", "on", "geoms", "fused kernel", "with noise", "`mjx.ray`", "C `mj_multiRay`", "off"]
    return (
        "### LiDAR\n\n"
        f"One scan of {rays:,} rays: median [ms]. With noise: the fused kernel with range noise and dropout.\n"
        "`mjx.ray` runs under `vmap`, C MuJoCo on one thread of the machine's CPU. Off: rays of the fused kernel / of\n"
        "`mjx.ray` that differ from C `mj_ray` by more than a millimetre within range.\n\n"
        + table(heads, lines, left=2)
    )


def main() -> None:
    """Rewrite the README's measured part."""
    README.write_text(rewritten(README.read_text(encoding="utf-8"), block()), encoding="utf-8")


if __name__ == "__main__":
    main()
