"""`maxjax train`: draw scenes, label them, train a network on them.

    key → city → pose → scan → voxels → goal → margin → (blocked, goal)

A scene is what one planning problem of a flight looks like to the planner: 32,768 rays from a place in the open, 3 to
15 m above the ground, the grid of 101³ voxels about it; below z = 0 everything is ground. The goal stands in the open
at the same heights. The margin is the planner's own choice for these two ends (`planning.problem.pose`): 8 m, or less
where that would seal one of them in.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.cli import report
from maxjax.core.grid import Grid
from maxjax.core.provenance import device, versions
from maxjax.core.serialize import atomic_write
from maxjax.core.status import Status
from maxjax.fields.occupancy import voxelize
from maxjax.nn.dataset import Chunks, Scenes, generate, usable
from maxjax.nn.model import save_model
from maxjax.nn.recipes import RECIPES, Training
from maxjax.nn.training import LOG, Run, train
from maxjax.planning.problem import pose
from maxjax.sim.lidar import Lidar, scan
from maxjax.worlds.geoms import Geoms, rotation_z
from maxjax.worlds.layouts import layout
from maxjax.worlds.raycast import cast_rays

_LIDAR = Lidar()
_LOW, _HIGH = 3.0, 15.0  # [m] above ground
_MARGIN = 8.0  # [m]
_REACH = 95.0  # [m], of poses and goals from the middle of the city, along x and y
_SKY = 400.0  # [m], above any roof
_APART = 3.0  # [m], to walls: further than the voxel that a place shares with one
# Places drawn for each; the first that will do is taken.
_POSES, _GOALS = 16, 32


@dataclasses.dataclass(frozen=True)
class ScannedCity:
    """Scenes of a map: a pure function of a key to (blocked, goal_index).

    Attributes:
        name: of `sim.layouts.MAPS`.
        grid: shape and spacing; it is moved to the sensor, in whole voxels.
    """

    name: str
    grid: Grid

    def __call__(self, key: PRNGKeyArray) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, " 3"]]:
        """The scene of a key."""
        return _draw(self.name, self.grid, key)


def _draw(name: str, grid: Grid, key: PRNGKeyArray) -> tuple[Bool[Array, "nx ny nz"], Int32[Array, " 3"]]:
    city, places, turn, noise = jax.random.split(key, 4)
    geoms = layout(name, city)
    u = jax.random.uniform(places, (_POSES + _GOALS, 3))
    low, high = jnp.array([-_REACH, -_REACH, _LOW]), jnp.array([_REACH, _REACH, _HIGH])
    points = low + (high - low) * u
    standing = _in_the_open(geoms, points)
    position = points[jnp.argmax(standing[:_POSES])]
    angle = jax.random.uniform(turn, (), maxval=2 * jnp.pi)
    found = scan(geoms, _LIDAR, position, rotation_z(angle), noise)
    # The grid is static: the world is moved under it, by whole voxels, until the sensor is in its middle.
    middle = jnp.asarray(grid.origin) + 0.5 * grid.spacing * (jnp.asarray(grid.shape) - 1)
    shift = middle - grid.spacing * jnp.round(position / grid.spacing)
    occupied = voxelize(found.points + shift, grid).occupied
    bottom = grid.origin[2] + grid.spacing * (jnp.arange(grid.shape[2]) - 0.5) - shift[2]
    ground = jnp.broadcast_to(bottom < -1e-3, grid.shape)
    goals = points[_POSES:] + shift
    eligible = standing[_POSES:] & grid.contains(goals)

    def attempt(state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        _, _, _, left = state
        chosen = jnp.argmax(left)
        problem = pose(occupied | ground, ground, position + shift, goals[chosen], _MARGIN, grid)
        return problem.blocked, problem.goal_index, problem.status, left.at[chosen].set(False)

    def unsolved(state: tuple[Array, Array, Array, Array]) -> Bool[Array, ""]:
        return (state[2] != Status.OK) & jnp.any(state[3])

    nothing = jnp.ones(grid.shape, bool), jnp.zeros(3, jnp.int32), jnp.int32(Status.NO_VALID_PATH), eligible
    blocked, goal_index, status, _ = lax.while_loop(unsolved, attempt, nothing)
    # Without a goal nothing is free: the solve will say so, and the scene is not used.
    return blocked | (status != Status.OK), goal_index


def _in_the_open(geoms: Geoms, points: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    """Whether nothing but sky is above each point [m], a metre of air below it, and a voxel's width around it."""
    down = jnp.array([[0.0, 0.0, -1.0]])
    around = _APART * jnp.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])

    def roof(xy: Float[Array, " 2"]) -> Float[Array, ""]:
        return _SKY - cast_rays(geoms, jnp.append(xy, _SKY), down)[0]

    roofs = jax.vmap(roof)((points[:, None, :2] + around).reshape(-1, 2)).reshape(-1, len(around))
    return jnp.max(roofs, axis=1) < points[:, 2] - 1.0


