"""RRT* finds verified paths, the same for the same seed, no longer for more samples; edges are checked exactly."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from maxjax import Grid, Plan, Status, plan, verify
from maxjax.planning.baselines.rrt_star import line_of_sight, rrt_star
from maxjax.planning.execute import plan_one
from maxjax.planning.task import Task

GRID = Grid((25, 25, 25), 1.0, (0.0, 0.0, 0.0))
START, GOAL = np.array([3, 12, 12], np.float32), np.array([21, 12, 12], np.float32)


def wall(gap: bool) -> np.ndarray:
    """A wall across the grid, with a gap of 3 x 3 voxels off the line from start to goal, or without."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[12] = True
    occupied[12, 17:20, 11:14] = not gap
    return occupied


def grow(occupied: np.ndarray, iterations: int, seed: int = 1) -> Plan:
    return plan_one(Task.of(occupied, START[None], GOAL, GRID, 0.0), rrt_star(iterations, seed), "rrtstar")


@pytest.mark.parametrize("density", [0.02, 0.05])
def test_edges_are_clear_exactly_where_verify_says_so(density: float) -> None:
    rng = np.random.default_rng(0)
    blocked = rng.random(GRID.shape) < density
    clear = line_of_sight(blocked)
    counts = {True: 0, False: 0}
    for a in rng.uniform(0, 24, (200, 3)):
        b = np.clip(a + rng.normal(0, 4, 3), 0, 24)
        verdict = verify(np.stack([a, b]), blocked, blocked, GRID)
        seen = clear(a, b)
        counts[seen] += 1
        if seen:
            assert verdict.ok
        elif verdict.ok:  # refused, though free: it passes close to an edge or a corner
            assert verdict.clearance < 0.45
    assert min(counts.values()) > 20


def test_edges_refuse_faces_corners_and_what_leaves_the_grid() -> None:
    blocked = np.zeros((5, 5, 5), bool)
    blocked[2, 2, 2] = True
    clear = line_of_sight(blocked)
    x = np.array([0.0, 0.0, 2.0])
    assert not clear(x, np.array([4.0, 4.0, 2.0]))
    assert not clear(np.array([1.5, 0.0, 2.0]), np.array([1.5, 4.0, 2.0]))
    assert not clear(np.array([0.0, 3.0, 2.0]), np.array([3.0, 0.0, 2.0]))  # through an edge of the cube
    assert clear(np.array([0.0, 2.0, 0.0]), np.array([0.0, 2.0, 4.0]))
    assert clear(x, x)
    assert not clear(x, np.array([-0.5, 0.0, 2.0]))


def test_a_missing_ompl_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is computed: the first plan of a process compiles for seconds."""
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.setattr("maxjax.api.plan_task", None)
    with pytest.raises(ImportError, match=r"maxjax\[bench\]"):
        plan(wall(gap=True), START, GOAL, GRID, method="rrtstar", margin=0.0)


class TestTree:
    """What the tree itself does."""

    @pytest.fixture(autouse=True)
    def _ompl(self) -> None:
        pytest.importorskip("ompl", reason="RRT* is OMPL's: pip install 'maxjax[bench]'")

    def test_a_wall_is_passed_through_its_gap(self) -> None:
        found = plan(wall(gap=True), START, GOAL, GRID, method="rrtstar", margin=0.0)
        assert found.status is Status.OK
        assert found.method == "rrtstar"
        assert np.array_equal(found.path[[0, -1]], np.stack([START, GOAL]))
        # No path through the gap is shorter than that over its nearest edge.
        shortest = 2 * np.hypot(9, 4.5)
        assert shortest <= found.length <= 1.1 * shortest

    def test_more_samples_never_lengthen_the_path(self) -> None:
        lengths = [grow(wall(gap=True), n).length for n in (400, 800, 1600)]
        assert lengths == sorted(lengths, reverse=True)
        assert lengths[-1] < lengths[0]

    def test_the_same_seed_gives_the_same_path(self) -> None:
        paths = [grow(wall(gap=True), 600, seed).path for seed in (3, 3, 4)]
        assert np.array_equal(paths[0], paths[1])
        assert not np.array_equal(paths[0], paths[2])

    def test_a_tree_that_is_too_small_has_stalled(self) -> None:
        found = grow(wall(gap=True), 3)
        assert found.status is Status.PATH_STALLED
        assert found.path.shape == (0, 3)

    def test_no_passage_is_proved_before_anything_is_sampled(self) -> None:
        assert grow(wall(gap=False), 10**9).status is Status.NO_VALID_PATH

    def test_paths_through_clutter_pass_the_judge(self) -> None:
        rng = np.random.default_rng(5)
        for _ in range(6):
            occupied = rng.random(GRID.shape) < 0.05
            occupied[tuple(START.astype(int))] = occupied[tuple(GOAL.astype(int))] = False
            found = grow(occupied, 600)
            assert found.status is Status.OK
            assert verify(found.path, occupied, occupied, GRID).ok
