"""`maxjax train`: draw scenes, label them, train networks on them."""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping
from typing import Any

import jax

from maxjax.core.grid import Grid
from maxjax.nn.dataset import Chunks, Scenes
from maxjax.nn.recipes import RECIPES
from maxjax.nn.training_run import Data, SceneSet, recipe_of, train_network
from maxjax.sim.mapping.scanned_city import TINY_GRID, ScannedCity
from maxjax.ui.cli import report
from maxjax.ui.cli.options import TrainOptions

_CHECKS, _CHUNK = 64, 16
_TINY_SCENES, _TINY_CHECKS, _TINY_CHUNK = 8, 4, 4
# Of the price on walls; a planner asks for 3.5 unless told otherwise.
_HEIGHTS = (0.0, 5.0)
# Keys of the sets, folded into that of the seed.
_TRAINING, _VALIDATION = 1, 2


def run_train(options: TrainOptions) -> int:
    """Draw, label, and train one network after the other. Returns the exit code.

    Each network has a folder of its own in OUT: NAME.npz (its weights), training.json, log.jsonl, a checkpoint.

    Raises:
        ValueError, OSError: for arguments or files that cannot be used, or a loss that is not finite.
    """
    _check(options)
    options.out.mkdir(parents=True, exist_ok=True)
    data = functools.cache(functools.partial(_data, options))
    for name in ("tiny",) if options.tiny else options.config:
        recipe = recipe_of(name, options.seed, options.epochs)
        # Networks that read the flood read prices too, and learn them; the paper's know none.
        scenes = data(_HEIGHTS if recipe.network.flood else (0.0, 0.0))
        show = functools.partial(_show_epoch, name, recipe.epochs)
        # At once, as an interruption discards what is not yet printed.
        print(train_network(name, recipe, scenes, options.out / name, show), flush=True)
    return 0


def _check(options: TrainOptions) -> None:
    unknown = [name for name in options.config if name not in RECIPES]
    if unknown or not options.config:
        raise ValueError(f"--config: expected some of {', '.join(RECIPES)}, given {', '.join(unknown) or 'none'}")
    if options.scenes < 1 or (options.epochs is not None and options.epochs < 1):
        raise ValueError(f"--scenes, --epochs: expected at least 1, given {options.scenes} and {options.epochs}")


def _data(options: TrainOptions, heights: tuple[float, float]) -> Data:
    """The scenes of both sets, with prices of some heights."""
    grid, scenes, checks, chunk = Grid(), options.scenes, _CHECKS, _CHUNK
    if options.tiny:
        grid, scenes, checks, chunk = TINY_GRID, _TINY_SCENES, _TINY_CHECKS, _TINY_CHUNK

    def made(name: str, stream: int, count: int) -> Scenes:
        started = time.perf_counter()
        key = jax.random.fold_in(jax.random.key(options.seed), stream)
        folder = None if options.cache is None else options.cache / (name if max(heights) == 0 else f"{name}-priced")
        wanted = SceneSet(ScannedCity("midtown", grid, heights), key, count, grid, Chunks(chunk, folder))
        found, usable = wanted.make(functools.partial(_show_drawn, name, count))
        report.complain(
            f"{name}: {usable} of {wanted.drawn} usable, {len(found.status)} taken, "
            f"{time.perf_counter() - started:.0f} s"
        )
        return found

    return Data(made("scenes", _TRAINING, scenes), made("validation", _VALIDATION, checks), grid)


def _show_drawn(name: str, count: int, done: int) -> None:
    if done >= count or done % (4 * _CHUNK) == 0:
        report.complain(f"{name}: {done} of {count}")


def _show_epoch(name: str, epochs: int, line: Mapping[str, Any], left: float) -> None:
    figures = ", ".join(f"{key} {value:.4g}" for key, value in line.items() if key != "epoch")
    report.complain(f"{name}, epoch {line['epoch']} of {epochs}: {figures}; {left:.0f} s left")
