"""Many problems at once.

On an accelerator it plans one chunk of them while the host verifies the last one:

    device   pose → solve → ascend → tighten, under `vmap`      chunk k
    host     verify, path by path                                chunk k − 1

A chunk is what a device is busy with: a larger one gains nothing, and waits longer for its slowest problem. So memory
is bounded whatever the size of the batch. A CPU is busy with a single problem, and plans one after the other.
"""

from __future__ import annotations

import dataclasses
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Int64, UInt8

from maxjax.core import bits
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.ascent import Ascent
from maxjax.planning.planner import (
    PathFinder,
    Plan,
    PotentialFn,
    Route,
    Stage,
    Stopwatch,
    field_path,
    judge,
    plan_path,
    posed,
    route,
)

_CHUNK = 64
# Paths that a thread verifies in one go, and threads: more of them would only wait for the interpreter.
_TOGETHER, _THREADS = 8, 4


@dataclasses.dataclass(frozen=True)
class _Problems:
    """Problems as in `maxjax.plan_batch`, and how to answer them."""

    potential: PotentialFn
    occupied: Bool[np.ndarray, "*m nx ny nz"]
    ground: Bool[np.ndarray, "*g nx ny nz"]
    start: Float[np.ndarray, "b 3"]
    goal: Float[np.ndarray, "b 3"]
    margin: float
    grid: Grid
    method: str
    settings: Ascent


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Found:
    """What the device hands back."""

    blocked: UInt8[Array | np.ndarray, "*b bytes"]
    margin: Float[Array | np.ndarray, "*b"]
    path: Float[Array | np.ndarray, "*b t 3"]
    status: Int32[Array | np.ndarray, "*b"]
    certified: Bool[Array | np.ndarray, "*b"]


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
    def one(filled: Array, bare: Array, start: Array, goal: Array) -> _Found:
        problem, blocked = posed(filled, bare, start, goal, margin, grid)
        path, status, certified = route(problem, grid, potential, settings)
        return _Found(blocked, problem.margin, path, status, certified)

    # A map that all problems share is not copied.
    axes = (*(None if packed.ndim == 1 else 0 for packed in (occupied, ground)), 0, 0)
    found: _Found = jax.vmap(one, in_axes=axes)(occupied, ground, start, goal)
    return found


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
    chunk: int | None = None,
) -> list[Plan]:
    """`planner.plan_path` with a field, for a batch.

    Arguments as in `maxjax.plan_batch`, already checked; maps and ground are one a problem, or one for all.

    Args:
        chunk: problems that the device plans at a time. None: what suits it; on a CPU one after the other, each stage
            by itself.

    Returns:
        One plan a problem. In chunks each has an equal share of the `timings`: `device` until the last chunk was there,
        `verify` what verification took beyond that.
    """
    if chunk is None and jax.default_backend() == "cpu":
        find = field_path(potential, settings)
        return one_by_one(find, occupied, start, goal, grid, margin=margin, ground=ground, method=method)
    problems = _Problems(potential, occupied, ground, start, goal, margin, grid, method, settings)
    return _in_chunks(problems, chunk or _CHUNK)


def one_by_one(
    find: PathFinder,
    occupied: Bool[np.ndarray, "*m nx ny nz"],
    start: Float[np.ndarray, "b 3"],
    goal: Float[np.ndarray, "b 3"],
    grid: Grid,
    *,
    margin: float,
    ground: Bool[np.ndarray, "*g nx ny nz"],
    method: str,
) -> list[Plan]:
    """`planner.plan_path` by any path finder, for a batch; arguments as of `plan_paths`."""
    maps = (np.broadcast_to(volume, (len(start), *grid.shape)) for volume in (occupied, ground))
    return [
        plan_path(find, filled | bare, a, b, grid, margin=margin, ground=bare, method=method)
        for filled, bare, a, b in zip(*maps, start, goal, strict=True)
    ]


def _in_chunks(problems: _Problems, chunk: int) -> list[Plan]:
    """Problems whose ascent needs more steps than the others go again, by themselves, as in `planner.field_path`."""
    chosen: dict[int, Plan] = {}
    waiting = np.arange(len(problems.start))
    for factor in (1, 4, 16):
        longer = dataclasses.replace(problems.settings, steps=problems.settings.steps * factor)
        # The first attempt compiles a program for just this batch; the others are rare, and share a few.
        most = len(waiting) if factor == 1 else 1 << (len(waiting) - 1).bit_length()
        size = -(-most // -(-most // chunk))
        found = _attempt(dataclasses.replace(problems, settings=longer), waiting, size)
        for k, plan in zip(waiting.tolist(), found, strict=True):
            before = chosen[k].timings if k in chosen else {}
            spent = {stage: seconds + before.get(stage, 0.0) for stage, seconds in plan.timings.items()}
            chosen[k] = dataclasses.replace(plan, timings=spent)
        waiting = np.array([k for k in waiting.tolist() if chosen[k].status == Status.PATH_STALLED], np.int64)
        if not waiting.size:
            break
    return [chosen[k] for k in range(len(problems.start))]


def _attempt(problems: _Problems, which: Int64[np.ndarray, " n"], size: int) -> list[Plan]:
    """Plans of some of the problems, in chunks of one size; the last one is filled up with copies."""
    watch, begun = Stopwatch(), time.perf_counter()
    futures: list[Future[list[Plan]]] = []
    static = {"margin": problems.margin, "grid": problems.grid, "potential": problems.potential}

    def packed(volumes: Bool[np.ndarray, "*m nx ny nz"], rows: Any) -> UInt8[Array, "*c bytes"]:
        return jnp.asarray(bits.pack(_some(volumes, rows)))

    def verified(rows: Int64[np.ndarray, " c"], found: _Found) -> list[Plan]:
        """Plans of a few problems; their maps are unpacked here, so that what threads hold stays small."""
        blocked = bits.unpack(np.asarray(found.blocked), problems.grid.shape)
        seen = np.broadcast_to(_some(problems.occupied, rows) & ~_some(problems.ground, rows), blocked.shape)
        outcomes = zip(found.path, found.status.tolist(), found.certified.tolist(), strict=True)
        routes = [Route(path, Status(status), sure) for path, status, sure in outcomes]
        return judge(
            routes, problems.start[rows], problems.goal[rows], np.arange(len(rows)),
            found.margin.tolist(), blocked, seen, problems.grid, Stopwatch(), problems.method,
        )  # fmt: skip

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
            maps = packed(problems.occupied, rows), packed(problems.ground, rows)
            ends = jnp.asarray(problems.start[rows]), jnp.asarray(problems.goal[rows])
            found = _DEVICE.start(watch, *maps, *ends, settings=problems.settings, **static)
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


def _some(volumes: Bool[np.ndarray, "*m nx ny nz"], rows: Any) -> Bool[np.ndarray, "*c nx ny nz"]:
    """Of maps those of some problems; of a shared one, itself."""
    return volumes if volumes.ndim == 3 else volumes[rows]
