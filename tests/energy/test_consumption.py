"""Energy along trajectories: the integral of power, legs and hovers, wind, take-off and landing, the way back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import fixed_quad

import maxjax
from maxjax.energy.airframe import Airframe
from maxjax.energy.battery import Battery
from maxjax.energy.consumption import RISE, SINK, measure_consumption
from maxjax.energy.power import power
from maxjax.energy.wind import Wind
from tests.energy.scenes import HOME, trajectory_over

MAVIC = Airframe.mavic_3_enterprise()
EAST = (120.0, 0.0, 10.0)


def watts_at(trajectory: maxjax.Trajectory, wind: Wind, time: np.ndarray) -> np.ndarray:
    motion = trajectory.at(time)
    return power(MAVIC, motion.velocity - wind.at(motion.time), motion.acceleration)


def test_energy_is_the_integral_of_power() -> None:
    flown = trajectory_over(HOME, EAST, (120.0, 60.0, 25.0))
    wind = Wind(np.array([0.0, 20.0]), np.array([[3.0, 0.0, 0.0], [-2.0, 4.0, 0.0]]))
    found = measure_consumption(flown, MAVIC, wind)
    knots = np.arange(0.0, flown.duration, flown.step)
    parts = [
        fixed_quad(lambda t: watts_at(flown, wind, t), a, min(b, flown.duration), n=8)[0]
        for a, b in zip(knots, knots + flown.step, strict=True)
    ]
    assert found.energy[-1] - found.takeoff == pytest.approx(sum(parts) / 3600.0, rel=1e-4)
    assert found.legs.sum() == pytest.approx(found.energy[-1] - found.takeoff)


def test_a_hover_counts_with_the_leg_that_leads_to_it() -> None:
    through, hovering = (
        measure_consumption(trajectory_over(HOME, maxjax.Waypoint(EAST, hover=hover), (120.0, 80.0, 10.0)), MAVIC)
        for hover in (0.0, 60.0)
    )
    hover = float(power(MAVIC, np.zeros((1, 3)), np.zeros((1, 3)))[0]) * 60.0 / 3600.0
    assert hovering.legs[0] - through.legs[0] == pytest.approx(hover, rel=2e-3)
    assert hovering.legs[1] == pytest.approx(through.legs[1], rel=2e-3)


def test_wind_from_ahead_costs_and_one_that_turns_is_taken_as_it_blows() -> None:
    flown = trajectory_over(HOME, EAST)
    calm, ahead, behind = (
        measure_consumption(flown, MAVIC, Wind.blowing(speed, comes_from)).legs[0]
        for speed, comes_from in ((0.0, 0.0), (12.0, 90.0), (4.0, 270.0))
    )
    assert ahead > 1.3 * calm
    # From behind it hovers through the air more slowly, which takes more than cruising.
    assert calm < behind < 1.1 * calm
    half = flown.duration / 2.0
    turns = Wind(np.array([half - 1e-6, half]), np.array([[-12.0, 0.0, 0.0], [12.0, 0.0, 0.0]]))
    found = measure_consumption(flown, MAVIC, turns)
    assert calm < found.legs[0] < ahead
    assert found.airspeed == pytest.approx(20.0, abs=0.1)


def test_take_off_and_landing_are_upright_from_and_to_the_ground() -> None:
    found = measure_consumption(trajectory_over(HOME, (50.0, 0.0, 30.0)), MAVIC)
    up, down = (float(power(MAVIC, np.array([[0.0, 0.0, v]]), np.zeros((1, 3)))[0]) for v in (RISE, -SINK))
    # The ground ends at z = 0.
    assert found.takeoff == pytest.approx(up * 10.0 / RISE / 3600.0)
    assert found.landing == pytest.approx(down * 30.0 / SINK / 3600.0)
    assert found.total == pytest.approx(found.energy[-1] + found.landing)
    assert found.energy[0] == pytest.approx(found.takeoff)


def test_the_way_back_is_that_of_the_mission_turned_round() -> None:
    wind = Wind.blowing(7.0, 270.0)
    there = measure_consumption(trajectory_over(HOME, maxjax.Waypoint(EAST, hover=30.0)), MAVIC, wind)
    back = measure_consumption(trajectory_over(EAST, HOME), MAVIC, wind)
    assert there.back[-1] == pytest.approx(back.total - back.takeoff, rel=3e-3)
    # Against more wind than it flies at that speed it flies back slower.
    strong = Wind.blowing(19.0, 270.0)
    slow = measure_consumption(trajectory_over(HOME, EAST), MAVIC, strong)
    seconds = 120.0 / (MAVIC.airspeed - 19.0)
    against = float(power(MAVIC, np.array([[-21.0, 0.0, 0.0]]), np.zeros((1, 3)))[0])
    assert slow.back[-1] - slow.back[0] == pytest.approx(against * seconds / 3600.0, rel=0.1)


def test_charge_falls_over_time_and_leg_by_leg_to_what_is_left_on_the_ground() -> None:
    found = measure_consumption(trajectory_over(HOME, EAST, HOME), MAVIC)
    battery = Battery(10.0, 0.2)
    charge, after = found.charge(battery), found.charge_after(battery)
    assert (np.diff(charge) < 0.0).all()
    assert charge[0] == pytest.approx(1.0 - found.takeoff / 10.0)
    assert len(after) == 2
    assert after[-1] == pytest.approx(1.0 - found.total / 10.0)
    assert after[0] == pytest.approx(1.0 - (found.takeoff + found.legs[0]) / 10.0)


def test_a_wind_or_a_flight_that_is_too_fast_is_a_sentence_with_the_number() -> None:
    flown = trajectory_over(HOME, EAST)
    with pytest.raises(ValueError, match=r"wind: expected less than the 21 m/s that DJI Mavic 3 .* given 22 m/s"):
        measure_consumption(flown, MAVIC, Wind.blowing(22.0, 0.0))
    with pytest.raises(ValueError, match=r"airspeed: expected at most 21 m/s .* asks for 2[34]\.\d m/s; give a lower"):
        measure_consumption(flown, MAVIC, Wind.blowing(16.0, 90.0))
