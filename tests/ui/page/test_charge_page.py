"""Energy on the page: the charge that is left stands in the panel, and what the battery does not last for is told."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

import maxjax
from maxjax.energy.split_flights import weigh_flight
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.page.answer import Answer, answer, describe_answer
from maxjax.ui.page.charge_chart import charge_chart
from maxjax.ui.page.download import file_of, page_of
from maxjax.ui.page.inspection_answer import InspectionRequest, describe_inspection, inspect_building
from maxjax.ui.request import Request
from tests.ui.page.test_inspection_page import ASKED, RULES, city
from tests.ui.page.test_page import town

STOPS = (Waypoint((8.0, 10.0, 10.0)), Waypoint((34.0, 40.0, 20.0), hover=60.0), Waypoint((58.0, 50.0, 12.0)))
GIVEN = {"airframe": "mavic_3_enterprise", "reserve": 0.25}


def planned(battery: float | None, **options: float) -> Answer:
    """The answer of the page for a mission with a hover of a minute."""
    given = {} if battery is None else {**GIVEN, "battery": battery}
    return answer(town(), Request(map="town", waypoints=STOPS, speed=6.0, **given, **options))  # type: ignore[arg-type]


def test_each_leg_has_its_energy_and_the_whole_its_verdict() -> None:
    """As the library measures the same trajectory."""
    found = planned(77.0)
    flown = maxjax.trajectory(found.verified, found.request.limits)
    taken = maxjax.measure_consumption(flown, maxjax.Airframe.mavic_3_enterprise())
    words = describe_answer(found)
    for leg, left in zip(taken.legs, taken.charge_after(maxjax.Battery(77.0, 0.25)), strict=True):
        assert f"{leg:.1f} Wh, {100.0 * left:.0f} % left" in words
    assert f"Battery: the flight takes {taken.total:.1f} of {0.75 * 77.0:.1f} Wh above the reserve." in words
    assert f"Battery: the flight takes {taken.total:.1f} of" in page_of(town(), found)
    assert "Wh" not in describe_answer(planned(None))
    assert charge_chart([planned(None).flight], None) == ""


def test_the_chart_is_the_charge_over_time() -> None:
    """From full on the upper edge down to what is left; the reserve is the veil below."""
    found = planned(20.0)
    assert found.flight is not None
    assert found.flight.taken is not None
    supply = found.request.supply
    assert supply is not None
    chart = charge_chart([found.flight], supply)
    (line,) = re.findall(r'points="([^"]+)"', chart)
    x, y = np.array([pair.split(",") for pair in line.split()], float).T
    assert (x[0], y[0], x[-1]) == (0.0, 0.0, 300.0)
    time = x / 300.0 * found.flight.taken.time[-1]
    drawn, charge = 1.0 - y / 70.0, found.flight.taken.charge(supply.battery)
    np.testing.assert_allclose(drawn[1:-1], np.interp(time[1:-1], found.flight.taken.time, charge), atol=2e-3)
    left = 1.0 - found.flight.taken.total / 20.0
    assert drawn[-1] == pytest.approx(left, abs=1e-3)
    assert f"100 % to {100.0 * left:.0f} %, reserve 25 %" in chart
    assert 'y="52.5"' in chart


def test_what_the_battery_does_not_last_for_is_told_and_not_downloaded() -> None:
    """A path is shown, and no file of it; its mission can be taken away to be split."""
    found = planned(3.0)
    assert found.ok
    assert "**CANNOT_RETURN** the flight takes" in describe_answer(found)
    with pytest.raises(ValueError, match="CANNOT_RETURN: the flight takes"):
        file_of(town(), None, ".csv", found)
    assert file_of(town(), None, ".toml", found)[0] == "mission.toml"
    storm = planned(77.0, wind=(30.0, 0.0))  # type: ignore[arg-type]
    assert "### Cannot be planned\nwind: expected less than" in describe_answer(storm)


def test_an_inspection_has_its_charge_and_its_verdict() -> None:
    def asked(battery: float) -> InspectionRequest:
        return dataclasses.replace(ASKED, rules=dataclasses.replace(RULES, battery=battery, **GIVEN))  # type: ignore[arg-type]

    lasts, small = inspect_building(city(), asked(77.0)), asked(2.0).rules
    flights = tuple(weigh_flight(mission, small.limits, small.supply) for mission in lasts.verified.missions)
    short = dataclasses.replace(lasts, flights=flights)
    (flight,) = lasts.flights
    assert flight.verdict is not None
    assert f"Battery: {flight.verdict.describe()}." in describe_inspection(lasts)
    assert "Battery: **CANNOT_RETURN** the flight takes" in describe_inspection(short)
    with pytest.raises(ValueError, match="CANNOT_RETURN"):
        short.verified  # noqa: B018 (raises)
    refused = describe_inspection(inspect_building(city(), asked(2.0)))
    assert "### Cannot be inspected\nplace" in refused
    assert "give more capacity" in refused
    chart = charge_chart(lasts.flights, lasts.request.rules.supply)
    assert f"<span>{lasts.duration:.0f} s</span>" in chart
