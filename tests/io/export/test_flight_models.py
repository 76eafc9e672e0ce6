"""How autopilots fly files of waypoints: flights of ArduCopter 4.7 in software are the oracle of the model's rows.

Its own physics, a quadrotor, true positions at 25 Hz; measured on docs/samples/round.toml and on a square.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax.io.export.as_flown import judge_lines
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.blended_legs import Leg, blended_legs, duration_of, targets_of
from maxjax.io.export.corners import Waypoints
from maxjax.io.export.export import export
from maxjax.io.export.flown_track import fly_track, set_point_duration
from maxjax.io.export.halts import halts_of
from maxjax.io.export.read_back import Lines
from maxjax.io.export.s_curve import LegLimits, SCurve
from maxjax.io.export.thinning import left_out, thin, thinnings
from maxjax.io.geo.earth import TangentPlane
from maxjax.planning.mission import Mission
from maxjax.trajectories.clear_curve import project
from tests.planners import bare_plan

ROUND = np.loadtxt(Path(__file__).parent / "round_path.csv", delimiter=",")
PLACES = np.array([0, 11, 26, 46])
SPEEDS, HOVERS = (8.0, 4.0, 8.0), (0.0, 5.0, 10.0, 0.0)
SQUARE = np.array([[0.0, 0.0, 20.0], [60.0, 0.0, 20.0], [60.0, 60.0, 20.0], [0.0, 60.0, 20.0], [0.0, 0.0, 20.0]])
SIX = {"WPNAV_SPEED_UP": 800.0, "WPNAV_SPEED_DN": 800.0, "WPNAV_ACCEL_Z": 250.0, "WPNAV_JERK": 5.0}
EMPTY = maxjax.VoxelMap.of(np.zeros((30, 30, 15), bool), spacing=8.0, origin=(-116.0, -116.0, 4.0))


def round_mission(tolerance: float | None = None) -> Mission:
    """The round without anything around, thinned or not."""
    whole = Mission.of_plan(bare_plan(EMPTY, ROUND, clearance_at=np.full(len(ROUND), np.inf)))
    parts = [ROUND[a : b + 1] for a, b in itertools.pairwise(PLACES.tolist())]
    legs = tuple(bare_plan(EMPTY, part, clearance_at=np.full(len(part), np.inf)) for part in parts)
    points = tuple(maxjax.Waypoint((x, y, z)) for x, y, z in ROUND[PLACES].tolist())
    whole = dataclasses.replace(whole, legs=legs, waypoints=points, places=PLACES)
    return whole if tolerance is None else thin(whole, tolerance)


def waypoints_on(mission: Mission) -> Waypoints:
    many = len(mission.path)
    holds, speeds = np.zeros(many), np.full(many, math.nan)
    for leg, (first, last) in enumerate(itertools.pairwise(mission.places.tolist())):
        holds[last], speeds[first + 1 : last + 1] = HOVERS[leg + 1], SPEEDS[leg]
    return Waypoints(mission.path, holds, np.full(many, 0.5), speeds=speeds)


@pytest.mark.parametrize(
    ("tolerance", "parameters", "seconds", "mean", "most"),
    [
        (None, {}, 211.0, 0.10, 0.59),
        (None, SIX, 144.0, 0.13, 0.78),
        (0.5, {}, 165.0, 0.11, 0.58),
        (1.0, {}, 156.0, 0.19, 0.93),
    ],
)
def test_the_round_takes_as_long_as_it_took(
    tolerance: float | None, parameters: dict[str, float], seconds: float, mean: float, most: float
) -> None:
    track = fly_track(waypoints_on(round_mission(tolerance)), Autopilot.arducopter(**parameters))
    assert track.duration == pytest.approx(seconds, rel=0.02)
    aside = project(track.points, ROUND)[0]
    assert aside.mean() == pytest.approx(mean, abs=0.1)
    assert aside.max() == pytest.approx(most, abs=0.2)


@pytest.mark.parametrize(("radius", "missed"), [(50.0, 0.07), (200.0, 1.35), (500.0, 4.4)])
def test_corners_of_a_square_are_missed_as_they_were(radius: float, missed: float) -> None:
    square = Waypoints(SQUARE, np.zeros(5), np.full(5, 0.5), speeds=np.full(5, 8.0))
    pilot = Autopilot.arducopter(WPNAV_RADIUS=radius, WPNAV_ACCEL_C=500.0)
    points = fly_track(square, pilot).points
    for corner in SQUARE[1:4]:
        assert np.linalg.norm(points - corner, axis=1).min() == pytest.approx(missed, abs=0.1)
    # The set-points alone miss it by the radius.
    legs = blended_legs(SQUARE, square.speeds_to, square.holds, pilot)
    apart = np.linalg.norm(targets_of(SQUARE[0], legs, 0.02).position - SQUARE[1], axis=1).min()
    assert apart == pytest.approx(radius / 100.0, abs=0.05)


def integrated(rate: np.ndarray, times: np.ndarray) -> np.ndarray:
    return np.asarray(np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times)))


def test_a_leg_keeps_its_limits_and_ends_at_rest() -> None:
    rng = np.random.default_rng(57)
    for length in 10.0 ** rng.uniform(-2.0, 2.5, 60):
        speed, acceleration, jerk = (float(x) for x in rng.uniform(0.3, 12.0, 3))
        snap = float(rng.uniform(1.0, 8.0)) * jerk
        curve = SCurve.of(float(length), LegLimits(speed, acceleration, jerk, snap))
        times = np.linspace(0.0, curve.duration, 4001)
        way, fast, hard = curve.at(times)
        for reached, most in ((fast, speed), (hard, acceleration), (np.gradient(hard, times), jerk)):
            assert np.abs(reached).max() <= most * 1.01
        assert np.abs(np.gradient(np.gradient(hard, times), times)[4:-4]).max() <= 1.02 * snap
        np.testing.assert_allclose([way[0], fast[0], hard[0], fast[-1], hard[-1]], 0.0, atol=1e-6)
        assert way[-1] == pytest.approx(length, rel=1e-6)
        # The way is the integral of the speed, and that of the acceleration.
        np.testing.assert_allclose(np.r_[0.0, integrated(fast, times)], way, atol=1e-4 * length)
        np.testing.assert_allclose(np.r_[0.0, integrated(hard, times)], fast, atol=1e-3 * speed)
        # On a way that is long enough it reaches its speed, and no sooner than its acceleration allows.
        long = SCurve.of(1e4, LegLimits(speed, acceleration, jerk, snap))
        assert long.at(np.array([long.accelerates]))[1] == pytest.approx(speed, rel=1e-9)
        assert long.accelerates >= speed / acceleration


def test_a_long_leg_takes_its_time_at_the_speed_and_half_a_ramp_at_each_end() -> None:
    curve = SCurve.of(500.0, LegLimits(8.0, 2.5, 1.0, math.pi / 0.6))
    ramp = 8.0 / 2.5 + 2.5 / 1.0 + 0.3  # v/a + a/j, and the time in which the jerk rises
    assert curve.duration == pytest.approx(500.0 / 8.0 + ramp, rel=1e-9)
    assert curve.accelerates == pytest.approx(ramp, rel=1e-9)
    # A leg too short for the whole jerk is all snap: half of it is 8 S τ⁴ / π.
    short = SCurve.of(0.1, LegLimits(8.0, 2.5, 1.0, 1.0))
    assert short.duration == pytest.approx(8.0 * (math.pi * 0.05 / 8.0) ** 0.25, rel=1e-6)


def test_an_upright_leg_keeps_the_limits_of_a_climb() -> None:
    places = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 65.0], [0.0, 0.0, 5.0]])
    up, down = blended_legs(places, np.full(3, 8.0), np.zeros(3), Autopilot.arducopter())
    # 2.5 m/s up and 1.5 down at 1 m/s², jerk 1 m/s³ that rises in 0.3 s.
    assert up.motion.duration == pytest.approx(60.0 / 2.5 + 2.5 + 1.0 + 0.3, rel=1e-9)
    assert down.motion.duration == pytest.approx(60.0 / 1.5 + 1.5 + 1.0 + 0.3, rel=1e-9)


def test_a_hold_before_no_way_is_kept() -> None:
    """As after a take-off that ends at the first waypoint."""
    places = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 5.0], [30.0, 0.0, 5.0]])
    (leg,) = blended_legs(places, np.full(3, 8.0), np.array([2.0, 1.0, 0.0]), Autopilot.arducopter())
    assert leg.start == 3.0


def test_two_legs_at_most_are_in_motion_and_one_at_a_hold() -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        places = np.cumsum(rng.normal(0.0, 6.0, (14, 3)), axis=0)
        holds = np.where(rng.random(14) < 0.2, 2.0, 0.0)
        legs = blended_legs(places, np.full(14, 8.0), holds, Autopilot.arducopter())
        spans = np.array([(leg.start, leg.start + leg.motion.duration) for leg in legs])
        for time in np.arange(0.0, duration_of(legs), 0.05):
            assert ((spans[:, 0] < time) & (time < spans[:, 1])).sum() <= 2
        for k in np.flatnonzero(holds[1:-1]) + 1:
            assert spans[k, 0] == pytest.approx(spans[k - 1, 1] + 2.0)
        targets = targets_of(places[0], legs, 0.01)
        np.testing.assert_allclose(targets.position[-1], places[-1], atol=1e-9)
        speed = np.diff(targets.position, axis=0) / 0.01
        np.testing.assert_allclose(speed, 0.5 * (targets.velocity[1:] + targets.velocity[:-1]), atol=2e-3)
        assert (np.hypot(speed[:, 0], speed[:, 1]) <= 8.001).all()
        assert (speed[:, 2] >= -1.501).all()
        assert (speed[:, 2] <= 2.501).all()


def test_what_is_modelled_lies_in_what_corners_are_judged_by() -> None:
    """Set-points leave the lines by no more than the bound of corners: r at the bisector."""
    rng = np.random.default_rng(5)
    for radius in (50.0, 200.0, 500.0):
        places = np.cumsum(rng.normal(0.0, 9.0, (20, 3)), axis=0)
        legs: list[Leg] = blended_legs(
            places, np.full(20, 8.0), np.zeros(20), Autopilot.arducopter(WPNAV_RADIUS=radius)
        )
        aside = project(targets_of(places[0], legs, 0.05).position, places)[0]
        assert aside.max() <= radius / 100.0


def test_holds_count_in_whole_seconds() -> None:
    pilot, places = Autopilot.arducopter(), SQUARE[:3]
    times = [
        duration_of(blended_legs(places, np.full(3, 8.0), np.array([0.0, hold, 0.0]), pilot))
        for hold in (1.0, 1.9, 2.0)
    ]
    assert times[0] == times[1] == pytest.approx(times[2] - 1.0)


def test_a_vehicle_that_touches_is_refused(tmp_path: Path) -> None:
    """Behind its last waypoint, over which it swings, stands a wall."""
    occupied = np.zeros((60, 8, 8), bool)
    occupied[56:, :, :] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    for end, touches in ((55.9, True), (54.0, False)):
        path = np.array([[4.0, 4.0, 4.0], [end, 4.0, 4.0]])
        plan = bare_plan(where, path, maxjax.Distances(0.05, 0.05), clearance_at=np.full(2, 0.1))
        lines = Lines((path,), holds=np.zeros(2), accepted=np.full(2, 0.5), speeds=np.full(2, 12.0))
        mission, pilot = Mission.of_plan(plan), Autopilot.arducopter()
        if touches:
            with pytest.raises(
                ValueError, match=r"by ArduCopter it leaves the map or touches something: the vehicle sw"
            ):
                judge_lines(tmp_path / "a.plan", lines, mission, None, autopilots=(pilot,))
        else:
            (flight,) = judge_lines(tmp_path / "a.plan", lines, mission, None, autopilots=(pilot,)).flights
            assert 0.0 < flight.clearance < 2.0


def test_px4_takes_at_least_the_way_at_its_speed() -> None:
    places = np.array([[0.0, 0.0, 10.0], [40.0, 0.0, 10.0], [80.0, 0.0, 10.0]])
    straight = Waypoints(places, np.zeros(3), np.full(3, 0.5), speeds=np.full(3, 5.0))
    ramp = 5.0 / 3.0 + 3.0 / 4.0
    through = set_point_duration(straight, Autopilot.px4())
    assert through == pytest.approx(80.0 / 5.0 + ramp, rel=1e-3)
    held = set_point_duration(dataclasses.replace(straight, holds=np.array([0.0, 4.0, 0.0])), Autopilot.px4())
    assert held == pytest.approx(80.0 / 5.0 + 2.0 * ramp + 4.0, rel=1e-3)
    climb = Waypoints(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 30.0]]), np.zeros(2), np.full(2, 0.5))
    assert set_point_duration(climb, Autopilot.px4()) == pytest.approx(10.0)
    corner = dataclasses.replace(straight, places=np.array([[0.0, 0.0, 10.0], [40.0, 0.0, 10.0], [40.0, 40.0, 10.0]]))
    assert through < set_point_duration(corner, Autopilot.px4()) < held - 4.0


def test_thinning_keeps_waypoints_and_stays_near() -> None:
    mission = round_mission()
    for tolerance in (0.1, 0.5, 1.0):
        found = thin(mission, tolerance)
        assert project(mission.path, found.path)[0].max() <= tolerance
        np.testing.assert_array_equal(found.path[found.places], ROUND[PLACES])
        gone = left_out(mission, found)
        np.testing.assert_array_equal(np.delete(mission.path, gone, axis=0), found.path)
    counts = [len(one.path) for one in thinnings(mission)]
    assert len(set(counts)) == len(counts) > 2


def test_a_shortcut_that_comes_nearer_is_none() -> None:
    """Around a pillar at 3 m: the line between the ends would pass it at 2.4 m."""
    occupied = np.zeros((40, 20, 10), bool)
    occupied[20, 6, :] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path = np.array([[5.0, 9.4, 5.0], [20.5, 10.0, 5.0], [35.0, 9.4, 5.0]])
    plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), clearance=3.0, clearance_at=np.full(3, 3.0))
    assert len(thin(Mission.of_plan(plan), 1.0).path) == 3
    free = dataclasses.replace(plan, map=EMPTY)
    assert len(thin(Mission.of_plan(free), 1.0).path) == 2


def test_a_file_is_thinned_where_that_saves_time_and_says_so(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 25)
    path = np.column_stack([-60.0 + 120.0 * t, 6.0 * np.sin(3.0 * t), 20.0 + 2.0 * np.cos(9.0 * t)])
    plan = bare_plan(EMPTY, path, clearance_at=np.full(25, np.inf))
    earth = TangentPlane(52.0, 4.3, 0.0)
    found = export(tmp_path / "a.plan", plan, earth=earth, ground=0.0, autopilot=Autopilot.arducopter())
    whole = set_point_duration(
        Waypoints(path, np.zeros(25), np.full(25, 0.5), speeds=np.full(25, 5.0)), Autopilot.arducopter()
    )
    assert 120.0 / 5.0 < found.duration < 0.8 * whole
    assert 5 < len(found.left_out) < 24
    text = (tmp_path / "a.plan").read_text()
    assert f"{len(found.left_out)} of 25 waypoints are left out" in text
    assert any("with all of its waypoints it would be flown by ArduCopter in" in remark for remark in found.remarks)
    assert str(found) == f"as flown by ArduCopter in {found.duration:.0f} s: nothing in the map to come near to"


def commands(file: Path) -> list[int]:
    return [item["command"] for item in json.loads(file.read_text())["mission"]["items"]]


def test_a_file_that_arducopter_may_fly_begins_with_a_take_off(tmp_path: Path) -> None:
    """Its AUTO does not begin on the ground without one; where the way up is not clear, a sentence says what to do."""
    occupied = np.zeros((30, 10, 12), bool)
    occupied[3:6, 3:6, 3] = True
    path = np.array([[4.5, 4.5, 8.0], [15.0, 5.0, 9.0], [25.0, 5.0, 8.0]])
    file, earth = tmp_path / "a.plan", TangentPlane(52.0, 4.3, 0.0)
    for roof, autopilot, begins in (
        (False, None, True),
        (False, Autopilot.arducopter(), True),
        (False, Autopilot.px4(), False),
        (True, Autopilot.arducopter(), False),
    ):
        where = maxjax.VoxelMap.of(occupied & roof, spacing=1.0, origin=(0.5, 0.5, 0.5))
        plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), clearance_at=np.full(3, 4.0))
        found = export(file, plan, earth=earth, ground=0.0, autopilot=autopilot)
        assert (commands(file)[0] == 22) == begins
        assert 21 not in commands(file)
        assert any("take off in GUIDED to the height of the start first" in one for one in found.remarks) == roof
        export(file, plan, earth=earth, ground=0.0, autopilot=autopilot, takeoff_and_landing=False)
        assert 22 not in commands(file)


def test_autopilots_know_their_limits() -> None:
    copter, px4 = Autopilot.arducopter(), Autopilot.px4()
    assert px4.limits == maxjax.FlightLimits()
    # What ArduCopter followed to 0.8 m at most: 2 m/s², jerk 4.
    assert (copter.limits.acceleration, copter.limits.jerk) == (2.0, 4.0)
    assert (copter.limits.ascent, copter.limits.descent) == (2.5, 1.5)
    assert (copter.stream_timeout, px4.stream_timeout) == (3.0, 1.0)
    assert math.degrees(copter.lean) == pytest.approx(30.0)
    agile = Autopilot.named("arducopter:WPNAV_ACCEL=500,WPNAV_SPEED_UP=800")
    assert agile.mission.corner_acceleration == 10.0
    assert agile.limits.acceleration == pytest.approx(4.0)
    assert agile.parameters["WPNAV_ACCEL"] == 500.0
    assert agile.parameters["WPNAV_SPEED_UP"] == 800.0
    assert "WPNAV_SPEED_DN" not in agile.parameters
    leaning = Autopilot.arducopter(ANGLE_MAX=1000.0)
    assert leaning.limits.acceleration == pytest.approx(0.8 * 9.80665 * math.tan(math.radians(10.0)))


def test_a_stop_takes_the_braking_way_and_walls_ahead_are_told() -> None:
    """A corner 1 m before a wall: a stop from before it leads into that; it does not 5 m before, since AUTO brakes."""
    for wall, touches in ((61, True), (65, False)):
        occupied = np.zeros((100, 80, 10), bool)
        occupied[wall:, :, :] = True
        where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
        places = np.array([[4.0, 10.0, 5.0], [60.0, 10.0, 5.0], [60.0, 70.0, 5.0]])
        waypoints = Waypoints(places, np.zeros(3), np.full(3, 0.5), speeds=np.full(3, 8.0))
        halts = halts_of(fly_track(waypoints, Autopilot.arducopter()), where)
        # v²/2a, v a/2j, and 0.3 s until it leans.
        assert halts.longest == pytest.approx(8.0 * (8.0 / 5.0 + 2.5 / 10.0 + 0.3), abs=0.4)
        assert (len(halts.touching) > 0) == touches
        assert ("it touches something, first at x" in str(halts)) == touches
        for x, y, _ in halts.touching:
            assert wall - x < halts.longest
            assert 9.0 < y < 16.0


def test_a_faster_file_that_is_less_clear_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shortcut past a pillar at 2.6 m in place of 3 m keeps the radius, and saves time."""
    from maxjax.io.export import fastest

    occupied = np.zeros((80, 20, 10), bool)
    occupied[40, 6, :] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    x = np.linspace(5.0, 76.0, 12)
    path = np.column_stack([x, 9.6 + 0.6 * np.exp(-(((x - 40.5) / 20.0) ** 2)), np.full(12, 5.0)])
    plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), clearance=3.0, clearance_at=np.full(12, 3.0))
    straight = dataclasses.replace(Mission.of_plan(plan), path=path[[0, -1]], places=np.array([0, 1]))
    monkeypatch.setattr(fastest, "thinnings", lambda mission: iter([straight]))
    earth = TangentPlane(52.0, 4.3, 0.0)
    found = export(tmp_path / "a.plan", plan, earth=earth, ground=0.0, autopilot=Autopilot.arducopter())
    assert found.left_out == ()
    assert found.clearance > 2.9


@pytest.mark.parametrize("name", ["a.plan", "a.waypoints"])
def test_the_speed_of_a_file_is_what_it_is_flown_at(tmp_path: Path, name: str) -> None:
    path = np.array([[-100.0, 0.0, 20.0], [100.0, 0.0, 20.0]])
    plan = bare_plan(EMPTY, path, clearance_at=np.full(2, np.inf))
    earth, pilot = TangentPlane(52.0, 4.3, 0.0), Autopilot.arducopter()
    found = export(tmp_path / name, plan, earth=earth, ground=0.0, takeoff_and_landing=False, autopilot=pilot)
    # 5 m/s where nothing else is asked for; the vehicle's clock costs the rest.
    assert found.duration == pytest.approx(200.0 / 5.0 + 5.0 / 2.5 + 2.5 + 0.3, abs=2.0)
