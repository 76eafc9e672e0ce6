"""Draw scans of `midtown`, and train the completion network on them; resumable.

    python -m experiments.completion.train --record       two cores: 50 minutes

    folder/scenes-*.npz: scans by city      folder/checkpoint.json, state-*.npz      folder/log.jsonl: an epoch a line

Everything random is a function of (seed, epoch, step). A run that was ended goes on from the last city that was drawn,
and from the last epoch.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, UInt8

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from experiments.completion import network as net
from experiments.completion.network import TINY_NETWORK
from experiments.completion.scenes import draw_scene
from maxjax.compile.threads import concurrently
from maxjax.core.files import atomic_write, read_text
from maxjax.core.serialization import load_pytree, save_pytree
from maxjax.nn import optimizer
from maxjax.nn.checkpoint import load_checkpoint, load_metadata, save_checkpoint
from maxjax.nn.completion import GRID, NETWORK, CompletionNet, Params, init_completion, save_completion
from maxjax.nn.optimizer import AdamW, Moments

RESULTS = Path(__file__).parents[1] / "results"
LOG = "log.jsonl"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        folder: of scans, checkpoint and log, from which an ended run goes on.
        map: to train on.
        cities, places: scans are drawn from so many cities and so many places in each.
        epochs: passes over the scans.
        batch: scans a step.
        rate: peak learning rate.
        seed: of everything.
        tiny: a network that trains in seconds, to see that it works.
        weights: file that the weights are written to at the end, as those that come with maxjax are; None: none.
        out: where the JSON of the losses goes.
    """

    folder: Path = Path("build/completion")
    map: str = "midtown"
    cities: int = 300
    places: int = 6
    epochs: int = 12
    batch: int = 8
    rate: float = 1e-3
    seed: int = 0
    tiny: bool = False
    weights: Path | None = None
    out: Path = RESULTS

    @property
    def network(self) -> CompletionNet:
        """The architecture."""
        return TINY_NETWORK if self.tiny else NETWORK

    @property
    def identity(self) -> dict[str, Any]:
        """What a checkpoint must be of."""
        stated = {
            name: value for name, value in dataclasses.asdict(self).items() if name not in ("folder", "weights", "out")
        }
        found: dict[str, Any] = json.loads(json.dumps(stated))
        return found


TINY = Config(Path("build/tiny/completion"), cities=1, places=2, epochs=2, batch=2, tiny=True)

State = tuple[Params, Moments]


def main(config: Config) -> list[Row]:
    """Train, or go on; save and return the loss of each epoch.

    Raises:
        ValueError: for a checkpoint of other settings, or a loss that is not finite.
    """
    scans = draw(config)
    state, done = _resumed(config)
    steps = -(-len(scans) // config.batch)
    step = step_program(config, len(scans))
    given = jnp.asarray(scans)
    log = config.folder / LOG
    lines = (read_text(log).decode().splitlines() if log.exists() else [])[:done]
    for number in range(done, config.epochs):
        started = time.perf_counter()
        losses = []
        for _ in range(steps):
            state, value = step(state, given)
            losses.append(value)
        mean = float(np.mean(losses))
        if not np.isfinite(mean):
            raise ValueError(f"loss: not finite in epoch {number + 1}; the checkpoint before is kept; lower the rate")
        lines.append(
            json.dumps({"epoch": number + 1, "loss": mean, "seconds": round(time.perf_counter() - started, 2)})
        )
        save_checkpoint(config.folder, state, (number + 1) * steps, config.identity)
        atomic_write(log, "".join(line + "\n" for line in lines))
        print(lines[-1], file=sys.stderr, flush=True)
    rows: list[Row] = [json.loads(line) for line in lines]
    if config.weights is not None:
        save_completion(state[0], config.weights)
    save("completion_training", config, rows, config.out)
    return rows


def draw(config: Config) -> UInt8[np.ndarray, "n nx ny nz"]:
    """The scans, those that the folder holds and those that it lacks, which it holds afterwards."""
    config.folder.mkdir(parents=True, exist_ok=True)

    def of_city(city: int) -> UInt8[np.ndarray, "places nx ny nz"]:
        path = config.folder / f"scenes-{config.map}-{config.seed}-{city:05d}-{config.places}.npz"
        shape = jax.ShapeDtypeStruct((config.places, *GRID.shape), np.uint8)
        if path.exists():
            return np.asarray(load_pytree(path, {"scans": shape})["scans"])
        scans = np.stack([draw_scene(config.map, config.seed, city, place) for place in range(config.places)])
        save_pytree(path, {"scans": scans})
        return scans

    found = []
    for scans in concurrently(of_city, range(config.cities), os.cpu_count() or 1):
        found.append(scans)
        if len(found) % 50 == 0:
            print(f"{len(found)} of {config.cities} cities", file=sys.stderr, flush=True)
    return np.concatenate(found)


@functools.lru_cache(maxsize=2)
def step_program(config: Config, count: int) -> Callable[[State, Array], tuple[State, Array]]:
    """One step as a jitted function (state, scans) ↦ (state, loss); the state given is consumed.

    Not a scan over steps: XLA's convolutions on a CPU take 40 times as long inside a loop.
    """
    steps, network = -(-count // config.batch), config.network
    settings = AdamW(config.rate, steps * config.epochs, warmup=min(200, steps))

    def step(state: State, scans: Array) -> tuple[State, Array]:
        params, moments = state
        epoch, place = jnp.divmod(moments.step, steps)
        order, turns = jax.random.split(jax.random.fold_in(jax.random.key(config.seed + 1), epoch))
        shuffled = jnp.resize(jax.random.permutation(order, count), (steps, config.batch))
        keys = jax.random.split(jax.random.fold_in(turns, place), config.batch)
        batch = jax.vmap(net.turn)(scans[shuffled[place]], keys)
        value, slope = jax.value_and_grad(net.loss)(params, batch, network)
        return optimizer.update(settings, params, moments, slope), value

    program: Callable[[State, Array], tuple[State, Array]] = jax.jit(step, donate_argnums=0)
    return program


def load(folder: Path) -> tuple[Params, CompletionNet]:
    """The weights of a folder, and their network.

    Raises:
        ValueError: if there are none.
    """
    found = load_metadata(folder)
    if found is None:
        raise ValueError(f"{folder}: expected the folder of a training run, found no checkpoint; run `train` first")
    config = Config(**{**found, "folder": folder})
    return load_checkpoint(folder, _first(config))[0], config.network


def _first(config: Config) -> State:
    params = init_completion(config.network, jax.random.key(config.seed))
    return params, optimizer.init_moments(params)


def _resumed(config: Config) -> tuple[State, int]:
    """The state to go on from, and the epochs that are done."""
    found = load_metadata(config.folder)
    if found is None:
        return _first(config), 0
    if found != config.identity:
        raise ValueError(
            f"{config.folder}: its checkpoint is of {found}, asked for is {config.identity}; choose another folder"
        )
    state: State = load_checkpoint(config.folder, _first(config))
    steps = -(-config.cities * config.places // config.batch)
    return state, int(state[1].step) // steps


if __name__ == "__main__":
    main(configured(TINY))
