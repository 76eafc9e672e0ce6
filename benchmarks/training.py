"""Training: a pass over the scenes, on several devices of one host.

    python -m benchmarks.training --devices 1 2 4     # GPUs of one host: 3 minutes
    python -m benchmarks.training --scenes 2          # two CPU cores: 3 minutes

Rows: seconds that an epoch of 749 scenes takes (the recipe's batch, split over the devices: strong scaling), from
epochs of fewer, after compilation, and how many times faster than on the first number of devices. The scenes are a few
of `midtown`, again and again; what they hold does not matter to the time.

Expected: the H200 takes 1.5 s an epoch of `maxjax`.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import jax
import jax.numpy as jnp

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, keep, measure, save
from benchmarks.common.problems import problems
from maxjax.nn.dataset import Scenes, label
from maxjax.nn.recipes import RECIPES, Training
from maxjax.nn.training import data_mesh, epoch_program, replicate, start
from maxjax.planning.problem.problem import formulate

# Scenes of the paper's training set, and how many different ones are drawn here.
_PAPER, _DRAWN = 749, 8


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        recipes: of `nn.training`.
        devices: numbers of devices, a row each.
        scenes: of a timed epoch.
        shape: of the grid, voxels of 2 m.
        repeats: timed epochs.
        seed: of the scenes.
        out: where the JSON goes.
    """

    recipes: tuple[str, ...] = ("maxjax",)
    devices: tuple[int, ...] = (1,)
    scenes: int = 64
    shape: tuple[int, int, int] = (101, 101, 101)
    repeats: int = 3
    seed: int = 0
    out: Path = RESULTS


TINY = Config(recipes=("tiny",), devices=(1, 99), scenes=4, shape=(25, 25, 17), repeats=1)


def main(config: Config) -> list[Row]:
    """Time epochs; save and return the rows."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    scenes = _scenes(config, grid)
    rows: list[Row] = []
    for name in config.recipes:
        first: float | None = None
        for count in config.devices:
            if count > jax.device_count():
                print(f"{count} devices: there are {jax.device_count()}", file=sys.stderr)
                continue
            seconds, row = _epoch(RECIPES[name], scenes, grid, count, config.repeats)
            first = first or seconds
            rows.append({"what": f"training, {name}", **row, "speed_up": round(first / seconds, 2)})
            print(rows[-1], file=sys.stderr, flush=True)
            keep("training", config, rows, config.out)
    save("training", config, rows, config.out)
    return rows


def _scenes(config: Config, grid: maxjax.Grid) -> Scenes:
    """A few labelled problems of `midtown`, repeated."""
    labelled = jax.jit(label, static_argnames=("grid",))
    formulated = jax.jit(formulate, static_argnames=("distances", "grid"))
    each = []
    for task in problems("midtown", min(_DRAWN, config.scenes), config.seed, grid, margin=0.0):
        maps = jnp.asarray(task.barred), jnp.asarray(task.kept_off)
        found = formulated(*maps, jnp.asarray(task.ends[0]), distances=task.distances, grid=grid.local)
        each.append(labelled((found.blocked, jnp.ones(grid.shape), found.goal_index), grid))
    chosen = jnp.arange(config.scenes) % len(each)
    repeated: Scenes = jax.tree.map(lambda *leaves: jnp.stack(leaves)[chosen], *each)
    return repeated


def _epoch(training: Training, scenes: Scenes, grid: maxjax.Grid, devices: int, repeats: int) -> tuple[float, Row]:
    mesh = data_mesh(jax.devices()[:devices])
    count = len(scenes.status)
    run, on_devices = epoch_program(training, count, grid, mesh), replicate(scenes, mesh)
    # A pass consumes the state that it is given.
    states = [replicate(start(training), mesh) for _ in range(repeats + 1)]
    timing = measure(lambda: run(states.pop(), on_devices), repeats)
    share = _PAPER / count
    return share * timing.median_s, {
        "devices": devices,
        "batch": training.batch,
        "seconds_an_epoch": round(share * timing.median_s, 3),
        "min": round(share * timing.min_s, 3),
        "max": round(share * timing.max_s, 3),
        "n": timing.n,
        "compile_s": round(timing.compile_s, 1),
    }


if __name__ == "__main__":
    main(configured(TINY))
