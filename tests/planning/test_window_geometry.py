"""Windows hold every way of a cost, and no way over a face is cheaper than is said; in NumPy and in JAX."""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from maxjax import Status
from maxjax.planning.windows.geometry import (
    centre,
    costs_over_faces,
    ellipsoid_box,
    ends_inside,
    is_proved,
    next_costs,
    path_costs,
)

LIMITS = np.array([60, 50, 30])


def ends_of(count: int) -> np.ndarray:
    return np.random.default_rng(count).uniform(0, LIMITS - 1, (count, 2, 3))


@pytest.mark.parametrize("xp", [np, jnp])
def test_the_box_holds_every_point_of_a_way_of_that_cost(xp: Any) -> None:
    rng, ends = np.random.default_rng(1), ends_of(40)
    costs = rng.uniform(1.0, 1.6, 40) * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    low, high = (np.asarray(x) for x in ellipsoid_box(xp.asarray(ends), xp.asarray(costs), xp.asarray(LIMITS), xp))
    points = rng.uniform(0, LIMITS - 1, (20_000, 3))
    for (start, goal), cost, first, last in zip(ends, costs, low, high, strict=True):
        reached = np.linalg.norm(points - start, axis=1) + np.linalg.norm(points - goal, axis=1) <= cost
        voxels = np.floor(points[reached] + 0.5)
        assert ((voxels >= first) & (voxels <= last)).all()
        # A voxel less on a side would lose points of the ellipsoid, unless the map ends there.
        tips = [_tip(start, goal, cost, axis, side) for axis in range(3) for side in (-1, 1)]
        for (axis, side), tip in zip([(a, s) for a in range(3) for s in (-1, 1)], tips, strict=True):
            bound = first[axis] if side < 0 else last[axis]
            assert abs(bound - np.clip(tip, 0, LIMITS[axis] - 1)) <= 1.001


def _tip(start: np.ndarray, goal: np.ndarray, cost: float, axis: int, side: int) -> float:
    """The outermost coordinate of an ellipsoid along an axis, from directions on a sphere."""
    middle, chord = (start + goal) / 2, goal - start
    length = np.linalg.norm(chord)
    along = chord / length
    minor = math.sqrt(max(float(cost**2 - length**2), 0.0)) / 2
    across = np.linalg.svd(along[None])[2][1:]
    direction = np.sqrt((cost / 2 * along[axis]) ** 2 + ((minor * across[:, axis]) ** 2).sum())
    return float(middle[axis] + side * direction)


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_way_over_a_face_costs_at_least_what_is_said(xp: Any) -> None:
    ends, size = ends_of(6), np.array([70, 64, 40])
    corner = np.array([-4, -3, -2])
    sizes = np.broadcast_to(size, (6, 3))
    found = np.asarray(
        costs_over_faces(xp.asarray(ends), xp.asarray(np.broadcast_to(corner, (6, 3))), xp.asarray(sizes), xp)
    )
    for (start, goal), costs in zip(ends, found, strict=True):
        for side, plane in enumerate((corner, corner + size - 1)):
            for axis in range(3):
                assert costs[side, axis] == pytest.approx(_least(start, goal, axis, plane[axis]), rel=1e-5)


def _least(start: np.ndarray, goal: np.ndarray, axis: int, plane: int) -> float:
    """The least cost of a way over a plane, by a search among its points."""

    def cost(flat: np.ndarray) -> float:
        point = np.insert(flat, axis, plane)
        return float(np.linalg.norm(point - start) + np.linalg.norm(point - goal))

    return float(minimize(cost, np.delete((start + goal) / 2, axis), method="Nelder-Mead", tol=1e-9).fun)


@pytest.mark.parametrize("xp", [np, jnp])
def test_ends_outside_and_one_point_are_not_inside(xp: Any) -> None:
    fine, beyond = [[0.0, 0.0, 0.0], [59.4, 49.4, 29.4]], [[0.0, 0.0, 0.0], [59.6, 49.0, 29.0]]
    ends = xp.asarray([fine, beyond, [fine[0]] * 2, [fine[0], [math.nan, 1.0, 1.0]], [fine[0], [math.inf, 1.0, 1.0]]])
    assert np.asarray(ends_inside(ends, xp.asarray(LIMITS), xp)).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize("xp", [np, jnp])
def test_windows_lie_in_the_map_with_their_boxes_in_the_middle(xp: Any) -> None:
    low, high = np.array([[20, 0, 3], [50, 40, 9]]), np.array([[29, 9, 12], [59, 49, 18]])
    sizes = np.array([[20, 20, 40], [20, 20, 20]])
    corners = centre(*map(xp.asarray, (low, high, sizes)), xp.asarray(LIMITS), xp=xp)
    assert np.asarray(corners).tolist() == [[15, 0, 0], [40, 30, 4]]


@pytest.mark.parametrize("xp", [np, jnp])
def test_what_a_window_proves_and_what_is_tried_next(xp: Any) -> None:
    status = xp.asarray([Status.OK, Status.OK, Status.NO_VALID_PATH, Status.GOAL_OCCUPIED, Status.START_OCCUPIED])
    costs, bounds = xp.asarray([9.0, 11.0, 0.0, 0.0, 0.0]), xp.full(5, 10.0)
    assert np.asarray(is_proved(status, costs, bounds)).tolist() == [True, False, False, True, True]
    tried = xp.full(5, 10.0)
    np.testing.assert_allclose(next_costs(status, costs, tried, xp)[:3], [10.0, 11.0, 16.0])
    path = xp.asarray([[[0.0, 0, 0], [3.0, 4.0, 0], [3.0, 4.0, 0]]] * 2)
    np.testing.assert_allclose(path_costs(path, xp.asarray([0.0, 7.0]), xp), [5.0, 7.0])
