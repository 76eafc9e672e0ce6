"""Surveys from the call to the missions: what is seen, what is flown around, what is lost, what is refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import maxjax
from maxjax.core.status import Closure
from tests.inspection.towns import rectangle, town

CAMERA = maxjax.Camera.named("DJI M3E")
SWEEP = maxjax.Sweep(distance=20.0, overlap=(0.6, 0.5))
DISTANCES = maxjax.Distances(radius=1.5)
AREA = rectangle(-20.0, -20.0, 40.0, 30.0)


def plain(height: float = 6.0) -> maxjax.LoadedMap:
    """A house of 12 x 9 m on flat ground, with air around it."""
    return town((rectangle(4.0, 0.0, 16.0, 9.0), height), spacing=2.0, room=60.0, sky=60.0 - height)


@pytest.fixture(scope="module")
def found() -> maxjax.Inspection:
    """The survey of a house that is lower than the flight."""
    return maxjax.survey(plain(), AREA, CAMERA, sweep=dataclasses.replace(SWEEP, beyond=12.0), distances=DISTANCES)


def test_the_area_is_seen_as_often_as_asked(found: maxjax.Inspection) -> None:
    """Roofs and ground, all of it four times; nothing is lost; the flight is verified and keeps its height."""
    assert found.status == maxjax.Status.OK
    assert found.coverage.wanted == 4
    assert found.coverage.share() > 0.999
    assert found.coverage.share(4) > 0.97
    assert found.coverage.surface.area == pytest.approx(60.0 * 50.0, rel=0.04)
    mission = found.mission
    assert maxjax.verify(mission.path, mission.map, radius=1.5).ok
    np.testing.assert_allclose(found.photos.position[:, 2], 20.0, atol=1.0)


def test_photos_are_as_far_apart_as_the_overlap_says(found: maxjax.Inspection) -> None:
    """Along a line by the photos' height, between lines by their width; no faster than the shutter."""
    width, height = CAMERA.footprint(20.0)
    looks = [waypoint.look for waypoint in found.mission.waypoints if waypoint.look is not None]
    every = {look.every for look in looks if look.every}
    assert len(every) == 1
    assert every.pop() == pytest.approx(0.4 * height)
    along = found.photos.position[:, :2] @ np.array([np.cos(found.photos.yaw[0]), np.sin(found.photos.yaw[0])])
    across = found.photos.position[:, :2] @ np.array([-np.sin(found.photos.yaw[0]), np.cos(found.photos.yaw[0])])
    rows = np.unique(np.round(across, 3))
    assert np.diff(rows).max() <= 0.5 * width + 1e-6
    for row in rows:
        assert np.diff(np.sort(along[np.abs(across - row) < 0.01])).max() == pytest.approx(0.4 * height, rel=1e-6)
    speeds = [waypoint.speed for waypoint in found.mission.waypoints if waypoint.speed is not None]
    assert max(speeds) <= 0.4 * height / CAMERA.interval + 1e-9


def test_a_tower_is_flown_around_and_its_photos_are_named() -> None:
    """A house as tall as the flight is high: lines end before it and go on behind; lost photos are told."""
    where = plain(height=28.0)
    found = maxjax.survey(where, AREA, CAMERA, sweep=SWEEP, distances=DISTANCES)
    assert found.status == maxjax.Status.OK
    assert maxjax.verify(found.mission.path, where, radius=1.5).ok
    lost = [remark for remark in found.remarks if "are lost: something stands there" in remark]
    assert lost
    assert len({remark.split(" around")[0] for remark in lost}) == len(lost)
    inside = [4.0 < x < 16.0 and 0.0 < y < 9.0 for x, y, _ in found.photos.position.tolist()]
    assert not any(inside)
    roofs = found.coverage.surface.points[:, 2] > 20.0
    assert found.coverage.counts[roofs].max() == 0
    assert any("roof of house 0" in remark for remark in found.remarks)
    above = maxjax.survey(
        where, AREA, CAMERA, sweep=dataclasses.replace(SWEEP, above="roof"), distances=maxjax.Distances(1.5)
    )
    assert not [remark for remark in above.remarks if "lost" in remark]
    assert above.coverage.counts[above.coverage.surface.points[:, 2] > 20.0].min() > 0
    with pytest.raises(ValueError, match=r"found none: .* the map ends there; load more of it"):
        maxjax.survey(where, AREA, CAMERA, sweep=maxjax.Sweep(distance=65.0), distances=DISTANCES)


def test_closed_air_is_named() -> None:
    """Half of the area is closed: its photos are lost for that reason, and no photo is taken there."""
    where = plain()
    reasons = np.zeros(where.grid.shape, np.uint8)
    reasons[int((10.0 - where.grid.lower[0]) / 2.0) :] = Closure.AREA
    found = maxjax.survey(where.closing(reasons), AREA, CAMERA, sweep=SWEEP, distances=DISTANCES)
    assert found.status == maxjax.Status.OK
    assert found.photos.position[:, 0].max() < 10.0
    assert any("are lost: the air there is closed" in remark for remark in found.remarks)
    with pytest.raises(ValueError, match="expected air to fly in, and all of it is closed"):
        maxjax.survey(where.closing(np.full_like(reasons, Closure.AREA)), AREA, CAMERA, sweep=SWEEP)
    east = rectangle(12.0, -20.0, 40.0, 30.0)
    with pytest.raises(ValueError, match=r"expected air to fly in above it, found none: \d+ photos .* closed"):
        maxjax.survey(where.closing(reasons), east, CAMERA, sweep=SWEEP)


