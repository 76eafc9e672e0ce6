"""Many problems at once: the device plans one chunk of them while the host verifies the last one.

    device   pose → solve → ascend → tighten, under `vmap`      chunk k
    host     verify, path by path                                chunk k − 1

A chunk is what a device is busy with: a larger one gains nothing, and waits longer for its slowest problem. So memory
is bounded whatever the size of the batch.
"""

from __future__ import annotations

import dataclasses
import math
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Int64, UInt8

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.ascent import Ascent
from maxjax.planning.planner import Plan, PotentialFn, Route, Stage, Stopwatch, judge, route
from maxjax.planning.problem import pose

_CHUNK = 64
# Paths that a thread verifies in one go, and threads: more of them would only wait for the interpreter.
_TOGETHER, _THREADS = 8, 4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Found:
    """What the device hands back."""

    blocked: UInt8[Array | np.ndarray, "*b bytes"]
    margin: Float[Array | np.ndarray, "*b"]
    path: Float[Array | np.ndarray, "*b t 3"]
    status: Int32[Array | np.ndarray, "*b"]
    certified: Bool[Array | np.ndarray, "*b"]


# Maps cross to the device and back as bits: the way is narrow.
def _packed(volumes: Bool[np.ndarray, "*b nx ny nz"]) -> UInt8[np.ndarray, "*b bytes"]:
    return np.packbits(volumes.reshape(*volumes.shape[:-3], -1), axis=-1)


def _unpacked(bits: UInt8[np.ndarray, "*b bytes"], grid: Grid) -> Bool[np.ndarray, "*b nx ny nz"]:
    voxels = np.unpackbits(bits, axis=-1, count=math.prod(grid.shape)).view(bool)
    return voxels.reshape(*bits.shape[:-1], *grid.shape)


def _plan_chunk(
    occupied: UInt8[Array, "*m bytes"],
    ground: UInt8[Array, "*g bytes"],
    start: Float[Array, "b 3"],
    goal: Float[Array, "b 3"],
    margin: float,
    grid: Grid,
    potential: PotentialFn,
    settings: Ascent,
) -> _Found:
    def voxels(bits: UInt8[Array, " bytes"]) -> Bool[Array, "nx ny nz"]:
        return jnp.unpackbits(bits, count=math.prod(grid.shape)).reshape(grid.shape) > 0

    def one(filled: Array, bare: Array, start: Array, goal: Array) -> _Found:
        below = voxels(bare)
        problem = pose(voxels(filled) | below, below, start, goal, margin, grid)
        path, status, certified = route(problem, grid, potential, settings)
        return _Found(jnp.packbits(problem.blocked), problem.margin, path, status, certified)

    if len(start) == 1:
        only = one(occupied.reshape(-1), ground.reshape(-1), start[0], goal[0])
        found: _Found = jax.tree.map(lambda leaf: leaf[None], only)
    else:
        # A map that all problems share is not copied.
        axes = (*(None if bits.ndim == 1 else 0 for bits in (occupied, ground)), 0, 0)
        found = jax.vmap(one, in_axes=axes)(occupied, ground, start, goal)
    return found


def _chunk() -> int:
    """Problems that are planned at a time: on a CPU one, which is busy with it, and quicker with two by themselves."""
    return 1 if jax.default_backend() == "cpu" else _CHUNK


_DEVICE = Stage("device", _plan_chunk, static=("margin", "grid", "potential", "settings"))


