"""Power: momentum theory in hover by its closed form, in flight by SciPy's root; climb, descent, drag, acceleration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from maxjax.energy.airframe import Airframe
from maxjax.energy.power import DENSITY, GRAVITY, power, rotor_inflow

PLAIN = Airframe("plain", 2.0, 4, 0.15, 1.0, 0.0, 0.0, 30.0)  # neither profile nor drag, nothing lost


def watts(airframe: Airframe, *velocity: float, acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> float:
    return float(power(airframe, np.array([velocity]), np.array([acceleration]))[0])


def test_in_hover_the_rotors_add_the_square_root_of_the_disc_loading() -> None:
    thrust = np.array([5.0, 20.0, 90.0])
    expected = np.sqrt(thrust / (2.0 * DENSITY * 0.3))
    np.testing.assert_allclose(rotor_inflow(thrust, 0 * thrust, 0 * thrust, 0.3), expected, rtol=1e-12)
    weight = PLAIN.mass * GRAVITY
    assert watts(PLAIN, 0.0, 0.0, 0.0) == pytest.approx(weight**1.5 / math.sqrt(2.0 * DENSITY * PLAIN.disc_area))


def test_in_flight_they_add_what_scipy_finds() -> None:
    rng = np.random.default_rng(0)
    thrust, across, along = rng.uniform(1.0, 200.0, 400), rng.uniform(0.0, 30.0, 400), rng.uniform(0.0, 12.0, 400)
    found = rotor_inflow(thrust, across, along, 0.25, 1.1)
    for k in range(400):
        wanted = thrust[k] / (2.0 * 1.1 * 0.25)

        def flow(v: float, k: int = k, wanted: float = wanted) -> float:
            return v * math.hypot(across[k], along[k] + v) - wanted

        assert found[k] == pytest.approx(brentq(flow, 0.0, 100.0, xtol=1e-13), rel=1e-9)


def test_climbing_lifts_the_weight_and_a_descent_gives_nothing_back() -> None:
    hover, climb = watts(PLAIN, 0.0, 0.0, 0.0), watts(PLAIN, 0.0, 0.0, 3.0)
    weight = PLAIN.mass * GRAVITY
    rotors = math.sqrt(1.5**2 + weight / (2.0 * DENSITY * PLAIN.disc_area)) - 1.5
    assert climb == pytest.approx(weight * (3.0 + rotors))
    assert watts(PLAIN, 0.0, 0.0, -2.0) == pytest.approx(hover)


def test_level_flight_pays_for_drag_and_saves_induced_power() -> None:
    dragging = Airframe("dragging", 2.0, 4, 0.15, 0.7, 1.5, 0.03, 30.0)
    powers = [watts(dragging, speed, 0.0, 0.0) for speed in (0.0, 7.0, 25.0)]
    assert powers[1] < powers[0] < powers[2]
    drag = 0.5 * DENSITY * 0.03 * 25.0**2
    thrust = math.hypot(2.0 * GRAVITY, drag)
    assert powers[2] > 25.0 * drag / 0.7 + 1.5 * thrust**1.5
    # The same whichever way it flies.
    assert watts(dragging, 3.0, -4.0, 1.0) == pytest.approx(watts(dragging, -5.0, 0.0, 1.0))


def test_acceleration_is_thrust() -> None:
    thrust = PLAIN.mass * math.hypot(GRAVITY, 4.0)
    expected = thrust**1.5 / math.sqrt(2.0 * DENSITY * PLAIN.disc_area)
    assert watts(PLAIN, 0.0, 0.0, 0.0, acceleration=(4.0, 0.0, 0.0)) == pytest.approx(expected)


def test_in_free_fall_nothing_is_infinite() -> None:
    assert watts(PLAIN, 0.0, 0.0, 0.0, acceleration=(0.0, 0.0, -GRAVITY)) == pytest.approx(0.0, abs=1e-9)
