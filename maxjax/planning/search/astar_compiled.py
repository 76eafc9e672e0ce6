"""`astar` by `astar.cpp`: the same paths and expansions, a hundred times as fast, where there is a compiler.

    query → `Query` (as the C++ reads it) → run → AstarResult

The library is built when it is first asked for and kept (`compile.native`). Nothing here is needed: without one
`astar.astar` gives the same answers.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Int64, Shaped, UInt8, UInt32

from maxjax.compile import native
from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.planning.search.astar import AstarResult, check_query, no_path, result_of_path, status_of_ends
from maxjax.planning.search.steps import AT_START, STEPS, rules

SOURCE = Path(__file__).with_name("astar.cpp")
_ROOM = 512  # steps of a path that are kept at first

# `Query` of the source.
_POINTERS = "blocked", "price", "path"
_FIELDS = "blocked", "price", "start", "goal", "path", "room", "count", "expanded"
_QUERY = np.dtype([(name, np.uint64 if name in _POINTERS else np.int64) for name in _FIELDS])
_NO_MEMORY = -2


def available() -> bool:
    """Whether there is a compiled A*; the first call may build it."""
    return native.available(SOURCE)


@functools.cache
def _library() -> ctypes.CDLL:
    """The library, its functions declared."""
    loaded = native.library(SOURCE)
    address, number = ctypes.c_void_p, ctypes.c_int64
    loaded.search_new.restype, loaded.search_new.argtypes = address, [address, address, address]
    loaded.search_delete.restype, loaded.search_delete.argtypes = None, [address]
    loaded.search_run.restype, loaded.search_run.argtypes = None, [address, address, number]
    return loaded


@functools.cache
def _rules() -> tuple[UInt32[np.ndarray, " n"], Int64[np.ndarray, " a"]]:
    """`steps.rules` in one row, and where those of each arrival begin."""
    rows = [
        [word for k, span, detours in rules(a) for word in (k, span, len(detours), *detours)]
        for a in range(AT_START + 1)
    ]
    return np.concatenate([np.array(row, np.uint32) for row in rows]), np.cumsum([0, *map(len, rows)])


def astar_in_cpp(
    blocked: Bool[np.ndarray, "nx ny nz"],
    start: Index3,
    goal: Index3,
    price: Float32[np.ndarray, "nx ny nz"] | None = None,
) -> AstarResult:
    """`planning.search.astar.astar`, compiled: the same arguments, results and errors.

    Raises:
        NotCompiledError: as `compile.native.library`.
        MemoryError: where 16 bytes a voxel of address space cannot be had; used are those of the voxels reached.
    """
    dearest = check_query(blocked, start, goal, price)
    if price is not None and price.dtype != np.float32:
        raise ValueError(f"price: expected float32, given {price.dtype}")
    if (status := status_of_ends(blocked, start, goal)) is not Status.OK:
        return no_path(status)
    # Where all prices are 1, it is searched without.
    volumes = [blocked, *([] if price is None or dearest == 1 else [price])]
    volumes = [np.ascontiguousarray(volume) for volume in volumes]
    query = np.zeros(1, _QUERY)
    for name, volume in zip(_POINTERS, volumes, strict=False):
        query[name] = volume.ctypes.data
    query["start"], query["goal"] = (np.ravel_multi_index(end, blocked.shape) for end in (start, goal))
    steps = _run(query, blocked.shape, _ROOM)
    count, expanded = int(query["count"][0]), int(query["expanded"][0])
    if count > _ROOM:  # once more, with room for all of it
        steps = _run(query, blocked.shape, count)
    if count < 0:
        return no_path(Status.NO_VALID_PATH, expanded)
    moves = np.array(STEPS, np.int32)[steps[:count]]
    voxels = np.cumsum(np.concatenate([np.array(start, np.int32)[None], moves]), axis=0, dtype=np.int32)
    return result_of_path(voxels, price, expanded)


def _run(query: Shaped[np.ndarray, "1"], shape: tuple[int, ...], room: int) -> UInt8[np.ndarray, " room"]:
    """Answer a query on a map of this shape; the steps of its path, as far as there is room for them."""
    library, dimensions, steps = _library(), np.array(shape, np.int64), np.zeros(room, np.uint8)
    query["path"], query["room"] = steps.ctypes.data, room
    search = library.search_new(dimensions.ctypes.data, *(array.ctypes.data for array in _rules()))
    if search:
        library.search_run(search, query.ctypes.data, 1)
        library.search_delete(search)
    if not search or query["count"][0] == _NO_MEMORY:
        raise MemoryError(f"A*: no memory for a search of a map of {shape}")
    return steps