def plan_paths(
    potential: PotentialFn,
    occupied: Bool[np.ndarray, "*m nx ny nz"],
    start: Float[np.ndarray, "b 3"],
    goal: Float[np.ndarray, "b 3"],
    grid: Grid,
    *,
    margin: float,
    ground: Bool[np.ndarray, "*g nx ny nz"],
    method: str,
    settings: Ascent = Ascent(),  # noqa: B008 (frozen)
) -> list[Plan]:
    """`planner.plan_path` with a field, for a batch.

    Arguments as in `maxjax.plan_batch`, already checked; maps and ground are one a problem, or one for all. Problems
    whose ascent needs more steps than the others go again, by themselves, as in `planner.field_path`.

    Returns:
        One plan a problem. Of `timings` each has an equal share: `device` until the last chunk was there, `verify` what
        verification took beyond that.
    """
    chosen: dict[int, Plan] = {}
    waiting = np.arange(len(start))
    for factor in (1, 4, 16):
        longer = dataclasses.replace(settings, steps=settings.steps * factor)
        # The first attempt compiles a program for just this batch; the others are rare, and share a few.
        most = len(waiting) if factor == 1 else 1 << (len(waiting) - 1).bit_length()
        size = -(-most // -(-most // _chunk()))
        found = _attempt(waiting, size, potential, occupied, start, goal, grid, margin, ground, method, longer)
        for k, plan in zip(waiting.tolist(), found, strict=True):
            before = chosen[k].timings if k in chosen else {}
            spent = {stage: seconds + before.get(stage, 0.0) for stage, seconds in plan.timings.items()}
            chosen[k] = dataclasses.replace(plan, timings=spent)
        waiting = np.array([k for k in waiting.tolist() if chosen[k].status == Status.PATH_STALLED], np.int64)
        if not waiting.size:
            break
    return [chosen[k] for k in range(len(start))]


def _attempt(
    which: Int64[np.ndarray, " n"],
    size: int,
    potential: PotentialFn,
    occupied: Bool[np.ndarray, "*m nx ny nz"],
    start: Float[np.ndarray, "b 3"],
    goal: Float[np.ndarray, "b 3"],
    grid: Grid,
    margin: float,
    ground: Bool[np.ndarray, "*g nx ny nz"],
    method: str,
    settings: Ascent,
) -> list[Plan]:
    """Plans of some problems, in chunks of one size; the last one is filled up with copies."""
    watch, begun = Stopwatch(), time.perf_counter()
    futures: list[Future[list[Plan]]] = []

    def some(volumes: Bool[np.ndarray, "*m nx ny nz"], rows: Any) -> Bool[np.ndarray, "*c nx ny nz"]:
        return volumes if volumes.ndim == 3 else volumes[rows]

    def verified(rows: Int64[np.ndarray, " c"], found: _Found) -> list[Plan]:
        """Plans of a few problems; their maps are unpacked here, so that what threads hold stays small."""
        blocked = _unpacked(np.asarray(found.blocked), grid)
        seen = np.broadcast_to(some(occupied, rows) & ~some(ground, rows), blocked.shape)
        outcomes = zip(found.path, found.status.tolist(), found.certified.tolist(), strict=True)
        routes = [Route(path, Status(status), sure) for path, status, sure in outcomes]
        maps = found.margin.tolist(), blocked, seen
        return judge(routes, start[rows], goal[rows], np.arange(len(rows)), *maps, grid, Stopwatch(), method)

    def hand_over(chunk: Int64[np.ndarray, " c"], found: _Found) -> None:
        """Wait for the device, then leave a chunk to the threads."""
        on_host: _Found = jax.device_get(found)
        for k in range(0, len(chunk), _TOGETHER):
            few = slice(k, min(k + _TOGETHER, len(chunk)))
            part = jax.tree.map(lambda leaf, few=few: leaf[few], on_host)
            futures.append(pool.submit(verified, chunk[few], part))

    with ThreadPoolExecutor(_THREADS) as pool:
        under_way: tuple[Int64[np.ndarray, " c"], _Found] | None = None
        for first in range(0, len(which), size):
            chunk = which[first : first + size]
            whole = len(chunk) == size and chunk[-1] - chunk[0] == size - 1
            # A slice is a view; a selection would copy the maps once more.
            rows = slice(chunk[0], chunk[-1] + 1) if whole else np.resize(chunk, size)
            arrays = _packed(some(occupied, rows)), _packed(some(ground, rows)), start[rows], goal[rows]
            found = _DEVICE.start(
                watch, *map(jnp.asarray, arrays), margin=margin, grid=grid, potential=potential, settings=settings
            )
            if under_way is not None:
                hand_over(*under_way)
            under_way = chunk, found
        if under_way is not None:
            hand_over(*under_way)
        ready = time.perf_counter()
        plans = [plan for future in futures for plan in future.result()]
    watch.seconds["device"] = ready - begun - watch.seconds["compile"]
    watch.seconds["verify"] = time.perf_counter() - ready
    timings = watch.report(len(which))
    return [dataclasses.replace(plan, timings=timings) for plan in plans]
