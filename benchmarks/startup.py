"""How long a command takes in a process of its own, with and without executables on disk (`compile.executable`).

    python -m benchmarks.startup     # two CPU cores: 10 minutes

Each row is timed from the start of the process to its end. `first` has an empty cache folder, `second` the one that the
first left; seconds of the CPU, of all threads, stand beside those of the clock: they depend less on what else the
machine does.

`program` rows: the whole program of one window, from its message to its route, as a device runs it: how many equations
JAX traces for this platform, and what it takes to trace, lower and compile them.
"""

from __future__ import annotations

import dataclasses
import functools
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
from typing import Any

import jax

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, save
from maxjax.compile.cache import VARIABLE
from maxjax.compile.lowering import lowering_for, target
from maxjax.core.grid import Index3
from maxjax.planning.problem.surroundings import halo_of
from maxjax.planning.run import pipeline
from maxjax.planning.windows.focus_window import SHAPES

_MODULE = ("-m", "maxjax")
# What the processes must not take over from this one: caches of JAX's, and the level of its logs.
_NOT_PASSED = ("JAX_", "TF_CPP_", "XLA_")


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        commands: of `plan`, `demo` and `fly`, those to time with an empty and a filled cache.
        windows: how many of the smallest sizes of windows to compile the program of.
        map: of the plan.
        start, goal: of the plan [m].
        repeats: processes a row, but one with an empty cache.
        out: where the JSON goes.
    """

    commands: tuple[str, ...] = ("plan", "demo", "fly")
    windows: int = 3
    map: str = "downtown:0"
    start: tuple[float, float, float] = (-40.0, 0.0, 9.0)
    goal: tuple[float, float, float] = (40.0, 10.0, 9.0)
    repeats: int = 3
    out: Path = RESULTS


TINY = Config(commands=(), windows=1, repeats=2)


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
    rows += [_program(shape) for shape in SHAPES[: config.windows]]
    save("startup", config, rows, config.out)
    return rows


def _program(shape: Index3) -> Row:
    """The program of a window of this shape."""
    distances, grid = maxjax.Distances(), maxjax.Grid(shape, 2.0, (0.0, 0.0, 0.0))
    layout = pipeline.Layout(distances, grid, halo_of(distances, grid), priced=False)
    started = time.perf_counter()
    with lowering_for(target()):
        traced = jax.jit(functools.partial(pipeline.answer, layout=layout, planner=maxjax.Field())).trace(
            pipeline.part_shapes(layout)
        )
        traced.lower().compile()
    seconds = round(time.perf_counter() - started, 3)
    what = f"program of a window of {' x '.join(map(str, shape))}"
    return {"what": what, "unit": "s", "median": seconds, "n": 1, "equations": equations(traced.jaxpr.jaxpr)}


def equations(jaxpr: Any) -> int:
    """How many a program has, those of its loops and branches counted once."""
    inner = (value for equation in jaxpr.eqns for value in jax.tree.leaves(list(equation.params.values())))
    return len(jaxpr.eqns) + sum(equations(getattr(one, "jaxpr", one)) for one in inner if _is_program(one))


def _is_program(value: Any) -> bool:
    return hasattr(getattr(value, "jaxpr", value), "eqns")


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
    main(configured(TINY))
