"""What a verdict on a path takes: the plain verifier and the compiled one, alone and in batches.

    python -m benchmarks.verifier                 # two CPU cores: 2 minutes

Verified are the paths of `plan_batch` for random problems of two cities a map (offline protocol, 101³ voxels of 2 m,
margin 8 m, radius 1 m), each in a map of its own. `one` rows: a path at a time, `batch` rows: all of them in parts of
so many; milliseconds a path, without planning. In the same run the verdicts of both are compared: `differ` counts the
paths of which a field differs, points that are equally near left out.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, left_out, save, timed_row, timing_of
from benchmarks.common.problems import joined, problems
from maxjax.compile import native
from maxjax.compile.threads import concurrently
from maxjax.sim.worlds.scenes import MAPS
from maxjax.verification.asked import Asked
from maxjax.verification.compiled import SOURCE, compiled_verdicts
from maxjax.verification.polylines import Paths
from maxjax.verification.verdicts import Verdicts
from maxjax.verification.verifier import plain_verdicts

Judge = Callable[[Asked], Verdicts]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: maps to take problems from.
        problems: problems a map.
        copies: how often each path stands in a batch.
        together: paths of a part of a batch, which a thread takes.
        shape: of the maps; voxels of 2 m around the origin.
        repeats: timed calls.
        margin: [m].
        seed: of the problems.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = MAPS
    problems: int = 20
    copies: int = 8
    together: int = 32
    shape: tuple[int, int, int] = (101, 101, 101)
    repeats: int = 7
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS


TINY = Config(maps=("suburb",), problems=2, copies=2, together=3, shape=(51, 51, 33), repeats=1)


def main(config: Config) -> list[Row]:
    """Time verdicts; save and return the rows."""
    asked = _questions(config)
    one = [_some(asked, slice(k, k + 1)) for k in range(len(asked.paths) // config.copies)]
    parts = [_some(asked, slice(k, k + config.together)) for k in range(0, len(asked.paths), config.together)]
    rows: list[Row] = [
        _row("plain, one", plain_verdicts, one, config),
        _row("plain, batch", plain_verdicts, parts, config),
    ]
    if native.available(SOURCE):
        library = native.library(SOURCE)

        def judge(question: Asked) -> Verdicts:
            return compiled_verdicts(question, library)

        differ = _differing(plain_verdicts(asked), judge(asked))
        rows += [_row("compiled, one", judge, one, config), _row("compiled, batch", judge, parts, config)]
        cores = os.cpu_count() or 1
        rows.append({**_row(f"compiled, batch on {cores} cores", judge, parts, config, cores), "differ": differ})
    else:
        rows.append(left_out("compiled", "no C++ compiler"))
    save("verifier", config, rows, config.out)
    return rows


def _questions(config: Config) -> Asked:
    """The paths of solved problems, several times over."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    drawn = [problems(name, config.problems, config.seed, grid, config.margin) for name in config.maps]
    task = joined([one for some in drawn for one in some])
    plans = maxjax.plan_batch(task.map, task.starts, task.goals, distances=task.distances)
    solved = np.tile(np.flatnonzero(plans.ok), config.copies)
    paths = Paths(plans.points[solved], plans.counts[solved], solved)
    return Asked.of(paths, task.map, task.distances.radius, plans.exemptions[solved], None)


def _some(asked: Asked, rows: slice) -> Asked:
    return dataclasses.replace(asked, paths=asked.paths.some(rows), exemptions=asked.exemptions[rows])


def _row(what: str, judge: Judge, parts: list[Asked], config: Config, threads: int = 1) -> Row:
    """The row of so many threads that judge parts of paths."""

    def seconds() -> float:
        start = time.perf_counter()
        if threads == 1:
            for part in parts:
                judge(part)
        else:
            list(concurrently(judge, parts, threads))
        return time.perf_counter() - start

    seconds()
    count = sum(len(part.paths) for part in parts)
    row = timed_row(what, timing_of([seconds() for _ in range(config.repeats)]), count)
    return {**row, "unit": "ms a path", "paths": count}


def _differing(first: Verdicts, second: Verdicts) -> int:
    """Of how many paths a field differs."""
    differ = np.zeros(len(first), bool)
    for name in (field.name for field in dataclasses.fields(Verdicts) if "nearest" not in field.name):
        a, b = (getattr(verdicts, name).reshape(len(first), -1) for verdicts in (first, second))
        differ |= ~((a == b) | (np.isnan(a) & np.isnan(b))).all(axis=1)
    return int(differ.sum())


if __name__ == "__main__":
    main(configured(TINY))
