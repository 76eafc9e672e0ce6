"""A training run as a folder: scenes drawn and labelled, weights, and the record of how they came about.

folder/NAME.npz: weights     training.json: recipe, errors, times     log.jsonl: an epoch a line     checkpoint
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
from jaxtyping import PRNGKeyArray

from maxjax.compile.lowering import target
from maxjax.core.files import atomic_write
from maxjax.core.grid import Grid
from maxjax.core.provenance import device, versions
from maxjax.nn.dataset import Chunks, Draw, Scenes, generate, usable
from maxjax.nn.model import save_model
from maxjax.nn.recipes import RECIPES, Training
from maxjax.nn.training import LOG, Run, train


@dataclasses.dataclass(frozen=True)
class SceneSet:
    """Scenes to be drawn.

    Attributes:
        draw: one scene's obstacles and goal, by key.
        key: of the set.
        count: wanted.
        grid: of the scenes.
        chunks: how many scenes are made at a time, and where they are kept.
    """

    draw: Draw
    key: PRNGKeyArray
    count: int
    grid: Grid
    chunks: Chunks

    @property
    def drawn(self) -> int:
        """Scenes to draw, some more than wanted: in a few places no goal can be reached."""
        return -(-(self.count + self.count // 16) // self.chunks.size) * self.chunks.size

    def make(self, report: Callable[[int], None]) -> tuple[Scenes, int]:
        """The first usable scenes, no more than wanted, and how many of those drawn are usable.

        Args:
            report: called with the number of scenes drawn so far, after each chunk.

        Raises:
            ValueError, OSError: as `dataset.generate` and `dataset.usable`.
        """
        found = usable(generate(self.draw, self.key, self.drawn, self.grid, self.chunks, report=report))
        return jax.tree.map(lambda leaf: leaf[: self.count], found), len(found.status)


@dataclasses.dataclass(frozen=True)
class Data:
    """Scenes of one grid, to train on and to test on."""

    scenes: Scenes
    validation: Scenes
    grid: Grid


def recipe_of(name: str, seed: int, epochs: int | None) -> Training:
    """The recipe of a name, as this machine computes it best.

    Args:
        name: of `RECIPES`.
        seed: of the weights.
        epochs: None: those of the recipe.
    """
    recipe = dataclasses.replace(RECIPES[name], seed=seed)
    if target() == "cpu":
        # XLA's gradients of convolutions are slow there, and half precision saves nothing.
        recipe = dataclasses.replace(recipe, precision="float32", by="product")
    return recipe if epochs is None else dataclasses.replace(recipe, epochs=epochs)


def train_network(
    name: str, recipe: Training, data: Data, folder: Path, report: Callable[[Mapping[str, Any], float], None]
) -> Path:
    """Train one network, or go on from its checkpoint, and leave its weights and record.

    Args:
        name: of the network's file.
        recipe: how.
        data: on what.
        folder: where; made if missing.
        report: called with each line of the log and the time that is left [s].

    Returns:
        The file of its weights.

    Raises:
        ValueError, OSError: as `training.train`.
    """
    started = time.perf_counter()
    epochs: list[int] = []

    def note(line: Mapping[str, Any]) -> None:
        epochs.append(int(line["epoch"]))
        report(line, (time.perf_counter() - started) / len(epochs) * (recipe.epochs - epochs[-1]))

    state = train(recipe, data.scenes, data.grid, Run(folder), validation=data.validation, report=note)
    lines = [json.loads(line) for line in (folder / LOG).read_text().splitlines()]
    metadata = {
        "training": dataclasses.asdict(recipe),
        "scenes": len(data.scenes.status),
        "validation_scenes": len(data.validation.status),
        "last": lines[-1],
        "seconds": round(time.perf_counter() - started, 1),
        "epochs_in_these_seconds": len(epochs),
        "versions": versions(),
        "device": device(),
    }
    path = folder / f"{name}.npz"
    save_model(path, name, state.params, metadata=metadata)
    record = json.dumps({**metadata, "epochs": lines}, indent=2, allow_nan=False)
    atomic_write(folder / "training.json", record + "\n")
    return path
