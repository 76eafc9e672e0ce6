"""Distances are kept outside exemptions, and the ends' own inside: by dense samples, brute force over all cubes."""

from __future__ import annotations

import inspect
import itertools
import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from maxjax import Grid, VoxelMap
from maxjax.verification.asked import CRUISE
from maxjax.verification.exempt_parts import cut
from maxjax.verification.polylines import Paths
from maxjax.verification.verdicts import Verification
from maxjax.verification.verifier import verify, verify_paths
from tests.references import to_world

pytestmark = pytest.mark.usefixtures("each_verifier")

SHAPE, SPACING, STEP = (14, 11, 9), 2.0, 0.01  # of samples [voxels]
GRID = Grid(SHAPE, SPACING, (3.0, -7.0, 1.0))


def sampled(path: np.ndarray) -> np.ndarray:
    """Points (n, 3) along a path, no farther apart than `STEP`."""
    ends = list(itertools.pairwise(path)) or [(path[0], path[0])]
    counts = [int(np.linalg.norm(b - a) / STEP) + 2 for a, b in ends]
    return np.concatenate([np.linspace(a, b, n) for (a, b), n in zip(ends, counts, strict=True)])


def distances(points: np.ndarray, voxels: np.ndarray) -> np.ndarray:
    """From each point to the nearest of these closed cubes, all of them measured [voxels]."""
    least = np.full(len(points), math.inf)
    for low in np.argwhere(voxels):
        gap = np.maximum(np.maximum(low - points, points - low - 1), 0)
        least = np.minimum(least, np.linalg.norm(gap, axis=1))
    return least


def within(least: float, samples: np.ndarray) -> bool:
    """Whether a least distance [m] is that of a path whose samples have these [voxels]."""
    expected = samples.min(initial=math.inf)
    return least == expected or expected - STEP <= least / SPACING <= expected + 1e-9


def check(verdict: Verification, path: np.ndarray, occupied: np.ndarray, ground: np.ndarray, kept: np.ndarray) -> bool:
    """Compare a verdict with samples; `kept` is the radius and both exemptions [voxels]. Returns if it was clear."""
    points = sampled(path)
    solid, held = distances(points, occupied & ~ground), distances(points, occupied)
    beside = distances(points, binary_dilation(ground))
    from_ends = np.linalg.norm(points[:, None] - path[[0, -1]], axis=2)
    exempt, cruising = from_ends < kept[1:], (from_ends >= CRUISE / SPACING).all(axis=1)
    cruising &= ~exempt.any(axis=1)
    # What each sample has to keep: the radius, or the own distance of an end whose exemption holds it.
    own = np.minimum(distances(path[[0, -1]], occupied & ~ground), kept[0])
    required = np.where(exempt, own, kept[0]).min(axis=1)
    end_beside = distances(path[[0, -1]], binary_dilation(ground) & ~occupied) <= 1e-3
    apart = ~(exempt & end_beside).any(axis=1)
    assert within(verdict.clearance, solid)
    assert within(verdict.cruise_clearance, solid[cruising] if cruising.any() else solid)
    np.testing.assert_allclose(verdict.clearance_at / SPACING, distances(path, occupied & ~ground), atol=1e-9)
    for least, place in (
        (verdict.clearance, verdict.nearest),
        (verdict.cruise_clearance, verdict.cruise_nearest),
    ):
        assert (place is None) == (least == math.inf)
        if place is not None:
            u = (np.array(place) - GRID.origin) / SPACING + 0.5
            assert SPACING * distances(u[None], occupied & ~ground)[0] == pytest.approx(least, abs=1e-9)
            assert np.linalg.norm(points - u, axis=1).min() < STEP
    near, touch = (solid - required).min(initial=math.inf), beside[apart].min(initial=math.inf)
    # Where a path has to keep what its end has, it does so only just: the tolerance counts for it.
    just = exempt.any() and abs(near) < 1e-9
    if 0 < held.min() < STEP or (-1e-2 < near < STEP and not just) or (kept[0] and 0 < touch < STEP):
        return False  # samples do not tell
    assert verdict.too_near == (kept[0] > 0 and near < 0 and not just)
    hit = held.min() == 0 or (kept[0] > 0 and touch == 0)
    assert (verdict.first_hit is not None) == hit
    assert verdict.ok == (not hit and not verdict.too_near)
    return True


