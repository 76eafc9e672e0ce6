"""The judge is exact: by rational arithmetic, by bounded least squares, along edges and through corners."""

from __future__ import annotations

import inspect
import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from references import touched
from scipy.ndimage import binary_erosion
from scipy.optimize import lsq_linear

from maxjax import Grid, Status
from maxjax.planning.baselines.astar import astar
from maxjax.planning.judge import touched_voxels, verify, verify_batch

GRID = Grid((4, 3, 5), 2.0, (-1.0, 4.0, 0.5))
UNIT = Grid((5, 4, 3), 1.0, (0.5, 0.5, 0.5))  # here index coordinates are world coordinates

quarters = st.integers(-3, 23).map(lambda n: n / 4)
lattice_points = st.tuples(quarters, quarters, quarters).map(np.array)
coordinates = st.one_of(st.floats(-1, 6), st.integers(-1, 6).map(float))
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)


def world(u: np.ndarray, grid: Grid) -> np.ndarray:
    """Index coordinates (voxel i being [i, i + 1]) in metres."""
    return np.array(grid.origin) + grid.spacing * (np.asarray(u, float) - 0.5)


def as_set(voxels: np.ndarray) -> set[tuple[int, ...]]:
    assert len(np.unique(voxels, axis=0)) == len(voxels)
    return set(map(tuple, voxels.tolist()))


@settings(max_examples=400, deadline=None)
@given(a=lattice_points, b=lattice_points)
@example(a=np.array([0.5, 0.5, 0.5]), b=np.array([2.5, 2.5, 2.5]))  # through corners
@example(a=np.array([1.0, 1.0, 0.0]), b=np.array([1.0, 1.0, 5.0]))  # along an edge
@example(a=np.array([1.0, 0.5, 1.5]), b=np.array([1.0, 2.5, 1.5]))  # along a face
@example(a=np.array([2.0, 2.0, 2.0]), b=np.array([2.0, 2.0, 2.0]))  # a point at a corner
def test_touches_exactly_the_closed_cubes_that_lattice_segments_meet(a: np.ndarray, b: np.ndarray) -> None:
    """Face, edge and corner contacts are everywhere here; near misses are far wider than the tolerance."""
    expected = touched(a, b, GRID.shape)
    voxels = touched_voxels(world(a, GRID), world(b, GRID), GRID)
    assert as_set(voxels) == set(expected)
    times = [float(expected[tuple(v)]) for v in voxels.tolist()]
    assert all(s <= t + 1e-4 for s, t in itertools.pairwise(times))  # the tolerance may swap simultaneous entries


@settings(max_examples=300, deadline=None)
@given(a=points, b=points)
def test_touches_all_cubes_met_and_none_beyond_the_tolerance(a: np.ndarray, b: np.ndarray) -> None:
    tolerance = 4 * 2.0**-24 * 5
    voxels = as_set(touched_voxels(a, b, UNIT))
    assert set(touched(a, b, UNIT.shape)) <= voxels <= set(touched(a, b, UNIT.shape, 1.001 * tolerance))


@pytest.mark.parametrize("origin", [(-100.0,) * 3, (37.3, -0.1, 1234.567), (-3.3, 85000.7, 0.0)])
@pytest.mark.parametrize("spacing", [2.0, 0.7])
def test_rounding_to_float32_hides_no_corner(origin: tuple[float, float, float], spacing: float) -> None:
    """Diagonals between voxel centres, rounded to float32, still touch every voxel around their corners."""
    grid = Grid((30, 30, 30), spacing, origin)
    rng = np.random.default_rng(0)
    for _ in range(60):
        step = rng.integers(-1, 2, 3)
        start = rng.integers(12, 18, 3)
        stop = start + rng.integers(1, 11) * step
        a, b = (np.float32(origin) + np.float32(spacing) * i.astype(np.float32) for i in (start, stop))
        window = np.minimum(start, stop) - 1
        expected = touched(start - window + 0.5, stop - window + 0.5, tuple(np.abs(stop - start) + 3))
        assert as_set(touched_voxels(a, b, grid) - window) == set(expected)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.integers(1, 6), density=st.sampled_from([0.0, 0.02, 0.2]))
