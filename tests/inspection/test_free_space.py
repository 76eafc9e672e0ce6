"""Free places against exact distances to the cubes of obstacles."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.core.status import Closure
from maxjax.inspection.free_space import FreeSpace
from tests.references import distances_to_cubes


def blocks_on_ground(rng: np.random.Generator) -> maxjax.VoxelMap:
    """Some blocks on flat ground, in voxels of 2 m."""
    occupied = np.zeros((24, 20, 14), bool)
    occupied[:, :, 0] = True
    ground = occupied.copy()
    for _ in range(5):
        x, y = rng.integers(2, 18), rng.integers(2, 14)
        occupied[x : x + 4, y : y + 3, 1 : rng.integers(3, 11)] = True
    return maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(100.0, 50.0, -1.0), ground=ground)


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.3, 5.0])
def test_what_is_free_keeps_the_radius(radius: float) -> None:
    """Random places: all that are free are so far from every cube, and most that are farther are free."""
    rng = np.random.default_rng(0)
    where = blocks_on_ground(rng)
    free = FreeSpace.of(where, radius)
    low, high = np.array(where.grid.origin), np.array(where.grid.origin) + 2.0 * (np.array(where.grid.shape) - 1)
    points = rng.uniform(low, high, (4000, 3))
    voxels = np.asarray(where.occupied) & ~np.asarray(where.ground)
    away = 2.0 * distances_to_cubes((points - low) / 2.0, voxels)
    held = free.holds(points)
    assert held.sum() > 500
    assert away[held].min() >= radius - 1e-9
    generous = (away > radius + 3.5) & (points[:, 2] > 5.0)
    assert held[generous].mean() > 0.98


def test_beyond_the_map_nothing_is_free() -> None:
    """Neither outside nor on its border."""
    free = FreeSpace.of(blocks_on_ground(np.random.default_rng(1)), 1.0)
    assert not free.holds(np.array([[99.0, 60.0, 10.0], [1e6, 0.0, 0.0], [110.0, 60.0, 26.0]])).any()


def test_rooms_that_are_not_joined() -> None:
    """What is sealed in is not free, unless a place in it is named."""
    occupied = np.zeros((30, 30, 16), bool)
    occupied[5:17, 5:17, 2:14] = True
    occupied[6:16, 6:16, 3:13] = False
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.0, 0.0, 0.0))
    inner, outer = np.array([[10.5, 10.5, 8.0]]), np.array([[25.0, 25.0, 8.0]])
    free = FreeSpace.of(where, 1.0)
    assert free.holds(outer).all()
    assert not free.holds(inner).any()
    room = FreeSpace.of(where, 1.0, inner[0])
    assert room.holds(inner).all()
    assert not room.holds(outer).any()
    with pytest.raises(ValueError, match=r"home: expected a place in the map that keeps the radius, given \(5, 5, 5\)"):
        FreeSpace.of(where, 1.0, np.array([5.0, 5.0, 5.0]))


def test_rules_of_the_air() -> None:
    """Closed air is not free, and is told apart from air that is too near to something; all closed is a sentence."""
    where = blocks_on_ground(np.random.default_rng(2))
    reasons = np.zeros(where.grid.shape, np.uint8)
    reasons[:12] = Closure.AREA
    free = FreeSpace.of(where.closing(reasons), 1.0)
    point = np.array([[110.0, 52.0, 24.0]])
    assert not free.holds(point).any()
    assert free.closed(point).all()
    reasons[:] = Closure.AREA
    with pytest.raises(ValueError, match="all of it is closed by the rules of the air"):
        FreeSpace.of(where.closing(reasons), 1.0)
