"""Windows that grow until they prove what they show, at last to the whole map: the routes of a task.

    cost → window → routes → proved
             ↑        └→ a higher cost → a larger window | the whole map

Each problem goes its own way. Those that wait for windows of one shape are shown together: as many as make a full view
at once, fewer only when there is nothing fuller to do, so that others may still join them.

Costs and bounds [voxels].
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Int64

from maxjax.compile.threads import as_finished
from maxjax.core.grid import Index3
from maxjax.planning.path.route import Routes
from maxjax.planning.problem.task import Task
from maxjax.planning.windows import focus_window
from maxjax.planning.windows.focus_window import View, Windows, windows_around
from maxjax.planning.windows.geometry import guess_costs, is_proved, next_costs, path_costs


@dataclasses.dataclass(frozen=True)
class ViewSolver:
    """How a device finds the routes of views.

    Attributes:
        find: a view ↦ its routes, in index coordinates of the whole map.
        full: shape of a window ↦ how many problems a view of such windows holds at most.
        together: how many views are shown at a time, each in a thread; 1: in the thread that asks.
        prepare: what to do before, with all views of the first windows.
    """

    find: Callable[[View], Routes]
    full: Callable[[Index3], float] = lambda shape: math.inf
    together: int = 1
    prepare: Callable[[list[View]], None] = lambda views: None


def find_in_windows(task: Task, solver: ViewSolver, whole: Callable[[Task], Routes]) -> Routes:
    """Routes of a task by windows that grow until they prove what they show, at last by whole maps.

    Args:
        task: what to plan.
        solver: finds the routes of windows.
        whole: routes of what no window answers.

    Returns:
        One route a problem, with the timings of all its windows.
    """
    growth = _Growth(task)
    solver.prepare(growth.waiting_views())

    def find(rows: Int64[np.ndarray, " r"]) -> Routes:
        return solver.find(growth.view(rows))

    for rows, routes in as_finished(lambda: growth.take(solver.full), find, solver.together):
        growth.answer(rows, routes)
    return growth.with_whole_maps(whole)


class _Growth:
    """The problems of a task on their way.

    Attributes:
        task: what to plan.
        found: routes so far.
    """

    def __init__(self, task: Task) -> None:
        count = len(task)
        self.task, self.found = task, Routes.blank(count)
        # By which the windows are chosen; the windows; rows that wait for theirs, by shape; rows that have none.
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

    def take(self, full: Callable[[Index3], float]) -> Int64[np.ndarray, " r"] | None:
        """Problems of the next view, which wait no longer: a full one, else of the smallest windows; None: none."""
        shapes = [shape for shape, rows in self._waiting.items() if rows]
        if not shapes:
            return None
        shape = next((shape for shape in shapes if len(self._waiting[shape]) >= full(shape)), shapes[0])
        count = int(min(full(shape), len(self._waiting[shape])))
        taken, self._waiting[shape] = self._waiting[shape][:count], self._waiting[shape][count:]
        return np.array(taken)

    def answer(self, rows: Int64[np.ndarray, " r"], routes: Routes) -> None:
        """Routes of some problems; those that their windows do not prove are asked again."""
        self.found = self.found.put(rows, routes)
        status, path = np.asarray(routes.route.status), np.asarray(routes.route.path, np.float64)
        costs = path_costs(path, np.asarray(routes.route.cost, np.float64) / self.task.grid.spacing, np)
        rest = ~is_proved(status, costs, self._windows.bounds[rows])
        if rest.any():
            self._costs[rows[rest]] = next_costs(status, costs, self._costs[rows], np)[rest]
            self._ask(rows[rest])

    def with_whole_maps(self, whole: Callable[[Task], Routes]) -> Routes:
        """All routes, where no window answers those of whole maps."""
        rest = np.array(sorted(self._beyond), np.int64)
        if not rest.size:
            return self.found
        answers = whole(self.task.some(rest))
        # A path that a window did not prove the cheapest is better than none.
        better = answers.ok | ~self.found.ok[rest]
        found = self.found.put(rest[better], answers.some(better))
        return found.add_seconds(rest[~better], answers.some(~better).timings)

    def _ask(self, rows: Int64[np.ndarray, " r"]) -> None:
        """Choose windows for some problems, which wait for them from now on."""
        windows = windows_around(self.task.some(rows), self._costs[rows])
        for of_all, of_some in zip(self._windows, windows, strict=True):
            of_all[rows] = of_some
        beyond = np.isnan(windows.bounds)
        for shape, waiting in self._waiting.items():
            waiting += rows[~beyond & (windows.shapes == shape).all(axis=1)].tolist()
        self._beyond += rows[beyond].tolist()
