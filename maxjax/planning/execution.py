"""How a task is carried out: the same plans, in the way that the device runs best.

    staged           formulate | solve | ascend | tighten | price | judge, each by itself     a CPU; searches everywhere
    single program   all of it but the judge in one, one message in, one out                  one problem, accelerator
    pipelined        chunks of problems, the judge beside the device (`planning.pipeline`)    many problems, accelerator

A CPU is busy with a single problem, and plans one after the other. A field is solved in a window of the map wherever
that proves the same (`planning.focus_window`). Where an ascent runs out of steps, it is made again with four times as
many, in every way by `with_longer_ascents`: a maze can need more of them than a city.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Int64

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning import pipeline
from maxjax.planning.ascent import Ascent
from maxjax.planning.corridor import in_corridor
from maxjax.planning.field_planner import ASCEND, TIGHTEN, Climb, potential_field
from maxjax.planning.focus_window import View, in_windows
from maxjax.planning.plan import Plan, judged, with_closures
from maxjax.planning.problem import Problem
from maxjax.planning.route import PathFinder, Route, failed, found, whole
from maxjax.planning.task import Task
from maxjax.programs.lowering import target
from maxjax.programs.program import Program
from maxjax.programs.stage_timer import added, recording, timed
from maxjax.programs.threads import concurrently

# Problems that an accelerator plans at a time: of whole maps more would gain little, and wait longer for the slowest.
_CHUNK = 32
# Windows are small, and their kernels short: as many at a time as have so many voxels, and how many those may be.
_VOXELS, _WINDOWS = 2**26, 512
# Voxels of the largest map that is solved as a whole where no window answers.
_LARGEST_WHOLE = 2**22
# Steps of an ascent, in terms of those of its settings, until it arrives.
_FACTORS = (1, 4, 16, 64, 256, 1024)

Result = TypeVar("Result", Route, Plan)


def plan_task(task: Task, find: PathFinder, method: str, *, chunk: int | None = None) -> list[Plan]:
    """Plan all problems of a task.

    Args:
        task: what to plan.
        find: how. A `Climb` is carried out as suits the target, in windows if it is `focused`; any other path finder is
            called on the host with the whole map, one problem after the other.
        method: name of the planner.
        chunk: problems that go through a device at a time. None: what suits the target; on a CPU staged.

    Returns:
        One plan a problem. In chunks each has an equal share of the `timings`: `device` until the last chunk was on the
        host, `verify` what verification took beyond that.
    """
    chunked = isinstance(find, Climb) and (chunk is not None or target() != "cpu")

    def plan(view: View) -> list[Plan]:
        if isinstance(find, Climb) and chunked:
            return _in_chunks(view, find, method, chunk)
        finder = staged(find) if isinstance(find, Climb) else find
        return [_plan_one(view.some(slice(k, k + 1)), finder, method) for k in range(len(view))]

    def plan_all(views: list[View]) -> list[list[Plan]]:
        # One shape is compiled beside the others, and planned while the paths of others are judged.
        return list(concurrently(plan, views, max(len(views), 1))) if chunked else [plan(view) for view in views]

    def otherwise(some: Task) -> list[Plan]:
        """Plans of what no window answers."""
        if math.prod(some.grid.shape) <= _LARGEST_WHOLE:
            return plan(View(some))
        return [_routed(some.some(slice(k, k + 1))) for k in range(len(some))]

    def _routed(one: Task) -> Plan:
        """The plan of a problem in a map too large to be solved as a whole, if a corridor has one."""
        found = in_corridor(one, plan_all)
        if found.status == Status.OK:
            return dataclasses.replace(found, method=method)
        (solved,) = plan(View(one))
        return dataclasses.replace(solved, timings=added(found.timings, solved.timings))

    focused = isinstance(find, Climb) and find.focused
    plans = in_windows(task, plan_all, otherwise) if focused else plan(View(task))
    return with_closures(with_largest_radii(plans, task), task)


def with_largest_radii(plans: list[Plan], task: Task) -> list[Plan]:
    """The plans of a task; those that end as NO_SAFE_PATH with a radius that joins their ends."""

    def largest(plan: Plan, k: int) -> Plan:
        if plan.status != Status.NO_SAFE_PATH:
            return plan
        parts = pipeline.parts_of(View(task.some(slice(k, k + 1))))
        return dataclasses.replace(plan, radius=float(_LARGEST(parts, distances=task.distances, grid=task.grid.local)))

    return [largest(plan, k) for k, plan in enumerate(plans)]


def plan_one(task: Task, find: PathFinder, method: str) -> Plan:
    """Formulate the only problem of a task, find a path in its whole map, judge it; step by step."""
    return _plan_one(View(task), find, method)


def _plan_one(view: View, find: PathFinder, method: str) -> Plan:
    with recording() as recorder:
        problem = problem_in(view)
        status = fetched(problem.status)
        route = failed(status) if status != Status.OK else find(problem, view.grid)
        (plan,) = judged([view.placed(whole_route(problem, route, view.grid), 0)], view.task, method)
    return dataclasses.replace(plan, timings=recorder.report())


def problem_of(task: Task) -> Problem:
    """The only problem of a task, formulated in its whole map."""
    return problem_in(View(task))


def problem_in(view: View) -> Problem:
    """The only problem that a device is shown."""
    with timed("transfer"):
        parts = jax.block_until_ready(jax.device_put(pipeline.parts_of(view)))
    problem: Problem = _FORMULATE(parts, distances=view.task.distances, grid=view.grid)
    return problem


def whole_route(problem: Problem, route: Route, grid: Grid) -> Route:
    """`route.completed` on the host."""
    if route.status != Status.OK:
        return route
    path = np.asarray(route.path)
    path = np.pad(path, ((0, -len(path) % _POINTS), (0, 0)), mode="edge")
    (path, cost), balls = fetched((_PRICE(problem.ends, problem.price, path), problem.balls))
    return dataclasses.replace(route, path=path, balls=balls, cost=np.asarray(grid.spacing * cost, np.float32))


# Paths are filled up to whole multiples of so many points, so that searches share programs.
_POINTS = 128

_FORMULATE = Program("formulate", pipeline.formulated, static=("distances", "grid"))
_LARGEST = Program("largest radius", pipeline.largest, static=("distances", "grid"))
_PRICE = Program("price", whole)


def fetched(tree: Any) -> Any:
    """Arrays on the host, all at once: on an accelerator every fetch costs as much as a short program."""
    with timed("transfer"):
        return jax.device_get(tree)


def staged(climb: Climb) -> PathFinder:
    """The path finder that climbs a potential by programs of their own, each timed."""

    def find(problem: Problem, grid: Grid) -> Route:
        field = potential_field(problem.blocked, problem.price, problem.goal_index, grid, climb.potential)
        room = problem.room

        def attempt(_: Int64[np.ndarray, " n"], settings: Ascent) -> list[Route]:
            ends = problem.start, problem.goal
            path, arrived, sight = ASCEND(field.log_phi, problem.blocked, *ends, settings=settings, room=room)
            taut = TIGHTEN(sight.codes, path, problem.price, room=room)
            verdict = field.status, field.certified, field.geodesic
            (status, certified, geodesic), on_goal, points = fetched((verdict, arrived, taut))
            if status == Status.OK and on_goal:
                return [found(points, bool(certified), bool(geodesic))]
            return [failed(status if status != Status.OK else Status.PATH_STALLED, bool(certified))]

        (route,) = with_longer_ascents(attempt, 1, climb.settings)
        return route

    return find


def with_longer_ascents(
    attempt: Callable[[Int64[np.ndarray, " n"], Ascent], list[Result]], count: int, settings: Ascent
) -> list[Result]:
    """Attempt several problems; those that stall go again, by themselves, with longer ascents.

    Args:
        attempt: (which of them, settings) ↦ a route or a plan for each.
        count: how many there are.
        settings: of the first attempt.
    """
    results: dict[int, Result] = {}
    waiting = np.arange(count)
    for factor in _FACTORS:
        longer = dataclasses.replace(settings, steps=settings.steps * factor)
        results.update(zip(waiting.tolist(), attempt(waiting, longer), strict=True))
        waiting = np.array([k for k in waiting.tolist() if results[k].status == Status.PATH_STALLED], np.int64)
        if not waiting.size:
            break
    return [results[k] for k in range(count)]


def _in_chunks(view: View, climb: Climb, method: str, chunk: int | None) -> list[Plan]:
    """Plans by whole programs, in chunks; timings are equal shares, and sums over the attempts."""
    spent: dict[int, dict[str, float]] = {}

    def attempt(which: Int64[np.ndarray, " n"], settings: Ascent) -> list[Plan]:
        some, longer = view.some(which), dataclasses.replace(climb, settings=settings)
        first = settings == climb.settings
        with recording() as recorder:
            if len(which) == 1:
                plans = pipeline.single(some, longer, method)
            else:
                plans = pipeline.pipelined(some, longer, method, _sizes(some, chunk, first))
        timings = recorder.report(len(which))
        for k in which.tolist():
            spent[k] = added(spent.get(k, {}), timings)
        return [dataclasses.replace(plan, timings=spent[k]) for k, plan in zip(which.tolist(), plans, strict=True)]

    return with_longer_ascents(attempt, len(view), climb.settings)


def _sizes(view: View, chunk: int | None, first: bool) -> list[int]:
    """How many problems each chunk has room for: few different numbers, since each is a program by itself."""
    count, small = len(view), chunk or _CHUNK
    if view.windows is None:
        # The first attempt in whole maps compiles a program for just this batch; all others share a few.
        most = count if first else 1 << (count - 1).bit_length()
        return [-(-most // -(-most // small))] * -(-most // small)
    large = max(min(_VOXELS // math.prod(view.grid.shape), _WINDOWS), small) if chunk is None else small
    few, rest = divmod(count, large)
    return [large] * few + ([large] if 4 * rest > large else [small] * -(-rest // small))