def test_the_ground_is_followed() -> None:
    """Over a slope of one in four, photos stay 20 m above the ground, to a voxel and a twentieth of that."""
    ground = np.zeros((70, 60, 40), bool)
    for x in range(70):
        ground[x, :, : 1 + x // 4] = True
    where = maxjax.VoxelMap.of(ground, spacing=2.0, origin=(1.0, 1.0, 1.0), ground=ground)
    area = rectangle(40.0, 40.0, 100.0, 80.0)
    found = maxjax.survey(where, area, CAMERA, sweep=SWEEP, distances=DISTANCES)
    assert found.status == maxjax.Status.OK
    heights = [z - where.terrain.at(x, y) for x, y, z in found.photos.position.tolist()]
    assert min(heights) > 18.9
    assert max(heights) < 24.0
    assert found.coverage.share() > 0.99


def test_twice_across_and_a_corridor() -> None:
    """Two sets of lines at right angles; a corridor along a bent line."""
    where = plain()
    one, two = (
        maxjax.survey(where, AREA, CAMERA, sweep=dataclasses.replace(SWEEP, cross=cross), distances=DISTANCES)
        for cross in (False, True)
    )
    assert len(two.photos) > 1.7 * len(one.photos)
    ways = np.unique(np.round(np.degrees(two.photos.yaw) % 180.0))
    assert len(ways) == 2
    assert abs(ways[1] - ways[0]) == 90.0
    road = [(-30.0, -20.0), (20.0, -20.0), (45.0, 5.0)]
    found = maxjax.survey(where, road, CAMERA, sweep=dataclasses.replace(SWEEP, width=16.0), distances=DISTANCES)
    assert found.status == maxjax.Status.OK
    assert found.coverage.share() > 0.99
    assert found.coverage.surface.area == pytest.approx(16.0 * (50.0 + math.hypot(25.0, 25.0)), rel=0.1)


def test_flights_and_vehicles_share_the_lines() -> None:
    """Each line in one flight, in order; two vehicles in less time than one."""
    where, homes = plain(), ((-40.0, -40.0, 10.0),)
    one, two, three = (
        maxjax.survey(where, AREA, CAMERA, sweep=SWEEP, vehicles=vehicles, distances=DISTANCES)
        for vehicles in (
            maxjax.Vehicles(homes),
            maxjax.Vehicles(homes, count=2),
            maxjax.Vehicles(homes, capacity=60.0),
        )
    )
    assert len(one.missions) == 1
    assert two.vehicles == (0, 1)
    assert max(mission.length for mission in two.missions) < 0.75 * one.mission.length
    assert len(three.missions) > 1
    for found in (two, three):
        np.testing.assert_allclose(
            np.sort(found.photos.position.round(3), axis=0), np.sort(one.photos.position.round(3), axis=0), atol=0.01
        )


@pytest.mark.parametrize(
    ("area", "options", "said"),
    [
        (((0, 0), (10, 10), (10, 0), (0, 10)), {}, "cross itself, given one whose edges 1 and 3 do, at x 5.0, y 5.0"),
        (((0, 0), (10, 10)), {}, "expected an outline"),
        (
            AREA,
            {"sweep": maxjax.Sweep(distance=1.0)},
            "more than the radius that a vehicle keeps, 1.5 m, given 1 m",
        ),
        (((500, 500), (510, 500), (510, 510)), {}, "within the map"),
        (((0, 0, 1), (0, 0, 2)), {"sweep": maxjax.Sweep(width=5.0)}, "area"),
        (((0, 0), (0, 0)), {"sweep": maxjax.Sweep(width=5.0)}, "a corner twice in a row"),
    ],
)
def test_areas_that_cannot_be_surveyed(area: object, options: dict[str, object], said: str) -> None:
    """A sentence with the number."""
    with pytest.raises(ValueError, match=said):
        maxjax.survey(plain(), area, CAMERA, **{"sweep": SWEEP, "distances": DISTANCES, **options})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"overlap": (1.0, 0.5)}, "below 1"),
        ({"heading": math.nan}, "heading"),
        ({"turn": -1.0}, "turn"),
        ({"beyond": math.inf}, "beyond"),
        ({"pitch": 10.0}, "pitch"),
        ({"width": 0.0}, "width"),
        ({"speed": -2.0}, "speed"),
        ({"width": 5.0, "cross": True}, "corridor"),
    ],
)
def test_sweeps_that_are_none(options: dict[str, object], said: str) -> None:
    """A sentence with the number."""
    with pytest.raises(ValueError, match=said):
        maxjax.Sweep(**options)  # type: ignore[arg-type]
