"""The figure of an inspection: the charge over its flights beside it, where a battery is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import maxjax

pytest.importorskip("matplotlib")

from maxjax.energy.charge_profile import ChargeProfile
from maxjax.energy.split_flights import weigh_flight
from maxjax.trajectories.limits import PX4_MISSION
from maxjax.ui.figures.inspections import figure_inspection
from maxjax.ui.figures.style import save_figure
from tests.inspection.towns import rectangle, town


def test_a_battery_has_axes_of_its_own_with_a_line_a_flight(tmp_path: Path) -> None:
    """Each line is the charge of its flight, in the colour that the flight has in space."""
    found = maxjax.inspect(
        town((rectangle(0.0, 0.0, 8.0, 6.0), 7.0)),
        "house 0",
        "DJI M3E",
        capture=maxjax.Capture(6.0, (0.5, 0.3)),
        vehicles=maxjax.Vehicles(((-14.0, 4.0, 6.0),), capacity=50.0),
    )
    supply = maxjax.Supply(maxjax.Airframe.mavic_3_enterprise(), maxjax.Battery(5.0, reserve=0.3))
    charges = [ChargeProfile.of(weigh_flight(one, PX4_MISSION, supply), supply) for one in found.missions]
    assert len(charges) > 1
    drawn = figure_inspection(found, charges=[one for one in charges if one is not None])
    space, _, battery = drawn.axes[:3]
    assert battery.get_ylabel() == "Charge\n[%]"
    for line, charge, way in zip(battery.lines, charges, space.lines, strict=False):
        assert charge is not None
        np.testing.assert_allclose(line.get_ydata(), 100.0 * charge.left)
        np.testing.assert_allclose(line.get_xdata(), charge.time)
        assert line.get_color() == way.get_color()
    save_figure(drawn, tmp_path / "inspection.png")
    labels = [axes.get_ylabel() for axes in figure_inspection(found).axes]
    assert "Charge\n[%]" not in labels
