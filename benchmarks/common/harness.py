"""Timing and saving, the same way for every benchmark.

    compile_s = first call - median of the later calls

Every call is timed until its result is ready on the device. A result file carries what is needed to run it
again: command, configuration, commit, versions and device; never a path of the machine it ran on.
"""

from __future__ import annotations

import dataclasses
import datetime
import importlib
import json
import os
import shlex
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
from rich.console import Console
from rich.table import Table

from maxjax.core.files import atomic_write
from maxjax.core.provenance import device, versions

RESULTS = Path(__file__).parents[1] / "results"
# Columns that a terminal still shows side by side.
_WIDEST = 12

# Typed here, because JAX leaves it untyped.
_ready: Callable[[object], object] = jax.block_until_ready

Row = Mapping[str, str | int | float | bool | None]


@dataclasses.dataclass(frozen=True)
class Timing:
    """Run times of n calls after the first, and what the first took beyond them [s]."""

    compile_s: float
    median_s: float
    min_s: float
    max_s: float
    n: int


def measure(fn: Callable[[], Any], n: int) -> Timing:
    """Time `fn`, whose result JAX can wait for (arrays, pytrees of them), once and then n times.

    Raises:
        ValueError: if n is less than 1.
    """
    if n < 1:
        raise ValueError(f"n: expected at least 1 timed call, given {n}")

    def call() -> float:
        start = time.perf_counter()
        _ready(fn())
        return time.perf_counter() - start

    first = call()
    times = [call() for _ in range(n)]
    median = statistics.median(times)
    return Timing(max(first - median, 0.0), median, min(times), max(times), n)


def timing_of(seconds: Sequence[float]) -> Timing:
    """The timing of calls that were timed one by one, after a warm-up [s]."""
    return Timing(0.0, statistics.median(seconds), min(seconds), max(seconds), len(seconds))


def timed_row(what: str, timing: Timing, scenes: int = 1, **more: str | float | bool | None) -> dict[str, Any]:
    """A row of run times, in milliseconds a scene.

    Args:
        what: is timed; the row's name.
        timing: of calls.
        scenes: a call.
        more: cells of the row.
    """

    def milliseconds(seconds: float) -> float:
        return float(f"{1e3 * seconds / scenes:.4g}")

    return {
        "what": what,
        "unit": "ms" if scenes == 1 else "ms a scene",
        "median": milliseconds(timing.median_s),
        "min": milliseconds(timing.min_s),
        "max": milliseconds(timing.max_s),
        "n": timing.n,
        **more,
    }


def left_out(what: str, why: str) -> Row:
    """The row of what was not measured."""
    return {"what": what, "note": f"left out: {why}"}


def package(name: str) -> ModuleType | None:
    """An optional package; None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def provenance() -> dict[str, Any]:
    """What a figure's reader needs to judge and repeat it."""
    # A copy of the tree without its history is told what it is; whether it was changed is then not known.
    told = os.environ.get("MAXJAX_COMMIT")
    commit = told or _git("rev-parse", "HEAD")
    # Results are no sources: a run that keeps them as it goes changes none.
    sources = (":/", *(f":(exclude,top){room}/results" for room in ("benchmarks", "experiments")))
    status = None if told or commit is None else _git("status", "--porcelain", "--", *sources)
    return {
        "command": _command(),
        "commit": commit,
        "dirty": None if status is None else bool(status),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "device": device(),
        "cpus": _cores(),
    }


def _cores() -> int | None:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def save(name: str, config: Any, rows: Sequence[Row], folder: Path = RESULTS) -> Path:
    """`keep`, and print the rows as a table."""
    path = keep(name, config, rows, folder)
    show(name, rows)
    return path


def keep(name: str, config: Any, rows: Sequence[Row], folder: Path = RESULTS) -> Path:
    """Write FOLDER/NAME.json whole or not at all; a long run does so after each row.

    Args:
        name: of the benchmark.
        config: its dataclass of settings; paths in it are left out: they are the machine's, not the result's.
        rows: one mapping a line of the table; finite numbers only.
        folder: where to; created if missing.

    Raises:
        ValueError: for a number that is not finite.
    """
    document = {
        "name": name,
        "config": _settings(config),
        "provenance": provenance(),
        "rows": [dict(row) for row in rows],
    }
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    atomic_write(path, text)
    return path


def begun(name: str, config: Any, folder: Path = RESULTS) -> list[Row]:
    """The rows that an earlier run kept, for one that goes on; none unless settings and commit are the same."""
    path = folder / f"{name}.json"
    if not path.is_file():
        return []
    document, now = json.loads(path.read_text(encoding="utf-8")), provenance()
    same = all(document["provenance"][key] == now[key] for key in ("commit", "dirty", "versions", "device", "cpus"))
    settings = json.loads(json.dumps(_settings(config)))
    return document["rows"] if same and not now["dirty"] and document["config"] == settings else []


def _settings(config: Any) -> dict[str, Any]:
    """What of a dataclass is written down."""
    return {key: value for key, value in dataclasses.asdict(config).items() if not _holds_paths(value)}


def _holds_paths(value: Any) -> bool:
    return isinstance(value, Path) or (isinstance(value, tuple) and any(isinstance(item, Path) for item in value))


def _command() -> str:
    """The command line without interpreter path, output folder and other paths of this machine."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    program = f"-m {spec.name.removesuffix('.__main__')}" if spec else Path(sys.argv[0]).name
    arguments: list[str] = []
    skip = False
    for argument in sys.argv[1:]:
        if not skip and not argument.startswith("--out="):
            skip = argument == "--out"
            if not skip:
                arguments.append(shlex.quote(Path(argument).name if Path(argument).is_absolute() else argument))
        else:
            skip = False
    return " ".join(["python", program, *arguments])


def _git(*arguments: str) -> str | None:
    """Output of git in this repository; None outside one."""
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def show(name: str, rows: Sequence[Row]) -> None:
    """Print rows as a table, on its side where that is narrower."""
    table = Table(title=name)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    if len(columns) > _WIDEST > len(rows):  # on its side
        for heading in ("", *(str(row.get(columns[0], "")) for row in rows)):
            table.add_column(heading)
        for column in columns[1:]:
            table.add_row(column, *(_cell(row.get(column)) for row in rows))
    else:
        for column in columns:
            table.add_column(column)
        for row in rows:
            table.add_row(*(_cell(row.get(column)) for column in columns))
    # A pipe has no width of its own.
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
