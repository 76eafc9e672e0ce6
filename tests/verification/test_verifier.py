"""The judge is exact: by rational arithmetic, along edges and through corners, near the origin and far from it."""

from __future__ import annotations

import inspect
import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from maxjax import Grid, VoxelMap, dilate
from maxjax.verification.contacts import touched_voxels
from maxjax.verification.polylines import Paths
from maxjax.verification.verifier import verify, verify_paths
from tests.references import to_world, touched

pytestmark = pytest.mark.usefixtures("each_verifier")

GRID = Grid((4, 3, 5), 2.0, (-1.0, 4.0, 0.5))
UNIT = Grid((5, 4, 3), 1.0, (0.5, 0.5, 0.5))  # here index coordinates are world coordinates

quarters = st.integers(-3, 23).map(lambda n: n / 4)
lattice_points = st.tuples(quarters, quarters, quarters).map(np.array)
coordinates = st.one_of(st.floats(-1, 6), st.integers(-1, 6).map(float))
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)


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
    voxels = touched_voxels(to_world(a, GRID), to_world(b, GRID), GRID)
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
    result = verify(path, VoxelMap.on(UNIT, blocked))
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


def test_diagonals_between_closed_corners_are_hits() -> None:
    grid = Grid((2, 2, 2), 2.0, (-100.0, -100.0, -100.0))
    diagonal = np.array([[-100, -100, -100], [-98, -98, -98]], np.float32)
    free = np.zeros(grid.shape, bool)
    assert verify(diagonal, VoxelMap.on(grid, free)).ok
    for corner in set(np.ndindex(grid.shape)) - {(0, 0, 0), (1, 1, 1)}:
        blocked = free.copy()
        blocked[corner] = True
        result = verify(diagonal, VoxelMap.on(grid, blocked))
        assert not result.ok
        assert result.first_hit == corner
        assert result.clearance == pytest.approx(0, abs=1e-6)


def test_contact_with_a_face_counts_from_both_sides() -> None:
    blocked = np.zeros(UNIT.shape, bool)
    blocked[2, 1, 1] = True
    for x, ok in ((1.999, True), (2.0, False), (3.0, False), (3.001, True)):
        result = verify(np.array([[x, 0.5, 1.5], [x, 3.5, 1.5]]), VoxelMap.on(UNIT, blocked))
        assert result.ok == ok
        assert result.clearance == pytest.approx(max(2 - x, 0, x - 3))


def test_points_and_repeated_points_are_legal_paths() -> None:
    blocked = np.zeros(UNIT.shape, bool)
    blocked[0, 0, 0] = True
    point = np.array([[3.5, 0.5, 0.5]])
    once = verify(point, VoxelMap.on(UNIT, blocked))
    assert (once.ok, once.length, once.clearance) == (True, 0.0, 2.5)
    assert verify(point.repeat(5, axis=0), VoxelMap.on(UNIT, blocked)) == once
    line = np.array([[3.5, 0.5, 0.5], [1.5, 0.5, 0.5]])
    assert verify(line.repeat(3, axis=0), VoxelMap.on(UNIT, blocked)) == verify(line, VoxelMap.on(UNIT, blocked))


def test_leaving_the_volume_is_not_inside() -> None:
    free = np.zeros(UNIT.shape, bool)
    for outside in ([5.001, 1, 1], [1, -0.001, 1], [1, 1, 1e300], [1e300, -1e300, 1e300]):
        result = verify(np.array([[1.0, 1.0, 1.0], outside]), VoxelMap.on(UNIT, free))
        assert (result.ok, result.inside, result.finite, result.first_hit) == (False, False, True, None)
        assert math.isnan(result.clearance)
    edge = verify(np.array([[0.0, 0.0, 0.0], UNIT.shape]), VoxelMap.on(UNIT, free))
    assert edge.ok
    assert edge.clearance == math.inf
    assert len(touched_voxels(np.array([-3.0, 1, 1]), np.array([-1.0, 1, 1]), UNIT)) == 0
    row = touched_voxels(np.array([-1e6, 1.5, 1.5]), np.array([1e6, 1.5, 1.5]), UNIT)
    assert row.tolist() == [[x, 1, 1] for x in range(5)]
    assert len(touched_voxels(np.array([1e30, 1, 1]), np.array([1e30, 1e30, 1]), UNIT)) == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nan_and_infinity_are_a_verdict_not_an_exception(bad: float) -> None:
    free = np.zeros(UNIT.shape, bool)
    result = verify(np.array([[1, 1, 1], [1, bad, 1]], np.float32), VoxelMap.on(UNIT, free))
    assert (result.ok, result.inside, result.finite, result.first_hit) == (False, False, False, None)
    assert math.isnan(result.length)


