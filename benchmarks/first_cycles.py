"""What it brings to take the first Newton cycles before any loop (`solvers.screened.Screened.first_cycles`).

    python -m benchmarks.first_cycles     # one GPU: 2 minutes

Random problems of the three maps (offline protocol, margin 8 m), from conductivity to certified potential, alone and in
a batch under `vmap`. The settings take turns in one run. On a CPU they are one program, so that nothing differs.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import tyro

import maxjax
from benchmarks.common.harness import RESULTS, Row, save
from benchmarks.common.problems import problems
from maxjax.core.status import Status
from maxjax.planning.problem import formulate
from maxjax.solvers.screened import Screened
from maxjax.worlds.scenes import MAPS


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        cycles: numbers of first cycles to compare.
        shape: of the grid, voxels of 2 m around the origin.
        maps: maps to take problems from.
        problems: problems a map.
        batch: scenes of a batch; the problems are repeated.
        repeats: timed calls of every program.
        margin: [m].
        seed: of the problems.
        out: where the JSON goes.
    """

    cycles: tuple[int, ...] = (3, 0)
    shape: tuple[int, int, int] = (101, 101, 101)
    maps: tuple[str, ...] = MAPS
    problems: int = 2
    batch: int = 64
    repeats: int = 15
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS


def main(config: Config) -> list[Row]:
    """Time solves; save and return the rows."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    sigmas, goals = _scenes(config, grid)
    repeated = jnp.arange(config.batch) % len(goals)
    batch = sigmas[repeated], goals[repeated]
    rows: list[dict[str, str | float | int]] = []
    programs: list[tuple[Callable[..., Any], list[tuple[jax.Array, jax.Array]], list[float]]] = []
    for cycles in config.cycles:
        solve = _solver(cycles)
        calls: list[tuple[str, Callable[..., Any], list[tuple[jax.Array, jax.Array]]]] = [
            ("single", jax.jit(solve), list(zip(sigmas, goals, strict=True))),
            (f"batch of {config.batch}, a scene", jax.jit(jax.vmap(solve)), [batch]),
        ]
        for what, call, arguments in calls:
            status = [jax.block_until_ready(call(*given)) for given in arguments]
            solved = sum(int(jnp.sum(each == Status.OK)) for _, each in status)
            rows.append({"what": what, "first_cycles": cycles, "unit": "ms", "solved": solved})
            programs.append((call, arguments, []))
    for _ in range(config.repeats):
        for program, arguments, seconds in programs:
            for given in arguments:
                started = time.perf_counter()
                jax.block_until_ready(program(*given))
                seconds.append((time.perf_counter() - started) / (1 if given[1].ndim == 1 else config.batch))
    for row, (_, _, seconds) in zip(rows, programs, strict=True):
        for name, figure in (("median", statistics.median(seconds)), ("min", min(seconds)), ("max", max(seconds))):
            row[name] = round(1e3 * figure, 4)
        row["n"] = len(seconds)
    save("first_cycles", config, rows, config.out)
    return list(rows)


def _scenes(config: Config, grid: maxjax.Grid) -> tuple[jax.Array, jax.Array]:
    """Conductivities and goals of the problems."""
    sigmas, goals = [], []
    for name in config.maps:
        for task in problems(name, config.problems, config.seed, grid, config.margin):
            problem = formulate(
                jnp.asarray(task.barred), jnp.asarray(task.kept_off), jnp.asarray(task.ends[0]), task.distances, grid
            )
            sigmas.append(maxjax.conductivity(problem.blocked, problem.goal_index, grid))
            goals.append(problem.goal_index)
    return jnp.stack(sigmas), jnp.stack(goals)


def _solver(cycles: int) -> Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]:
    def solve(sigma: jax.Array, goal: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = maxjax.solve_potential(sigma, goal, setting=Screened(first_cycles=cycles))
        return found.log_phi, found.status

    return solve


if __name__ == "__main__":
    main(tyro.cli(Config))
