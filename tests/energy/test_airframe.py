"""Airframes: the model flies them for as long as their sources say, and refuses figures that are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maxjax.energy.airframe import AIRFRAMES, Airframe
from maxjax.energy.power import power


def watts(airframe: Airframe, speed: float, climb: float = 0.0) -> float:
    velocity = np.array([[speed, 0.0, climb]])
    return float(power(airframe, velocity, np.zeros((1, 3)))[0])


@pytest.mark.parametrize(("payload", "minutes"), [(0.0, 28.0), (0.5, 20.0), (1.0, 16.0)])
def test_matrice_100_hovers_as_its_manual_says_and_is_promised_no_longer(payload: float, minutes: float) -> None:
    hovers = 60.0 * 129.96 / watts(Airframe.matrice_100().with_payload(payload), 0.0)
    assert 0.94 * minutes < hovers < 1.002 * minutes


def test_mavic_3_enterprise_hovers_and_flies_as_its_specifications_say() -> None:
    airframe = Airframe.mavic_3_enterprise()
    assert 60.0 * 77.0 / watts(airframe, 0.0) == pytest.approx(38.0, rel=2e-3)
    assert 60.0 * 77.0 / watts(airframe, 9.0) == pytest.approx(45.0, rel=2e-3)
    assert 3.6 * 15.0 * 77.0 / watts(airframe, 15.0) == pytest.approx(32.0, rel=2e-3)


@pytest.mark.parametrize("speed", [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0])
def test_iris_plus_takes_what_liu_measured(speed: float) -> None:
    k1, k2, c2, c4, c5 = 0.8554, 0.3051, 0.3177, 0.0296, 0.0279
    weight, forward = 1.5 * 9.8, speed * math.cos(math.radians(10.0))
    thrust = math.hypot(weight - c5 * forward**2, c4 * speed**2)
    liu = (k1 / k2 + c2) * thrust**1.5 + c4 * speed**3
    assert watts(Airframe.iris_plus(), speed) == pytest.approx(liu, rel=0.05)


def test_iris_plus_climbs_within_a_tenth_of_what_liu_measured() -> None:
    k1, k2, c2, weight = 0.8554, 0.3051, 0.3177, 1.5 * 9.8
    for climb in (1.0, 2.0):
        liu = k1 * weight * (climb / 2 + math.sqrt(climb**2 / 4 + weight / k2**2)) + c2 * weight**1.5
        assert 1.0 < watts(Airframe.iris_plus(), 0.0, climb) / liu < 1.11


def test_every_named_airframe_has_a_source_and_a_speed_that_it_can_fly() -> None:
    for name in AIRFRAMES:
        airframe = Airframe.named(name)
        assert airframe.source
        drag = 0.5 * 1.225 * airframe.drag_area * airframe.airspeed**2
        assert math.degrees(math.atan2(drag, airframe.mass * 9.81)) < 36.0
    with pytest.raises(ValueError, match="airframe: expected one of iris_plus, matrice_100, mavic_3_enterprise"):
        Airframe.named("phantom")


@pytest.mark.parametrize(
    ("name", "value"),
    [("mass", 0.0), ("mass", math.nan), ("rotors", 0), ("rotor_radius", -0.1), ("efficiency", 1.2),
     ("efficiency", 0.0), ("profile", -1.0), ("drag_area", math.inf), ("airspeed", 0.0)],
)  # fmt: skip
def test_figures_that_are_none_are_refused(name: str, value: float) -> None:
    fields = {"name": "own", "mass": 1.0, "rotors": 4, "rotor_radius": 0.1, "efficiency": 0.7, "profile": 2.0,
              "drag_area": 0.02, "airspeed": 15.0}  # fmt: skip
    assert Airframe(**fields).disc_area == pytest.approx(0.04 * math.pi)
    with pytest.raises(ValueError, match=f"Airframe.{name}: expected"):
        Airframe(**fields | {name: value})
    with pytest.raises(ValueError, match="payload: expected a mass"):
        Airframe(**fields).with_payload(-1.0)
