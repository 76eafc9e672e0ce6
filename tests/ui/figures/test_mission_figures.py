"""Figures of missions show what they say: clearance, heights, speeds and waypoints."""

from __future__ import annotations

import functools
import itertools
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax.energy.charge_profile import ChargeProfile
from maxjax.energy.split_flights import weigh_flight
from maxjax.planning.mission import Mission

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402

from maxjax.ui.figures.missions import figure_mission  # noqa: E402
from maxjax.ui.figures.style import save_figure  # noqa: E402

GRID = maxjax.Grid((60, 60, 20), 2.0, (-59.0, -59.0, 1.0))
LIMITS = maxjax.FlightLimits(speed=6.0)
WAYPOINTS = (
    maxjax.Waypoint((-40.0, -10.0, 12.0)),
    maxjax.Waypoint((30.0, 5.0, 20.0), hover=4.0),
    maxjax.Waypoint((0.0, 40.0, 30.0), speed=3.0),
    maxjax.Waypoint((-40.0, -10.0, 12.0)),
)


@functools.cache
def flown(ground: bool = True) -> tuple[Mission, maxjax.Trajectory]:
    soil = np.zeros(GRID.shape, bool)
    soil[:, :, :2] = ground
    occupied = soil.copy()
    occupied[25:33, 27:33, :12] = True
    mission = maxjax.plan_mission(maxjax.VoxelMap.on(GRID, occupied, soil), WAYPOINTS, planner=maxjax.AStar())
    return mission, maxjax.trajectory(mission, LIMITS)


def test_strips_over_time_show_height_clearance_and_speed() -> None:
    mission, trajectory = flown()
    height, clearance, speed = figure_mission(*flown()).axes[3:]
    motion = trajectory.sampled(0.1)
    line = height.lines[0]
    np.testing.assert_allclose(line.get_xdata(), motion.time)
    # The ground ends at z = 4 m.
    np.testing.assert_allclose(line.get_ydata(), motion.position[:, 2] - 4.0)
    verdict = maxjax.verify(motion.position, mission.map)
    np.testing.assert_allclose(clearance.lines[0].get_ydata(), np.minimum(verdict.clearance_at, 30.0))
    np.testing.assert_allclose(speed.lines[0].get_ydata(), np.linalg.norm(motion.velocity, axis=1))
    np.testing.assert_array_equal(speed.lines[1].get_ydata(), [6.0, 3.0, 6.0, 6.0])
    np.testing.assert_array_equal(speed.lines[1].get_xdata(), trajectory.passes)
    assert [text.get_text() for text in height.texts] == ["0", "1", "2", "3"]
    assert height.get_ylabel() == "Height above\nground [m]"
    assert mission.status == maxjax.Status.OK


def test_a_map_without_ground_shows_z() -> None:
    height = figure_mission(*flown(ground=False)).axes[3]
    assert height.get_ylabel() == "Height, z [m]"
    np.testing.assert_allclose(height.lines[0].get_ydata(), flown(ground=False)[1].sampled(0.1).position[:, 2])


def test_waypoints_are_numbered_with_their_heights() -> None:
    plan = figure_mission(*flown()).axes[0]
    assert [text.get_text() for text in plan.texts if text.get_text()] == ["0, 3:  z 12 m", "1:  z 20 m", "2:  z 30 m"]


def test_a_battery_has_a_strip_of_its_own() -> None:
    """Charge over time with the reserve; times stand below it, and not twice."""
    mission, _ = flown()
    supply = maxjax.Supply(maxjax.Airframe.mavic_3_enterprise(), maxjax.Battery(20.0, reserve=0.3))
    charge = ChargeProfile.of(weigh_flight(mission, LIMITS, supply), supply)
    assert charge is not None
    speed, battery = figure_mission(*flown(), charge=charge).axes[5:]
    np.testing.assert_allclose(battery.lines[0].get_ydata(), 100.0 * charge.left)
    assert battery.patches[0].get_xy()[1] + battery.patches[0].get_height() == pytest.approx(30.0)
    assert (speed.get_xlabel(), battery.get_xlabel()) == ("", "Time [s]")


@pytest.mark.parametrize("capacity", [None, 20.0])
def test_nothing_overlaps_or_leaves_the_page(tmp_path: Path, capacity: float | None) -> None:
    charge = None
    if capacity is not None:
        supply = maxjax.Supply(maxjax.Airframe.mavic_3_enterprise(), maxjax.Battery(capacity, reserve=0.3))
        charge = ChargeProfile.of(weigh_flight(flown()[0], LIMITS, supply), supply)
    drawn = figure_mission(*flown(), "Town", charge=charge)
    renderer = FigureCanvasAgg(drawn).get_renderer()
    boxes = [axes.get_tightbbox(renderer) for axes in drawn.axes]
    for first, second in itertools.combinations(boxes, 2):
        assert not first.padded(-2).overlaps(second.padded(-2))
    for box in boxes:
        assert 0 <= box.x0 < box.x1 <= drawn.bbox.x1
        assert 0 <= box.y0 < box.y1 <= drawn.bbox.y1
    save_figure(drawn, tmp_path / "mission.png")
