"""Routes by programs of a fixed list of shapes, compiled beforehand, while there is time: for a loop on board.

    shapes of a grid:   windows of less than half of it (`planning.windows.focus_window`), and the grid itself

A window is chosen as for any plan, so that a route is the same, but for ascents: there is one, of `LONGER` times the
planner's steps, in place of a retry with other programs. Nothing stops a program that runs. So a shape is asked only if
what it took last time still fits, and what was found until then is the answer: a route that no window has proved the
cheapest is certified like any other.
"""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from maxjax.compile.lowering import target
from maxjax.compile.stage_timer import recording
from maxjax.core.grid import Grid, Index3
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.path.route import Routes, equal_shares
from maxjax.planning.planner import FieldClimber
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run import pipeline
from maxjax.planning.run.execution import find_one_by_one, stage_finder
from maxjax.planning.windows import focus_window
from maxjax.planning.windows.focus_window import View, Windows
from maxjax.planning.windows.geometry import worthwhile
from maxjax.planning.windows.growth import WindowFinder, find_in_windows

LONGER = 4
# By what the time of a shape shrinks when it is not asked: one slow turn is not held against it for ever.
_FORGOTTEN = 0.9


class _LateError(Exception):
    """The next shape would not be done in time."""


class FixedShapes:
    """Finds routes on one grid.

    Attributes:
        grid: shape and spacing of all maps; they may lie anywhere.
        planner: with the steps of its ascents.
        distances: to keep.
    """

    def __init__(self, grid: Grid, planner: FieldClimber, distances: Distances) -> None:
        ascent = dataclasses.replace(planner.ascent, steps=LONGER * planner.ascent.steps)
        self.grid, self.planner, self.distances = grid, planner.with_ascent(ascent), distances
        self._finder = stage_finder(self.planner, factors=())
        # What each shape took when it was last asked [s].
        self._seconds: dict[Index3, float] = {}

    @property
    def shapes(self) -> tuple[Index3, ...]:
        """Of all windows that may be asked, and of the grid."""
        whole = self.grid.shape
        few = [shape for shape in focus_window.SHAPES if worthwhile(shape, whole)]
        return (*(few if self.planner.focus else []), whole)

    def warm_up(self) -> None:
        """Compile all that `route` may ask for, and take the time of each shape."""
        nothing = VoxelMap.on(self.grid, np.zeros(self.grid.shape, bool))
        for shape in self.shapes:
            far = np.minimum(shape, self.grid.shape) - 1
            ends = [self.grid.to_metres(np.round(share * far)) for share in (0.25, 0.75)]
            task = Task.of(nothing, ends[0][None], ends[1], self.distances)
            windows = Windows.upright(np.zeros((1, 3), np.int64), np.array([shape], np.int64), np.array([math.inf]))
            for _ in range(2):
                self._ask(View(task, None if shape == self.grid.shape else windows))

    def route(self, task: Task, until: float) -> Routes:
        """The route of the only problem of a task; TIMEOUT where none was found in time.

        Args:
            task: on a grid of this shape and spacing.
            until: when to answer, by `time.perf_counter` [s].
        """
        best = Routes.blank(1, Status.TIMEOUT)

        def find(view: View) -> Routes:
            nonlocal best
            if time.perf_counter() + self._seconds[view.grid.shape] > until:
                self._seconds[view.grid.shape] *= _FORGOTTEN
                raise _LateError
            found = self._ask(view)
            best = found if found.ok.all() else best
            return found

        def whole(some: Task) -> Routes:
            return find(View(some))

        try:
            return find_in_windows(task, WindowFinder(find), whole) if self.planner.focus else whole(task)
        except _LateError:
            return best

    def _ask(self, view: View) -> Routes:
        """The route that a view shows."""
        started = time.perf_counter()
        if target() == "cpu":
            found = find_one_by_one(view, self.planner, self._finder)
        else:
            with recording() as recorder:
                route = pipeline.run_one(view, self.planner)
            found = Routes(route, equal_shares(recorder, 1))
        self._seconds[view.grid.shape] = time.perf_counter() - started
        return found