def test_wrong_shapes_are_told_with_what_was_given() -> None:
    unchecked, trace = (
        inspect.unwrap(verify),
        inspect.unwrap(touched_voxels),
    )  # as users call them, without type checks
    free, path = np.zeros(UNIT.shape, bool), np.ones((2, 3))
    where = VoxelMap.on(UNIT, free)
    for wrong in (np.ones((2, 2)), np.ones(3), np.ones((0, 3))):
        with pytest.raises(ValueError, match=r"path: expected shape \(t, 3\).*given \("):
            inspect.unwrap(Paths.of.__func__)(Paths, [wrong])
    with pytest.raises(ValueError, match=r"map: expected a maxjax\.VoxelMap, given an array of shape \(5, 4, 3\)"):
        unchecked(path, free)
    with pytest.raises(ValueError, match="map: expected one map, given a batch of 2"):
        unchecked(path, VoxelMap.on(UNIT, np.stack([free] * 2)))
    with pytest.raises(ValueError, match=r"blocked: expected shape .*5, 4, 3.*given \(1, 4, 4, 4\)"):
        unchecked(path, where, blocked=np.zeros((4, 4, 4), bool))
    with pytest.raises(ValueError, match="b: expected three finite coordinates"):
        trace(np.ones(3), np.array([1, math.nan, 1]), UNIT)


def test_grid_beyond_the_resolution_of_a_path_is_refused() -> None:
    """There, a float32 path cannot say where it is; a float64 path can."""
    grid = Grid((3, 3, 3), 0.5, (5.8e6, 0.0, 0.0))
    free, path = np.zeros(grid.shape, bool), np.array([grid.origin])
    rounded = path.astype(np.float32)
    refused = r"path of float32 resolves 0\.5 m.*5799999\.75.*float64"
    with pytest.raises(ValueError, match=refused):
        verify(rounded, VoxelMap.on(grid, free))
    with pytest.raises(ValueError, match=refused):
        touched_voxels(rounded[0], rounded[0], grid)
    assert verify(path, VoxelMap.on(grid, free)).ok
    assert len(touched_voxels(path[0], path[0], grid)) == 1


# Also a map of the Netherlands, whose northings are hundreds of kilometres.
ORIGINS = [(0.0, 0.0, 0.0), (1000.0, 10_000.0, 0.0), (84_888.0, 447_501.0, 0.0), (1e6, 1e6, 1e6)]


@pytest.mark.parametrize("spacing", [1.0, 2.0, 0.7])
def test_a_float64_path_has_one_verdict_wherever_its_map_lies(spacing: float) -> None:
    rng = np.random.default_rng(8)
    shape = (17, 19, 12)
    maps = rng.random((3, *shape)) < np.array([0.002, 0.01, 0.1])[:, None, None, None]
    maps[:, 8, :12, :] = True
    grown = maps | (rng.random(maps.shape) < 0.002)
    paths = [rng.uniform(0.5, np.array(shape) - 0.5, (n, 3)) for n in rng.integers(1, 7, 90)]
    which = rng.integers(0, 3, len(paths))
    near, *far = (
        verify_paths(Paths.of([to_world(path, grid) for path in paths], which), VoxelMap.on(grid, maps), blocked=grown)
        for grid in (Grid(shape, spacing, origin) for origin in ORIGINS)
    )
    assert 10 < sum(verdict.ok for verdict in near) < 80
    for expected, *others in zip(near, *far, strict=True):
        for verdict in others:
            assert (verdict.ok, verdict.first_hit) == (expected.ok, expected.first_hit)
            assert verdict.length == pytest.approx(expected.length, abs=1e-8)
            assert verdict.clearance == pytest.approx(expected.clearance, abs=1e-8)


