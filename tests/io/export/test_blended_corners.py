"""What two blended legs may reach around a waypoint, and rises and descents at the edge of the map."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.io.export.as_flown import upright
from maxjax.io.export.corners import _STEP, _blend
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


def test_a_rise_from_below_the_map_begins_on_its_lowest_layer() -> None:
    """Home may lie lower than what was mapped, which is ground; beside the map is nothing that was verified."""
    where = maxjax.VoxelMap.of(np.zeros((9, 9, 9), bool), spacing=2.0, origin=(1.0, 1.0, 1.0))
    way = np.array([[5.0, 5.0, 9.0], [13.0, 5.0, 9.0]])
    plan = bare_plan(where, way, maxjax.Distances(0.5, 0.5), clearance_at=np.full(2, np.inf), timings={"total": 0.0})
    mission = Mission.of_plan(plan)
    assert upright(np.array([[5.0, 5.0, -3.0], [5.0, 5.0, 9.0]]), mission, 0).ok
    assert not upright(np.array([[-1.0, 5.0, 0.5], [-1.0, 5.0, 9.0]]), mission, 0).inside
