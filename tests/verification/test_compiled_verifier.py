"""The compiled verifier is the one in NumPy, verdict by verdict, and both are right by brute force.

PATHS=100000 python -m pytest tests/verification/test_compiled_verifier.py      # at length
"""

from __future__ import annotations

import ctypes
import dataclasses
import math
import os

import numpy as np
import pytest
from references import distances_to_cubes, random_blocks, to_world, touched

from maxjax import Grid, VoxelMap
from maxjax.programs import native
from maxjax.verification import compiled
from maxjax.verification.asked import Asked
from maxjax.verification.clearance import distances_at
from maxjax.verification.compiled import compiled_verdicts
from maxjax.verification.polylines import Paths
from maxjax.verification.verdicts import Verdicts
from maxjax.verification.verifier import plain_verdicts, verify, verify_paths

PATHS = int(os.environ.get("PATHS", "3000"))
TOGETHER = 200
SHAPES = [(9, 8, 7), (17, 16, 9), (1, 5, 3), (24, 8, 8), (40, 33, 20), (101, 60, 25)]
GRIDS = [(1.0, (0.5, 0.5, 0.5)), (2.0, (-100.0, -37.0, 0.0)), (0.3, (1.7, 250000.1, -3.3)), (0.7, (0.1, 0.2, 0.3))]
RADII = [0.0, 0.5, 1.0, 3.0]
ODD = [math.nan, math.inf, -math.inf, 1e300, -1e300, 1e30, 9.3e18]
# Fields that must be equal, and fields that are minima of equal numbers.
VERDICTS = ("ok", "inside", "finite", "too_near", "first_hit", "counts")
NUMBERS = ("length", "clearance", "cruise_clearance", "clearance_at")


def volumes(rng: np.random.Generator, shape: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """What a map holds, and its ground: empty, a few voxels, boxes, noise, or full."""
    kind, occupied = rng.integers(6), np.zeros(shape, bool)
    if kind == 1:
        occupied[tuple(rng.integers(0, shape, (rng.integers(1, 6), 3)).T)] = True
    elif kind == 2:
        occupied = random_blocks(rng, shape, int(rng.integers(1, 9)), 5)
    elif kind >= 3:
        occupied = rng.random(shape) < rng.choice([0.01, 0.1, 0.3, 1.0], p=[0.4, 0.4, 0.15, 0.05])
    ground = np.zeros(shape, bool)
    if rng.random() < 0.6:
        ground |= np.arange(shape[2]) < rng.integers(0, 3, shape[:2])[..., None]
    if rng.random() < 0.2:
        ground |= rng.random(shape) < 0.05
    return occupied | ground, ground


def index_path(rng: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Points of a path in index coordinates: anywhere, or on faces, edges, corners and centres, and just beside them."""
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
    layout = rng.integers(3)
    if layout == 1:  # one map for all
        occupied, ground = (np.broadcast_to(one[:1], (4, *shape)) for one in (occupied, ground))
    elif layout == 2:
        occupied, ground = (np.asfortranarray(some) for some in (occupied, ground))
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
    for name in VERDICTS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    for name in NUMBERS:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), 1e-12, 0.0, err_msg=name)
    for place, clearance in (("nearest", "clearance"), ("cruise_nearest", "cruise_clearance")):
        points, others = getattr(found, place), getattr(expected, place)
        np.testing.assert_array_equal(np.isnan(points), np.isnan(others), place)
        # Where two points are equally near, either may be told.
        other = np.flatnonzero((points != others).any(axis=1) & ~np.isnan(points).any(axis=1))
        u = (points[other] - np.array(asked.grid.origin)) / asked.grid.spacing + 0.5
        maps = asked.volumes.occupied, asked.volumes.ground
        distances = asked.grid.spacing * distances_at(u, asked.paths.map_of[other], *maps)
        scale = 1e-12 * (1 + np.abs(asked.grid.origin).max())
        np.testing.assert_allclose(distances, getattr(found, clearance)[other], 1e-9, scale, err_msg=place)


@pytest.mark.parametrize("seed", range(-(-PATHS // TOGETHER)))
def test_is_the_plain_verifier(seed: int, compiled_verifier: ctypes.CDLL) -> None:
    asked = question(np.random.default_rng(seed))
    check_same(asked, compiled_verdicts(asked, compiled_verifier), plain_verdicts(asked))
