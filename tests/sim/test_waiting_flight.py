"""Simulated flights by a clock that waits: time itself in calm air, and never far behind in wind."""

from __future__ import annotations

import functools

import numpy as np

import maxjax
from maxjax.sim.loop.trajectory_flight import AFTER, follow_setpoints
from maxjax.sim.loop.waiting_flight import follow_waiting
from maxjax.sim.vehicle.controller import Controller
from maxjax.sim.vehicle.quadrotor import Vehicle
from tests.planners import bare_plan

LEANS = Vehicle(), Controller(tilt=20.0)
FLIGHTS = 8


@functools.cache
def trajectory() -> maxjax.Trajectory:
    grid = maxjax.Grid((41, 21, 11), 2.0, (-40.0, -20.0, 0.0))
    path = np.array([[-14.0, 0.0, 4.0], [14.0, 0.0, 4.0]])
    plan = bare_plan(
        maxjax.VoxelMap.on(grid, np.zeros(grid.shape, bool)),
        path,
        length=28.0,
        clearance=np.inf,
        clearance_at=np.full(2, np.inf),
    )
    return maxjax.trajectory(plan, maxjax.FlightLimits(speed=8.0, acceleration=2.5, jerk=5.0))


def worst(position: np.ndarray, times: np.ndarray) -> float:
    return float(np.linalg.norm(position - trajectory().at(times).position, axis=1).max())


def test_in_calm_air_it_is_the_flight_by_time() -> None:
    ((times, position, _),) = follow_setpoints([trajectory()], 0.0, 0, *LEANS)
    ((later, waited, _, clock),) = follow_waiting([trajectory()], maxjax.Follower(), 0.0, 0, *LEANS)
    count = min(len(times), len(later))
    assert abs(len(times) - len(later)) <= 2
    np.testing.assert_allclose(waited[:count], position[:count], atol=0.02)
    np.testing.assert_allclose(clock, np.minimum(later, trajectory().duration), atol=1e-3)


def test_in_wind_that_it_cannot_fly_against_it_stays_within_twice_the_tolerance() -> None:
    flights = [trajectory()] * FLIGHTS
    by_time = [worst(position, times) for times, position, _ in follow_setpoints(flights, 8.0, 3, *LEANS)]
    waited = follow_waiting(flights, maxjax.Follower(), 8.0, 3, *LEANS)
    assert max(by_time) > 5.0
    assert max(worst(position, clock) for _, position, _, clock in waited) < 2.0
    late = [times[-1] - trajectory().duration - AFTER for times, *_ in waited]
    assert min(late) > -0.05
    assert max(late) > 1.0
    for _, position, velocity, clock in waited:
        assert (np.diff(clock) >= 0.0).all()
        assert np.linalg.norm(position[-1] - trajectory().at([1e3]).position[0]) < 0.5
        assert np.linalg.norm(velocity[-1]) < 0.7  # in gusts
