"""`astar` by `astar.cpp`: the same paths and expansions, a hundred times as fast, where there is a compiler.

    queries → Queries (as the C++ reads them) → run on a `Search` a thread → AstarResult

The library is built when it is first asked for and kept (`compile.native`). Nothing here is needed: without one
`astar.astar` gives the same answers.
"""

from __future__ import annotations

import ctypes
import functools
import queue
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int64, Shaped, UInt8, UInt32

from maxjax.compile import native
from maxjax.compile.threads import concurrently
from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.planning.search.astar import AstarResult, check_query, no_path, result_of_path, status_of_ends
from maxjax.planning.search.steps import AT_START, STEPS, rules

SOURCE = Path(__file__).with_name("astar.cpp")
_ROOM, _TOGETHER = 512, 16  # steps of a path that are kept at first; queries that a thread takes at a time

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


class Search:
    """Workspace of one thread for maps of one shape; kept, it spares later queries their first touch of memory.

    Raises:
        NotCompiledError: as `compile.native.library`.
        MemoryError: where 16 bytes a voxel of address space cannot be had; used are those of the voxels reached.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._library, self._rules = _library(), _rules()
        dimensions = np.array(shape, np.int64)
        self._search = self._library.search_new(dimensions.ctypes.data, *(array.ctypes.data for array in self._rules))
        if not self._search:
            raise MemoryError(f"A*: no memory for maps of {shape}")

    def __del__(self) -> None:
        if getattr(self, "_search", None):
            self._library.search_delete(self._search)

    def run(self, rows: Shaped[np.ndarray, " n"]) -> None:
        """Answer some rows of `Queries`, one after the other, while other threads run."""
        self._library.search_run(self._search, rows.ctypes.data, len(rows))


class Query(NamedTuple):
    """Arguments of `astar`, with ends in free voxels and a price of at least 1."""

    blocked: Bool[np.ndarray, "nx ny nz"]
    start: Index3
    goal: Index3
    price: Float32[np.ndarray, "nx ny nz"] | None = None


class Queries:
    """Queries on maps of one shape as the library reads them, and its answers once they were run.

    Raises:
        ValueError: unless all maps and prices have one shape and their dtype, and all ends lie in free voxels.
    """

    def __init__(self, queries: Sequence[Query]) -> None:
        self.shape = queries[0].blocked.shape
        self._queries = [q._replace(blocked=self._in_order(q.blocked, np.bool_)) for q in queries]
        self._queries = [
            q if q.price is None else q._replace(price=self._in_order(q.price, np.float32)) for q in self._queries
        ]
        self._paths = np.zeros((len(queries), _ROOM), np.uint8)
        self._rows = np.array([self._row(q, path) for q, path in zip(self._queries, self._paths, strict=True)], _QUERY)

    def __len__(self) -> int:
        return len(self._rows)

    def run(self, searches: Sequence[Search]) -> None:
        """Answer all, on as many threads as there are searches, which are of this shape."""
        if any(search.shape != self.shape for search in searches):
            raise ValueError(f"searches: expected maps of {self.shape}, given {[search.shape for search in searches]}")
        if len(searches) == 1:
            return searches[0].run(self._rows)
        # A call of the library leaves the interpreter to other threads.
        idle: queue.SimpleQueue[Search] = queue.SimpleQueue()
        for search in searches:
            idle.put(search)

        def some(rows: Shaped[np.ndarray, " n"]) -> None:
            search = idle.get()
            search.run(rows)
            idle.put(search)

        parts = (self._rows[k : k + _TOGETHER] for k in range(0, len(self), _TOGETHER))
        list(concurrently(some, parts, len(searches)))

    def result(self, k: int) -> AstarResult:
        """The answer to one query, as `astar` gives it.

        Raises:
            MemoryError: where memory did not suffice.
        """
        query, path, row = self._queries[k], self._paths[k], self._rows[k : k + 1]
        if row["count"] > len(path):  # once more, with room for all of it
            path = np.zeros(int(row["count"][0]), np.uint8)
            row = np.array([self._row(query, path)], _QUERY)
            Search(self.shape).run(row)
        count, expanded = int(row["count"][0]), int(row["expanded"][0])
        if count == _NO_MEMORY:
            raise MemoryError(f"A*: no memory for a search of a map of {self.shape}")
        if count < 0:
            return no_path(Status.NO_VALID_PATH, expanded)
        moves = np.array(STEPS, np.int32)[path[:count]]
        voxels = np.cumsum(np.concatenate([np.array(query.start, np.int32)[None], moves]), axis=0, dtype=np.int32)
        return result_of_path(voxels, query.price, expanded)

    def _in_order(self, volume: np.ndarray, dtype: type) -> np.ndarray:
        """The volume as the library reads it: checked, and contiguous."""
        if volume.shape != self.shape or volume.dtype != dtype:
            raise ValueError(f"queries: expected {dtype} of {self.shape}, given {volume.dtype} {volume.shape}")
        return np.ascontiguousarray(volume)

    def _row(self, query: Query, path: UInt8[np.ndarray, " n"]) -> tuple[int, ...]:
        """A query in the library's terms; where all prices are 1, it is searched without."""
        dearest = check_query(query.blocked, query.start, query.goal, query.price)
        if (status := status_of_ends(query.blocked, query.start, query.goal)) is not Status.OK:
            raise ValueError(f"queries: expected ends in free voxels, given {query.start}, {query.goal}: {status.name}")
        start, goal = (int(np.ravel_multi_index(end, self.shape)) for end in (query.start, query.goal))
        price = 0 if query.price is None or dearest == 1 else query.price.ctypes.data
        return query.blocked.ctypes.data, price, start, goal, path.ctypes.data, len(path), 0, 0


def astar_in_cpp(
    blocked: Bool[np.ndarray, "nx ny nz"],
    start: Index3,
    goal: Index3,
    price: Float32[np.ndarray, "nx ny nz"] | None = None,
) -> AstarResult:
    """`planning.search.astar.astar`, compiled: the same arguments, results and errors.

    Raises:
        NotCompiledError: as `compile.native.library`.
        MemoryError: as `Search` and `Queries.result`.
    """
    check_query(blocked, start, goal, price)
    status = status_of_ends(blocked, start, goal)
    if status is not Status.OK:
        return no_path(status)
    asked = Queries([Query(blocked, start, goal, price)])
    asked.run([Search(asked.shape)])
    return asked.result(0)
