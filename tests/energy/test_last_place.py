"""Where a mission ends: at the cheapest of its places that the battery lasts to."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.energy.battery import Battery
from tests.energy.scenes import HOME, LIMITS, field

UPWIND, DOWNWIND = (-90.0, 0.0, 20.0), (0.0, 100.0, 20.0)


def ending(capacity: float) -> maxjax.BatteryFlight:
    """A flight to one of two places, in a wind of 12 m/s that blows against the way to the nearer one."""
    supply = maxjax.Supply(
        maxjax.Airframe.mavic_3_enterprise(), Battery(capacity, 0.2), maxjax.Wind.blowing(12.0, 270.0)
    )
    last = maxjax.Waypoint(UPWIND, alternatives=(DOWNWIND,))
    (flight,) = maxjax.plan_flights(field(), [HOME, last], supply, limits=LIMITS)
    return flight


def alone(place: tuple[float, float, float]) -> float:
    """Energy of the flight to a place by itself [Wh]."""
    wind = maxjax.Wind.blowing(12.0, 270.0)
    flown = maxjax.trajectory(maxjax.plan_mission(field(), [HOME, place]), LIMITS)
    return maxjax.measure_consumption(flown, maxjax.Airframe.mavic_3_enterprise(), wind).total


def test_a_battery_that_does_not_last_to_the_first_lands_at_the_other() -> None:
    """By the energies of both flights alone: enough for both, for one, for none."""
    near, other = alone(UPWIND), alone(DOWNWIND)
    assert other < near  # although it is farther
    both, one, none = (ending(0.5 * (a + b) / 0.8) for a, b in ((near, 2 * near), (near, other), (0.0, other)))
    assert both.status == one.status == maxjax.Status.OK
    assert both.mission.waypoints[-1].position == UPWIND
    assert one.mission.waypoints[-1].position == DOWNWIND
    assert one.mission.choices[-1].taken == 1
    assert one.taken is not None
    assert one.taken.total == pytest.approx(other)
    assert none.status is maxjax.Status.CANNOT_RETURN
    np.testing.assert_allclose(none.mission.path[-1], UPWIND)
