"""One problem or many, each chunk of them as a single program.

On an accelerator it plans one chunk while the host verifies the last one and packs the next one:

    device   pose → solve → ascend → tighten, under `vmap`      chunk k
    host     verify, path by path; pack, and send                chunks k − 1 and k + 1

A chunk is what a device is busy with: a larger one gains little, and waits longer for its slowest problem. So memory
is bounded whatever the size of the batch. A chunk comes back as one array of bytes, in the host's memory: every array
that is sent or fetched costs as much as a short stage. A CPU is busy with a single problem, and plans one after the
other, stage by stage.
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
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Int64, Shaped, UInt8

from maxjax.core import bits
from maxjax.core.grid import Grid, Index3
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

_CHUNK = 32
# Bytes of a start and a goal.
_ENDS = 2 * 3 * 4
# Paths that a thread verifies in one go, and threads: more of them would only wait for the interpreter.
_TOGETHER, _THREADS = 8, 2


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


@dataclasses.dataclass(frozen=True)
class _Found:
    """What the device found out about c problems."""

    path: Float[np.ndarray, "c t 3"]
    margin: Float[np.ndarray, " c"]
    status: Int32[np.ndarray, " c"]
    certified: Bool[np.ndarray, " c"]
    blocked: Bool[np.ndarray, "c nx ny nz"]


def _planned(
    occupied: UInt8[Array, " bytes"],
    ground: UInt8[Array, " bytes"],
    ends: Float[Array, "2 3"],
    margin: float,
    grid: Grid,
    potential: PotentialFn,
    settings: Ascent,
) -> tuple[UInt8[Array, " numbers"], Bool[Array, "nx ny nz"]]:
    """What was found out about one problem: the numbers of a `_Found` in a row, and its dilated map."""
    problem = posed(occupied, ground, ends[0], ends[1], margin, grid)
    path, status, certified = route(problem, grid, potential, settings)
    numbers = (lax.bitcast_convert_type(x, jnp.uint8).reshape(-1) for x in (path, problem.margin, status))
    return jnp.concatenate([*numbers, certified.astype(jnp.uint8)[None]]), problem.blocked


def _read(message: UInt8[np.ndarray, "c written"], points: int, shape: Index3) -> _Found:
    """What comes back for paths of so many points: the numbers, and the map, in bytes or in bits."""
    numbers = np.ascontiguousarray(message[:, : 12 * points + 8])
    floats, blocked = numbers.view(np.float32), message[:, 12 * points + 9 :]
    in_bytes = blocked.shape[1] == math.prod(shape)
    return _Found(
        floats[:, :-2].reshape(-1, points, 3),
        floats[:, -2],
        numbers.view(np.int32)[:, -1],
        message[:, 12 * points + 8] > 0,
        blocked.view(bool).reshape(-1, *shape) if in_bytes else bits.unpack(blocked, shape),
    )


def _plan_one(
    message: UInt8[Array, " sent"], margin: float, grid: Grid, potential: PotentialFn, settings: Ascent
) -> UInt8[Array, "1 written"]:
    """One problem: its maps in bits and its ends, sent as one array, since each array costs as much as a short stage.

    The dilated map goes back in bytes: a host takes longer to unpack one than it takes on the way.
    """
    occupied, ground, ends = jnp.split(message, [(message.size - _ENDS) // 2, message.size - _ENDS])
    ends = lax.bitcast_convert_type(ends.reshape(2, 3, 4), jnp.float32)
    numbers, blocked = _planned(occupied, ground, ends, margin, grid, potential, settings)
    return _on_host(jnp.concatenate([numbers, blocked.astype(jnp.uint8).reshape(-1)])[None])


def _plan_many(
    occupied: UInt8[Array, "*m bytes"],
    ground: UInt8[Array, "*g bytes"],
    ends: Float[Array, "b 2 3"],
    margin: float,
    grid: Grid,
    potential: PotentialFn,
    settings: Ascent,
) -> UInt8[Array, "b written"]:
    """Several problems; a map that all of them share is not copied."""

    def one(occupied: Array, ground: Array, ends: Array) -> UInt8[Array, " written"]:
        numbers, blocked = _planned(occupied, ground, ends, margin, grid, potential, settings)
        return jnp.concatenate([numbers, jnp.packbits(blocked)])

    axes = (*(None if packed.ndim == 1 else 0 for packed in (occupied, ground)), 0)
    return _on_host(jax.vmap(one, in_axes=axes)(occupied, ground, ends))


def _on_host(message: UInt8[Array, "b written"]) -> UInt8[Array, "b written"]:
    there: UInt8[Array, "b written"] = jax.device_put(message, jax.memory.Space.Host)
    return there


_STATIC = "margin", "grid", "potential", "settings"
_ONE, _MANY = Stage("device", _plan_one, static=_STATIC), Stage("device", _plan_many, static=_STATIC)


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
    """Plans of some of the problems, in chunks of one size, or of a single one."""
    watch = Stopwatch()
    plans = _alone(problems, int(which[0]), watch) if len(which) == 1 else _pipelined(problems, which, size, watch)
    timings = watch.report(len(which))
    return [dataclasses.replace(plan, timings=timings) for plan in plans]


def _alone(problems: _Problems, k: int, watch: Stopwatch) -> list[Plan]:
    """The plan of one problem; no thread is worth its start."""
    begun, rows = time.perf_counter(), slice(k, k + 1)
    message = np.concatenate([part.view(np.uint8).reshape(-1) for part in _packed(problems, rows)])
    answer = np.asarray(_ONE.start(watch, message, **_static(problems)))
    ready = time.perf_counter()
    plans = _verified(problems, rows, answer)
    _book(watch, begun, ready)
    return plans


def _pipelined(problems: _Problems, which: Int64[np.ndarray, " n"], size: int, watch: Stopwatch) -> list[Plan]:
    """Plans chunk by chunk; the last chunk is filled up with copies."""
    begun = time.perf_counter()
    results: list[Future[list[Plan]]] = []

    def prepared(first: int) -> tuple[Int64[np.ndarray, " c"], Any]:
        """A chunk, and what is sent of it: ahead, while the device is at the chunk before."""
        chunk = which[first : first + size]
        return chunk, jax.device_put(_packed(problems, _rows(np.resize(chunk, size))))

    def verified(chunk: Int64[np.ndarray, " c"], answer: Future[np.ndarray], few: slice) -> list[Plan]:
        """Some plans of a chunk: their dilated maps are unpacked here, so that what threads hold stays small."""
        return _verified(problems, _rows(chunk[few]), answer.result()[few])

    with ThreadPoolExecutor(_THREADS) as pool:
        following = pool.submit(prepared, 0)
        for first in range(0, len(which), size):
            chunk, sent = following.result()
            if first + size < len(which):
                following = pool.submit(prepared, first + size)
            # At each turn of a loop the device asks the host: it takes the thread that started it, nearly to the end.
            answer = pool.submit(np.asarray, _MANY.start(watch, *sent, **_static(problems)))
            for k in range(0, len(chunk), _TOGETHER):
                results.append(pool.submit(verified, chunk, answer, slice(k, min(k + _TOGETHER, len(chunk)))))
        answer.result()
        ready = time.perf_counter()
        plans = [plan for result in results for plan in result.result()]
    _book(watch, begun, ready)
    return plans


def _packed(problems: _Problems, rows: Any) -> tuple[np.ndarray, np.ndarray, Float[np.ndarray, "b 2 3"]]:
    """Maps and ground of some problems in bits, and their ends."""
    occupied, ground = (bits.pack(_some(maps, rows)) for maps in (problems.occupied, problems.ground))
    return occupied, ground, np.stack([problems.start[rows], problems.goal[rows]], axis=1)


def _static(problems: _Problems) -> dict[str, Any]:
    """What programs are compiled for."""
    return {name: getattr(problems, name) for name in _STATIC}


def _verified(problems: _Problems, rows: Any, answer: UInt8[np.ndarray, "c written"]) -> list[Plan]:
    """Plans of some problems."""
    found = _read(answer, problems.settings.steps + 1, problems.grid.shape)
    occupied, ground = (
        np.broadcast_to(_some(maps, rows), found.blocked.shape) for maps in (problems.occupied, problems.ground)
    )
    outcomes = zip(found.path, found.status.tolist(), found.certified.tolist(), strict=True)
    routes = [Route(path, Status(status), sure) for path, status, sure in outcomes]
    return judge(
        routes, problems.start[rows], problems.goal[rows], np.arange(len(routes)),
        found.margin.tolist(), found.blocked, occupied, problems.grid, Stopwatch(), problems.method, ground,
    )  # fmt: skip


def _book(watch: Stopwatch, begun: float, ready: float) -> None:
    """Until the device was ready, and what verification took beyond that."""
    watch.seconds["device"] = ready - begun - watch.seconds["compile"]
    watch.seconds["verify"] = time.perf_counter() - ready


def _rows(which: Int64[np.ndarray, " n"]) -> slice | Int64[np.ndarray, " n"]:
    """As a slice where they follow each other: that is a view, where a selection would copy the maps once more."""
    in_a_row = np.array_equal(which, np.arange(which[0], which[0] + len(which)))
    return slice(which[0], which[0] + len(which)) if in_a_row else which


def _some(maps: Shaped[np.ndarray, "..."], rows: Any) -> Shaped[np.ndarray, "..."]:
    """Of maps those of some problems; of a shared one, which has only the three axes of one map, itself."""
    return maps if maps.ndim == 3 else maps[rows]
