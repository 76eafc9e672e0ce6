"""What two blended legs may reach around a waypoint, and rises and descents at the edge of the map."""

from __future__ import annotations

from inspect import unwrap  # without the run-time type checks of the tests
from types import SimpleNamespace

import numpy as np
import pytest

import maxjax
from maxjax.io.export.as_flown import _sag
from maxjax.io.export.corners import _STEP, _blend
from maxjax.io.export.upright_ways import upright
from maxjax.planning.mission import Mission
from tests.planners import bare_plan


@pytest.mark.parametrize("seed", range(20))
def test_a_blend_fills_the_corner_up_to_the_radius(seed: int) -> None:
    """Along its bisector as far as the radius, out to points on both legs, without gaps, wherever the corner lies."""
    rng = np.random.default_rng(seed)
    before, after = rng.uniform(5.0, 40.0, (2, 1)) * rng.normal(size=(2, 3))
    places = np.array([before, np.zeros(3), after])
    radius = float(rng.uniform(0.5, 3.0))
    shift = np.array([84_000.0, 447_000.0, 12.0])
    one, two = -before / np.linalg.norm(before), after / np.linalg.norm(after)
    sides = _blend(places, radius)
    for side, moved, along in zip(sides, _blend(places + shift, radius), (-one, two), strict=True):
        np.testing.assert_allclose(moved - shift, side, atol=1e-7)
        middle, *_, end = rim = side[:, 1]
        assert np.linalg.norm(middle) <= radius + 1e-9
        np.testing.assert_allclose(np.cross(middle, two - one), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.cross(end, along), 0.0, atol=1e-9)
        assert end @ along > 0.0
        assert np.linalg.norm(np.diff(rim, axis=0), axis=1).max() <= _STEP + 1e-9


def test_where_the_way_leads_straight_on_nothing_is_cut() -> None:
    assert not any(len(side) for side in _blend(np.array([[0.0, 0, 0], [5, 0, 0], [9, 0, 0]]), 2.0))


class Circling:
    """A trajectory around a circle of radius r at speed v [m, m/s]."""

    def __init__(self, radius: float, speed: float) -> None:
        self.radius, self.speed = radius, speed

    def at(self, times: np.ndarray) -> SimpleNamespace:
        inwards = -np.stack([np.cos(times), np.sin(times), 0 * times], axis=1)
        return SimpleNamespace(acceleration=self.speed**2 / self.radius * inwards)


@pytest.mark.parametrize("step", [0.1, 0.4])
def test_set_points_sag_as_chords_of_a_circle_do(step: float) -> None:
    """A chord of an arc of angle a lies r (1 - cos a/2) off it: by a t² / 8 to second order, and never more."""
    radius, speed = 20.0, 6.0
    exact = radius * (1.0 - np.cos(0.5 * speed * step / radius))
    sag = unwrap(_sag)(Circling(radius, speed), np.array([0.0, 0.05, 0.05 + step]))
    assert exact <= sag <= 1.01 * exact


def test_a_rise_from_below_the_map_begins_on_its_lowest_layer() -> None:
    """Home may lie lower than what was mapped, which is ground; beside the map is nothing that was verified."""
    where = maxjax.VoxelMap.of(np.zeros((9, 9, 9), bool), spacing=2.0, origin=(1.0, 1.0, 1.0))
    way = np.array([[5.0, 5.0, 9.0], [13.0, 5.0, 9.0]])
    plan = bare_plan(where, way, maxjax.Distances(0.5, 0.5), clearance_at=np.full(2, np.inf), timings={"total": 0.0})
    mission = Mission.of_plan(plan)
    assert upright(np.array([[5.0, 5.0, -3.0], [5.0, 5.0, 9.0]]), mission, 0).ok
    assert not upright(np.array([[-1.0, 5.0, 0.5], [-1.0, 5.0, 9.0]]), mission, 0).inside
