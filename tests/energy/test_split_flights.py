"""Missions split at the battery: every place once and in order, and every flight lands at home above the reserve."""

from __future__ import annotations

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

import maxjax
from maxjax.energy.airframe import Airframe
from maxjax.energy.battery import Battery
from maxjax.energy.split_flights import BatteryFlight, Supply, split_mission
from maxjax.energy.wind import Wind
from maxjax.planning.path.route import Route
from maxjax.planning.problem.problem import Problem
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import legs_of
from tests.energy.scenes import HOME, LIMITS, field
from tests.planners import ByFunction

MAVIC = Airframe.mavic_3_enterprise()
PLACES = [(120.0 * np.cos(a), 120.0 * np.sin(a), 20.0) for a in np.linspace(0.0, 3.0, 5)]


def straight(problem: Problem) -> Route:
    return Route(jnp.stack([problem.start, problem.goal]), problem.status, jnp.array(False))


def split(battery: Battery, *places: tuple[float, ...], wind: Wind | None = None) -> tuple[BatteryFlight, ...]:
    stops = [maxjax.Waypoint(place) for place in (HOME, *(places or PLACES), HOME)]
    task = Task.of(field(), *legs_of(stops))
    supply = Supply(MAVIC, battery, Wind.calm() if wind is None else wind)
    return split_mission(task, stops, ByFunction(straight), LIMITS, supply)


def test_a_battery_that_lasts_flies_all_at_once() -> None:
    (whole,) = split(Battery(77.0, 0.2))
    assert whole.status == maxjax.Status.OK
    assert len(whole.mission.legs) == 6


@pytest.mark.parametrize("capacity", [3.6, 4.3])
def test_flights_share_the_places_in_order_and_each_lands_at_home_above_the_reserve(capacity: float) -> None:
    battery = Battery(capacity, 0.2)
    flights = split(battery)
    assert len(flights) > 1
    visited = [waypoint.position for flight in flights for waypoint in flight.mission.waypoints[1:-1]]
    np.testing.assert_allclose(visited, PLACES)
    for flight in flights:
        assert flight.status == flight.mission.status == maxjax.Status.OK
        np.testing.assert_allclose(flight.mission.path[[0, -1]], [HOME, HOME])
        assert flight.taken is not None
        assert flight.taken.charge_after(battery)[-1] >= 0.2
    # None could have taken the next place along.
    for flight, after in itertools.pairwise(flights):
        longer = [waypoint.position for waypoint in (*flight.mission.waypoints[1:-1], after.mission.waypoints[1])]
        assert split(battery, *longer)[0].mission.waypoints[1:-1] == flight.mission.waypoints[1:-1]


def test_a_place_that_is_too_far_ends_it_with_the_number() -> None:
    battery = Battery(3.6, 0.2)
    flights = split(battery, PLACES[0], (180.0, 180.0, 50.0), PLACES[1])
    assert [flight.status for flight in flights] == [maxjax.Status.OK, maxjax.Status.CANNOT_RETURN]
    verdict = flights[-1].verdict
    assert verdict is not None
    assert verdict.needed > verdict.usable == pytest.approx(battery.usable)
    assert f"the battery has {battery.usable:.1f} Wh above its reserve; beyond (" in verdict.describe()


def test_wind_costs_flights() -> None:
    battery = Battery(4.0, 0.2)
    assert len(split(battery, wind=Wind.blowing(12.0, 200.0))) > len(split(battery))


def test_a_place_that_is_not_reached_keeps_the_status_of_its_plan() -> None:
    flights = split(Battery(77.0, 0.2), PLACES[0], (120.0, 0.0, 500.0))
    assert flights[-1].status == maxjax.Status.GOAL_OUTSIDE_MAP
    assert flights[-1].verdict is None
