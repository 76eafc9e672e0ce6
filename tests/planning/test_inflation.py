"""What keeps the radius at the corners of a box between centres keeps it everywhere in the box."""

from __future__ import annotations

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import binary_dilation, generate_binary_structure

from maxjax.fields.distance import cube_distance
from maxjax.fields.occupancy import squared_distance
from maxjax.planning.problem.inflation import inflate, least_quarters

SHAPE = (10, 9, 8)


def distance_to_cubes(points: np.ndarray, occupied: np.ndarray) -> np.ndarray:
    gap = np.maximum(np.abs(points[:, None] - np.argwhere(occupied)[None]) - 0.5, 0)
    return np.sqrt((gap**2).sum(axis=-1)).min(axis=1, initial=np.inf)


def blocked_at(occupied: np.ndarray, ground: np.ndarray, radius: float) -> np.ndarray:
    quarters = cube_distance(jnp.asarray(occupied & ~ground), radius)
    return np.asarray(inflate(quarters, squared_distance(jnp.asarray(ground), 1), least_quarters(radius)))


@pytest.mark.parametrize("radius", [0.2, 0.5, 0.6, 0.8, 1.0, 1.5, 2.2, 3.0])
def test_every_box_of_free_centres_keeps_the_radius(radius: float) -> None:
    rng = np.random.default_rng(0)
    boxes = 0
    for density in (0.005, 0.02, 0.08):
        occupied = rng.random(SHAPE) < density
        free = ~blocked_at(occupied, np.zeros(SHAPE, bool), radius)
        centres = np.argwhere(np.ones(SHAPE))
        np.testing.assert_array_equal(free.ravel(), distance_to_cubes(centres, occupied) >= radius - 1e-9)
        for extent in itertools.product((0, 1), repeat=3):
            corners = [np.array(c) for c in itertools.product(*(range(e + 1) for e in extent))]
            lows = np.argwhere(np.ones(np.array(SHAPE) - extent))
            lows = lows[np.all([free[tuple((lows + c).T)] for c in corners], axis=0)]
            points = np.concatenate([lows + rng.random(3) * extent for _ in range(4)])
            assert (distance_to_cubes(points, occupied) >= radius - 1e-9).all()
            boxes += len(lows)
    assert boxes > 1000


def test_half_a_voxel_of_radius_blocks_what_is_occupied() -> None:
    occupied = np.random.default_rng(1).random(SHAPE) < 0.1
    for radius in (1e-3, 0.5, 0.5 + 1e-7):
        np.testing.assert_array_equal(blocked_at(occupied, np.zeros(SHAPE, bool), radius), occupied)
    thresholds = [least_quarters(r) for r in np.linspace(0, 4, 200).tolist()]
    assert sorted(thresholds) == thresholds
    assert (least_quarters(0.0), least_quarters(1e-6), least_quarters(0.51), least_quarters(1.0)) == (0, 1, 2, 4)


def test_the_ground_keeps_one_voxel_from_centre_to_centre() -> None:
    ground = np.zeros(SHAPE, bool)
    ground[:, :, :2] = True
    ground[3, 4, 2:4] = True
    occupied = ground.copy()
    occupied[6, 6, 2:6] = True
    beside = binary_dilation(ground, generate_binary_structure(3, 1))
    np.testing.assert_array_equal(blocked_at(occupied, ground, 0.5), occupied | beside)
    np.testing.assert_array_equal(blocked_at(occupied, ground, 0.0), occupied)
