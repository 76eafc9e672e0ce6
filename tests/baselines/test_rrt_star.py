"""RRT* finds verified paths, the same for the same seed, no longer for more samples; edges are checked exactly."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest
from scipy import ndimage

from maxjax import Grid, Plan, RRTStar, Status, VoxelMap, plan, verify
from maxjax.baselines.rrt_star import _grow, cost_of_segments, line_of_sight
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task

GRID = Grid((25, 25, 25), 1.0, (0.0, 0.0, 0.0))
START, GOAL = np.array([3, 12, 12], np.float32), np.array([21, 12, 12], np.float32)


def wall(gap: bool) -> np.ndarray:
    """A wall across the grid, with a gap of 3 x 3 voxels off the line from start to goal, or without."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[12] = True
    occupied[12, 17:20, 11:14] = not gap
    return occupied


def grow(occupied: np.ndarray, iterations: int, seed: int = 1) -> Plan:
    task = Task.of(VoxelMap.on(GRID, occupied), START[None], GOAL, Distances(0.0, 0.0))
    return plan_task(task, RRTStar(iterations, seed))[0]


@pytest.mark.parametrize("density", [0.02, 0.05])
def test_edges_are_clear_exactly_where_verify_says_so(density: float) -> None:
    rng = np.random.default_rng(0)
    blocked = rng.random(GRID.shape) < density
    clear = line_of_sight(blocked)
    counts = {True: 0, False: 0}
    for a in rng.uniform(0, 24, (200, 3)):
        b = np.clip(a + rng.normal(0, 4, 3), 0, 24)
        verdict = verify(np.stack([a, b]), VoxelMap.on(GRID, blocked))
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


def test_edges_with_room_keep_to_the_dual_cells() -> None:
    """Sampled densely: a point is allowed if the voxels that the open box of one voxel around it overlaps are free."""
    rng = np.random.default_rng(3)
    blocked = rng.random(GRID.shape) < 0.01
    clear = line_of_sight(blocked, 0.5)
    counts = {True: 0, False: 0}
    for a in rng.uniform(0.5, 23.5, (150, 3)):
        b = np.clip(a + rng.normal(0, 4, 3), 0.5, 23.5)
        line = a + np.linspace(0, 1, 400)[:, None] * (b - a)
        allowed = True
        for corner in np.ndindex(2, 2, 2):
            allowed &= not blocked[tuple(np.where(corner, np.ceil(line), np.floor(line)).astype(int).T)].any()
        seen = clear(a, b)
        counts[seen] += 1
        assert allowed or not seen
        if allowed and not seen:  # it passes close to an edge of the boxes around the blocked voxels
            gaps = np.abs(line[:, None] - np.argwhere(blocked)).max(axis=-1)
            assert gaps.min() < 1.25
    assert min(counts.values()) > 20


def test_a_corridor_of_one_voxel_is_clear_along_its_middle() -> None:
    blocked = np.ones((7, 5, 5), bool)
    blocked[:, 2, 2] = False
    clear = line_of_sight(blocked, 0.5)
    assert clear(np.array([0.0, 2, 2]), np.array([6.0, 2, 2]))
    assert clear(np.array([0.3, 2, 2]), np.array([5.6, 2, 2.0001]))
    assert not clear(np.array([0.0, 2, 2]), np.array([6.0, 2.1, 2]))
    assert not clear(np.array([0.0, 2, 2]), np.array([6.1, 2, 2]))  # half a voxel from the outside


def test_an_edge_costs_the_integral_of_its_price() -> None:
    rng = np.random.default_rng(4)
    price = 1 + 4 * rng.random((9, 8, 7))
    price = ndimage.gaussian_filter(price, 1)
    cost = cost_of_segments(price)
    for _ in range(40):
        a, b = rng.uniform(-0.5, np.array(price.shape) - 0.5, (2, 3))
        points = a + (np.arange(4000)[:, None] + 0.5) / 4000 * (b - a)
        values = ndimage.map_coordinates(price, points.T, order=0, mode="nearest")
        assert cost(a, b) == pytest.approx(np.linalg.norm(b - a) * values.mean(), rel=0.15)
    assert cost(a, a) == 0


def test_a_missing_ompl_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is computed: the first plan of a process compiles for seconds."""
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(ImportError, match=r"maxjax\[bench\]"):
        RRTStar()


class TestTree:
    """What the tree itself does."""

    @pytest.fixture(autouse=True)
    def _ompl(self) -> None:
        pytest.importorskip("ompl", reason="RRT* is OMPL's: pip install 'maxjax[bench]'")

    def test_a_wall_is_passed_through_its_gap(self) -> None:
        found = plan(
            VoxelMap.on(GRID, wall(gap=True)),
            START,
            GOAL,
            planner=RRTStar(),
            distances=Distances(radius=0.0, margin=0.0),
        )
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

    def test_a_price_is_avoided(self) -> None:
        price = np.ones(GRID.shape, np.float32)
        price[8:17, 6:19, :] = 6
        ends = [START.astype(float), GOAL.astype(float)]
        paths = [_grow(np.zeros(GRID.shape, bool), ends, 300, prices, 0.5) for prices in (None, price)]
        costs = []
        for path in paths:
            assert path is not None
            costs.append(sum(cost_of_segments(price)(a, b) for a, b in itertools.pairwise(path)))
        assert costs[0] > 1.8 * costs[1]  # 9 voxels at 6 against a detour of about 4
        assert costs[1] < 32

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
            assert verify(found.path, VoxelMap.on(GRID, occupied)).ok
