"""Scenes with their certified potentials, from keys.

    scene i = label(draw(fold_in(key, i)))        draw: key ↦ (blocked, price, goal)

A scene is a pure function of its key: the same in any batch. The caller's `draw` makes cities, scans and goals; this
module labels them with the solver's field and stores them.

On disk, optionally: one checked file a chunk of scenes (`core.serialization`), named by its first scene. A run that was
killed resumes with the missing chunks.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray, UInt16

from maxjax.core.grid import Grid
from maxjax.core.serialization import load_pytree, save_pytree
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.nn.encoding import Known
from maxjax.solvers.medium import medium_of
from maxjax.solvers.potential import solve_potential
from maxjax.solvers.screened import Screened

# The relative change of any voxel by one more sweep: values are then good to about 1 % of φ, 0.01 nats.
TOLERANCE = 1e-3

Fields = dict[str, Array]  # those of `Scenes`: a dictionary may hold shapes in place of arrays
Drawn = tuple[Bool[Array, "nx ny nz"], Float[Array, "nx ny nz"], Int32[Array, " 3"]]
Draw = Callable[[PRNGKeyArray], Drawn]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Scenes:
    """Labelled scenes; a batch axis leads.

    Attributes:
        blocked: voxels that conduct nothing.
        price: N ≥ 1, what a voxel costs (`fields.price.lattice_price`).
        goal_index: voxel of the goal.
        steps: of the flood from the goal, prices counted; 0 outside its component.
        target: y = −ℓ log φ [voxels] (`nn.encoding`); 0 at the goal and outside its component.
        screening_length: ℓ [voxels].
        status: `Status` of the solve as int32; only scenes that are OK are trained on.
    """

    blocked: Bool[Array, "*batch nx ny nz"]
    price: Float[Array, "*batch nx ny nz"]
    goal_index: Int32[Array, "*batch 3"]
    steps: UInt16[Array, "*batch nx ny nz"]
    target: Float[Array, "*batch nx ny nz"]
    screening_length: Float[Array, "*batch"]
    status: Int32[Array, "*batch"]


def label(drawn: Drawn, grid: Grid) -> Scenes:
    """The solver's field of one scene; for `jit` and `vmap`.

    Args:
        drawn: voxels that conduct nothing, the price N, the voxel of the goal.
        grid: of these; static.
    """
    blocked, price, goal_index = drawn
    sigma = conductivity(blocked, goal_index, grid)
    solved = solve_potential(sigma, goal_index, price, solver=Screened(tolerance=TOLERANCE))
    steps = medium_of(sigma, goal_index, price).distance.astype(jnp.uint16)
    target = jnp.where(jnp.isfinite(solved.log_phi), -solved.screening_length * solved.log_phi, 0)
    return Scenes(blocked, price, goal_index, steps, target, solved.screening_length, solved.status)


def network_inputs(scene: Scenes, grid: Grid) -> Known:
    """Inputs of networks for a scene; `grid` is static."""
    sigma = conductivity(scene.blocked, scene.goal_index, grid)
    return Known(sigma, scene.price, scene.goal_index, scene.steps, scene.screening_length)


@dataclasses.dataclass(frozen=True)
class Chunks:
    """How scenes are made and kept.

    Attributes:
        size: scenes made at a time.
        folder: where chunks are kept and looked for; None: nowhere. One folder serves one draw, key and grid.
    """

    size: int = 16
    folder: Path | None = None


def generate(
    draw: Draw,
    key: PRNGKeyArray,
    count: int,
    grid: Grid,
    chunks: Chunks = Chunks(),
    *,
    report: Callable[[int], None] | None = None,
) -> Scenes:
    """Scenes 0 to count − 1 of a key, on the device.

    Args:
        draw: one scene's obstacles and goal, pure; hashable, as a static argument is.
        key: of the set; another key, other scenes.
        count: scenes.
        grid: of the scenes.
        chunks: how many are made at a time, and where they are kept.
        report: called with the number of scenes made or read so far, after each chunk.

    Raises:
        ValueError: for fewer than one scene, or a kept chunk that is damaged, cut short or of other scenes.
        OSError: if a chunk cannot be written; those before it stay.
    """
    chunk, folder = chunks.size, chunks.folder
    if count < 1 or chunk < 1:
        raise ValueError(f"scenes: expected at least one, given {count} in chunks of {chunk}")

    make = functools.partial(_make, draw, grid)
    shape = jax.eval_shape(make, key, jax.ShapeDtypeStruct((chunk,), jnp.int32))
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    # Written in place: parts joined at the end would take the memory twice.
    scenes = jax.tree.map(lambda leaf: jnp.zeros((count, *leaf.shape[1:]), leaf.dtype), shape)
    identity = {"key": np.asarray(jax.random.key_data(key)).tolist(), "grid": dataclasses.asdict(grid)}
    for first in range(0, count, chunk):
        # The last chunk is drawn whole, so that a longer set begins with a shorter one's files.
        path = None if folder is None else folder / f"scenes-{first:06d}-{chunk}.npz"
        part = _kept(path, shape, identity) if path is not None and path.exists() else None
        if part is None:
            part = make(key, jnp.arange(first, first + chunk, dtype=jnp.int32))
            if path is not None:
                save_pytree(path, {"scenes": part, "identity": _stamp(identity)})
        wanted = min(chunk, count - first)
        scenes = _place(scenes, jax.tree.map(lambda leaf, n=wanted: leaf[:n], part), jnp.int32(first))
        if report is not None:
            report(first + wanted)
    return Scenes(**scenes)


@functools.partial(jax.jit, static_argnums=(0, 1))
def _make(draw: Draw, grid: Grid, key: PRNGKeyArray, indices: Int32[Array, " chunk"]) -> Fields:
    def one(index: Int32[Array, ""]) -> Fields:
        return dict(vars(label(draw(jax.random.fold_in(key, index)), grid)))

    made: Fields = jax.vmap(one)(indices)
    return made


@jax.jit
def _ok(scenes: Scenes) -> Bool[Array, " n"]:
    return scenes.status == Status.OK


def _put(scenes: Fields, part: Fields, first: Int32[Array, ""]) -> Fields:
    joined: Fields = jax.tree.map(lambda a, b: jax.lax.dynamic_update_slice_in_dim(a, b, first, 0), scenes, part)
    return joined


_place = jax.jit(_put, donate_argnums=0)


def usable(scenes: Scenes) -> Scenes:
    """The scenes whose solve is OK.

    Raises:
        ValueError: if there are none.
    """
    good = np.flatnonzero(np.asarray(_ok(scenes)))
    if not len(good):
        raise ValueError("scenes: expected some with a certified potential, given none")
    if len(good) == len(scenes.status):
        return scenes
    chosen: Scenes = jax.tree.map(lambda leaf: leaf[good], scenes)
    return chosen


def _stamp(identity: dict[str, object]) -> np.ndarray:
    """The identity of a set of scenes, as plain numbers."""
    return np.frombuffer(repr(sorted(identity.items())).encode(), np.uint8)


def _kept(path: Path, shape: dict[str, Any], identity: dict[str, object]) -> Fields:
    stamp = _stamp(identity)
    like: dict[str, Any] = {"scenes": shape, "identity": stamp}
    # Its length is part of what is compared.
    found = load_pytree(path, like)
    if not np.array_equal(found["identity"], stamp):
        raise ValueError(f"{path}: holds scenes of another key or grid; give each set a folder of its own")
    scenes: Fields = jax.tree.map(jnp.asarray, found["scenes"])
    return scenes
