"""How long a command takes in a process of its own, with and without executables on disk (`programs.executable`).

    python -m benchmarks.startup     # two CPU cores: 10 minutes

Each row is timed from the start of the process to its end. `first` has an empty cache folder, `second` the one that the
first left; seconds of the CPU, of all threads, stand beside those of the clock: they depend less on what else the
machine does.
"""

from __future__ import annotations

import dataclasses
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import tyro

from benchmarks.common.harness import RESULTS, Row, save
from maxjax.programs.cache import VARIABLE

_MODULE = ("-m", "maxjax")
# What the processes must not take over from this one: caches of JAX's, and the level of its logs.
_NOT_PASSED = ("JAX_", "TF_CPP_", "XLA_")


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        commands: of `plan`, `demo` and `fly`, those to time with an empty and a filled cache.
        map: of the plan.
        start, goal: of the plan [m].
        repeats: processes a row, but one with an empty cache.
        out: where the JSON goes.
    """

    commands: tuple[str, ...] = ("plan", "demo", "fly")
    map: str = "downtown:0"
    start: tuple[float, float, float] = (-40.0, 0.0, 9.0)
    goal: tuple[float, float, float] = (40.0, 10.0, 9.0)
    repeats: int = 3
    out: Path = RESULTS


@dataclasses.dataclass(frozen=True)
class Spent:
    """What one process took.

    Attributes:
        clock: [s].
        cpu: of all its threads [s].
        output: its stdout.
    """

    clock: float
    cpu: float
    output: str


def main(config: Config) -> list[Row]:
    """Time processes; save and return the rows."""
    with tempfile.TemporaryDirectory() as folder:
        cache, out = Path(folder) / "cache", Path(folder) / "out"
        rows = [
            _row("import maxjax", [_run(("-c", "import maxjax"), cache) for _ in range(config.repeats)]),
            _row("import maxjax, and its names", [_run(("-c", _NAMES), cache) for _ in range(config.repeats)]),
            _row("maxjax --help", [_run((*_MODULE, "--help"), cache) for _ in range(config.repeats)]),
        ]
        for name in config.commands:
            arguments = (*_MODULE, *_arguments(name, config, out))
            own = cache / name  # an empty one
            rows.append(_row(f"maxjax {name}: first", [_run(arguments, own)]))
            later = [_run(arguments, own) for _ in range(config.repeats)]
            rows.append(_row(f"maxjax {name}: second", later))
            if name == "plan":
                rows += _stages(later[-1].output)
    save("startup", config, rows, config.out)
    return rows


_NAMES = "import maxjax\nfor name in maxjax.__all__: getattr(maxjax, name)"


def _arguments(name: str, config: Config, out: Path) -> tuple[str, ...]:
    given = {
        "plan": (config.map, "--start", *map(str, config.start), "--goal", *map(str, config.goal), "--json"),
        "demo": ("--out", str(out)),
        "fly": (config.map.partition(":")[0], "--trials", "1", "--json"),
    }
    return (name, *given[name])


def _run(arguments: tuple[str, ...], cache: Path) -> Spent:
    """A process of its own, waited for."""
    here = {name: value for name, value in os.environ.items() if not name.startswith(_NOT_PASSED)}
    here |= {VARIABLE: str(cache), "JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS", "cpu")}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True, env=here)
    clock, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(clock, cpu, done.stdout)


def _row(what: str, spent: Sequence[Spent]) -> Row:
    clocks = [one.clock for one in spent]
    return {
        "what": what,
        "unit": "s",
        "median": round(statistics.median(clocks), 3),
        "min": round(min(clocks), 3),
        "max": round(max(clocks), 3),
        "cpu": round(statistics.median(one.cpu for one in spent), 3),
        "n": len(spent),
    }


def _stages(output: str) -> list[Row]:
    """Of a second plan: reading its programs, and running them."""
    timings = json.loads(output)["timings"]
    return [
        {"what": f"maxjax plan: second, {what}", "unit": "s", "median": round(timings[name], 3), "n": 1}
        for what, name in (("programs read", "compile"), ("planning", "total"))
    ]


if __name__ == "__main__":
    main(tyro.cli(Config))
