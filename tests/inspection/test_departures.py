"""Departures that keep vehicles apart: by trajectories that are sampled finely, with NumPy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import maxjax
from maxjax.inspection.departures import Departures, keep_apart

RISE, SINK = 1.0, 0.5  # [m/s], as docs/energy.md has them


def field() -> maxjax.VoxelMap:
    """Flat ground at z = 0."""
    ground = np.zeros((60, 60, 20), bool)
    ground[:, :, 0] = True
    return maxjax.VoxelMap.of(ground.copy(), spacing=2.0, origin=(-59.0, -59.0, -1.0), ground=ground)


FIELD = field()


def fly(*places: tuple[float, float, float]) -> maxjax.Trajectory:
    """A trajectory through some places."""
    return maxjax.trajectory(maxjax.plan_mission(FIELD, list(places)), maxjax.FlightLimits(speed=6.0))


def places_at(flight: maxjax.Trajectory, departs: float, times: np.ndarray) -> np.ndarray:
    """Where a vehicle is at some times; NaN on the ground."""
    start, goal = flight.at([0.0, flight.duration]).position
    rise = start[2] / RISE
    since = times - departs - rise
    position = flight.at(np.clip(since, 0.0, flight.duration)).position
    position[:, 2] += np.where(since < 0.0, RISE * since, 0.0)
    position[:, 2] -= np.where(since > flight.duration, SINK * (since - flight.duration), 0.0)
    grounded = (since < -rise) | (since > flight.duration + goal[2] / SINK)
    return np.where(grounded[:, None], np.nan, position)


def least_of(flights: list[maxjax.Trajectory], vehicles: list[int], departs: np.ndarray, lasts: float) -> float:
    """Least distance between two vehicles in the air, every 0.02 s."""
    times = np.arange(0.0, lasts, 0.02)
    tracks = [places_at(flight, float(begin), times) for flight, begin in zip(flights, departs, strict=True)]
    found = [
        np.nanmin(np.append(np.linalg.norm(tracks[i] - tracks[j], axis=1), np.inf))
        for i, j in itertools.combinations(range(len(flights)), 2)
        if vehicles[i] != vehicles[j]
    ]
    return float(min(found))


CROSSING = [
    fly((-40.0, 0.0, 10.0), (40.0, 0.0, 10.0), (-40.0, 0.0, 10.0)),
    fly((0.0, -40.0, 10.0), (0.0, 40.0, 10.0), (0.0, -40.0, 10.0)),
    fly((-40.0, -40.0, 10.0), (40.0, 40.0, 10.0), (-40.0, -40.0, 10.0)),
]


def check(found: Departures, flights: list[maxjax.Trajectory], vehicles: list[int]) -> None:
    """What is told is so, by the samples: distances, the order of each vehicle's flights, and seconds."""
    lasts = float(found.lands.max()) + 1.0
    least = least_of(flights, vehicles, found.departs, lasts)
    assert least >= found.apart
    assert found.least <= least + 1e-3
    assert found.least >= min(least, 1e6) - 1.0
    ready = np.zeros(len(flights))
    for k, vehicle in enumerate(vehicles):
        before = [found.lands[j] for j in range(k) if vehicles[j] == vehicle]
        assert found.departs[k] - found.waits[k] == pytest.approx(max(before, default=0.0))
        earlier = [found.lands[j] - found.departs[j] for j in range(k) if vehicles[j] == vehicle]
        ready[k] = sum(earlier)
    assert found.before == pytest.approx(least_of(flights, vehicles, ready, lasts), abs=0.5)
    assert found.costs == pytest.approx(found.lands.max() - (ready + found.lands - found.departs).max())


def test_crossing_flights_wait_until_they_are_apart() -> None:
    """All three meet in the middle at once; afterwards none comes nearer than asked, and the first does not wait."""
    found = keep_apart(CROSSING, [0, 1, 2], 8.0)
    check(found, CROSSING, [0, 1, 2])
    assert found.before < 1.0
    assert found.waits[0] == 0.0
    assert (found.waits[1:] > 0.0).all()
    assert found.costs < sum(flight.duration for flight in CROSSING)  # not simply one after the other
    assert "flight 2 waits" in str(found)


def test_nobody_waits_longer_than_for_the_last_moment_that_is_too_near() -> None:
    """Half a second earlier, the step of what is tried, the second flight would come too near: it waits no longer."""
    flights = CROSSING[:2]
    found = keep_apart(flights, [0, 1], 8.0)
    sooner = found.departs - np.array([0.0, 0.5])
    assert least_of(flights, [0, 1], sooner, float(found.lands.max())) < 8.0 + 0.2


def test_flights_of_a_vehicle_follow_one_another_and_share_a_home() -> None:
    """Two vehicles with one home, two flights each: they rise and land in the same column, one at a time."""
    flights = [
        fly((0.0, 0.0, 8.0), end, (0.0, 0.0, 8.0))
        for end in ((40.0, 0.0, 12.0), (30.0, 30.0, 12.0), (-40.0, 0.0, 12.0), (0.0, -40.0, 12.0))
    ]
    vehicles = [0, 0, 1, 1]
    found = keep_apart(flights, vehicles, 6.0)
    check(found, flights, vehicles)
    assert found.before < 0.1


def test_flights_that_are_apart_do_not_wait() -> None:
    """30 m beside each other; nor does one vehicle wait for itself."""
    flights = [fly((-40.0, y, 10.0), (40.0, y, 10.0)) for y in (-15.0, 15.0)]
    found = keep_apart(flights, [0, 1], 10.0)
    check(found, flights, [0, 1])
    assert (found.waits == 0.0).all()
    assert found.costs == 0.0
    assert "none has to wait" in str(found)
    alone = keep_apart(flights, [0, 0], 10.0)
    assert np.isinf(alone.least)
    assert (alone.waits == 0.0).all()


def test_bad_input_is_told() -> None:
    """Numbers of vehicles, and a distance that is none."""
    with pytest.raises(ValueError, match="expected one a flight, given 1 for 3 flights"):
        keep_apart(CROSSING, [0], 5.0)
    with pytest.raises(ValueError, match="apart: expected a positive number of metres, given 0"):
        keep_apart(CROSSING, [0, 1, 2], 0.0)
