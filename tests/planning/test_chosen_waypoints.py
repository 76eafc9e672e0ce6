"""Alternatives of waypoints: the one taken is the cheapest of plans to each, made one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest

import maxjax
from maxjax import Status, Waypoint

GRID = maxjax.Grid((41, 41, 21), 2.0, (-40.0, -40.0, -20.0))


def walled() -> maxjax.VoxelMap:
    """A wall across the map with a gap at its one end: what is near behind it is a long way off."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[20:22, :36] = True
    occupied[30:36, 4:10, 4:12] = True
    return maxjax.VoxelMap.on(GRID, occupied)


CITY = walled()
START, BEHIND, ASIDE, INSIDE = (-10.0, -20.0, 0.0), (12.0, -20.0, 0.0), (-34.0, 10.0, 0.0), (25.0, -25.0, -5.0)


@pytest.mark.parametrize("planner", [maxjax.Field(), maxjax.AStar()])
def test_the_alternative_that_costs_least_is_taken(planner: maxjax.Planner) -> None:
    """Plans to each by themselves cost as much; 22 m away but behind the wall costs more than 38 m away."""
    asked = Waypoint(BEHIND, hover=2.0, alternatives=(ASIDE, INSIDE))
    mission = maxjax.plan_mission(CITY, [START, asked, BEHIND], planner=planner)
    assert mission.status is Status.OK
    (choice,) = mission.choices
    alone = [maxjax.plan(CITY, START, place, planner=planner) for place in (BEHIND, ASIDE, INSIDE)]
    paid = [(plan.cost or plan.length) if plan.status is Status.OK else math.nan for plan in alone]
    np.testing.assert_allclose(choice.costs, paid, rtol=0.03)
    assert choice.taken == int(np.nanargmin(paid)) == 1
    assert (choice.number, choice.by_cost) == (1, (1, 0))
    assert mission.waypoints[1] == Waypoint(ASIDE, hover=2.0)
    np.testing.assert_allclose(mission.path[mission.places[1]], ASIDE)
    assert "cannot be reached" in choice.describe()
    assert "(-34, 10, 0) costs" in choice.describe().partition(";")[0]


def test_an_alternative_counts_from_the_place_that_was_taken_before() -> None:
    """The second choice is by the way from the first one's place."""
    first = Waypoint(BEHIND, alternatives=(ASIDE,))
    near, far = (-30.0, 20.0, 0.0), (-6.0, -30.0, 0.0)
    mission = maxjax.plan_mission(CITY, [START, first, Waypoint(far, alternatives=(near,))])
    assert [waypoint.position for waypoint in mission.waypoints] == [START, ASIDE, near]


def test_where_nothing_is_reached_the_nearest_is_tried_and_told() -> None:
    """Its status says why."""
    beyond = (200.0, 0.0, 0.0)
    mission = maxjax.plan_mission(CITY, [START, Waypoint(beyond, alternatives=(INSIDE,))])
    assert mission.status is Status.GOAL_OCCUPIED
    assert mission.waypoints[1].position == INSIDE
    assert np.isnan(mission.choices[0].costs).all()


def test_bad_alternatives_are_told() -> None:
    """Those of the start, those that are no places, and those that have some themselves."""
    with pytest.raises(ValueError, match="waypoint 0: expected a start without alternatives, given 1"):
        maxjax.plan_mission(CITY, [Waypoint(START, alternatives=(ASIDE,)), BEHIND])
    with pytest.raises(ValueError, match=r"Waypoint\.alternatives: expected numbers of shape"):
        Waypoint(START, alternatives=((1.0, 2.0),))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="expected waypoints without their own, given one with 1"):
        Waypoint(START, alternatives=(Waypoint(ASIDE, alternatives=(BEHIND,)),))
