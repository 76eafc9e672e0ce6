"""Inspections from the call to the missions: verified flights, photos in order, homes, batteries, several vehicles."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest

import maxjax
from maxjax.core.status import Closure
from maxjax.energy.power import power
from maxjax.energy.split_flights import weigh_flight
from maxjax.inspection.leg_costs import EnergyCost, TimeCost
from maxjax.trajectories.limits import PX4_MISSION
from tests.inspection.towns import rectangle, town

CAPTURE = maxjax.Capture(distance=8.0, overlap=(0.3, 0.3))
DISTANCES = maxjax.Distances(radius=1.5)
HOME = (-14.0, 4.0, 6.0)


@pytest.fixture(scope="module")
def where() -> maxjax.LoadedMap:
    """A house of 12 x 9 x 14 m with a lower one 8 m beside it."""
    return town((rectangle(0.0, 0.0, 12.0, 9.0), 14.0), (rectangle(20.0, 0.0, 26.0, 9.0), 6.0))


@pytest.fixture(scope="module")
def found(where: maxjax.LoadedMap) -> maxjax.Inspection:
    """The inspection of the house by one vehicle."""
    return maxjax.inspect(where, "house 0", "DJI M3E", capture=CAPTURE, distances=DISTANCES)


def flown(found: maxjax.Inspection) -> list[float]:
    """Seconds of each flight along its waypoints, by a straight leg each, with 2 s at each photo and at home."""
    cost = TimeCost(PX4_MISSION, stay=2.0)
    seconds = []
    for mission in found.missions:
        places = np.array([waypoint.position for waypoint in mission.waypoints])
        seconds.append(float(0.5 * (cost(places[:-1], places[1:]) + cost(places[1:], places[:-1])).sum()))
    return seconds


def test_the_flight_is_verified_and_takes_each_photo_once(where: maxjax.LoadedMap, found: maxjax.Inspection) -> None:
    """From home to each viewpoint and back, at rest there, with the camera turned to the wall."""
    assert found.status == maxjax.Status.OK
    assert found.coverage.share() > 0.99
    mission = found.mission
    assert maxjax.verify(mission.path, where, radius=1.5).ok
    home, *places, last = mission.waypoints
    assert home.position == last.position
    assert len(places) == len(found.photos)
    np.testing.assert_allclose([place.position for place in places], found.photos.position)
    for place, yaw, pitch in zip(places, found.photos.yaw, found.photos.pitch, strict=True):
        assert place.look == maxjax.Look(pitch, photo=True)
        assert math.cos(float(place.yaw_from(np.zeros((1, 3)))[0]) - yaw) == pytest.approx(1.0)
        assert place.hover == 2.0
    apart = [math.dist(a.position, b.position) for a, b in itertools.combinations(places, 2)]
    assert min(apart) > 0.2


def test_home_is_chosen_under_open_sky(where: maxjax.LoadedMap, found: maxjax.Inspection) -> None:
    """Nothing above it, the ground below it, and no nearer to the house than the photos."""
    x, y, z = found.mission.waypoints[0].position
    sky = where.grid.upper[2] - 0.6
    assert maxjax.verify(np.array([[x, y, z], [x, y, sky]]), where, radius=1.5).ok
    assert 3.0 < z < 7.0
    assert math.hypot(max(-x, x - 12.0, 0.0), max(-y, y - 9.0, 0.0)) >= 8.0


def test_a_home_of_ones_own_and_a_battery(where: maxjax.LoadedMap) -> None:
    """Flights that take at most 70 s each, all from home and back, with every photo in one of them."""
    vehicles = maxjax.Vehicles(homes=(HOME,), capacity=70.0)
    found = maxjax.inspect(where, "house 0", "DJI M3E", capture=CAPTURE, vehicles=vehicles, distances=DISTANCES)
    assert found.status == maxjax.Status.OK
    assert len(found.missions) > 1
    assert set(found.vehicles) == {0}
    assert max(flown(found)) <= 70.0 * 1.001
    for mission in found.missions:
        assert mission.waypoints[0].position == mission.waypoints[-1].position == HOME
    assert sum(len(mission.waypoints) - 2 for mission in found.missions) == len(found.photos)
    np.testing.assert_array_equal(
        found.flight, np.repeat(np.arange(len(found.missions)), [len(m.waypoints) - 2 for m in found.missions])
    )
    with pytest.raises(ValueError, match="use missions"):
        found.mission  # noqa: B018 (raises)


def test_two_vehicles_from_two_homes(where: maxjax.LoadedMap) -> None:
    """Each from its own home; together they are done much earlier than one."""
    homes = (HOME, (14.0, 30.0, 6.0))
    alone, both = (
        maxjax.inspect(
            where, "house 0", "DJI M3E", capture=CAPTURE, vehicles=maxjax.Vehicles(some, len(some)), distances=DISTANCES
        )
        for some in (homes[:1], homes)
    )
    assert both.vehicles == (0, 1)
    for mission, home in zip(both.missions, homes, strict=True):
        assert mission.waypoints[0].position == home
    assert max(flown(both)) < 0.65 * max(flown(alone))


def test_a_cost_of_ones_own(where: maxjax.LoadedMap) -> None:
    """Metres in place of seconds: each flight is no longer than the capacity, but for what the legs go around."""

    def metres(starts: np.ndarray, goals: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.asarray(goals) - starts, axis=1)

    vehicles = maxjax.Vehicles((HOME,), capacity=125.0, cost=metres)
    found = maxjax.inspect(where, "house 0", "DJI M3E", capture=CAPTURE, vehicles=vehicles, distances=DISTANCES)
    assert len(found.missions) > 1
    assert max(mission.length for mission in found.missions) < 1.15 * 125.0


def test_flights_are_shared_by_what_a_battery_lasts_for(where: maxjax.LoadedMap) -> None:
    """Each flight, weighed as it is planned, leaves the reserve; with a larger battery there are fewer."""
    counts = []
    for capacity in (4.0, 16.0):
        supply = maxjax.Supply(maxjax.Airframe.mavic_3_enterprise(), maxjax.Battery(capacity, reserve=0.3))
        vehicles = maxjax.Vehicles.on_battery(supply, (HOME,))
        assert vehicles.capacity is not None
        assert vehicles.capacity < 0.85 * 0.7 * capacity
        found = maxjax.inspect(where, "house 0", "DJI M3E", capture=CAPTURE, vehicles=vehicles, distances=DISTANCES)
        flights = [weigh_flight(mission, PX4_MISSION, supply) for mission in found.missions]
        assert all(flight.status == maxjax.Status.OK for flight in flights)
        counts.append(len(flights))
    assert counts[0] > counts[1]


def test_energy_of_a_leg_is_its_seconds_at_the_power_of_its_flight() -> None:
    airframe = maxjax.Airframe.mavic_3_enterprise()
    starts, goals = np.zeros((2, 3)), np.array([[30.0, 0.0, 0.0], [0.0, 0.0, 12.0]])
    still, windy = EnergyCost(airframe, TimeCost(stay=2.0)), EnergyCost(airframe, TimeCost(stay=2.0), wind=10.0)
    watts = power(airframe, np.array([[0.0, 0.0, 0.0], [TimeCost().limits.speed, 0.0, 0.0]]), np.zeros((2, 3))).max()
    np.testing.assert_allclose(still(starts, goals), TimeCost(stay=2.0)(starts, goals) * watts / 3600.0)
    assert (windy(starts, goals) > still(starts, goals)).all()


@pytest.mark.parametrize(
    ("capacity", "spare", "message"),
    [
        (77.0, -0.1, "spare: expected a share"),
        (77.0, 1.0, "spare: expected a share"),
        (0.5, 0.1, "battery: expected more"),
    ],
)
def test_a_battery_that_no_flight_can_be_made_with_is_refused(capacity: float, spare: float, message: str) -> None:
    supply = maxjax.Supply(maxjax.Airframe.mavic_3_enterprise(), maxjax.Battery(capacity, reserve=0.3))
    with pytest.raises(ValueError, match=message):
        maxjax.Vehicles.on_battery(supply, spare=spare)


def test_what_is_written_is_plain_json(found: maxjax.Inspection) -> None:
    """Everything that is told, angles in degrees."""
    content = json.loads(json.dumps(found.to_dict()))
    assert content["status"] == "OK"
    assert len(content["photos"]) == len(found.photos)
    assert content["photos"][0]["yaw"] == pytest.approx(math.degrees(found.photos.yaw[0]), abs=1e-6)
    assert content["coverage"]["share"] == pytest.approx(found.coverage.share())
    assert sum(content["coverage"]["overlaps"].values()) == pytest.approx(found.coverage.surface.area)
    assert "% of" in str(found)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vehicles": maxjax.Vehicles(((6.0, 4.0, 5.0),))}, r"home: expected a place .* given \(6, 4, 5\)"),
        ({"vehicles": maxjax.Vehicles((HOME,), capacity=8.0)}, "expected a round of at most 8 from home and back"),
        ({"capture": maxjax.Capture(distance=1.0)}, "more than the radius that a vehicle keeps, 1.5 m, given 1 m"),
        ({"camera": "DJI M9"}, "camera: expected one of DJI M3E"),
        ({"target": "house 7"}, "given 'house 7'; of its 2 buildings near it are house 1, house 0"),
    ],
)
def test_what_cannot_be_used(where: maxjax.LoadedMap, options: dict[str, object], said: str) -> None:
    """A sentence with the number."""
    given = {"target": "house 0", "camera": "DJI M3E", "capture": CAPTURE, "distances": DISTANCES, **options}
    with pytest.raises(ValueError, match=said):
        maxjax.inspect(where, given.pop("target"), given.pop("camera"), **given)  # type: ignore[arg-type]


def test_a_city_under_a_zone(where: maxjax.LoadedMap) -> None:
    """All of the air is closed: a sentence."""
    closed = where.closing(np.full(where.grid.shape, Closure.AREA, np.uint8))
    with pytest.raises(ValueError, match="all of it is closed by the rules of the air"):
        maxjax.inspect(closed, "house 0", "DJI M3E", capture=CAPTURE, distances=DISTANCES)


def test_home_under_a_ceiling(where: maxjax.LoadedMap) -> None:
    """Air that is closed above is no obstacle, but no home: all is below, and home not in the closed west."""
    closed = np.full(where.grid.shape, Closure.OPEN, np.uint8)
    top = where.grid.lower[2] + where.grid.spacing * 16
    closed[:, :, 16:] = Closure.AREA
    east = where.grid.lower[0] + where.grid.spacing * 40
    closed[:40, :, :9] = Closure.AREA
    low = maxjax.inspect(where.closing(closed), "house 0", "DJI M3E", capture=CAPTURE, distances=DISTANCES)
    assert low.status == maxjax.Status.OK
    assert low.mission.path[:, 2].max() < top
    x, y, z = low.mission.waypoints[0].position
    assert x > east
    assert maxjax.verify(np.array([[x, y, z], [x, y, where.grid.upper[2] - 0.6]]), where, radius=1.5).ok


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"count": 0}, "at least one vehicle"),
        ({"homes": (HOME, HOME), "count": 3}, "one or 3, given 2"),
        ({"capacity": 0.0}, "positive finite number"),
        ({"homes": ((1.0, 2.0, math.nan),)}, "finite"),
    ],
)
def test_vehicles_that_are_none(options: dict[str, object], said: str) -> None:
    """A sentence with the number."""
    with pytest.raises(ValueError, match=said):
        maxjax.Vehicles(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "said"), [({"pitch": math.inf}, "pitch"), ({"pitch": 2.0}, "pitch"), ({"every": -1.0}, "every")]
)
def test_looks_that_are_none(options: dict[str, float], said: str) -> None:
    """A sentence with the number."""
    with pytest.raises(ValueError, match=said):
        maxjax.Look(**options)  # type: ignore[arg-type]
