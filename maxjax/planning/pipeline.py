"""Whole programs: maps and ends in, routes out, each as one message (`programs.message`).

    device   formulate → solve → ascend → tighten, under `vmap`      chunk k
    host     judge, route by route; pack, and send                   chunks k − 1 and k + 1

A chunk is what a device is busy with, so memory is bounded whatever the size of the batch. Maps are sent as bits, and
none comes back: a path is judged in the maps that the host has.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int64, Shaped, UInt8

from maxjax.core.grid import Grid
from maxjax.planning.ascent import Ascent
from maxjax.planning.field_planner import Climb
from maxjax.planning.focus_window import View
from maxjax.planning.plan import Plan, judged
from maxjax.planning.problem import Problem, formulate, largest_joining
from maxjax.planning.route import Route, completed
from maxjax.planning.task import Distances, Rows
from maxjax.programs import message as wire
from maxjax.programs.lowering import in_host_memory
from maxjax.programs.program import Program
from maxjax.programs.stage_timer import timed

# Routes that a thread judges in one go, and threads: more of them would only wait for the interpreter.
_TOGETHER, _THREADS = 16, 4

# What a device is sent of a problem, by name: `occupied`, `ground`, `ends` in index coordinates, and of a window `rim`,
# how much of it the map fills.
Parts = dict[str, Any]


def parts_of(view: View) -> Parts:
    """What a device needs of the only problem that it is shown."""
    return view.shared | {name: part[0] for name, part in _own(view, slice(0, 1)).items()}


def formulated(parts: Parts, distances: Distances, grid: Grid) -> Problem:
    """The problem of its parts; `distances` and `grid` static."""
    occupied, ground = parts["occupied"] | parts["ground"], parts["ground"]
    return formulate(occupied, ground, parts["ends"], distances, grid, parts.get("rim"))


def largest(parts: Parts, distances: Distances, grid: Grid) -> Float[Array, ""]:
    """A radius [m] below the one asked for that joins the ends of its parts; static as in `formulated`."""
    return largest_joining(parts["occupied"] | parts["ground"], parts["ground"], parts["ends"], distances, grid)


def single(view: View, climb: Climb, method: str) -> list[Plan]:
    """The plan of one problem; no thread is worth its start."""
    with timed("device"):
        message = np.asarray(_ONE.start(wire.pack(parts_of(view)), **_static(view, climb)))
        answer = wire.unpack(message, _answered(climb.settings))
    return _judged(answer, view, method)


def pipelined(view: View, climb: Climb, method: str, sizes: Sequence[int]) -> list[Plan]:
    """Plans in chunks of these sizes, which are enough for all; the last one is filled up with copies."""
    stops = np.cumsum(sizes)
    chunks, like = np.split(np.arange(len(view)), stops[:-1]), _answered(climb.settings)
    shared = view.shared
    results: list[Future[list[Plan]]] = []

    def prepared(k: int) -> Any:
        """What is sent of a chunk, while the device is busy with the chunk before."""
        own = _own(view, np.resize(chunks[k], sizes[k]))
        return jax.device_put((wire.pack(shared), wire.pack(own, axes=1)))

    def verified(chunk: Int64[np.ndarray, " c"], answer: Future[np.ndarray], few: slice) -> list[Plan]:
        """Some plans of a chunk."""
        return _judged(wire.unpack(answer.result()[few], like), view.some(chunk[few]), method)

    with ThreadPoolExecutor(_THREADS) as pool:
        with timed("device"):
            following = pool.submit(prepared, 0)
            for k, chunk in enumerate(chunks):
                messages = following.result()
                if k + 1 < len(chunks):
                    following = pool.submit(prepared, k + 1)
                # Loop conditions are synchronisations in the thread that started the program, which is busy to the end.
                started = _MANY.start(*messages, shared=tuple(shared), **_static(view, climb))
                answer = pool.submit(np.asarray, started)
                for first in range(0, len(chunk), _TOGETHER):
                    few = slice(first, min(first + _TOGETHER, len(chunk)))
                    results.append(pool.submit(verified, chunk, answer, few))
            answer.result()
        with timed("verify"):
            return [plan for result in results for plan in result.result()]


def _judged(answers: Route, view: View, method: str) -> list[Plan]:
    """Plans of a task from what came back, in a batch."""
    routes = [view.placed(jax.tree.map(lambda x, k=k: x[k, ...], answers), k) for k in range(len(view))]
    return judged(routes, view.task, method)


def _own(view: View, rows: Rows) -> Parts:
    """What is sent of some problems beside the maps that all problems share."""
    rim = {} if view.windows is None else {"rim": view.rim(rows)}
    return view.own(rows) | rim | {"ends": view.ends(rows)}


def _sent(grid: Grid, halo: int) -> Parts:
    """Shapes and types of the parts of one problem."""
    seen = [n + 2 * halo for n in grid.shape]
    rim = {"rim": _blank(np.int32, 3)} if halo else {}
    return {"occupied": _blank(bool, *seen), "ground": _blank(bool, *seen), "ends": _blank(np.float32, 2, 3), **rim}


def _answered(settings: Ascent) -> Route:
    """Shapes and types of the answer to one problem: a route with its exact ends."""
    number, flag = _blank(np.float32), _blank(bool)
    return Route(
        path=_blank(np.float32, settings.steps + 3, 3),
        status=_blank(np.int32),
        certified=flag,
        balls=_blank(np.float32, 2),
        geodesic=flag,
        cost=number,
    )


def _blank(dtype: Any, *shape: int) -> Shaped[np.ndarray, "..."]:
    """An array of a shape and type, without memory of its own."""
    return np.broadcast_to(np.zeros((), dtype), shape)


def _answer(parts: Parts, distances: Distances, grid: Grid, climb: Climb) -> Route:
    problem = formulated(parts, distances, grid)
    return completed(problem, climb(problem, grid), grid)


def _plan_one(
    message: UInt8[Array, " sent"], distances: Distances, grid: Grid, halo: int, climb: Climb
) -> UInt8[Array, "1 got"]:
    """One problem, from its message to that of its answer."""
    answer = _answer(wire.unpack(message, _sent(grid, halo)), distances, grid, climb)
    return in_host_memory(jnp.asarray(wire.pack(answer))[None])


# arguments: two arrays, and what the program is compiled for
def _plan_many(
    common: UInt8[Array, " bytes"],
    own: UInt8[Array, "b sent"],
    shared: tuple[str, ...],
    distances: Distances,
    grid: Grid,
    halo: int,
    climb: Climb,
) -> UInt8[Array, "b written"]:
    """Several problems; maps that all of them share are sent once, in `common`."""
    like = _sent(grid, halo)
    maps = wire.unpack(common, {name: like[name] for name in shared})

    def one(message: UInt8[Array, " sent"]) -> UInt8[Array, " written"]:
        parts = wire.unpack(message, {name: like[name] for name in like if name not in shared})
        return jnp.asarray(wire.pack(_answer(maps | parts, distances, grid, climb)))

    return in_host_memory(jax.vmap(one)(own))


_STATIC = "distances", "grid", "halo", "climb"
_ONE, _MANY = Program("device", _plan_one, static=_STATIC), Program("device", _plan_many, static=(*_STATIC, "shared"))


def _static(view: View, climb: Climb) -> dict[str, Any]:
    """What programs are compiled for."""
    return {"distances": view.task.distances, "grid": view.grid, "halo": view.halo, "climb": climb}
