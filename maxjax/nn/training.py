"""Training: batches of labelled scenes, a loss, AdamW; whole epochs as one program.

    loss = mean over voxels of the goal's component of (e² + s |∇e|²)        e = network(x) − (y − y₀) / unit

e is the error of the log-potential y; x, y₀ and the unit are those of `nn.encoding`. s = 0 is the mean squared error
of the paper. With s > 0 the differences between neighbours count as well, which are what an ascent reads.

Everything random is a function of (seed, epoch, step): the order of the scenes, the symmetries, dropout. A run that
stopped after an epoch resumes with the same numbers. With several devices each takes its share of every batch; weights
are replicated, and XLA sums the gradients.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.core.files import atomic_write, brief, open_to_append, read_text
from maxjax.core.grid import Grid
from maxjax.fields import stencil
from maxjax.nn import optimizer
from maxjax.nn.architecture import Autoencoder
from maxjax.nn.autoencoder import Params, apply_folded, cast, fold, init_params
from maxjax.nn.checkpoint import load_checkpoint, load_metadata, save_checkpoint
from maxjax.nn.dataset import Scenes, network_inputs
from maxjax.nn.encoding import UNIT, encode
from maxjax.nn.evaluation import evaluate, summary
from maxjax.nn.optimizer import AdamW, Moments
from maxjax.nn.recipes import Training

LOG = "log.jsonl"
_CHECKPOINT_S = 60.0  # what a kill may cost of a run, beyond an epoch [s]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class TrainingState:
    """Loop carry of training: from step to step, epoch to epoch and run to run.

    Attributes:
        params: weights, float32.
        moments: of the optimiser; its step counts.
    """

    params: Params
    moments: Moments


def start(training: Training) -> TrainingState:
    """The state before the first step."""
    params = init_params(jax.random.key(training.seed), training.network)
    return TrainingState(params, optimizer.init_moments(params))


def steps_per_epoch(training: Training, scenes: int) -> int:
    """Batches in an epoch; the last one is filled up from the first."""
    return math.ceil(scenes / training.batch)


def inputs_of(network: Autoencoder, scene: Scenes, grid: Grid) -> tuple[Array, Array, Bool[Array, "nx ny nz"]]:
    """x, the network's target, and where it counts: the goal's component without the goal."""
    x, base = encode(network.start, network.flood, network_inputs(scene, grid))
    return x, (scene.target - base) / UNIT[network.start], scene.steps > 0


def loss(params: Params, training: Training, scenes: Scenes, grid: Grid, key: PRNGKeyArray | None) -> Float[Array, ""]:
    """The loss of a batch.

    Args:
        params: weights, float32.
        training: recipe; static.
        scenes: a batch.
        grid: of the scenes; static.
        key: of dropout; None: nothing is dropped.
    """
    network = training.network
    x, wanted, counts = jax.vmap(lambda scene: inputs_of(network, scene, grid))(scenes)
    predicted = apply_folded(cast(fold(params, network), training.precision), x, network, key=key, by=training.by)
    weight = counts.astype(jnp.float32)
    error = weight * (predicted - wanted)
    total = jnp.sum(error**2)
    if training.slope:
        total = total + training.slope * jnp.sum(jax.vmap(_roughness)(error, weight))
    return total / jnp.maximum(jnp.sum(weight), 1)


def _roughness(error: Float[Array, "nx ny nz"], weight: Float[Array, "nx ny nz"]) -> Float[Array, ""]:
    """Sum of the squared differences between neighbours that both count."""
    total = jnp.zeros(())
    for axis in range(3):
        step = stencil.ahead(error, axis) - error
        total = total + jnp.sum(weight * stencil.ahead(weight, axis) * step**2)
    return total


def turn(scene: Scenes, key: PRNGKeyArray) -> Scenes:
    """One of the eight symmetries of a scene about the vertical; the grid is as long as wide."""
    mirror_x, mirror_y, swap = jax.random.bernoulli(key, 0.5, (3,))
    nx = scene.blocked.shape[0]

    def volume(a: Array) -> Array:
        a = jnp.where(mirror_x, jnp.flip(a, 0), a)
        a = jnp.where(mirror_y, jnp.flip(a, 1), a)
        return jnp.where(swap, jnp.swapaxes(a, 0, 1), a)

    x, y, z = scene.goal_index
    x, y = jnp.where(mirror_x, nx - 1 - x, x), jnp.where(mirror_y, nx - 1 - y, y)
    goal = jnp.stack([jnp.where(swap, y, x), jnp.where(swap, x, y), z])
    return dataclasses.replace(
        scene,
        blocked=volume(scene.blocked),
        price=volume(scene.price),
        goal_index=goal,
        steps=volume(scene.steps),
        target=volume(scene.target),
    )


@functools.lru_cache(maxsize=4)
def epoch_program(
    training: Training, count: int, grid: Grid, mesh: Mesh
) -> Callable[[TrainingState, Scenes], tuple[TrainingState, Array]]:
    """One epoch as a jitted function (state, scenes) ↦ (state, loss of each step); the state given is consumed.

    The same function for the same arguments, so that it is compiled once.

    Args:
        training: recipe.
        count: scenes.
        grid: of the scenes.
        mesh: devices, of `data_mesh`.

    Raises:
        ValueError: for a batch that the devices cannot share evenly, or symmetries of a grid that is not square.
    """
    steps, devices = steps_per_epoch(training, count), mesh.shape["batch"]
    if training.batch % devices:
        raise ValueError(f"batch: expected a multiple of {devices} devices, given {training.batch}")
    if training.turned and grid.shape[0] != grid.shape[1]:
        raise ValueError(f"grid: expected as many voxels along x as along y, for its symmetries, given {grid.shape}")
    settings = AdamW(training.rate, steps * training.epochs, training.warmup, training.decay)
    shared = NamedSharding(mesh, PartitionSpec("batch"))

    def step(state: TrainingState, given: tuple[Array, PRNGKeyArray], scenes: Scenes) -> tuple[TrainingState, Array]:
        chosen, key = given
        batch = jax.tree.map(lambda leaf: lax.with_sharding_constraint(leaf[chosen], shared), scenes)
        dropped, turned = jax.random.split(key)
        if training.turned:
            batch = jax.vmap(turn)(batch, jax.random.split(turned, training.batch))
        value, slope = jax.value_and_grad(loss)(state.params, training, batch, grid, dropped)
        return TrainingState(*optimizer.update(settings, state.params, state.moments, slope)), value

    def epoch(state: TrainingState, scenes: Scenes) -> tuple[TrainingState, Array]:
        number = state.moments.step // steps
        order, *keys = jax.random.split(jax.random.fold_in(jax.random.key(training.seed + 1), number), steps + 1)
        chosen = jnp.resize(jax.random.permutation(order, count), (steps, training.batch))
        return lax.scan(lambda state, given: step(state, given, scenes), state, (chosen, jnp.stack(keys)))

    program: Callable[[TrainingState, Scenes], tuple[TrainingState, Array]] = jax.jit(epoch, donate_argnums=0)
    return program


def data_mesh(devices: list[jax.Device] | None = None) -> Mesh:
    """A row of devices that share each batch; by default all there are."""
    return Mesh(np.array(jax.devices() if devices is None else devices), ("batch",))


def replicate(tree: Any, mesh: Mesh) -> Any:
    """The tree on every device of the mesh."""
    return jax.device_put(tree, NamedSharding(mesh, PartitionSpec()))


@dataclasses.dataclass(frozen=True)
class Run:
    """How far to train, and what is left on disk.

    Attributes:
        folder: of the checkpoint and of log.jsonl, one line an epoch.
        epochs: where to stop; by default at the recipe's end.
        every: epochs between checkpoints; the last epoch always leaves one, and the first that ends a minute or more
            after the one before.
    """

    folder: Path
    epochs: int | None = None
    every: int = 20


def train(
    training: Training,
    scenes: Scenes,
    grid: Grid,
    run: Run,
    *,
    validation: Scenes | None = None,
    report: Callable[[Mapping[str, Any]], None] | None = None,
) -> TrainingState:
    """Train on all devices, or resume from the checkpoint in the folder; bit for bit as if it had never stopped.

    Args:
        training: recipe; a checkpoint must be of the same.
        scenes: to train on.
        grid: of the scenes.
        run: folder, epochs, checkpoints.
        validation: scenes whose errors are logged every `run.every` epochs, and at last.
        report: called with each line of the log.

    Raises:
        ValueError: for a loss that is not finite, with its epoch; for a checkpoint of another recipe, or a damaged one.
        OSError: if a file cannot be written. The last checkpoint stays in all of these cases.
    """
    folder, mesh, count = run.folder, data_mesh(), len(scenes.status)
    steps, last = steps_per_epoch(training, count), training.epochs if run.epochs is None else run.epochs
    identity = {"training": dataclasses.asdict(training), "scenes": count, "grid": dataclasses.asdict(grid)}
    state, done = _resumed(training, folder, _plain(identity), steps)
    state, scenes = replicate(state, mesh), replicate(scenes, mesh)
    program = epoch_program(training, count, grid, mesh)
    folder.mkdir(parents=True, exist_ok=True)
    _keep_lines(folder / LOG, done)
    saved_s = time.perf_counter()
    for epoch in range(done, last):
        start_s = time.perf_counter()
        state, each = program(state, scenes)
        losses = _finite(np.asarray(each), epoch)
        line = {"epoch": epoch + 1, "loss": float(losses.mean()), "seconds": round(time.perf_counter() - start_s, 3)}
        regular = (epoch + 1) % run.every == 0 or epoch + 1 == last
        if regular and validation is not None:
            folded = cast(fold(state.params, training.network), training.precision)
            line |= summary(evaluate(folded, validation, training.network, grid, training.by))
        if regular or time.perf_counter() - saved_s >= _CHECKPOINT_S:
            save_checkpoint(folder, state, (epoch + 1) * steps, identity)
            saved_s = time.perf_counter()
        with open_to_append(folder / LOG) as log:
            log.write((json.dumps(line) + "\n").encode())
        if report is not None:
            report(line)
    return state


def _finite(losses: Float[np.ndarray, " n"], epoch: int) -> Float[np.ndarray, " n"]:
    """The losses of an epoch's steps, if all are finite."""
    if not np.isfinite(losses).all():
        step = int(np.argmin(np.isfinite(losses)))
        raise ValueError(
            f"loss: not finite in epoch {epoch}, step {step}; stopped; an earlier epoch's checkpoint is kept. "
            "Lower the learning rate"
        )
    return losses


def _resumed(training: Training, folder: Path, identity: Mapping[str, Any], steps: int) -> tuple[TrainingState, int]:
    found = load_metadata(folder)
    if found is None:
        return start(training), 0
    wrong = [name for name in identity if found.get(name) != identity[name]]
    if wrong:
        raise ValueError(
            f"{folder}: its checkpoint is of another configuration ({', '.join(wrong)} differ: "
            f"{brief([found.get(name) for name in wrong])} in the folder); choose another one"
        )
    state: TrainingState = load_checkpoint(folder, start(training))
    return state, int(state.moments.step) // steps


def _keep_lines(path: Path, epochs: int) -> None:
    """Drop what a killed run logged after its last checkpoint."""
    lines = read_text(path).decode().splitlines()[:epochs] if path.exists() else []
    atomic_write(path, "".join(line + "\n" for line in lines))


def _plain(value: Any) -> Any:
    """As JSON gives it back."""
    return json.loads(json.dumps(value))