@pytest.mark.parametrize("origin", ORIGINS)
@settings(max_examples=60, deadline=None)
@given(axis=st.integers(0, 2), side=st.sampled_from([-1, 1]), seed=st.integers(0, 2**32 - 1))
def test_a_thousandth_of_a_voxel_is_told_apart_at_every_origin(
    origin: tuple[float, float, float], axis: int, side: int, seed: int
) -> None:
    """Across the middle of a blocked cube's face: 0.001 voxel outside it is free, 0.001 voxel inside it a contact."""
    grid, rng = Grid((9, 8, 7), 1.0, origin), np.random.default_rng(seed)
    blocked = np.zeros(grid.shape, bool)
    cube = rng.integers(2, 5, 3)
    blocked[tuple(cube)] = True
    for outside in (1e-3, -1e-3):
        path = cube + 0.5 + np.outer([-1, 1], rng.uniform(-2, 2, 3))
        path[:, axis] = cube[axis] + 0.5 + side * (0.5 + outside)
        verdict = verify(to_world(path, grid), VoxelMap.on(grid, blocked))
        assert verdict.ok == (outside > 0)
        assert verdict.first_hit == (None if outside > 0 else tuple(cube))
        assert verdict.clearance == pytest.approx(max(outside, 0), abs=1e-8)


def test_a_batch_is_its_paths_one_by_one() -> None:
    rng = np.random.default_rng(4)
    grid = Grid((17, 9, 12), 2.0, (-5.0, 0.0, 3.0))
    maps = rng.random((4, *grid.shape)) < np.array([0.02, 0.3, 0.0, 0.001])[:, None, None, None]
    grown = maps | (rng.random(maps.shape) < 0.02)
    size = np.array(grid.shape) * grid.spacing
    paths = [np.array(grid.lower) + rng.uniform(-0.02, 1.02, (n, 3)) * size for n in rng.integers(1, 9, 60)]
    paths[7][0, 1] = np.nan
    which = rng.integers(0, 4, 60)
    verdicts = verify_paths(Paths.of(paths, which), VoxelMap.on(grid, maps), blocked=grown)
    assert 3 < sum(verdict.ok for verdict in verdicts) < 57
    assert 3 < sum(not verdict.inside for verdict in verdicts) < 57
    for path, k, verdict in zip(paths, which, verdicts, strict=True):
        # repr, since NaN equals nothing.
        assert repr(verdict) == repr(verify(path, VoxelMap.on(grid, maps[k]), blocked=grown[k]))


def test_every_path_of_a_batch_has_a_map() -> None:
    free = np.zeros((2, *UNIT.shape), bool)
    with pytest.raises(ValueError, match="map_of: expected the map, 0 to 1, of 1 paths"):
        verify_paths(Paths.of([np.ones((2, 3))], np.array([2])), VoxelMap.on(UNIT, free))
    assert len(verify_paths(Paths.of([]), VoxelMap.on(UNIT, free))) == 0


def test_what_dilate_gives_is_taken_as_blocked() -> None:
    """A device array, too: a way that keeps the margin passes, one within it does not."""
    occupied = np.zeros((12, 5, 5), bool)
    occupied[0] = True
    city = VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    blocked = dilate(city.occupied, 3.0, city.grid)
    for x, ok in ((4.5, True), (3.5, False)):
        way = np.array([[x, 0.5, 0.5], [x, 4.5, 4.5]])
        assert verify(way, city, blocked=blocked).ok == ok
