"""Windows that grow until they prove what they show, at last to the whole map: the routes of a task.

    cost → window → route → proved
      ↑                └→ not: a higher cost, a larger window, at last the whole map
      └──────────────────────┘

Each problem goes its own way. Those that wait for windows of one shape are shown together, and of all shapes the view
comes next that is fullest, so that others may still join the rest.

Costs and bounds [voxels].
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.compile.threads import as_finished
from maxjax.core.grid import Index3
from maxjax.planning.path.route import Routes
from maxjax.planning.problem.task import Task
from maxjax.planning.windows import focus_window
from maxjax.planning.windows.focus_window import View, Windows, windows_around
from maxjax.planning.windows.geometry import guess_costs, is_proved, next_costs, path_costs


@dataclasses.dataclass(frozen=True)
class WindowFinder:
    """How windows of the maps of a task are chosen, and the routes in them found.

    Attributes:
        find: a view ↦ its routes, in index coordinates of the whole map.
        choose: problems, costs [voxels] ↦ the windows that no way of its cost leaves; see `windows_around`.
        full: shape of a window ↦ how many problems a view of such windows holds at most.
        together: how many views are shown at a time, each in a thread; 1: in the thread that asks.
        prepare: called before, with all views of the first windows.
    """

    find: Callable[[View], Routes]
    choose: Callable[[Task, Float64[np.ndarray, " b"]], Windows] = windows_around
    full: Callable[[Index3], float] = lambda shape: math.inf
    together: int = 1
    prepare: Callable[[list[View]], None] = lambda views: None


FinderOf = Callable[[Task], WindowFinder]


def find_in_windows(task: Task, finder: WindowFinder, whole: Callable[[Task], Routes]) -> Routes:
    """Routes of a task by windows that grow until they prove what they show, at last by whole maps.

    Args:
        task: what to plan.
        finder: of windows of its maps.
        whole: routes of what no window answers.

    Returns:
        One route a problem, with the timings of all its windows.
    """
    growth = _Growth(task, finder.choose)
    finder.prepare(growth.waiting_views())

    def find(asked: _Asked) -> Routes:
        return whole(task.some(asked.rows)) if asked.whole else finder.find(growth.view(asked.rows))

    for asked, routes in as_finished(lambda: growth.take(finder.full), find, finder.together):
        growth.answer(asked, routes)
    return growth.found


class _Asked(NamedTuple):
    """Problems that are shown together, in windows of one shape or as whole maps."""

    rows: Int64[np.ndarray, " r"]
    whole: bool


class _Growth:
    """The problems of a task on their way.

    Attributes:
        task: what to plan.
        found: routes so far.
    """

    def __init__(self, task: Task, choose: Callable[[Task, Float64[np.ndarray, " b"]], Windows]) -> None:
        count = len(task)
        self.task, self.found, self._choose = task, Routes.blank(count), choose
        # By which the windows are chosen; the windows; problems that wait for theirs, by shape, the smallest first; and
        # those that wait for the whole map.
        self._costs = guess_costs(task.index, np)
        self._windows = Windows.upright(np.zeros((count, 3), np.int64), np.zeros((count, 3), np.int64), np.zeros(count))
        self._waiting: dict[Index3, list[int]] = {shape: [] for shape in focus_window.SHAPES}
        self._beyond: list[int] = []
        self._ask(np.arange(count))

    def view(self, rows: Int64[np.ndarray, " r"]) -> View:
        """The windows of some problems, which have one shape."""
        return View(self.task.some(rows), self._windows.some(rows))

    def waiting_views(self) -> list[View]:
        """Views of all that wait."""
        return [self.view(np.array(rows)) for rows in self._waiting.values() if rows]

    def take(self, full: Callable[[Index3], float]) -> _Asked | None:
        """What to show next: the fullest view, whole maps where no window waits; None: nothing waits."""
        shapes = [shape for shape, rows in self._waiting.items() if rows]
        if shapes:
            shape = max(shapes, key=lambda shape: min(len(self._waiting[shape]) / full(shape), 1.0))
            count = int(min(full(shape), len(self._waiting[shape])))
            taken, self._waiting[shape] = self._waiting[shape][:count], self._waiting[shape][count:]
            return _Asked(np.array(taken), False)
        rows, self._beyond = np.array(self._beyond, np.int64), []
        return _Asked(rows, True) if rows.size else None

    def answer(self, asked: _Asked, routes: Routes) -> None:
        """Routes of some problems; those that their windows do not prove are asked again."""
        rows = asked.rows
        if asked.whole:
            # A path that a window did not prove the cheapest is better than none.
            better = routes.ok | ~self.found.ok[rows]
            found = self.found.put(rows[better], routes.some(better))
            self.found = found.add_seconds(rows[~better], routes.some(~better).timings)
            return
        self.found = self.found.put(rows, routes)
        status, path = np.asarray(routes.route.status), np.asarray(routes.route.path, np.float64)
        costs = path_costs(path, np.asarray(routes.route.cost, np.float64) / self.task.grid.spacing, np)
        rest = ~is_proved(status, costs, self._windows.bounds[rows])
        if rest.any():
            self._costs[rows[rest]] = next_costs(status, costs, self._costs[rows], np)[rest]
            self._ask(rows[rest])

    def _ask(self, rows: Int64[np.ndarray, " r"]) -> None:
        """Choose windows for some problems, which wait for them from now on."""
        windows = self._choose(self.task.some(rows), self._costs[rows])
        for of_all, of_some in zip(self._windows, windows, strict=True):
            of_all[rows] = of_some
        beyond = np.isnan(windows.bounds)
        for shape, waiting in self._waiting.items():
            waiting += rows[~beyond & (windows.shapes == shape).all(axis=1)].tolist()
        self._beyond += rows[beyond].tolist()
