"""Planning by name: one problem, many, or a scan; and what is wrong with the inputs, with what was given."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable

import numpy as np
import pytest

import maxjax
from maxjax import AStar, Distances, Grid, Plans, Status, VoxelMap, plan, plan_batch, plan_scan, verify
from tests.references import random_blocks, random_free

GRID = Grid((16, 18, 20), 2.0, (-10.0, 3.0, 1.0))
COUNT = 5


def world(index: np.ndarray) -> np.ndarray:
    return np.array(GRID.origin) + GRID.spacing * np.asarray(index, float)


@pytest.fixture(scope="module")
def problems() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Five problems: one sealed, one with its goal in a wall, the others feasible."""
    rng = np.random.default_rng(1)
    occupied = np.stack([random_blocks(rng, GRID.shape, 12, 5) for _ in range(COUNT)])
    ends = np.stack([world(random_free(rng, o, 2)) for o in occupied])
    occupied[3, 8] = True
    ends[3] = world([[1, 1, 1], [14, 14, 14]])
    occupied[3, 1, 1, 1] = occupied[3, 14, 14, 14] = False
    ends[4, 1] = world(np.argwhere(occupied[4])[0])
    return occupied, ends[:, 0], ends[:, 1]


@pytest.fixture(scope="module")
def batch(problems: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Plans:
    occupied, starts, goals = problems
    return plan_batch(VoxelMap.on(GRID, occupied), starts, goals, distances=Distances(margin=4.0))


def test_public_names_exist() -> None:
    assert all(hasattr(maxjax, name) for name in maxjax.__all__)
    assert len(set(maxjax.__all__)) == len(maxjax.__all__)


def test_a_batch_equals_single_plans(problems: tuple[np.ndarray, np.ndarray, np.ndarray], batch: Plans) -> None:
    assert len(batch) == COUNT
    for given, occupied, start, goal in zip(batch, *problems, strict=True):
        single = plan(VoxelMap.on(GRID, occupied), start, goal, distances=Distances(margin=4.0))
        assert given.status is single.status
        assert given.certified is single.certified
        assert given.exemptions == pytest.approx(single.exemptions, abs=1e-5)
        if single.status is Status.OK:
            # Rounding may choose another of two equal ways around.
            assert given.length == pytest.approx(single.length, rel=2e-3)
            assert verify(given.path, VoxelMap.on(GRID, occupied), radius=1.0, exemptions=given.exemptions).ok
            np.testing.assert_array_equal(given.path[[0, -1]], [start, goal])
    assert batch.status.tolist()[3:] == [Status.NO_VALID_PATH, Status.GOAL_OCCUPIED]
    assert (batch.status == Status.OK).sum() == 3


def test_a_batch_is_a_sequence_of_plans_and_its_numbers_are_arrays(batch: Plans) -> None:
    assert batch[-1].status == list(batch)[-1].status == batch[-1 - COUNT + COUNT].status
    assert [one.length for one in batch[1:3]] == pytest.approx(batch.length[1:3], nan_ok=True)
    with pytest.raises(IndexError):
        batch[COUNT]
    for name in ("status", "certified", "length", "clearance", "cruise_clearance", "cost", "radius", "exemptions"):
        np.testing.assert_array_equal(getattr(batch, name), [getattr(p, name) for p in batch])
        assert len(getattr(batch, name)) == COUNT
    for k, one in enumerate(batch):
        assert (one.margin, one.method) == (4.0, "field")
        assert batch.counts[k] == len(one.path) == len(one.clearance_at)
        np.testing.assert_array_equal(batch.points[k, : batch.counts[k]], one.path)
        np.testing.assert_array_equal(one.map.occupied, batch.map.occupied[k])
        if one.status is Status.OK:  # filled up with the last point
            assert (batch.points[k, batch.counts[k] :] == one.path[-1]).all()
    np.testing.assert_array_equal(batch.ok, batch.status == Status.OK)


def test_a_shared_map_equals_its_copies(problems: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    occupied, rng = problems[0][0], np.random.default_rng(2)
    starts, goals = (world(random_free(rng, occupied, COUNT)) for _ in range(2))
    ground = np.zeros(GRID.shape, bool)
    shared = plan_batch(VoxelMap.on(GRID, occupied, ground), starts, goals, distances=Distances(margin=4.0))
    copies = plan_batch(VoxelMap.on(GRID, np.stack([occupied] * COUNT)), starts, goals, distances=Distances(margin=4.0))
    for one, other in zip(shared, copies, strict=True):
        assert one.status is other.status
        np.testing.assert_array_equal(one.path, other.path)
    rivals = plan_batch(VoxelMap.on(GRID, occupied), starts, goals, planner=AStar(), distances=Distances(margin=4.0))
    for field, graph in zip(shared, rivals, strict=True):
        assert field.status is graph.status
        assert graph.method == "astar"
        if field.status is Status.OK:
            assert field.cost <= 1.05 * graph.cost


def test_a_second_plan_of_the_same_shape_compiles_nothing(
    problems: tuple[np.ndarray, np.ndarray, np.ndarray], batch: Plans
) -> None:
    for k in range(2):
        found = plan(VoxelMap.on(GRID, problems[0][k]), problems[1][k], problems[2][k], distances=Distances(margin=4.0))
    assert found.status is Status.OK
    assert found.timings["compile"] == 0
    stages = {"transfer", "formulate", "solve", "ascend", "tighten", "price", "verify"}
    assert stages <= set(found.timings)
    assert found.timings["total"] == pytest.approx(sum(found.timings[s] for s in stages))
    assert batch.status.shape == (COUNT,)
    solved = batch.status == Status.OK
    assert (batch.cost[solved] >= batch.length[solved] * (1 - 1e-6)).all()
    assert (batch.cruise_clearance[solved] >= batch.clearance[solved]).all()
    assert np.isnan([batch.cost[~solved], batch.cruise_clearance[~solved]]).all()
    again = plan_batch(
        VoxelMap.on(GRID, problems[0][::-1]), problems[1][::-1], problems[2][::-1], distances=Distances(margin=4.0)
    )
    assert again[0].timings["compile"] == 0


def test_takes_lists_integers_and_device_arrays() -> None:
    empty = np.zeros(GRID.shape, bool)
    for start, goal in (([-8, 5, 3], (18, 36, 38)), (np.array([-8, 5, 3]), np.array([18.0, 36, 38]))):
        found = _plan(VoxelMap.on(GRID, empty.tolist()), start, goal, planner=AStar())
        assert found.status is Status.OK
        np.testing.assert_array_equal(found.path[[0, -1]], np.array([start, goal], float))


def test_the_radius_is_never_lowered_in_silence() -> None:
    occupied = np.zeros(GRID.shape, bool)
    occupied[8] = True
    occupied[8, 5:8, 5:8] = False  # a window 3 voxels wide: its middle keeps 3 m
    ends = world([2, 9, 9]), world([14, 9, 9])
    found = plan(VoxelMap.on(GRID, occupied), *ends, distances=Distances(radius=3.0, margin=4.0))
    assert (found.status, found.radius, found.margin) == (Status.OK, 3.0, 4.0)
    assert found.clearance >= 3.0 - 2e-3
    assert found.cost > found.length
    shut = plan(VoxelMap.on(GRID, occupied, np.ones(GRID.shape, bool)), *ends, distances=Distances(margin=4.0))
    assert shut.status is Status.START_OCCUPIED


def test_scans() -> None:
    rng = np.random.default_rng(3)
    wall = np.stack([np.full(3000, 6.0), rng.uniform(2, 39, 3000), rng.uniform(0, 25, 3000)], axis=1)
    misses = np.concatenate([np.zeros((50, 3)), np.full((50, 3), np.nan), np.full((50, 3), 1e4)])
    start, goal = world([2, 9, 5]), world([14, 9, 5])
    found = plan_scan(np.concatenate([wall, misses]), start, goal, GRID, distances=Distances(margin=4.0))
    assert found.status is Status.OK
    assert found.length > math.dist(start, goal) + 5
    assert found.timings["voxelise"] > 0
    assert found.timings["total"] > found.timings["voxelise"]
    for nothing in (misses, misses[:0], misses[50:100], np.zeros((4, 3), np.int64)):
        empty = _scan(nothing, start, goal, GRID)
        assert empty.status is Status.EMPTY_SCAN
        assert empty.path.shape == (0, 3)
        assert not empty.certified
        assert math.isnan(empty.length)


EMPTY = VoxelMap.on(GRID, np.zeros(GRID.shape, bool))
SEVERAL = VoxelMap.on(GRID, np.zeros((3, *GRID.shape), bool))
POINT, TWO = np.zeros(3), np.zeros((2, 3))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: _plan(EMPTY.occupied, POINT, POINT), r"map: expected a maxjax.VoxelMap, given an array .*VoxelMap.of"),
        (lambda: _plan(None, POINT, POINT), "map: expected a maxjax.VoxelMap, given NoneType"),
        (lambda: _plan(SEVERAL, POINT, POINT), r"map: expected one map, given a batch of 3; take one, as map\[0\]"),
        (lambda: _plan(EMPTY, POINT[:2], POINT), r"start: expected numbers of shape \(3,\) .*given float64 \(2,\)"),
        (lambda: _plan(EMPTY, POINT, "goal"), r"goal: expected numbers of shape \(3,\).*given <U4 \(\)"),
        (lambda: _plan(EMPTY, POINT, POINT * 1j), "goal: expected numbers .*given complex128"),
        (lambda: _plan(EMPTY, None, POINT), r"start: expected numbers of shape \(3,\) .*given object"),
        (lambda: _plan(EMPTY, [1, [2], 3], POINT), "start: expected an array, given list"),
        (lambda: _plan(EMPTY, POINT, POINT, planner="astar"), "planner: expected a planner, as maxjax.Field.*'astar'"),
        (lambda: _plan(EMPTY, POINT, POINT, planner=AStar), "planner: expected a planner, .*given <class"),
        (lambda: _plan(EMPTY, POINT, POINT, distances=8.0), "distances: expected a maxjax.Distances, given 8.0"),
        (lambda: _plan(EMPTY, POINT, POINT, airspace=8.0), "airspace: expected a maxjax.Airspace, given 8.0"),
        (lambda: _batch(EMPTY, POINT, POINT), r"starts: .*shape \(b, 3\) with b >= 1 .*given float64 \(3,\)"),
        (lambda: _batch(EMPTY, TWO[:0], TWO[:0]), r"starts: expected .*b >= 1 .*given float64 \(0, 3\)"),
        (lambda: _batch(EMPTY, TWO, np.zeros((3, 3))), r"goals: expected .*\(2, 3\).*given .*\(3, 3\)"),
        (lambda: _batch(SEVERAL, TWO, TWO), "map: expected one map, or 2 maps for as many starts, given 3"),
        (lambda: _scan(np.zeros((5, 2)), POINT, POINT, GRID), r"points: expected .*\(n, 3\) .*given float64 \(5, 2\)"),
        (lambda: _scan(np.array(["a"]), POINT, POINT, GRID), r"points: expected numbers .*given <U1 \(1,\)"),
        (lambda: _scan(np.zeros((5, 3)), POINT, POINT, GRID, planner="astar"), "planner: expected a planner"),
        (lambda: _scan(np.full((5, 3), 1 + 2j), POINT, POINT, GRID), r"points: expected numbers .*given complex128"),
        (lambda: _scan(np.zeros((5, 3)), POINT, POINT, None), "map: expected a maxjax.VoxelMap, given NoneType"),
    ],
)
def test_wrong_arguments_are_told_with_what_was_given(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


# As users call them: without the run-time type checks of the tests.
_plan, _batch, _scan = (inspect.unwrap(function) for function in (plan, plan_batch, plan_scan))
