"""Clearance is exact: by bounded least squares, and between bounds from dense samples in a city."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_erosion
from scipy.optimize import lsq_linear

from maxjax import Grid, Status, VoxelMap
from maxjax.planning.search.astar import astar
from maxjax.verification.polylines import Paths
from maxjax.verification.verifier import verify, verify_paths
from tests.references import to_world

pytestmark = pytest.mark.usefixtures("each_verifier")


def bounded_distance(a: np.ndarray, b: np.ndarray, voxel: np.ndarray, size: np.ndarray | int = 1) -> float:
    """Distance from a segment to a closed box of voxels: bounded least squares over t and the nearest point."""
    matrix = np.column_stack([b - a, -np.eye(3)])
    bounds = (np.array([0.0, *voxel]), np.array([1.0, *(voxel + size)]))
    return math.sqrt(2 * lsq_linear(matrix, -a, bounds, method="bvls", tol=1e-14).cost)


@pytest.mark.large
@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    length=st.integers(1, 4),
    count=st.integers(1, 12),
    lattice=st.booleans(),
    spacing=st.sampled_from([1.0, 0.3, 2.0]),
    widest=st.sampled_from([14, 60]),
)
def test_clearance_is_the_least_distance(
    seed: int, length: int, count: int, lattice: bool, spacing: float, widest: int
) -> None:
    """Also where the nearest voxel lies beyond the window that is searched first, and where ground is nearer."""
    rng = np.random.default_rng(seed)
    grid = Grid(tuple(rng.integers(1, widest, 3).tolist()), spacing)
    path = rng.random((length, 3)) * np.minimum(grid.shape, 14)
    path = np.round(path) if lattice else path
    voxels = rng.integers(0, grid.shape, (count, 3))
    occupied = np.zeros(grid.shape, bool)
    occupied[tuple(voxels.T)] = True
    segments = list(itertools.pairwise(path)) or [(path[0], path[0])]
    expected = min(bounded_distance(a, b, v) for a, b in segments for v in voxels)
    ground = ~occupied & (rng.random(grid.shape) < rng.choice([0.0, 0.3]))
    result = verify(
        to_world(path, grid), VoxelMap.on(grid, occupied | ground, ground), blocked=np.zeros(grid.shape, bool)
    )
    assert result.clearance == pytest.approx(spacing * expected, rel=1e-6, abs=1e-6 * spacing)
    assert result.length == pytest.approx(spacing * sum(np.linalg.norm(b - a) for a, b in segments))


@pytest.mark.large
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), largest=st.sampled_from([1, 6, 40]))
def test_clearance_is_the_least_distance_for_each_path_of_a_batch(seed: int, largest: int) -> None:
    """Whole buildings, next to one path and far from another; maps may share their memory."""
    rng = np.random.default_rng(seed)
    grid = Grid((45, 31, 58), 2.0, (-10.0, 0.0, 5.0))
    paths = [rng.random((length, 3)) * rng.choice([(4, 4, 4), grid.shape]) for length in rng.integers(1, 6, 4)]
    corners = rng.integers(0, grid.shape, (2, 3, 3))
    sizes = np.minimum(rng.integers(1, largest + 1, (2, 3, 3)), grid.shape - corners)
    occupied = np.zeros((2, *grid.shape), bool)
    for k, box in itertools.product(range(2), range(3)):
        occupied[(k, *map(slice, corners[k, box], corners[k, box] + sizes[k, box]))] = True
    free, which = np.broadcast_to(False, occupied.shape), np.array([1, 0, 1, 1])
    ground = ~occupied & (np.arange(grid.shape[2]) < rng.integers(0, 3))
    filled = occupied | ground
    given = Paths.of([to_world(path, grid) for path in paths], which)
    verdicts = verify_paths(given, VoxelMap.on(grid, filled, ground), blocked=free)
    for path, k, verdict in zip(paths, which, verdicts, strict=True):
        ends = list(itertools.pairwise(path)) or [(path[0], path[0])]
        boxes = list(zip(corners[k], sizes[k], strict=True))
        expected = min(bounded_distance(a, b, *box) for (a, b), box in itertools.product(ends, boxes))
        assert verdict.clearance == pytest.approx(2 * expected, rel=1e-6, abs=1e-6)


def test_a_far_voxel_that_is_found_first_hides_no_nearer_one() -> None:
    """Next to the box around a diagonal path lies one 14 voxels away; above that box, one 12 voxels away."""
    grid = Grid((45, 45, 45), 1.0, (0.5, 0.5, 0.5))
    occupied = np.zeros(grid.shape, bool)
    occupied[30, 9, 10] = occupied[20, 20, 22] = True
    path = np.array([[10.0, 10.0, 10.0], [30.0, 30.0, 10.0]])
    assert verify(path, VoxelMap.on(grid, occupied)).clearance == 12


@pytest.mark.large
def test_city_at_full_size_agrees_with_dense_sampling() -> None:
    """A* through a dense city is legal, and samples along its path bracket the clearance."""
    grid, rng = Grid(), np.random.default_rng(5)
    occupied = np.zeros(grid.shape, bool)
    for x, y in itertools.product(range(4, 95, 13), repeat=2):
        occupied[x : x + rng.integers(4, 8), y : y + rng.integers(4, 8), : rng.integers(5, 60)] = True
    occupied[:, :, 0] = True
    surface = np.argwhere(occupied & ~binary_erosion(occupied, border_value=1))
    free = np.argwhere(~occupied[:, :, :8])
    for start, goal in rng.choice(free, (6, 2)).tolist():
        plan = astar(occupied, tuple(start), tuple(goal))
        assert plan.status is Status.OK
        path = (np.array(grid.origin) + grid.spacing * plan.path).astype(np.float32)
        result = verify(path, VoxelMap.on(grid, occupied))
        assert result.ok
        assert result.length == pytest.approx(grid.spacing * plan.length, rel=1e-6)
        u = plan.path + 0.5
        samples = np.concatenate([np.linspace(a, b, 9) for a, b in itertools.pairwise(u)])
        gaps = [np.abs(np.maximum(np.abs(surface + 0.5 - p) - 0.5, 0)) for p in samples]
        sampled = grid.spacing * min(np.linalg.norm(g, axis=1).min() for g in gaps)
        assert sampled - grid.spacing * math.sqrt(3) / 16 <= result.clearance <= sampled + 1e-4
