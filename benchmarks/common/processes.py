"""Plans by a planner of the host, a process a core: the most that a machine's cores make of it.

    plans a second = problems / time until the last is planned

Each process is bound to one core, computes on it alone, whatever accelerator there is, and holds the problems, so that
nothing but numbers of problems and statuses goes to and fro.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import maxjax
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.ui.methods import planner_named


def planned_by_processes(tasks: Sequence[Task], method: str, count: int, repeats: int) -> tuple[list[float], int]:
    """Seconds in which `count` problems are planned, time and again, and how many of them end as OK.

    Args:
        tasks: the problems; they are taken in turn, until there are `count`.
        method: name of the planner.
        count: problems a run.
        repeats: timed runs, after all processes have planned each problem once.
    """
    cores = _cores()
    spawn = multiprocessing.get_context("spawn")
    ready = spawn.Barrier(len(cores) + 1)
    free = spawn.SimpleQueue()
    for core in cores:
        free.put(core)
    turns = [k % len(tasks) for k in range(count)]
    with _on_cpus(), spawn.Pool(len(cores), _begin, (list(tasks), method, free, ready)) as pool:
        ready.wait()
        seconds, solved = [], 0
        for _ in range(repeats):
            start = time.perf_counter()
            solved = sum(pool.imap_unordered(_solved, turns))
            seconds.append(time.perf_counter() - start)
    return seconds, solved


def _cores() -> list[int]:
    """The cores that this process may use; where they cannot be chosen, as many places."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


@contextmanager
def _on_cpus() -> Iterator[None]:
    """Processes that start meanwhile see no accelerator."""
    before = os.environ.get("JAX_PLATFORMS")
    os.environ["JAX_PLATFORMS"] = "cpu"
    try:
        yield
    finally:
        del os.environ["JAX_PLATFORMS"]
        if before is not None:
            os.environ["JAX_PLATFORMS"] = before


# What a process plans; set as it begins.
_asked: tuple[list[Task], str] = [], ""


def _begin(tasks: list[Task], method: str, free: Any, ready: Any) -> None:
    global _asked
    core = free.get()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
    _asked = tasks, method
    for k in range(len(tasks)):
        _solved(k)
    ready.wait()


def _solved(k: int) -> bool:
    tasks, method = _asked
    return bool(plan_task(tasks[k], planner_named(method)).status[0] == maxjax.Status.OK)
