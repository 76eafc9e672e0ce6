"""A trajectory flown in MJX: beside C MuJoCo's own flight, in wind, and before a judge by hand."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math

import numpy as np
import pytest

import maxjax
from maxjax.planning.plan import Plan
from maxjax.sim.loop.trajectory_flight import AFTER, Tracking, fly_all, follow_setpoints, summarize_tracking
from tests.planners import bare_plan

GRID = maxjax.Grid((41, 41, 21), 2.0, (5000.0, -40.0, 1.0))
WAYS = (
    [[5020.0, -30.0, 20.0], [5040.0, -30.0, 20.0], [5040.0, -10.0, 24.0]],
    [[5020.0, 0.0, 20.0], [5030.0, 0.0, 20.0]],
)


def polyline(points: list[list[float]]) -> Plan:
    """A plan by hand, in a map without obstacles."""
    path = np.array(points)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    return bare_plan(free(), path, length=length, clearance_at=np.full(len(path), np.inf))


def empty() -> np.ndarray:
    return np.zeros(GRID.shape, bool)


def free() -> maxjax.VoxelMap:
    return maxjax.VoxelMap.on(GRID, empty())


@functools.cache
def ways() -> list[maxjax.Trajectory]:
    return [maxjax.trajectory(polyline(points)) for points in WAYS]


@functools.cache
def calm() -> list[Tracking]:
    return fly_all(ways(), free())


def test_the_vehicle_follows() -> None:
    for asked, flown in zip(ways(), calm(), strict=True):
        assert flown.status == maxjax.Status.OK
        assert flown.time[0] == 0.0
        assert asked.duration + AFTER <= flown.time[-1] < asked.duration + AFTER + 0.02
        assert np.quantile(flown.error, 0.95) <= 0.3
        np.testing.assert_allclose(flown.position[-1], asked.at([asked.duration]).position[0], atol=0.02)
        wanted = np.linalg.norm(flown.position - asked.at(flown.time).position, axis=1)
        np.testing.assert_allclose(flown.error, wanted, atol=1e-9)
        slope = np.diff(flown.position, axis=0) / np.diff(flown.time)[:, None]
        np.testing.assert_allclose(slope, flown.velocity[1:], atol=0.1)
        assert np.isinf(flown.clearance).all()
        assert not flown.contact.any()


def test_a_flight_does_not_depend_on_its_company() -> None:
    """Nor on the duration of others, which the scan is as long as."""
    alone = fly_all(ways()[1:], free())[0]
    np.testing.assert_allclose(alone.position, calm()[1].position, atol=1e-3)


def test_wind_and_its_seed_are_felt_and_repeatable() -> None:
    one = ways()[1]
    first, again, other = (maxjax.fly(one, free(), wind=8.0, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.position, again.position)
    assert np.abs(first.position - other.position).max() > 0.01
    assert np.abs(first.position - calm()[1].position).max() > 0.01
    assert first.status == maxjax.Status.OK


def test_a_wall_in_the_way_is_a_contact_at_the_voxels_face() -> None:
    wall = empty()
    wall[13] = True  # x from 5025 to 5027
    asked = ways()[1]
    flown = maxjax.fly(asked, maxjax.VoxelMap.on(GRID, wall))
    assert flown.status == maxjax.Status.IN_CONTACT
    gap = np.maximum(np.maximum(5025.0 - flown.position[:, 0], flown.position[:, 0] - 5027.0), 0.0)
    np.testing.assert_allclose(flown.clearance, gap, atol=1e-6)
    np.testing.assert_array_equal(flown.contact, gap <= 0.5)


def test_ground_is_touched_but_not_counted_as_clearance() -> None:
    floor = empty()
    floor[:, :, 9] = True  # z from 18 to 20, which is where it flies
    flown = maxjax.fly(ways()[1], maxjax.VoxelMap.on(GRID, floor, floor))
    assert np.isinf(flown.clearance).all()
    assert flown.status == maxjax.Status.IN_CONTACT


def test_in_a_ball_only_the_centre_keeps_off() -> None:
    wall = empty()
    wall[:, 20, :] = True  # y from -1 to 1
    asked = dataclasses.replace(ways()[1], exemptions=(4.0, 0.0))
    time = np.arange(0.0, 3.0, 0.1)
    beside = asked.at(time).position + np.array([0.0, 1.3, 0.0])
    flown = summarize_tracking(asked, time, beside, np.zeros_like(beside), maxjax.VoxelMap.on(GRID, wall))
    away = np.linalg.norm(beside - asked.at([0.0]).position, axis=1)
    np.testing.assert_array_equal(flown.contact, away > 4.0)


def test_a_waypoint_in_between_has_its_ball_too() -> None:
    """By way of a gap of 2 m, where nothing keeps a radius of 1.5 m, and back out."""
    walls = empty()
    walls[15:26, [19, 21], :] = True  # x from 5029 to 5051, a gap between y = -1 and 1
    places = (5010.0, 0.0, 21.0), (5034.0, 0.0, 21.0), (5010.0, -20.0, 21.0)
    mission = maxjax.plan_mission(
        maxjax.VoxelMap.on(GRID, walls), places, planner=maxjax.AStar(), distances=maxjax.Distances(radius=1.5)
    )
    assert mission.status == maxjax.Status.OK
    asked = maxjax.trajectory(mission)
    assert asked.exemptions[0] == asked.exemptions[2] == 0.0
    assert asked.exemptions[1] == max(mission.legs[0].exemptions[1], mission.legs[1].exemptions[0]) > 0.0
    np.testing.assert_allclose(asked.at(asked.passes).position[1], places[1], atol=1e-6)
    time = np.arange(0.0, asked.duration, 0.05)
    aside = asked.at(time).position + np.array([0.0, 0.6, 0.0])  # 0.4 m from a wall
    flown = summarize_tracking(asked, time, aside, np.zeros_like(aside), mission.map)
    in_ball = np.linalg.norm(aside - np.array(places[1]), axis=1) < asked.exemptions[1]
    assert in_ball.any()
    assert not flown.contact[in_ball].any()
    bare = dataclasses.replace(asked, exemptions=(0.0, 0.0, 0.0))
    assert summarize_tracking(bare, time, aside, np.zeros_like(aside), mission.map).contact[in_ball].any()


def test_a_vehicle_that_strays_or_is_lost_says_so() -> None:
    asked = ways()[1]
    time = np.array([0.0, 1.0])
    place = asked.at(time).position
    off = summarize_tracking(asked, time, place + np.array([0.0, 1.2, 0.0]), place, free())
    assert off.status == maxjax.Status.OFF_TRAJECTORY
    place[1] = math.nan
    lost = summarize_tracking(asked, time, place, place, free())
    assert lost.status == maxjax.Status.NONFINITE_STATE
    assert lost.error.tolist() == [0.0, math.inf]
    outside = summarize_tracking(
        asked, time[:1], place[:1] + np.array([500.0, 0.0, 0.0]), place[:1], maxjax.VoxelMap.on(GRID, ~empty())
    )
    assert outside.clearance[0] == pytest.approx(5520.0 - 5081.0, abs=1e-6)


def test_a_hurricane_is_not_followed() -> None:
    flown = maxjax.fly(ways()[1], free(), wind=60.0)
    assert flown.status in (maxjax.Status.OFF_TRAJECTORY, maxjax.Status.NONFINITE_STATE)


def test_what_cannot_be_flown_is_refused() -> None:
    with pytest.raises(ValueError, match=r"map: expected a maxjax\.VoxelMap, given an array"):
        inspect.unwrap(maxjax.fly)(ways()[0], empty())
    with pytest.raises(ValueError, match="wind: expected a speed"):
        maxjax.fly(ways()[0], free(), wind=-1.0)
    with pytest.raises(ValueError, match="expected at least one, given none"):
        follow_setpoints([])
