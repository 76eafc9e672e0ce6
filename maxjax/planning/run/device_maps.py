"""Maps on a device, of which it chooses and cuts windows itself: a host sends ends, and gets paths.

    maps as bits, once → volumes, and tables of their columns (`windows.column_counts`)
    ends, costs        → windows                                     `choose`
    windows, ends      → formulate → route → complete, under `vmap`  `routes`

Maps that several problems share are sent once. Everything else that goes to the device or comes back is a message
(`compile.message`).
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int32, Int64, Shaped, UInt8

from maxjax.compile import message as messages
from maxjax.compile.lowering import in_host_memory
from maxjax.compile.program import Program
from maxjax.compile.stage_timer import time_stage
from maxjax.compile.threads import in_parts
from maxjax.core.grid import Index3
from maxjax.planning.path.route import Route
from maxjax.planning.planner import Planner
from maxjax.planning.problem.task import Task
from maxjax.planning.run import pipeline
from maxjax.planning.windows import focus_window
from maxjax.planning.windows.column_counts import Table, count_columns, lowest_open_layers
from maxjax.planning.windows.focus_window import View, Windows
from maxjax.planning.windows.window_choice import Choice, choose

# Problems whose windows are chosen in one go, and bytes of maps that a thread makes bits of.
_BLOCK, _BYTES = 256, 2**22
# Of all maps: with their tables they take 4 to 8 bytes a voxel, which are counted by 32 bits.
_VOXELS = 2**30

# What a device is sent of a problem for a choice, and for a route.
_ASKED = {
    "cost": pipeline.blank(np.float32),
    "ends": pipeline.blank(np.float32, 2, 3),
    "map": pipeline.blank(np.int32),
}
_SHOWN = {
    "corner": pipeline.blank(np.int32, 3),
    "ends": pipeline.blank(np.float32, 2, 3),
    "map": pipeline.blank(np.int32),
    "rim": pipeline.blank(np.int32, 3),
    "turned": pipeline.blank(bool),
}
_CHOSEN = Choice(pipeline.blank(np.int32, 3), pipeline.blank(np.int32, 3), pipeline.blank(np.float32))

Volume = Bool[Array, "_ nx ny nz"]


class DeviceMaps:
    """The maps of a task on the default device."""

    def __init__(self, task: Task) -> None:
        self._task = task
        used = np.unique(task.map_of)
        # Where each map of the task is among those that were sent; −1: it was not.
        self._place = np.full(int(used[-1]) + 1, -1, np.int32)
        self._place[used] = np.arange(len(used))
        occupied, ground = _distinct(task.barred, used), _distinct(task.kept_off, used)
        shapes = tuple(volume.shape for volume in (occupied, ground))
        bits = jax.device_put([_bits_of(volume) for volume in (occupied, ground)])
        self._occupied, self._ground, self._table = _RECEIVE.start(*bits, shapes=shapes)
        self._price = None if task.price is None else jax.device_put(task.price)

    @staticmethod
    def fit(task: Task) -> bool:
        """Whether the maps of a task are few and small enough to be sent as a whole."""
        count = 1 if _is_shared(task.barred) else len(np.unique(task.map_of))
        return count * math.prod(task.grid.shape) <= _VOXELS

    def hold(self, task: Task) -> bool:
        """Whether they are those of another task, too."""
        mine = task.barred is self._task.barred and task.kept_off is self._task.kept_off
        sent = np.flatnonzero(self._place >= 0)
        return mine and task.price is self._task.price and bool(np.isin(task.map_of, sent).all())

    def choose(self, task: Task, costs: Float64[np.ndarray, " b"]) -> Windows:
        """`focus_window.windows_around`, in single precision.

        Args:
            task: problems in these maps.
            costs: of the ways, at least the straight lines [voxels].
        """
        asked = {"cost": costs.astype(np.float32), "ends": task.ends, "map": self._place[task.map_of]}
        sent = messages.pack(asked, axes=1)
        blocks = [np.resize(sent[k : k + _BLOCK], (_BLOCK, sent.shape[1])) for k in range(0, len(sent), _BLOCK)]
        shapes = tuple(focus_window.SHAPES)
        started = [_CHOOSE.start(self._table, block, shapes=shapes) for block in blocks]
        rows = np.concatenate([np.asarray(answer) for answer in started])[: len(sent)]
        return Windows.of(messages.unpack(rows, _CHOSEN))

    def routes(self, view: View, planner: Planner, size: int) -> Route:
        """Routes of windows, as many as there is room for in a chunk of this size, in index coordinates of the map."""
        layout = pipeline.layout_of(view)
        with time_stage("device"):
            rows = np.resize(self._message(view), (size, messages.size_of(_SHOWN)))
            answer = np.asarray(_PLAN.start(*self._volumes, rows, layout=layout, planner=planner))
            found: Route = messages.unpack(answer[: len(view)], pipeline.answer_layout(planner, layout))
        return view.in_map(found)

    def prepare(self, layout: pipeline.Layout, planner: Planner, size: int) -> None:
        """Compile the program of chunks of this size."""
        rows = jax.ShapeDtypeStruct((size, messages.size_of(_SHOWN)), np.uint8)
        _PLAN.prepare(*self._volumes, rows, layout=layout, planner=planner)

    @property
    def _volumes(self) -> tuple[Volume, Volume, Float[Array, "nx ny nz"] | None]:
        return self._occupied, self._ground, self._price

    def _message(self, view: View) -> UInt8[np.ndarray, "b sent"]:
        """What the device is told of windows."""
        every = slice(None)
        shown = {
            "corner": view.corners.astype(np.int32),
            "ends": view.ends(every),
            "map": self._place[view.task.map_of],
            "rim": view.rim(every),
            "turned": view.turned,
        }
        return np.asarray(messages.pack(shown, axes=1))


def _distinct(volumes: Bool[np.ndarray, "..."], used: Int64[np.ndarray, " u"]) -> Bool[np.ndarray, "m nx ny nz"]:
    """The maps that are used, as few as there are; one where all problems share it."""
    if _is_shared(volumes):
        return volumes[None] if volumes.ndim == 3 else volumes[:1]
    return volumes if len(used) == len(volumes) else volumes[used]


def _is_shared(volumes: Bool[np.ndarray, "..."]) -> bool:
    """Whether all problems have one map, be it given once or as a row of views."""
    return volumes.ndim == 3 or volumes.strides[0] == 0


def _bits_of(volumes: Bool[np.ndarray, "m nx ny nz"]) -> UInt8[np.ndarray, " bytes"]:
    """Voxels as bits, the first one in the highest, on all cores."""
    flat = np.ascontiguousarray(volumes).reshape(-1)
    return np.concatenate(in_parts(lambda rows: np.packbits(flat[rows]), len(flat), _BYTES))


def _receive(
    occupied: UInt8[Array, " o"], ground: UInt8[Array, " g"], shapes: tuple[tuple[int, ...], tuple[int, ...]]
) -> tuple[Volume, Volume, Table]:
    """Maps of their bits, and the table of what is occupied."""
    first, second = (
        jnp.asarray(messages.unpack(bits, pipeline.blank(bool, *shape)))
        for bits, shape in zip((occupied, ground), shapes, strict=True)
    )
    return first, second, count_columns(first)


def _choose(table: Table, asked: UInt8[Array, "b sent"], shapes: tuple[Index3, ...]) -> UInt8[Array, "b got"]:
    """Windows, as messages."""
    told: dict[str, Any] = messages.unpack(asked, _ASKED)
    map_of = told["map"] if table.shape[0] > 1 else jnp.zeros_like(told["map"])
    nx, ny, nz = table.shape[1] - 1, table.shape[2] - 1, table.shape[3]

    def lowest_open(low: Int32[Array, "b k 3"], high: Int32[Array, "b k 3"]) -> Int32[Array, "b k"]:
        return lowest_open_layers(table, map_of, low, high)

    chosen = choose(told["ends"], told["cost"], (nx, ny, nz), shapes, lowest_open, jnp)
    sent = Choice(chosen.corners.astype(jnp.int32), chosen.sizes.astype(jnp.int32), chosen.bounds.astype(jnp.float32))
    return in_host_memory(jnp.asarray(messages.pack(sent, axes=1)))


def _plan(
    occupied: Volume,
    ground: Volume,
    price: Float[Array, "nx ny nz"] | None,
    asked: UInt8[Array, "b sent"],
    layout: pipeline.Layout,
    planner: Planner,
) -> UInt8[Array, "b got"]:
    """Routes of windows, as messages."""
    hx, hy, hz = (n + 2 * layout.halo for n in layout.grid.shape)

    def one(message: UInt8[Array, " sent"]) -> UInt8[Array, " got"]:
        told: dict[str, Any] = messages.unpack(message, _SHOWN)
        corner, turned = told["corner"], told["turned"]

        def around(volumes: Volume) -> Bool[Array, "hx hy hz"]:
            return cut_window(volumes, told["map"], corner - layout.halo, turned, (hx, hy, hz), False)

        parts = {"occupied": around(occupied), "ground": around(ground), "ends": told["ends"], "rim": told["rim"]}
        if price is not None:  # It ends with a window, and beyond the map a metre costs 1.
            parts["price"] = cut_window(price[None], told["map"], corner, turned, layout.grid.shape, 1.0)
        return jnp.asarray(messages.pack(pipeline.answer(parts, layout, planner)))

    return in_host_memory(jax.vmap(one)(asked))


def cut_window(
    volumes: Shaped[Array, "m nx ny nz"],
    which: Int32[Array, ""],
    corner: Int32[Array, " 3"],
    turned: Bool[Array, ""],
    shape: Index3,
    beyond: Any,
) -> Shaped[Array, "bx by bz"]:
    """What a window shows of a map.

    Args:
        volumes: of several maps, or of the only one, which all windows lie in.
        which: map.
        corner: lowest voxel of the map that is shown; it may lie beyond it.
        turned: whether x and y are exchanged in what is shown.
        shape: of what is shown. Static.
        beyond: shown where the map ends.
    """
    count, nx, ny, nz = volumes.shape
    i, j, k = (jnp.arange(n, dtype=jnp.int32).reshape(-1, *[1] * (2 - axis)) for axis, n in enumerate(shape))
    x, y, z = corner[0] + jnp.where(turned, j, i), corner[1] + jnp.where(turned, i, j), corner[2] + k
    inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny) & (z >= 0) & (z < nz)
    at = which if count > 1 else 0
    flat = ((at * nx + jnp.clip(x, 0, nx - 1)) * ny + jnp.clip(y, 0, ny - 1)) * nz + jnp.clip(z, 0, nz - 1)
    return jnp.where(inside, volumes.reshape(-1)[flat], jnp.asarray(beyond, volumes.dtype))


_RECEIVE = Program("maps", _receive, static=("shapes",))
_CHOOSE = Program("windows", _choose, static=("shapes",))
_PLAN = Program("device", _plan, static=("layout", "planner"))
