"""Heights along lines against their definition, place by place."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import maxjax
from maxjax.inspection.height_profile import SLOPE, Below, legs_along, lift, samples


def hilly() -> maxjax.VoxelMap:
    """A slope with a cliff, and a tower on it."""
    ground = np.zeros((60, 20, 30), bool)
    for x in range(60):
        ground[x, :, : 2 + x // 10 + (8 if x >= 40 else 0)] = True
    occupied = ground.copy()
    occupied[20:24, 8:12, :20] = True
    return maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(1.0, 1.0, 1.0), ground=ground)


@pytest.mark.parametrize("above", ["ground", "roof"])
def test_the_lowest_line_above_that_is_not_too_steep(above: str) -> None:
    """By the maximum over all places of the line, as the module has it."""
    below = Below.of(hilly(), above)  # type: ignore[arg-type]
    line = np.array([[3.0, 20.0], [115.0, 22.0]])
    found = lift(line, below, 10.0)
    along = np.linalg.norm(found[:, :2] - found[0, :2], axis=1)
    wanted = below.at(found[:, :2]) + 10.0
    expected = (wanted[None] - SLOPE * np.abs(along[:, None] - along[None])).max(axis=1)
    np.testing.assert_allclose(found[:, 2], expected)
    assert (np.abs(np.diff(found[:, 2])) <= SLOPE * np.diff(along) + 1e-9).all()
    tower = wanted[np.abs(found[:, 0] - 44.0) < 2.0].max()
    assert tower == pytest.approx(50.0 if above == "roof" else 18.0)


def test_legs_stay_near_all_places_with_few_waypoints() -> None:
    """None is farther than a twentieth of the distance from the straight legs; a level line is one leg."""
    below = Below.of(hilly(), "ground")
    points = lift(np.array([[3.0, 20.0], [115.0, 22.0]]), below, 20.0)
    numbers = legs_along(points, 20.0)
    assert len(numbers) < 12
    for a, b in itertools.pairwise(numbers):
        way = points[b] - points[a]
        share = np.clip((points[a : b + 1] - points[a]) @ way / (way @ way), 0.0, 1.0)
        assert np.linalg.norm(points[a : b + 1] - points[a] - share[:, None] * way, axis=1).max() <= 1.0
    level = lift(np.array([[3.0, 5.0], [3.0, 30.0]]), below, 20.0)
    assert legs_along(level, 20.0) == [0, len(level) - 1]


def test_samples_hold_the_corners() -> None:
    """At most a metre apart, each corner among them."""
    line = np.array([[0.0, 0.0], [10.4, 0.0], [10.4, 3.0]])
    found = samples(line)
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).max() <= 1.0
    for corner in line:
        assert np.linalg.norm(found - corner, axis=1).min() < 1e-12


def test_a_map_without_ground() -> None:
    """A sentence that says what to do."""
    where = maxjax.VoxelMap.of(np.zeros((5, 5, 5), bool), spacing=1.0, origin=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"load it with ground=0\.0"):
        Below.of(where, "ground")
