"""Whole programs: maps and ends in, routes out, each as one message (`compile.message`).

    device   formulate → route → complete, under `vmap`      chunk k
    host     pack, and send                                  chunk k + 1

A chunk is what a device is busy with, so memory is bounded whatever the size of the batch. Maps are sent as bits, and
none comes back: a path is verified in the maps that the host has.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int64, Shaped, UInt8

from maxjax.compile import message as messages
from maxjax.compile.lowering import in_host_memory
from maxjax.compile.program import Program
from maxjax.compile.stage_timer import time_stage
from maxjax.compile.threads import in_parts
from maxjax.core.grid import Grid
from maxjax.planning.path.route import Route, complete_route
from maxjax.planning.planner import Planner, field_climber
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate, largest_joining_radius
from maxjax.planning.problem.task import Rows
from maxjax.planning.windows.focus_window import View

# What a device is sent of a problem, by name: `occupied` and `ground` (what is closed counts as both), `ends` in index
# coordinates; of a window `rim`, how much of it the map fills; and `price`, where voxels have one.
Parts = dict[str, Any]

# Problems whose message a thread makes in one go.
_TOGETHER = 32


@dataclasses.dataclass(frozen=True)
class Layout:
    """Static arguments of the programs of problems.

    Attributes:
        distances: to keep.
        grid: that is planned in, its origin at zero.
        halo: how far the maps reach beyond it [voxels].
        priced: whether each voxel has a price of its own.
    """

    distances: Distances
    grid: Grid
    halo: int
    priced: bool


def layout_of(view: View) -> Layout:
    """Static arguments of the programs of a view."""
    return Layout(view.task.distances, view.grid, view.halo, view.task.price is not None)


def parts_of(view: View) -> Parts:
    """Arrays of the only problem of a device."""
    return view.shared | {name: part[0] for name, part in _own(view, slice(0, 1)).items()}


def formulate_parts(parts: Parts, layout: Layout) -> Problem:
    """The problem of its parts."""
    occupied, ground = parts["occupied"] | parts["ground"], parts["ground"]
    problem = formulate(occupied, ground, parts["ends"], layout.distances, layout.grid, parts.get("rim"))
    return dataclasses.replace(problem, price=parts["price"]) if layout.priced else problem


def largest_radius(parts: Parts, layout: Layout) -> Float[Array, ""]:
    """A radius [m] below the one asked for that joins the ends of its parts."""
    ground = parts["ground"]
    return largest_joining_radius(parts["occupied"] | ground, ground, parts["ends"], layout.distances, layout.grid)


def run_one(view: View, planner: Planner) -> Route:
    """The route of one problem, in a batch of one; no thread is worth its start."""
    layout = layout_of(view)
    with time_stage("device"):
        message = np.asarray(_ONE.start(messages.pack(parts_of(view)), layout=layout, planner=planner))
        found = messages.unpack(message, answer_layout(planner, layout))
    return view.in_map(found)


def run_chunks(view: View, planner: Planner, sizes: Sequence[int]) -> Route:
    """Routes in chunks of these sizes, which are enough for all; the last one is filled up with copies."""
    layout, shared = layout_of(view), view.shared
    chunks = [rows for rows in np.split(np.arange(len(view)), np.cumsum(sizes)[:-1]) if rows.size]

    def prepare(k: int) -> Any:
        """Arrays of a chunk, sent while the device is busy with the chunk before."""
        own = _pack(view, chunks[k])
        return jax.device_put((messages.pack(shared), np.resize(own, (sizes[k], own.shape[1]))))

    answers = []
    with ThreadPoolExecutor(2) as pool, time_stage("device"):
        following = pool.submit(prepare, 0)
        for k in range(len(chunks)):
            sent = following.result()
            if k + 1 < len(chunks):
                following = pool.submit(prepare, k + 1)
            # Loop conditions are synchronisations in the thread that started the program, which is busy to the end.
            started = _MANY.start(*sent, shared=tuple(shared), layout=layout, planner=planner)
            answers.append(pool.submit(np.asarray, started))
        rows = [answer.result()[: len(chunk)] for answer, chunk in zip(answers, chunks, strict=True)]
    return view.in_map(messages.unpack(np.concatenate(rows), answer_layout(planner, layout)))


def _pack(view: View, rows: Int64[np.ndarray, " b"]) -> UInt8[np.ndarray, "b sent"]:
    """The messages of some problems, cut and packed on all cores."""
    packed = in_parts(lambda part: messages.pack(_own(view, rows[part]), axes=1), len(rows), _TOGETHER)
    return np.concatenate(packed)


def _own(view: View, rows: Rows) -> Parts:
    """Arrays of some problems beside the maps that all problems share."""
    rim = {} if view.windows is None else {"rim": view.rim(rows)}
    return view.own(rows) | rim | {"ends": view.ends(rows)}


def part_shapes(layout: Layout) -> Parts:
    """Shapes and types of the parts of one problem."""
    seen = [n + 2 * layout.halo for n in layout.grid.shape]
    rim = {"rim": blank(np.int32, 3)} if layout.halo else {}
    price = {"price": blank(np.float32, *layout.grid.shape)} if layout.priced else {}
    volumes = {"occupied": blank(bool, *seen), "ground": blank(bool, *seen)}
    return volumes | price | {"ends": blank(np.float32, 2, 3)} | rim


@functools.cache
def answer_layout(planner: Planner, layout: Layout) -> Route:
    """Shapes and types of the answer to one problem: a route with its exact ends."""
    number, flag = blank(np.float32), blank(bool)
    return Route(
        path=blank(np.float32, _points(planner, layout) + 2, 3),
        status=blank(np.int32),
        certified=flag,
        exemptions=blank(np.float32, 2),
        geodesic=flag,
        cost=number,
    )


def _points(planner: Planner, layout: Layout) -> int:
    """How many points the paths of a batched planner have."""
    if (climber := field_climber(planner)) is not None:
        return climber.ascent.steps + 1
    path = jax.eval_shape(lambda parts: planner.route(formulate_parts(parts, layout)).path, part_shapes(layout))
    return int(path.shape[0])


def blank(dtype: Any, *shape: int) -> Shaped[np.ndarray, "..."]:
    """An array of a shape and type without memory of its own, of which only these are read."""
    return np.broadcast_to(np.zeros((), dtype), shape)


def answer(parts: Parts, layout: Layout, planner: Planner) -> Route:
    """The route of one problem, from its parts."""
    problem = formulate_parts(parts, layout)
    answer = complete_route(problem, planner.route(problem))
    return dataclasses.replace(answer, geodesic=jnp.asarray(answer.geodesic))


def _plan_one(message: UInt8[Array, " sent"], layout: Layout, planner: Planner) -> UInt8[Array, "1 got"]:
    """One problem, from its message to that of its answer."""
    found = answer(messages.unpack(message, part_shapes(layout)), layout, planner)
    return in_host_memory(jnp.asarray(messages.pack(found))[None])


def _plan_many(
    common: UInt8[Array, " bytes"],
    own: UInt8[Array, "b sent"],
    shared: tuple[str, ...],
    layout: Layout,
    planner: Planner,
) -> UInt8[Array, "b written"]:
    """Several problems; maps that all of them share are sent once, in `common`."""
    like = part_shapes(layout)
    maps = messages.unpack(common, {name: like[name] for name in shared})

    def one(message: UInt8[Array, " sent"]) -> UInt8[Array, " written"]:
        parts = messages.unpack(message, {name: like[name] for name in like if name not in shared})
        return jnp.asarray(messages.pack(answer(maps | parts, layout, planner)))

    return in_host_memory(jax.vmap(one)(own))


_STATIC = "layout", "planner"
_ONE, _MANY = Program("device", _plan_one, static=_STATIC), Program("device", _plan_many, static=(*_STATIC, "shared"))
