"""The point of no return: the last place from which the way back is within the battery."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.energy.airframe import Airframe
from maxjax.energy.battery import Battery
from maxjax.energy.consumption import measure_consumption
from maxjax.energy.point_of_no_return import judge_battery
from maxjax.energy.wind import Wind
from tests.energy.scenes import HOME, LIMITS, trajectory_over

MAVIC = Airframe.mavic_3_enterprise()
FAR = (180.0, 0.0, 10.0)


@pytest.mark.parametrize("wind", [Wind.calm(), Wind.blowing(8.0, 270.0)])
def test_beyond_it_out_and_back_takes_more_than_the_battery_has(wind: Wind) -> None:
    flown = trajectory_over(HOME, FAR, HOME)
    taken = measure_consumption(flown, MAVIC, wind)
    battery = Battery(0.7 * taken.total / 0.8, 0.2)
    verdict = judge_battery(flown, taken, battery)
    assert verdict.status == maxjax.Status.CANNOT_RETURN
    assert (verdict.needed, verdict.usable) == pytest.approx((taken.total, 0.7 * taken.total))
    # Beginning to brake there, or twenty metres later, and flying home, each flown by itself.
    braking = LIMITS.speed**2 / (2.0 * LIMITS.acceleration)
    for ahead, enough in ((braking, True), (braking + 20.0, False)):
        there = (verdict.place[0] + ahead, 0.0, 10.0)
        out, back = (measure_consumption(trajectory_over(*way), MAVIC, wind) for way in ((HOME, there), (there, HOME)))
        needed = out.energy[-1] + back.energy[-1] - back.takeoff + back.landing
        assert (needed <= battery.usable) == enough
    said = verdict.describe()
    assert said.startswith(f"the flight takes {taken.total:.1f} Wh, the battery has {battery.usable:.1f} Wh above its")
    assert f"({round(verdict.place[0], 1):.10g}, " in said
    assert f"{verdict.time:.0f} s after the start" in said


def test_a_battery_that_lasts_says_how_much_of_it_and_never_without_its_reserve() -> None:
    flown = trajectory_over(HOME, FAR, HOME)
    taken = measure_consumption(flown, MAVIC)
    battery = Battery(1.001 * taken.total / 0.75, 0.25)
    verdict = judge_battery(flown, taken, battery)
    assert (verdict.status, verdict.place) == (maxjax.Status.OK, pytest.approx(HOME))
    assert verdict.describe().endswith(f"of {battery.usable:.1f} Wh above the reserve")
    # The whole battery would last, what is above the reserve does not.
    short = Battery(1.001 * taken.total, 0.25)
    assert judge_battery(flown, taken, short).status == maxjax.Status.CANNOT_RETURN


def test_a_flight_that_ends_elsewhere_needs_no_way_back() -> None:
    flown = trajectory_over(HOME, FAR)
    taken = measure_consumption(flown, MAVIC)
    assert judge_battery(flown, taken, Battery(1.001 * taken.total / 0.8, 0.2)).status == maxjax.Status.OK


def test_a_battery_that_does_not_reach_the_first_metre_has_no_place_but_the_start() -> None:
    flown = trajectory_over(HOME, FAR)
    verdict = judge_battery(flown, measure_consumption(flown, MAVIC), Battery(0.01, 0.5))
    assert verdict.time == 0.0
    np.testing.assert_allclose(verdict.place, HOME)
