"""How a task is carried out: the same plans, in the way that the device runs best.

    staged           formulate | solve | ascend | tighten | price, each by itself    a CPU
    on the host      formulate | the planner's own search                            planners that are not batched
    single program   all of it in one, one message in, one out                       one problem, accelerator
    in chunks        chunks of problems in whole maps (`planning.run.pipeline`)      many problems, accelerator
    on its maps      chunks of windows that it cuts (`planning.run.device_maps`)     many problems, accelerator

and in all of them the verifier at the end, once for all paths. On a CPU a few problems are planned at a time, each on a
core. A field is solved in a window of the map wherever that proves the same (`planning.windows.focus_window`). Where an
ascent runs out of steps, it is made again with more, in every way by `with_longer_ascents`.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Int64

from maxjax.compile.lowering import target
from maxjax.compile.program import Program
from maxjax.compile.stage_timer import Recorder, recording, time_stage
from maxjax.compile.threads import concurrently
from maxjax.core.status import Status
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Route, RouteFn, Routes, complete_path, equal_shares, no_route
from maxjax.planning.plan import Plans
from maxjax.planning.planner import FieldClimber, Planner, field_climber, plans_in_windows
from maxjax.planning.problem.occupied_end import plans_of_occupied_ends
from maxjax.planning.problem.problem import Problem
from maxjax.planning.problem.task import Task
from maxjax.planning.run import pipeline
from maxjax.planning.run.device_maps import DeviceMaps
from maxjax.planning.run.device_windows import finder_on_device
from maxjax.planning.run.longer_ascents import FACTORS, with_longer_ascents
from maxjax.planning.run.stages import STAGED, status_of_climb
from maxjax.planning.run.verifying import verify_routes, with_closures
from maxjax.planning.windows.corridor import find_in_corridor
from maxjax.planning.windows.focus_window import View
from maxjax.planning.windows.growth import WindowFinder, find_in_windows

# Problems in whole maps that an accelerator plans at a time: more would gain little, and wait longer for the slowest.
_CHUNK = 32
# Voxels of the largest map that is solved as a whole where no window answers.
_LARGEST_WHOLE = 2**22


def plan_task(task: Task, planner: Planner, *, chunk: int | None = None) -> Plans:
    """Plan all problems of a task, and verify their paths together.

    Args:
        task: what to plan.
        planner: how. One that climbs a field is carried out as suits the target, in windows if it has `focus`; any
            other is shown the whole map.
        chunk: problems that go through a device at a time. None: what suits the target; on a CPU one by one.

    Returns:
        One plan a problem. In chunks each has an equal share of the `timings`, and so it has of `verify`.
    """
    if (taken := plans_of_occupied_ends(task, planner.name)) is not None:
        return with_closures(dataclasses.replace(taken, timings=equal_shares(Recorder(), len(task))))
    return plans_of(routes_of(task, planner, chunk=chunk), task, planner.name)


def plans_of(routes: Routes, task: Task, method: str) -> Plans:
    """Plans of routes: verified, with a radius that joins where the one asked for does not, and with closures."""
    with recording() as recorder:
        plans = with_closures(with_largest_radii(verify_routes(routes.route, task, method)))
    timings = routes.add_seconds(np.arange(len(task)), equal_shares(recorder, len(task))).timings
    return dataclasses.replace(plans, timings=timings, ratio=np.where(plans.ok, routes.ratio, math.nan))


def routes_of(task: Task, planner: Planner, *, chunk: int | None = None) -> Routes:
    """Routes of all problems of a task, not yet verified; arguments as those of `plan_task`."""
    chunked = planner.batched and (chunk is not None or target() != "cpu")

    def find(view: View) -> Routes:
        return _in_chunks(view, planner, chunk) if chunked else find_one_by_one(view, planner)

    sent: list[DeviceMaps] = []

    def finder_of(some: Task) -> WindowFinder:
        """Of several problems an accelerator has the maps itself, which legs of a corridor share."""
        climber = field_climber(planner)
        if climber is None or not chunked or len(some) == 1 or not DeviceMaps.fit(some):
            return WindowFinder(find)
        if not (sent and sent[0].hold(some)):
            sent[:] = [DeviceMaps(some)]
        return finder_on_device(sent[0], climber, chunk)

    def otherwise(some: Task) -> Routes:
        """Routes of what no window answers."""
        if math.prod(some.grid.shape) <= _LARGEST_WHOLE:
            return find(View(some))
        found = Routes.blank(len(some))
        for k in range(len(some)):
            found = found.put(np.array([k]), find_route(some.some(slice(k, k + 1))))
        return found

    def find_route(one: Task) -> Routes:
        """The route of a problem in a map too large to be solved as a whole, if a corridor has one."""
        guided = find_in_corridor(one, finder_of, formulate_view)
        if guided.ok.all():
            return guided
        return find(View(one)).add_seconds(np.arange(1), guided.timings)

    return find_in_windows(task, finder_of(task), otherwise) if plans_in_windows(planner) else find(View(task))


def with_largest_radii(plans: Plans) -> Plans:
    """The plans; those that end as NO_SAFE_PATH with a radius that joins their ends."""
    task, radius = plans.task, plans.radius.copy()
    for k in np.flatnonzero(plans.status == Status.NO_SAFE_PATH).tolist():
        view = View(task.some(slice(k, k + 1)))
        radius[k] = _LARGEST(pipeline.parts_of(view), layout=pipeline.layout_of(view))
    return dataclasses.replace(plans, radius=radius)


def find_one_by_one(view: View, planner: Planner, finder: RouteFn | None = None) -> Routes:
    """Routes of a view problem by problem; those of a batched planner on all cores, by a finder if one is given."""
    find = finder or _host_finder(planner)

    def one(k: int) -> tuple[Route, dict[str, float]]:
        with recording() as recorder:
            shown = view.some(slice(k, k + 1))
            problem = formulate_view(shown)
            status = fetch(problem.status)
            route = no_route(status) if status != Status.OK else find(problem)
            route = complete_on_host(problem, route)
        return route, recorder.report()

    # The first by itself: it may compile.
    results = [one(0)]
    cores = (os.cpu_count() or 1) if planner.batched else 1
    results += concurrently(one, range(1, len(view)), cores)
    routes, timings = zip(*results, strict=True)
    found = Routes.of(routes, timings)
    return Routes(view.in_map(found.route), found.timings)


def _host_finder(planner: Planner) -> RouteFn:
    """How routes are found one by one: by stages, by one program, or by the planner's own search."""
    if (climber := field_climber(planner)) is not None:
        return stage_finder(climber)
    if not planner.batched:
        return planner.route

    def find(problem: Problem) -> Route:
        route: Route = _ROUTE(problem, planner=planner)
        return jax.tree.map(np.asarray, route)  # type: ignore[no-any-return]

    return find