def test_every_zone_of_a_path_is_judged_by_its_own_rule() -> None:
    """Paths through and around obstacles and above ground, exemptions that overlap or hold all of a path, batched."""
    rng = np.random.default_rng(7)
    count = 40
    occupied = rng.random((4, *SHAPE)) < np.array([0.002, 0.006, 0.015, 0.0])[:, None, None, None]
    ground = np.zeros_like(occupied)
    ground[0, :, :, 0] = ground[2, 3:6, :5, :2] = True
    occupied |= ground
    which = rng.integers(0, 4, count)
    paths = [rng.uniform(0, SHAPE, (n, 3)) for n in rng.integers(1, 6, count)]
    for path in paths[:20]:
        path[:, 2] = path[:, 2] / 4 + 3  # level, so that some keep away from the ground
    exemptions = rng.choice([0.0, 0.6, 2.0, 4.0, 30.0], (count, 2), p=[0.3, 0.2, 0.2, 0.2, 0.1])
    clear, seen = 0, set()
    for radius in (0.0, 0.5, 0.9):
        given = [to_world(path, GRID) for path in paths]
        kept = {"radius": SPACING * radius, "exemptions": SPACING * exemptions}
        verdicts = verify_paths(Paths.of(given, which), VoxelMap.on(GRID, occupied, ground), **kept)
        for path, k, own, verdict in zip(paths, which, exemptions, verdicts, strict=True):
            clear += check(verdict, path, occupied[k], ground[k], np.array([radius, *own]))
            seen.add((verdict.ok, verdict.too_near, verdict.first_hit is None))
    assert clear > 0.8 * 3 * count
    assert seen == {(True, False, True), (False, True, True), (False, True, False), (False, False, False)}


# A wall over the whole map but for its upper layers, and a path of 18 voxels beside it that dips towards it once.
WALL = np.zeros((20, 7, 7), bool)
WALL[:, 0] = True
LONG = Grid(WALL.shape, SPACING)


@pytest.mark.parametrize("at", [1, 2, 9])
@pytest.mark.parametrize("own", [0.3, 0.45])
@pytest.mark.parametrize("end", [0, -1])
def test_an_exemption_excuses_what_its_end_does_and_nothing_else(at: int, own: float, end: int) -> None:
    """An end is `own` voxels off the wall; the path dips to 0.3 voxel at a point `at` voxels from it."""
    path = np.array([[1.0, 1.0 + own, 3.5], [2.0, 3.0, 3.5], [1.0 + at, 1.3, 3.5], [19.0, 3.0, 3.5]])
    path = path if end == 0 else path[::-1] * np.array([-1.0, 1.0, 1.0]) + np.array([20.0, 0.0, 0.0])

    def verdict(radius: float, other: float = 0.0) -> Verification:
        exemptions = (SPACING * radius, SPACING * other)
        world = to_world(path, LONG)
        return verify(
            world, VoxelMap.on(LONG, WALL), radius=1.0, exemptions=exemptions if end == 0 else exemptions[::-1]
        )

    assert verdict(0.0, other=2.0).too_near
    assert not verdict(0.05).ok
    # The dip is nearer than half a voxel along less than 3 voxels of the path.
    assert verdict(at + 3.0).too_near == (own > 0.3)
    assert verdict(at + 3.0).clearance == pytest.approx(SPACING * 0.3)
    # Where they overlap, that of the other end, which keeps the radius, excuses nothing, and takes nothing away.
    assert verdict(at + 3.0, other=30.0).too_near == (own > 0.3)
    assert verdict(0.0, other=30.0).too_near
    through = path.copy()
    through[0 if end == 0 else -1, 1] = 0.9
    assert not verify(to_world(through, LONG), VoxelMap.on(LONG, WALL), radius=1.0, exemptions=(99.0, 99.0)).ok


