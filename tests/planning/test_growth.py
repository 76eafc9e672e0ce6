"""Windows grow until they prove what they show; problems join views that wait."""

import numpy as np
import pytest

from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.path.route import Route, Routes
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.windows import focus_window as focus
from maxjax.planning.windows.focus_window import View
from maxjax.planning.windows.growth import WindowFinder, find_in_windows

SHAPES = ((12, 8, 8), (18, 14, 12), (24, 20, 16))


@pytest.fixture
def task(monkeypatch: pytest.MonkeyPatch) -> Task:
    """Thirty problems in an empty map."""
    monkeypatch.setattr(focus, "SHAPES", SHAPES)
    rng = np.random.default_rng(1)
    starts = rng.uniform(20, 40, (30, 3))
    where = VoxelMap.of(np.zeros((60, 60, 60), bool), spacing=1.0, origin=(0.0, 0.0, 0.0))
    return Task.of(where, starts, starts + rng.uniform(-6, 6, (30, 3)), Distances(0.5, 4.0))


def routes_of(task: Task, factors: np.ndarray, status: Status = Status.OK) -> Routes:
    """Straight routes that cost more than their length by these factors."""
    lengths = np.linalg.norm(task.goals - task.starts, axis=1)
    count = len(task)
    path = np.stack([task.index[:, 0], task.index[:, 1]], axis=1)
    flags = np.ones(count, bool)
    return Routes(
        Route(
            path,
            np.full(count, int(status), np.int32),
            flags,
            np.zeros((count, 2), np.float32),
            ~flags,
            factors * lengths,
        )
    )


@pytest.mark.parametrize("together", [1, 3])
def test_every_problem_ends_with_a_window_that_proves_it_or_the_whole_map(task: Task, together: int) -> None:
    factors = np.random.default_rng(2).choice([1.1, 1.5, 3.0, 40.0], len(task))
    shown: list[tuple[int, tuple[int, int, int]]] = []
    wholes: list[int] = []
    row_of = {tuple(start): k for k, start in enumerate(task.starts)}

    def rows_of(some: Task) -> np.ndarray:
        return np.array([row_of[tuple(start)] for start in some.starts])

    def find(view: View) -> Routes:
        rows = rows_of(view.task)
        shown.extend((int(k), view.grid.shape) for k in rows)
        assert len(view) <= 4
        return routes_of(view.task, factors[rows])

    def whole(some: Task) -> Routes:
        wholes.extend(rows_of(some).tolist())
        return routes_of(some, factors[rows_of(some)])

    found = find_in_windows(task, WindowFinder(find, full=lambda shape: 4, together=together), whole)
    assert found.ok.all()
    np.testing.assert_allclose(found.route.cost, factors * np.linalg.norm(task.goals - task.starts, axis=1))
    # A window is never smaller than the one before, and the dearest have none.
    assert set(np.flatnonzero(factors == 40.0)) <= set(wholes)
    for k in range(len(task)):
        sizes = [np.prod(shape) for row, shape in shown if row == k]
        assert sizes == sorted(sizes)
    # A cost of 1.1 lengths is within what the first window was chosen by.
    assert all(sum(row == k for row, _ in shown) == 1 for k in np.flatnonzero(factors == 1.1))


def test_the_fullest_view_comes_first_and_those_that_grow_join_what_waits(task: Task) -> None:
    shown: list[tuple[tuple[int, int, int], int]] = []

    def find(view: View) -> Routes:
        shown.append((view.grid.shape, len(view)))
        return routes_of(view.task, np.full(len(view), 1.1 if view.grid.shape != SHAPES[0] else 2.0))

    views: list[View] = []
    finder = WindowFinder(find, full=lambda shape: 100, prepare=views.extend)
    find_in_windows(task, finder, lambda some: routes_of(some, np.ones(len(some))))
    first = {view.grid.shape: len(view) for view in views}
    assert sum(first.values()) == len(task)
    assert shown[0] == max(first.items(), key=lambda item: item[1])
    # One view of each shape: those whose first window was too small were shown with the others of the next shape.
    if shown[0][0] == SHAPES[0]:
        assert len(shown) == len({shape for shape, _ in shown})


def test_a_route_that_no_window_proved_is_kept_where_the_whole_map_has_none(task: Task) -> None:
    finder = WindowFinder(lambda view: routes_of(view.task, np.full(len(view), 1e3)))
    found = find_in_windows(task, finder, lambda some: routes_of(some, np.ones(len(some)), Status.NO_VALID_PATH))
    assert found.ok.all()
