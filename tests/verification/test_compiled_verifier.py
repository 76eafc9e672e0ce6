"""The compiled verifier is the one in NumPy, verdict by verdict and to the bit.

PATHS=100000 python -m pytest tests/verification/test_compiled_verifier.py      # at length
"""

from __future__ import annotations

import ctypes
import dataclasses
import math
import os

import numpy as np
import pytest

from maxjax import Grid, VoxelMap
from maxjax.compile.threads import concurrently
from maxjax.verification import compiled
from maxjax.verification.asked import Asked
from maxjax.verification.clearance import distances_at
from maxjax.verification.compiled import compiled_verdicts
from maxjax.verification.polylines import Paths
from maxjax.verification.verdicts import Verdicts
from maxjax.verification.verifier import plain_verdicts, verify_paths
from tests.references import random_blocks, to_world

PATHS = int(os.environ.get("PATHS", "3000"))
TOGETHER = 200
SHAPES = [(9, 8, 7), (17, 16, 9), (1, 5, 3), (24, 8, 8), (40, 33, 140), (101, 60, 25)]
KINDS = ("ok", "inside", "finite", "too_near")
GRIDS = [(1.0, (0.5, 0.5, 0.5)), (2.0, (-100.0, -37.0, 0.0)), (0.3, (1.7, 250000.1, -3.3)), (0.7, (0.1, 0.2, 0.3))]
RADII = [0.0, 0.5, 1.0, 3.0]
ODD = [math.nan, math.inf, -math.inf, 1e300, -1e300, 1e30, 9.3e18]
PLACES = {"nearest": "clearance", "cruise_nearest": "cruise_clearance"}  # and what is so far away from them


