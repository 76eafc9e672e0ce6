"""Street corners: repeatable, open to the sensor, closed to a straight flight."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax import Grid, VoxelMap, verify
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.sim.worlds.street_corners import corners


def test_corners_are_repeatable_and_their_sensors_look_into_both_streets() -> None:
    grid = Grid()
    occupied, ground = occupancy(make_scene("downtown", 1).geoms, grid)
    buildings = occupied & ~ground
    found = corners(buildings, grid, 1)
    assert found == corners(buildings, grid, 1)
    for corner in found:
        sensor, start, goal = map(np.array, (corner.sensor, corner.start, corner.goal))
        assert 60 <= np.linalg.norm((goal - start)[:2]) <= 90
        for end in (start, goal):
            assert verify(np.stack([sensor, end]), VoxelMap.on(grid, buildings)).ok
        # Towers stand between the ends.
        assert not verify(np.stack([start, goal]), VoxelMap.on(grid, buildings)).ok


def test_a_city_without_a_corner_is_refused_by_its_seed() -> None:
    grid = Grid((60, 60, 20), 2.0, (-59.0, -59.0, 1.0))
    for city in (np.zeros(grid.shape, bool), np.ones(grid.shape, bool)):
        with pytest.raises(ValueError, match=r"seed 7: this city has no .*choose another seed"):
            corners(city, grid, 7)