def test_an_end_that_keeps_the_radius_excuses_nothing() -> None:
    """However large the exemption that is claimed around it."""
    dips = np.array([[1.0, 3.0, 3.5], [5.0, 1.3, 3.5], [19.0, 3.0, 3.5]])
    for exemptions in ((0.0, 0.0), (40.0, 0.0), (0.0, 40.0), (40.0, 40.0)):
        verdict = verify(to_world(dips, LONG), VoxelMap.on(LONG, WALL), radius=1.0, exemptions=exemptions)
        assert verdict.too_near
        assert not verdict.ok
    assert verify(to_world(dips, LONG), VoxelMap.on(LONG, WALL), radius=0.6, exemptions=(0.0, 0.0)).ok


def test_only_an_end_beside_the_ground_may_come_by_it() -> None:
    """Voxels beside the ground begin at 1, and end at 2 voxels off it."""
    for start, allowed in ((1.4, True), (2.0, True), (2.01, False), (3.0, False)):
        path = to_world(np.array([[1.0, start, 3.0], [3.0, 1.5, 3.0], [5.0, 3.0, 3.0], [19.0, 3.0, 3.0]]), LONG)
        found = verify(path, VoxelMap.on(LONG, WALL, WALL), radius=1.0, exemptions=(SPACING * 4.0, 0.0))
        assert found.ok == allowed
        assert not verify(path, VoxelMap.on(LONG, WALL, WALL), radius=1.0, exemptions=(SPACING * 1.0, 0.0)).ok
        assert verify(path, VoxelMap.on(LONG, WALL, WALL)).ok


def test_half_a_voxel_is_kept_to_a_thousandth() -> None:
    """Planning keeps half a voxel less 2.5e-4; what is a hundredth short of it is refused."""
    for short, ok in ((0.0, True), (2.5e-4, True), (9e-4, True), (1.1e-3, False), (1e-2, False)):
        path = to_world(np.array([[1.0, 1.5 - short, 3.0], [19.0, 1.5 - short, 3.0]]), LONG)
        assert verify(path, VoxelMap.on(LONG, WALL), radius=1.0).ok == ok
        assert verify(path, VoxelMap.on(LONG, WALL, WALL), radius=1.0).first_hit is not None
        assert verify(path, VoxelMap.on(LONG, WALL, WALL)).ok
    above = to_world(np.array([[1.0, 2.01, 3.0], [19.0, 2.01, 3.0]]), LONG)
    assert verify(above, VoxelMap.on(LONG, WALL, WALL), radius=9.0).ok


def test_parts_of_segments_lie_inside_or_outside_as_a_whole() -> None:
    rng = np.random.default_rng(3)
    a, d = rng.uniform(-3, 3, (2, 200, 3))
    d[:20] = 0
    centres = rng.uniform(-3, 3, (200, 2, 3))
    centres[20:60, 0], centres[40:60, 1] = a[20:60], (a + d)[40:60]
    radii = np.sort(rng.choice([0.0, 0.5, 2.0, 9.0], (200, 3, 2)), axis=1)
    parts = cut(a, d, centres, radii)
    assert np.unique(parts.segment).tolist() == list(range(200))
    for k in range(200):
        own = parts.segment == k
        starts, stops = parts.start[own], parts.start[own] + parts.step[own]
        np.testing.assert_allclose(np.concatenate([starts, stops[-1:]])[[0, -1]], [a[k], a[k] + d[k]], atol=1e-12)
        np.testing.assert_allclose(stops[:-1], starts[1:], atol=1e-12)
        t = np.linspace(1e-6, 1 - 1e-6, 7)[:, None, None]
        gap = np.linalg.norm((starts + t * parts.step[own])[:, :, None] - centres[k], axis=-1)
        outside = (gap[:, :, None] > radii[k] - 1e-9).all(axis=-1).sum(axis=-1)
        assert (outside == parts.zone[own]).all()
    whole = np.bincount(parts.segment) == 1
    np.testing.assert_array_equal(parts.step[whole[parts.segment]], d[whole])


def test_radius_and_balls_that_are_no_distances_are_refused() -> None:
    unchecked, path = inspect.unwrap(verify), np.ones((2, 3))
    for bad in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"radius: expected a distance \[m\] of at least 0, given"):
            unchecked(path, VoxelMap.on(LONG, WALL), radius=bad)
        with pytest.raises(ValueError, match="exemptions: expected two radii"):
            unchecked(path, VoxelMap.on(LONG, WALL), exemptions=(1.0, bad))