_VALIDATION = 64
_CHUNK = 16
TINY_GRID = Grid((33, 33, 33), 4.0, (-64.0, -64.0, -64.0))


def run(
    configs: Sequence[str],
    out: Path,
    tiny: bool,
    epochs: int | None,
    scenes: int,
    cache: Path | None,
    seed: int,
) -> int:
    """Draw, label, and train one network after the other; arguments as on the command line. Returns the exit code.

    Each network has a folder of its own in OUT: NAME.npz (its weights), training.json, log.jsonl, a checkpoint.

    Raises:
        ValueError, OSError: for arguments or files that cannot be used, or a loss that is not finite.
    """
    unknown = [name for name in configs if name not in RECIPES]
    if unknown or not configs:
        raise ValueError(f"--config: expected some of {', '.join(RECIPES)}, given {', '.join(unknown) or 'none'}")
    if scenes < 1 or (epochs is not None and epochs < 1):
        raise ValueError(f"--scenes, --epochs: expected at least 1, given {scenes} and {epochs}")
    out.mkdir(parents=True, exist_ok=True)
    grid, checks, chunk = Grid(), _VALIDATION, _CHUNK
    if tiny:
        grid, scenes, checks, chunk = TINY_GRID, 8, 4, 4
    sets = []
    for number, (name, count) in enumerate((("scenes", scenes), ("validation", checks)), start=1):
        begun = time.perf_counter()
        key = jax.random.fold_in(jax.random.key(seed), number)
        folder = None if cache is None else cache / name
        done = functools.partial(_show_done, name, count)
        # Some more than wanted: in a few places no goal can be reached.
        drawn = -(-(count + count // 16) // chunk) * chunk
        found = usable(generate(ScannedCity("midtown", grid), key, drawn, grid, Chunks(chunk, folder), report=done))
        sets.append(jax.tree.map(lambda leaf, n=count: leaf[:n], found))
        report.complain(
            f"{name}: {len(found.status)} of {drawn} usable, {len(sets[-1].status)} taken, "
            f"{time.perf_counter() - begun:.0f} s"
        )
    for name in ("tiny",) if tiny else configs:
        recipe = dataclasses.replace(RECIPES[name], seed=seed)
        if jax.default_backend() == "cpu":
            # XLA's gradients of convolutions are slow there, and half precision saves nothing.
            recipe = dataclasses.replace(recipe, precision="float32", by="product")
        if epochs is not None:
            recipe = dataclasses.replace(recipe, epochs=epochs)
        print(_train(name, recipe, grid, sets[0], sets[1], out / name))
    return 0


def _show_done(name: str, count: int, done: int) -> None:
    if done >= count or done % (4 * _CHUNK) == 0:
        report.complain(f"{name}: {done} of {count}")


def _train(name: str, recipe: Training, grid: Grid, scenes: Scenes, validation: Scenes, out: Path) -> Path:
    """One network; returns the file of its weights."""
    begun = time.perf_counter()
    seen: list[int] = []

    def show(line: Mapping[str, Any]) -> None:
        seen.append(int(line["epoch"]))
        left = (time.perf_counter() - begun) / len(seen) * (recipe.epochs - seen[-1])
        figures = ", ".join(f"{key} {value:.4g}" for key, value in line.items() if key != "epoch")
        report.complain(f"{name}, epoch {seen[-1]} of {recipe.epochs}: {figures}; {left:.0f} s left")

    state = train(recipe, scenes, grid, Run(out), validation=validation, report=show)
    lines = [json.loads(line) for line in (out / LOG).read_text().splitlines()]
    metadata = {
        "training": dataclasses.asdict(recipe),
        "scenes": len(scenes.status),
        "validation_scenes": len(validation.status),
        "last": lines[-1],
        "seconds": round(time.perf_counter() - begun, 1),
        "epochs_in_these_seconds": len(seen),
        "versions": versions(),
        "device": device(),
    }
    path = out / f"{name}.npz"
    save_model(path, name, state.params, metadata=metadata)
    atomic_write(out / "training.json", report.dumps({**metadata, "epochs": lines}))
    return path