def test_first_hit_is_the_first_blocked_cube_along_the_path(seed: int, length: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    path = rng.integers(0, 4 * np.array(UNIT.shape) + 1, (length, 3)) / 4
    blocked = rng.random(UNIT.shape) < density
    result = verify(path, blocked, blocked, UNIT)
    hits = []
    for k, (a, b) in enumerate(itertools.pairwise(path if length > 1 else [*path, *path])):
        hits += [(k, t, v) for v, t in touched(a, b, UNIT.shape).items() if blocked[v]]
    assert result.inside
    assert result.ok == (not hits)
    if hits:
        first = min(hits)
        # Cubes entered at the same time are equally first.
        assert result.first_hit in {v for k, t, v in hits if k == first[0] and t - first[1] < 1e-4}
        assert blocked[result.first_hit]


def bounded_distance(a: np.ndarray, b: np.ndarray, voxel: np.ndarray, size: np.ndarray | int = 1) -> float:
    """Distance from a segment to a closed box of voxels: bounded least squares over t and the nearest point."""
    matrix = np.column_stack([b - a, -np.eye(3)])
    bounds = (np.array([0.0, *voxel]), np.array([1.0, *(voxel + size)]))
    return math.sqrt(2 * lsq_linear(matrix, -a, bounds, method="bvls", tol=1e-14).cost)


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
    result = verify(world(path, grid), np.zeros(grid.shape, bool), occupied | ground, grid, ground=ground)
    assert result.clearance == pytest.approx(spacing * expected, rel=1e-6, abs=1e-6 * spacing)
    assert result.length == pytest.approx(spacing * sum(np.linalg.norm(b - a) for a, b in segments))


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
    verdicts = verify_batch([world(path, grid) for path in paths], which, free, filled, grid, ground=ground)
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
    assert verify(path, occupied, occupied, grid).clearance == 12


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
        result = verify(path, occupied, occupied, grid)
        assert result.ok
        assert result.length == pytest.approx(grid.spacing * plan.length, rel=1e-6)
        u = plan.path + 0.5
        samples = np.concatenate([np.linspace(a, b, 9) for a, b in itertools.pairwise(u)])
        gaps = [np.abs(np.maximum(np.abs(surface + 0.5 - p) - 0.5, 0)) for p in samples]
        sampled = grid.spacing * min(np.linalg.norm(g, axis=1).min() for g in gaps)
        assert sampled - grid.spacing * math.sqrt(3) / 16 <= result.clearance <= sampled + 1e-4


def test_diagonals_between_closed_corners_are_hits() -> None:
    grid = Grid((2, 2, 2), 2.0, (-100.0, -100.0, -100.0))
    diagonal = np.array([[-100, -100, -100], [-98, -98, -98]], np.float32)
    free = np.zeros(grid.shape, bool)
    assert verify(diagonal, free, free, grid).ok
    for corner in set(np.ndindex(grid.shape)) - {(0, 0, 0), (1, 1, 1)}:
        blocked = free.copy()
        blocked[corner] = True
        result = verify(diagonal, blocked, blocked, grid)
        assert not result.ok
        assert result.first_hit == corner
        assert result.clearance == pytest.approx(0, abs=1e-6)


def test_contact_with_a_face_counts_from_both_sides() -> None:
    blocked = np.zeros(UNIT.shape, bool)
    blocked[2, 1, 1] = True
    for x, ok in ((1.999, True), (2.0, False), (3.0, False), (3.001, True)):
        result = verify(np.array([[x, 0.5, 1.5], [x, 3.5, 1.5]]), blocked, blocked, UNIT)
        assert result.ok == ok
        assert result.clearance == pytest.approx(max(2 - x, 0, x - 3))


def test_points_and_repeated_points_are_legal_paths() -> None:
    blocked = np.zeros(UNIT.shape, bool)
    blocked[0, 0, 0] = True
    point = np.array([[3.5, 0.5, 0.5]])
    once = verify(point, blocked, blocked, UNIT)
    assert (once.ok, once.length, once.clearance) == (True, 0.0, 2.5)
    assert verify(point.repeat(5, axis=0), blocked, blocked, UNIT) == once
    line = np.array([[3.5, 0.5, 0.5], [1.5, 0.5, 0.5]])
    assert verify(line.repeat(3, axis=0), blocked, blocked, UNIT) == verify(line, blocked, blocked, UNIT)


def test_leaving_the_volume_is_not_inside() -> None:
    free = np.zeros(UNIT.shape, bool)
    for outside in ([5.001, 1, 1], [1, -0.001, 1], [1, 1, 1e300], [1e300, -1e300, 1e300]):
        result = verify(np.array([[1.0, 1.0, 1.0], outside]), free, free, UNIT)
        assert (result.ok, result.inside, result.finite, result.first_hit) == (False, False, True, None)
        assert math.isnan(result.clearance)
    edge = verify(np.array([[0.0, 0.0, 0.0], UNIT.shape]), free, free, UNIT)
    assert edge.ok
    assert edge.clearance == math.inf
    assert len(touched_voxels(np.array([-3.0, 1, 1]), np.array([-1.0, 1, 1]), UNIT)) == 0
    row = touched_voxels(np.array([-1e6, 1.5, 1.5]), np.array([1e6, 1.5, 1.5]), UNIT)
    assert row.tolist() == [[x, 1, 1] for x in range(5)]
    assert len(touched_voxels(np.array([1e30, 1, 1]), np.array([1e30, 1e30, 1]), UNIT)) == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nan_and_infinity_are_a_verdict_not_an_exception(bad: float) -> None:
    free = np.zeros(UNIT.shape, bool)
    result = verify(np.array([[1, 1, 1], [1, bad, 1]], np.float32), free, free, UNIT)
    assert (result.ok, result.inside, result.finite, result.first_hit) == (False, False, False, None)
    assert math.isnan(result.length)


def test_wrong_shapes_are_told_with_what_was_given() -> None:
    judge, trace = (
        inspect.unwrap(verify),
        inspect.unwrap(touched_voxels),
    )  # as users call them, without type checks
    free, path = np.zeros(UNIT.shape, bool), np.ones((2, 3))
    for wrong in (np.ones((2, 2)), np.ones(3), np.ones((0, 3))):
        with pytest.raises(ValueError, match=r"path: expected shape \(t, 3\).*given \("):
            judge(wrong, free, free, UNIT)
    with pytest.raises(ValueError, match=r"blocked: expected shape .*5, 4, 3.*given \(4, 4, 4\)"):
        judge(path, np.zeros((4, 4, 4), bool), free, UNIT)
    with pytest.raises(ValueError, match=r"occupied: expected bool .*given float64"):
        judge(path, free, np.zeros(UNIT.shape), UNIT)
    with pytest.raises(ValueError, match=r"ground: expected shape .*5, 4, 3.*given \(5, 4\)"):
        judge(path, free, free, UNIT, ground=np.zeros((5, 4), bool))
    with pytest.raises(ValueError, match="b: expected three finite coordinates"):
        trace(np.ones(3), np.array([1, math.nan, 1]), UNIT)


def test_grid_beyond_the_resolution_of_float32_is_refused() -> None:
    grid = Grid((3, 3, 3), 0.5, (5.8e6, 0.0, 0.0))
    with pytest.raises(ValueError, match="float32 resolves"):
        verify(np.array([grid.origin]), np.zeros(grid.shape, bool), np.zeros(grid.shape, bool), grid)


def test_a_batch_is_its_paths_one_by_one() -> None:
    rng = np.random.default_rng(4)
    grid = Grid((17, 9, 12), 2.0, (-5.0, 0.0, 3.0))
    maps = rng.random((4, *grid.shape)) < np.array([0.02, 0.3, 0.0, 0.001])[:, None, None, None]
    grown = maps | (rng.random(maps.shape) < 0.02)
    size = np.array(grid.shape) * grid.spacing
    paths = [np.array(grid.lower) + rng.uniform(-0.02, 1.02, (n, 3)) * size for n in rng.integers(1, 9, 60)]
    paths[7][0, 1] = np.nan
    which = rng.integers(0, 4, 60)
    verdicts = verify_batch(paths, which, grown, maps, grid)
    assert 3 < sum(verdict.ok for verdict in verdicts) < 57
    assert 3 < sum(not verdict.inside for verdict in verdicts) < 57
    for path, k, verdict in zip(paths, which, verdicts, strict=True):
        # repr, since NaN equals nothing.
        assert repr(verdict) == repr(verify(path, grown[k], maps[k], grid))


def test_every_path_of_a_batch_has_a_map() -> None:
    free = np.zeros((2, *UNIT.shape), bool)
    with pytest.raises(ValueError, match="which: expected the map, 0 to 1, of 1 paths"):
        verify_batch([np.ones((2, 3))], np.array([2]), free, free, UNIT)
    assert verify_batch([], np.zeros(0, int), free, free, UNIT) == []
