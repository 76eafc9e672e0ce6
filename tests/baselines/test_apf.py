"""The artificial potential field keeps off blocked voxels and, in a dead end, says that it is stuck."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax import APF, AStar, Distances, Grid, Status, VoxelMap, plan
from maxjax.baselines.apf import descend, distance_field, look

GRID = Grid((25, 25, 25), 1.0, (0.0, 0.0, 0.0))
START, GOAL = (3.0, 12.0, 12.0), (21.0, 12.4, 12.0)


def distance_to_cubes(blocked: np.ndarray, x: np.ndarray) -> float:
    """From x to the nearest closed cube, by looking at all of them."""
    cubes = np.argwhere(blocked)
    return float(np.linalg.norm(x - np.clip(x, cubes - 0.5, cubes + 0.5), axis=1).min())


def test_the_room_is_the_exact_distance_up_to_half_a_voxel() -> None:
    rng = np.random.default_rng(0)
    blocked = rng.random((9, 9, 9)) < 0.06
    distance = distance_field(blocked)
    near = 0
    for x in rng.uniform(0, 8, (400, 3)):
        exact = distance_to_cubes(blocked, x)
        near += exact < 0.5
        assert look(distance, x)[2] == pytest.approx(min(exact, 0.5), abs=1e-12)
    assert near > 50


def test_the_gradient_is_that_of_the_distance() -> None:
    rng = np.random.default_rng(1)
    blocked = rng.random((15, 15, 15)) < 0.003
    distance = distance_field(blocked)
    h = 1e-6 * np.eye(3)
    seen = 0
    # Away from the faces of the interpolation's cells, where its gradient jumps.
    for x in rng.integers(0, 14, (200, 3)) + rng.uniform(0.01, 0.99, (200, 3)):
        d, gradient, room = look(distance, x)
        if room < 0.5 or d < 0.5 + 1e-5:
            continue
        seen += 1
        slope = [(look(distance, x + e)[0] - look(distance, x - e)[0]) / 2e-6 for e in h]
        assert np.allclose(gradient, slope, atol=1e-6)
        centres = np.linalg.norm(np.argwhere(blocked) - x, axis=1).min()
        assert d == pytest.approx(centres - 0.5, abs=0.5)
    assert seen > 100


def test_empty_space_is_crossed_on_the_straight_line() -> None:
    found = plan(
        VoxelMap.on(GRID, np.zeros(GRID.shape, bool)),
        START,
        GOAL,
        planner=APF(),
        distances=Distances(radius=0.0, margin=0.0),
    )
    assert found.status is Status.OK
    assert found.method == "apf"
    assert found.length == pytest.approx(np.linalg.norm(np.subtract(GOAL, START)), rel=1e-4)
    assert np.array_equal(found.path[[0, -1]], np.array([START, GOAL]))


def test_a_convex_obstacle_is_passed_by() -> None:
    x, y, z = np.indices(GRID.shape)
    ball = (x - 12) ** 2 + (y - 10.5) ** 2 + (z - 12) ** 2 <= 9
    found = plan(VoxelMap.on(GRID, ball), START, GOAL, planner=APF(), distances=Distances(radius=0.0, margin=0.0))
    assert found.status is Status.OK
    assert found.clearance > 0.05
    assert 18.0 < found.length < 1.25 * 18.0


def test_a_price_pushes_the_path_off_a_wall() -> None:
    floor = np.zeros(GRID.shape, bool)
    floor[:, :, :9] = True
    distance, ends = distance_field(floor), (np.array(START), np.array(GOAL))
    price = np.maximum(distance, 0)
    bare, priced = descend(distance, *ends), descend(distance, *ends, 1 + 4 * np.maximum(1 - price / 8, 0) ** 2)
    assert bare is not None
    assert priced is not None
    assert bare[:, 2].max() < 12.1
    assert priced[:, 2].max() > 12.3


def test_a_dead_end_is_a_local_minimum_and_has_no_path() -> None:
    cup = np.zeros(GRID.shape, bool)
    cup[14, 6:19, 6:19] = True
    for axis in (1, 2):
        for side in (6, 18):
            index: list[int | slice] = [slice(8, 15), slice(6, 19), slice(6, 19)]
            index[axis] = side
            cup[tuple(index)] = True
    stuck = plan(VoxelMap.on(GRID, cup), START, GOAL, planner=APF(), distances=Distances(radius=0.0, margin=0.0))
    assert stuck.status is Status.PATH_STALLED
    assert stuck.path.shape == (0, 3)
    assert (
        plan(VoxelMap.on(GRID, cup), START, GOAL, planner=AStar(), distances=Distances(radius=0.0, margin=0.0)).status
        is Status.OK
    )


@pytest.mark.parametrize(("density", "radius"), [(0.005, 0.0), (0.02, 0.0), (0.1, 0.0), (0.005, 0.5), (0.02, 0.5)])
def test_clutter_is_never_touched(density: float, radius: float) -> None:
    rng = np.random.default_rng(7)
    arrived = 0
    for _ in range(8):
        blocked = rng.random(GRID.shape) < density
        start, goal = rng.uniform(1, 23, (2, 3)).astype(np.float32)
        for end in (start, goal):
            blocked[tuple(np.floor(end + 0.5).astype(int))] = False
        found = plan(
            VoxelMap.on(GRID, blocked),
            start,
            goal,
            planner=APF(),
            distances=Distances(radius=radius, margin=6 * radius),
        )
        # A path that touches something would be PATH_IN_COLLISION.
        assert found.status in (Status.OK, Status.PATH_STALLED, Status.NO_VALID_PATH)
        arrived += found.status is Status.OK
    if density < 0.01:
        assert arrived >= 4
