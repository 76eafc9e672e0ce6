"""Photos along paths: at waypoints, and by the distance flown in plan."""

from __future__ import annotations

import math

import numpy as np
import pytest

import maxjax
from maxjax.inspection.mission_photos import photos_along
from maxjax.planning.look import AimedLook

DOWN = -0.5 * math.pi


def test_photos_by_distance() -> None:
    """One where it begins, then every 3 m in plan, around a corner and up a slope, until it is told to stop."""
    path = np.array([[0.0, 0.0, 5.0], [10.0, 0.0, 5.0], [10.0, 8.0, 11.0], [10.0, 30.0, 11.0]])
    looks = {0: AimedLook(pitch=DOWN, every=3.0), 2: AimedLook(every=0.0)}
    found = photos_along(path, looks)
    along = np.where(found.position[:, 1] > 0.0, 10.0 + found.position[:, 1], found.position[:, 0])
    np.testing.assert_allclose(along, 3.0 * np.arange(7))
    np.testing.assert_allclose(found.position[4:, 2], 5.0 + 6.0 * np.array([2.0, 5.0, 8.0]) / 8.0)
    np.testing.assert_allclose(found.yaw, [0.0] * 4 + [0.5 * math.pi] * 3)
    assert (found.pitch == DOWN).all()


def test_photos_at_waypoints() -> None:
    """With heading and gimbal of their own, once each, at rest or not."""
    path = np.array([[0.0, 0.0, 5.0], [10.0, 0.0, 5.0], [10.0, 0.0, 15.0], [0.0, 0.0, 15.0]])
    looks = {1: AimedLook(pitch=-0.3, photo=True), 2: AimedLook(photo=True)}
    turned, plain = maxjax.Waypoint((0.0, 0.0, 0.0), heading=90.0 - math.degrees(2.0)), maxjax.Waypoint((0.0, 0.0, 0.0))
    found = photos_along(path, looks, [plain, turned, plain, plain])
    np.testing.assert_allclose(found.position, path[1:3])
    # An upright leg has the course of the one before, and the gimbal stays as it was.
    assert found.yaw[0] == pytest.approx(2.0)
    assert abs(found.yaw[1]) == pytest.approx(math.pi)
    np.testing.assert_allclose(found.pitch, [-0.3, -0.3])


def test_photos_on_a_leg_look_where_its_waypoint_says() -> None:
    """To a point of interest beside the leg, from each place anew."""
    seen = maxjax.Waypoint((12.0, 0.0, 5.0), look_at=(6.0, 6.0, 0.0))
    path = np.array([[0.0, 0.0, 5.0], [12.0, 0.0, 5.0]])
    found = photos_along(path, {0: AimedLook(every=6.0)}, [maxjax.Waypoint((0.0, 0.0, 5.0)), seen])
    np.testing.assert_allclose(found.position[:, 0], [0.0, 6.0, 12.0])
    np.testing.assert_allclose(found.yaw[1:], [0.5 * math.pi, 0.75 * math.pi])


def test_a_run_of_no_length_is_one_photo() -> None:
    """Where a trigger begins and ends at one place."""
    path = np.array([[0.0, 0.0, 5.0], [4.0, 0.0, 5.0]])
    assert len(photos_along(path, {0: AimedLook(every=0.0, photo=True)})) == 1
    assert len(photos_along(path, {})) == 0
    assert len(photos_along(np.zeros((0, 3)), {})) == 0