def _route(problem: Problem, planner: Planner) -> Route:
    return planner.route(problem)


def problem_of(task: Task) -> Problem:
    """The only problem of a task, formulated in its whole map."""
    return formulate_view(View(task))


def formulate_view(view: View) -> Problem:
    """The only problem that a device is shown."""
    problem: Problem = _FORMULATE(pipeline.parts_of(view), layout=pipeline.layout_of(view))
    return problem


def complete_on_host(problem: Problem, route: Route) -> Route:
    """`route.complete_route` on the host."""
    if route.status != Status.OK:
        return dataclasses.replace(route, path=np.zeros((0, 3), np.float32))
    path = np.asarray(route.path)
    path = np.pad(path, ((0, -len(path) % _POINTS), (0, 0)), mode="edge")
    (path, cost), exemptions, spacing = fetch(
        (_PRICE(problem.ends, problem.price, path), problem.exemptions, problem.spacing)
    )
    return dataclasses.replace(route, path=path, exemptions=exemptions, cost=np.asarray(spacing * cost, np.float32))


# Paths are filled up to whole multiples of so many points, so that searches share programs.
_POINTS = 128

_FORMULATE = Program("formulate", pipeline.formulate_parts, static=("layout",))
_LARGEST = Program("largest radius", pipeline.largest_radius, static=("layout",))
_PRICE = Program("price", complete_path)
_ROUTE = Program("route", _route, static=("planner",))


def fetch(tree: Any) -> Any:
    """Arrays on the host, all at once: on an accelerator every fetch costs as much as a short program."""
    with time_stage("transfer"):
        return jax.device_get(tree)


def stage_finder(planner: FieldClimber, factors: Sequence[int] = FACTORS) -> RouteFn:
    """How a field is climbed by programs of their own, each timed; `factors` as of `with_longer_ascents`."""

    def find(problem: Problem) -> Route:
        field = STAGED.field(problem, planner.potential)
        verdict = problem.status, field.status, field.certified, field.geodesic

        def attempt(_: Int64[np.ndarray, " n"], settings: Ascent) -> Routes:
            climbed = STAGED.path(field.log_phi, problem, settings)
            (fault, status, certified, geodesic), (path, arrived) = fetch((verdict, climbed))
            return Routes.of([Route(path, status_of_climb(fault, status, arrived, np), certified, geodesic=geodesic)])

        return with_longer_ascents(attempt, 1, planner.ascent, factors).one(0)

    return find


def _in_chunks(view: View, planner: Planner, chunk: int | None) -> Routes:
    """Routes of a view as whole programs; those that stall by themselves again, in chunks of fewer sizes."""
    climber = field_climber(planner)

    def attempt(which: Int64[np.ndarray, " n"], settings: Ascent | None) -> Routes:
        some = view.some(which)
        longer = climber.with_ascent(settings) if climber is not None and settings is not None else planner
        # The first attempt of a planner of whole maps has a program for just this batch; all others share a few.
        exactly = longer == planner and not plans_in_windows(planner)
        with recording() as recorder:
            if len(which) == 1:
                route = pipeline.run_one(some, longer)
            else:
                route = pipeline.run_chunks(some, longer, _sizes(len(some), chunk or _CHUNK, exactly))
        return Routes(route, equal_shares(recorder, len(which)))

    if climber is None:
        return attempt(np.arange(len(view)), None)
    return with_longer_ascents(attempt, len(view), climber.ascent)


def _sizes(count: int, chunk: int, exactly: bool) -> list[int]:
    """How many whole maps each chunk has room for: the same number for all, exactly as many or a power of two."""
    most = count if exactly else 1 << (count - 1).bit_length()
    return [-(-most // -(-most // chunk))] * -(-most // chunk)
