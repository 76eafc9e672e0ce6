"""Whole programs: maps and ends in, routes and dilated maps out, each as one message (`core.wire`).

    device   formulate → solve → ascend → tighten, under `vmap`      chunk k
    host     judge, route by route; pack, and send                   chunks k − 1 and k + 1

A chunk is what a device is busy with, so memory is bounded whatever the size of the batch. Maps are sent as bits. A
single dilated map comes back in bytes, since a host takes longer to unpack bits than they save on the way; those of a
chunk come back in bits, and are unpacked by the threads that judge.
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int64, Shaped, UInt8

from maxjax.core import wire
from maxjax.core.grid import Grid
from maxjax.core.lowering import in_host_memory
from maxjax.planning.ascent import Ascent
from maxjax.planning.climb import Climb
from maxjax.planning.plan import Plan, judged
from maxjax.planning.problem import Dilated, Problem, formulate
from maxjax.planning.program import Program
from maxjax.planning.recorder import timed
from maxjax.planning.route import Route
from maxjax.planning.task import Rows, Task, maps_of, rows_of

# Routes that a thread judges in one go, and threads: more of them would only wait for the interpreter.
_TOGETHER, _THREADS = 8, 2

# What a device is sent of a problem, by name: `occupied`, `ground`, and `ends` in index coordinates.
Parts = dict[str, Any]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Answer:
    """What comes back of a problem: a route, and the map that it has to keep to; batch axes lead."""

    route: Route
    dilated: Dilated


def parts_of(task: Task) -> Parts:
    """What a device needs of the only problem of a task."""
    shared, own = _parts(task, slice(0, 1))
    return shared | {name: part[0] for name, part in own.items()}


def formulated(parts: Parts, margin: float, grid: Grid) -> Problem:
    """The problem of its parts; `margin` and `grid` static."""
    return formulate(parts["occupied"] | parts["ground"], parts["ground"], parts["ends"], margin, grid)


def single(task: Task, climb: Climb, method: str) -> list[Plan]:
    """The plan of one problem; no thread is worth its start."""
    with timed("device"):
        message = np.asarray(_ONE.start(wire.pack(parts_of(task)), **_static(task, climb)))
        answer = wire.unpack(message, _answered(task.grid, climb.settings), bits=False)
    return _judged(answer, task, method)


def pipelined(task: Task, climb: Climb, method: str, size: int) -> list[Plan]:
    """Plans chunk by chunk; the last chunk is filled up with copies."""
    which, like = np.arange(len(task)), _answered(task.grid, climb.settings)
    shared, _ = _parts(task, slice(0, 0))
    results: list[Future[list[Plan]]] = []

    def prepared(first: int) -> tuple[Int64[np.ndarray, " c"], Any]:
        """A chunk, and what is sent of it, while the device is busy with the chunk before."""
        chunk = which[first : first + size]
        own = _parts(task, rows_of(np.resize(chunk, size)))[1]
        return chunk, jax.device_put((wire.pack(shared), wire.pack(own, axes=1)))

    def verified(chunk: Int64[np.ndarray, " c"], answer: Future[np.ndarray], few: slice) -> list[Plan]:
        """Some plans of a chunk: their dilated maps are unpacked here, so that what threads hold stays small."""
        return _judged(wire.unpack(answer.result()[few], like), task.some(rows_of(chunk[few])), method)

    with ThreadPoolExecutor(_THREADS) as pool:
        with timed("device"):
            following = pool.submit(prepared, 0)
            for first in range(0, len(which), size):
                chunk, messages = following.result()
                if first + size < len(which):
                    following = pool.submit(prepared, first + size)
                # Loop conditions are synchronisations in the thread that started the program, which is busy to the end.
                started = _MANY.start(*messages, shared=tuple(shared), **_static(task, climb))
                answer = pool.submit(np.asarray, started)
                for k in range(0, len(chunk), _TOGETHER):
                    few = slice(k, min(k + _TOGETHER, len(chunk)))
                    results.append(pool.submit(verified, chunk, answer, few))
            answer.result()
        with timed("verify"):
            return [plan for result in results for plan in result.result()]


def _judged(answer: Answer, task: Task, method: str) -> list[Plan]:
    """Plans of a task from what came back, in a batch."""
    routes = [jax.tree.map(lambda x, k=k: x[k, ...], answer.route) for k in range(len(task))]
    return judged(routes, task, answer.dilated, method)


def _parts(task: Task, rows: Rows) -> tuple[Parts, Parts]:
    """What is sent of some problems: the maps that all problems share, and what each of them has for itself."""
    maps = {"occupied": task.occupied, "ground": task.ground}
    shared = {name: volume for name, volume in maps.items() if volume.ndim == 3}
    own = {name: maps_of(volume, rows) for name, volume in maps.items() if name not in shared}
    return shared, own | {"ends": task.ends[rows]}


def _sent(grid: Grid) -> Parts:
    """Shapes and types of the parts of one problem."""
    return {
        "occupied": _blank(bool, *grid.shape),
        "ground": _blank(bool, *grid.shape),
        "ends": _blank(np.float32, 2, 3),
    }


def _answered(grid: Grid, settings: Ascent) -> Answer:
    """Shapes and types of the answer to one problem."""
    path, dilated = _blank(np.float32, settings.steps + 1, 3), Dilated(_blank(bool, *grid.shape), _blank(np.float32))
    return Answer(Route(path, _blank(np.int32), _blank(bool)), dilated)


def _blank(dtype: Any, *shape: int) -> Shaped[np.ndarray, "..."]:
    """An array of a shape and type, without memory of its own."""
    return np.broadcast_to(np.zeros((), dtype), shape)


def _answer(parts: Parts, margin: float, grid: Grid, climb: Climb) -> Answer:
    problem = formulated(parts, margin, grid)
    return Answer(climb(problem, grid), problem.dilated)


def _plan_one(message: UInt8[Array, " sent"], margin: float, grid: Grid, climb: Climb) -> UInt8[Array, "1 written"]:
    """One problem, from its message to that of its answer."""
    answer = _answer(wire.unpack(message, _sent(grid)), margin, grid, climb)
    return in_host_memory(jnp.asarray(wire.pack(answer, bits=False))[None])


def _plan_many(
    common: UInt8[Array, " bytes"],
    own: UInt8[Array, "b sent"],
    shared: tuple[str, ...],
    margin: float,
    grid: Grid,
    climb: Climb,
) -> UInt8[Array, "b written"]:
    """Several problems; maps that all of them share are sent once, in `common`."""
    like = _sent(grid)
    maps = wire.unpack(common, {name: like[name] for name in shared})

    def one(message: UInt8[Array, " sent"]) -> UInt8[Array, " written"]:
        parts = wire.unpack(message, {name: like[name] for name in like if name not in shared})
        return jnp.asarray(wire.pack(_answer(maps | parts, margin, grid, climb)))

    return in_host_memory(jax.vmap(one)(own))


_STATIC = "margin", "grid", "climb"
_ONE, _MANY = Program("device", _plan_one, static=_STATIC), Program("device", _plan_many, static=(*_STATIC, "shared"))


def _static(task: Task, climb: Climb) -> dict[str, Any]:
    """What programs are compiled for."""
    return {"margin": task.margin, "grid": task.grid.local, "climb": climb}
