"""State of charge over a flight: it begins full, ends as the legs say, and steps where the vehicle rises and lands."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.energy.charge_profile import ChargeProfile
from maxjax.energy.power import power
from maxjax.energy.split_flights import BatteryFlight, weigh_flight
from tests.energy.scenes import HOME, LIMITS, mission_over

SUPPLY = maxjax.Supply(maxjax.Airframe.mavic_3_enterprise(), maxjax.Battery(20.0, reserve=0.3))


def test_charge_runs_from_full_to_what_is_left_on_the_ground() -> None:
    mission = mission_over(HOME, maxjax.Waypoint((120.0, 0.0, 10.0), hover=30.0), (80.0, 90.0, 20.0))
    flight = weigh_flight(mission, LIMITS, SUPPLY)
    found = ChargeProfile.of(flight, SUPPLY)
    assert found is not None
    assert flight.taken is not None
    assert flight.trajectory is not None
    assert found.left[0] == 1.0
    assert found.reserve == 0.3
    assert (found.time[0], found.time[-1]) == (0.0, pytest.approx(flight.trajectory.duration))
    assert found.left[-1] == pytest.approx(flight.taken.charge_after(SUPPLY.battery)[-1])
    assert (np.diff(found.left) <= 0.0).all()
    # The steps are the take-off over 10 m at 1 m/s, and the landing from 20 m at 0.5 m/s.
    for step, speed, seconds in ((found.left[0] - found.left[1], 1.0, 10.0), (-np.diff(found.left)[-1], -0.5, 40.0)):
        watts = power(SUPPLY.airframe, np.array([[0.0, 0.0, speed]]), np.zeros((1, 3)))[0]
        assert 20.0 * step == pytest.approx(watts * seconds / 3600.0)
    # At rest for 30 s the battery gives what a hover takes.
    arrives = flight.trajectory.passes[1]
    begin, end = np.interp([arrives + 1.0, arrives + 29.0], found.time, found.left)
    hover = power(SUPPLY.airframe, np.zeros((1, 3)), np.zeros((1, 3)))[0]
    assert 20.0 * (begin - end) == pytest.approx(hover * 28.0 / 3600.0, rel=1e-3)


def test_without_a_battery_there_is_none() -> None:
    mission = mission_over(HOME, (120.0, 0.0, 10.0))
    flight = weigh_flight(mission, LIMITS, None)
    assert flight.trajectory is not None
    assert flight.status == maxjax.Status.OK
    assert ChargeProfile.of(flight, None) is None
    assert ChargeProfile.of(BatteryFlight(mission), SUPPLY) is None
    assert ChargeProfile.of(None, SUPPLY) is None
