"""Processes that write one folder of executables at once (`compile.cache`), which is full of what was used long ago.

Each process compiles programs that all of them need and programs of its own, beginning at the same moment. Afterwards
the folder has to hold no more than its limit, and as many processes again have to find all their programs there.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import maxjax
from benchmarks.common.harness import Row
from maxjax.compile.cache import LIMIT, VARIABLE, cache_folder
from maxjax.core.grid import Point3

Problem = tuple[maxjax.VoxelMap, Point3, Point3]

_OLD = 2**24  # of a file from long ago, which takes no place on the disk [B]
_LOOKS = 0.02  # between looks at the folder [s]
_OF_JAX = "JAX_COMPILATION_CACHE_DIR"  # where this is set, maxjax keeps nothing


def written_at_once(folder: Path, problem: Problem, count: int) -> Row:
    """How much the folder held, and what was compiled a second time.

    Args:
        folder: an empty one.
        problem: that each process plans.
        count: processes.
    """
    with _kept_in(folder):
        kept = cache_folder()
        if kept is None:
            raise OSError(f"{folder}: expected a folder that can be written")
        for k in range(LIMIT // _OLD + 1):
            old = kept / f"old-{k}"
            with old.open("wb") as file:
                file.truncate(_OLD)
            os.utime(old, (k, k))
        started, most = time.perf_counter(), list[int]()
        watch = threading.Event()
        watcher = threading.Thread(target=_watched, args=(kept, watch, most))
        watcher.start()
        first = _all_plan(problem, count)
        watch.set()
        watcher.join()
        seconds, written = time.perf_counter() - started, _programs(kept)
        again = _all_plan(problem, count)
        return {
            "what": "one folder of executables",
            "processes": count,
            "solved": first + again,
            "programs": len(written),
            "seconds": round(seconds, 1),
            "most_MB": round(max(most) / 1e6, 1),
            "last_MB": round(_bytes_in(kept) / 1e6, 1),
            "limit_MB": round(LIMIT / 1e6, 1),
            "compiled_again": len(_programs(kept).items() - written.items()),
        }


@contextmanager
def _kept_in(folder: Path) -> Iterator[None]:
    """Processes that start meanwhile keep their executables there, and not where JAX is told to."""
    before = dict(os.environ)
    os.environ.pop(_OF_JAX, None)
    os.environ[VARIABLE] = str(folder)
    try:
        yield
    finally:
        os.environ.update(before)
        if VARIABLE not in before:
            del os.environ[VARIABLE]


def _programs(folder: Path) -> dict[str, int]:
    """When each executable was written."""
    files = (path for path in folder.iterdir() if path.is_file() and not path.name.startswith("old-"))
    return {path.name: path.stat().st_mtime_ns for path in files}


def _bytes_in(folder: Path) -> int:
    total = 0
    for path in folder.iterdir():
        try:
            total += path.stat().st_size
        except FileNotFoundError:  # removed since
            continue
    return total


def _watched(folder: Path, until: threading.Event, most: list[int]) -> None:
    # Old files are there from the beginning, beyond the limit: what counts comes after the first was removed.
    begun = _bytes_in(folder)
    most.append(0)
    while not until.wait(_LOOKS):
        now = _bytes_in(folder)
        if now < begun:
            most[0] = max(most[0], now)


def _all_plan(problem: Problem, count: int) -> int:
    """How many plans of as many processes are OK, of two each: with a margin of all, and with one of its own."""
    spawn = multiprocessing.get_context("spawn")
    ready, found = spawn.Barrier(count), spawn.SimpleQueue()
    processes = [spawn.Process(target=_plan, args=(problem, k, ready, found)) for k in range(count)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    solved = 0
    while not found.empty():
        solved += found.get()
    return solved


def _plan(problem: Problem, k: int, ready: Any, found: Any) -> None:
    ready.wait()
    # Distances are a part of programs.
    for margin in (8.0, 4.0 + k / 8):
        plan = maxjax.plan(*problem, planner=maxjax.AStar(), distances=maxjax.Distances(margin=margin))
        found.put(int(plan.status == maxjax.Status.OK))