def volumes(rng: np.random.Generator, shape: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """What a map holds, and its ground: empty, a few voxels, boxes, noise, or full."""
    kind, occupied = rng.integers(6), np.zeros(shape, bool)
    if kind == 1:
        occupied[tuple(rng.integers(0, shape, (rng.integers(1, 6), 3)).T)] = True
    elif kind == 2:
        occupied = random_blocks(rng, shape, int(rng.integers(1, 9)), 5)
    elif kind >= 3:
        occupied = rng.random(shape) < rng.choice([0.01, 0.1, 0.3, 1.0], p=[0.55, 0.35, 0.07, 0.03])
    ground = np.zeros(shape, bool)
    if rng.random() < 0.6:
        ground |= np.arange(shape[2]) < rng.integers(0, 3, shape[:2])[..., None]
    if rng.random() < 0.3:
        ground |= rng.random(shape) < 0.05
    return occupied | ground, ground


def index_path(rng: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Points of a path in index coordinates: anywhere, or on faces, edges, corners, centres, and just beside."""
    size = np.array(shape)
    path = rng.random((rng.integers(1, 7), 3)) * size
    kind = rng.integers(5)
    if kind == 1:
        path = np.round(path)
    elif kind == 2:
        path = np.clip(np.floor(path) + 0.5, 0, size)
    elif kind == 3:
        path = np.round(4 * path) / 4
    elif kind == 4:
        path = np.clip(np.round(path) + rng.choice([0.0, 1e-9, -1e-9, 1e-4, -1e-4, 0.499, -0.499]), 0, size)
    for t in range(1, len(path)):
        chance = rng.random()
        if chance < 0.1:
            path[t] = path[t - 1]  # does not move
        elif chance < 0.4:
            axes = rng.integers(3, size=rng.integers(1, 3))
            path[t, axes] = path[t - 1, axes]  # along a face, or an edge
    if rng.random() < 0.1:
        path[rng.integers(len(path))] += rng.choice([-1.0, 1.0], 3) * rng.choice([1e-5, 1e-3, 0.6, 40.0])
    if rng.random() < 0.03:
        path[rng.integers(len(path)), rng.integers(3)] = rng.choice(ODD)
    return path


def question(rng: np.random.Generator) -> Asked:
    """Paths in one map, or in several, in memory as callers may have them."""
    shape = SHAPES[rng.integers(len(SHAPES))]
    spacing, origin = GRIDS[rng.integers(len(GRIDS))]
    grid, maps = Grid(shape, spacing, origin), int(rng.choice([1, 4]))
    occupied, ground = (np.stack(both) for both in zip(*(volumes(rng, shape) for _ in range(maps)), strict=True))
    layout = rng.integers(4)
    if layout == 1:  # one map for all
        occupied, ground = (np.broadcast_to(one[:1], (4, *shape)) for one in (occupied, ground))
    elif layout == 2:
        occupied, ground = (np.asfortranarray(some) for some in (occupied, ground))
    elif layout == 3:  # one ground for all, as of maps without any
        ground = np.broadcast_to(ground[0], occupied.shape)
        occupied |= ground
    blocked = rng.random(occupied.shape) < 0.02 if rng.random() < 0.3 else None
    with np.errstate(over="ignore"):
        paths = [to_world(index_path(rng, shape), grid) for _ in range(TOGETHER)]
        if abs(origin[1]) < 1e4 and rng.random() < 0.3:
            paths = [path.astype(np.float32) for path in paths]
    exemptions = rng.choice([0.0, 0.0, 0.4, 2.0, 6.0, 30.0], (TOGETHER, 2))
    which = rng.integers(0, len(occupied), TOGETHER)
    where = VoxelMap(occupied, ground, None, grid)
    return Asked.of(Paths.of(paths, which), where, float(rng.choice(RADII)), exemptions, blocked)


def check_same(asked: Asked, found: Verdicts, expected: Verdicts) -> None:
    """Verdicts and numbers are equal to the bit; where two places are equally near, either may be told."""
    for name in (field.name for field in dataclasses.fields(Verdicts) if field.name not in PLACES):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    for place, clearance in PLACES.items():
        points, others = getattr(found, place), getattr(expected, place)
        np.testing.assert_array_equal(np.isnan(points), np.isnan(others), place)
        other = np.flatnonzero((points != others).any(axis=1) & ~np.isnan(points).any(axis=1))
        u = (points[other] - np.array(asked.grid.origin)) / asked.grid.spacing + 0.5
        maps = asked.volumes.occupied, asked.volumes.ground
        distances = asked.grid.spacing * distances_at(u, asked.paths.map_of[other], *maps)
        rounding = 1e-12 * (1 + np.abs(asked.grid.origin).max())
        np.testing.assert_allclose(distances, getattr(found, clearance)[other], 1e-9, rounding, err_msg=place)


@pytest.mark.parametrize("seed", range(-(-PATHS // TOGETHER)))
def test_is_the_plain_verifier(seed: int, compiled_verifier: ctypes.CDLL) -> None:
    """Also the verdict on a path does not depend on those it is judged with, nor on a padding of any kind."""
    asked = question(np.random.default_rng(seed))
    found = compiled_verdicts(asked, compiled_verifier)
    check_same(asked, found, plain_verdicts(asked))
    some = slice(7, 9)
    points = asked.paths.points.copy()
    points[np.arange(points.shape[1]) >= asked.paths.counts[:, None]] = math.nan
    paths = dataclasses.replace(asked.paths, points=points).some(some)
    alone = compiled_verdicts(
        dataclasses.replace(asked, paths=paths, exemptions=asked.exemptions[some]), compiled_verifier
    )
    for field in dataclasses.fields(Verdicts):
        np.testing.assert_array_equal(getattr(alone, field.name), getattr(found, field.name)[some], field.name)


def test_the_questions_are_of_all_kinds() -> None:
    """Else the test above would say little."""
    verdicts = [plain_verdicts(question(np.random.default_rng(seed))) for seed in range(8)]
    joined = {name: np.concatenate([getattr(some, name) for some in verdicts]) for name in KINDS}
    for values in joined.values():
        assert 0.01 < values.mean() < 0.99
    hit = np.concatenate([some.first_hit[:, 0] >= 0 for some in verdicts])
    assert (joined["too_near"] & ~hit).any()
    assert (~joined["too_near"] & hit).any()


@pytest.mark.parametrize("nearer", [0.25, 1.5])
@pytest.mark.parametrize("backwards", [False, True])
def test_an_exemption_is_judged_by_its_own_end_alone(
    nearer: float, backwards: bool, compiled_verifier: ctypes.CDLL
) -> None:
    """A wall beside one end does not hide that the path comes too near to another one in the other's exemption."""
    grid = Grid((40, 12, 5), 1.0, (0.5, 0.5, 0.5))
    occupied = np.zeros(grid.shape, bool)
    occupied[1, 2, 2] = True  # 0.2 from the first point
    occupied[34, 2, 2] = True  # `nearer` than the last point is
    path = np.array([[1.5, 3.2, 2.5], [4.0, 8.0, 2.5], [34.5, 3.0 + nearer, 2.5], [36.0, 7.0, 2.5]])
    paths = Paths.of([path[::-1] if backwards else path])
    asked = Asked.of(paths, VoxelMap.on(grid, occupied), 2.0, np.array([[6.0, 6.0]]), None)
    expected = plain_verdicts(asked)
    assert expected.too_near.all()
    assert expected.clearance[0] == pytest.approx(0.2)
    check_same(asked, compiled_verdicts(asked, compiled_verifier), expected)


def test_the_only_obstacle_is_found_wherever_it_stands_in_each_of_several_maps(compiled_verifier: ctypes.CDLL) -> None:
    """Far beyond the blocks that are looked at first, and beyond what was seen to be empty in another map."""
    grid, at = Grid((130, 70, 80), 1.0, (0.5, 0.5, 0.5)), np.array([3.25, 2.5, 1.5])
    voxels = np.array([[129, 69, 79], [60, 0, 0], [0, 69, 0], [0, 0, 79], [31, 31, 63], [33, 33, 64], [129, 2, 1]])
    occupied = np.zeros((len(voxels), *grid.shape), bool)
    occupied[(np.arange(len(voxels)), *voxels.T)] = True
    which = np.append(np.arange(len(voxels)), np.arange(len(voxels))[::-1])
    where = VoxelMap(occupied, np.zeros_like(occupied), None, grid)
    asked = Asked.of(Paths.of([at[None]] * len(which), which), where, 1.0, None, None)
    found = compiled_verdicts(asked, compiled_verifier)
    gaps = np.maximum(np.maximum(voxels - at, at - (voxels + 1)), 0)
    np.testing.assert_allclose(found.clearance, np.linalg.norm(gaps, axis=1)[which], 1e-12)
    check_same(asked, found, plain_verdicts(asked))


def test_several_threads_ask_one_library(compiled_verifier: ctypes.CDLL) -> None:
    asked = [question(np.random.default_rng(seed)) for seed in range(4)]
    expected = [compiled_verdicts(one, compiled_verifier) for one in asked]
    for _ in range(3):
        found = concurrently(lambda one: compiled_verdicts(one, compiled_verifier), 3 * asked, 4)
        for k, verdicts in enumerate(found):
            np.testing.assert_array_equal(verdicts.clearance_at, expected[k % 4].clearance_at)
            np.testing.assert_array_equal(verdicts.first_hit, expected[k % 4].first_hit)


@pytest.mark.parametrize("counts", [[2, 0], [2, 4], [-1, 2]])
def test_the_library_refuses_counts_and_maps_that_it_would_read_beyond(
    counts: list[int], compiled_verifier: ctypes.CDLL
) -> None:
    grid = Grid((4, 4, 4), 1.0)
    paths = Paths.of([np.zeros((3, 3)), np.ones((2, 3))])
    where = VoxelMap.on(grid, np.zeros(grid.shape, bool))
    asked = Asked.of(paths, where, 0.0, None, None)
    for wrong in (
        dataclasses.replace(paths, counts=np.array(counts)),
        dataclasses.replace(paths, map_of=np.array(counts) - 1),
    ):
        with pytest.raises(ValueError, match=r"counts: expected 1 to 3 points|map_of: expected the map, 0 to 0"):
            Asked.of(wrong, where, 0.0, None, None)
        with pytest.raises(RuntimeError, match="refuses"):
            compiled_verdicts(dataclasses.replace(asked, paths=wrong), compiled_verifier)
    twice = np.zeros((2, *grid.shape), bool)
    with pytest.raises(ValueError, match="blocked: expected one volume for each of 1 maps, given 2"):
        Asked.of(paths, where, 0.0, None, twice)


def test_the_verifier_asks_the_library_where_there_is_one(
    compiled_verifier: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the plain one where there is none; nothing else changes."""
    asked = question(np.random.default_rng(2))
    where = VoxelMap(asked.volumes.occupied, asked.volumes.ground, None, asked.grid)
    seen = []
    monkeypatch.setattr(compiled, "compiled_verdicts", lambda *given: seen.append(given) or compiled_verdicts(*given))
    for library, times in ((None, 0), (compiled_verifier, 1)):
        monkeypatch.setattr(compiled, "at_hand", lambda library=library: library)
        verdicts = verify_paths(
            asked.paths, where, radius=asked.radius, exemptions=asked.exemptions, blocked=asked.volumes.blocked
        )
        assert len(seen) == times
        check_same(asked, verdicts, plain_verdicts(asked))
