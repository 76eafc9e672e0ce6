"""Files of inspections: what their photos show, counted from the files alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax.inspection.flown_files import _seen
from maxjax.inspection.mission_photos import photos_along
from maxjax.planning.mission import looks_of
from tests.inspection.towns import rectangle, town
from tests.io.export.test_exports import link  # noqa: F401 (a fixture)

EARTH = maxjax.TangentPlane(47.0, 8.0, 400.0)


@pytest.fixture(scope="module")
def found() -> maxjax.Inspection:
    """A small house in two flights."""
    where = town((rectangle(0.0, 0.0, 10.0, 8.0), 10.0))
    vehicles = maxjax.Vehicles(((-14.0, 4.0, 6.0),), capacity=70.0)
    return maxjax.inspect(
        where,
        "house 0",
        "DJI M3E",
        capture=maxjax.Capture(8.0, (0.4, 0.3)),
        vehicles=vehicles,
        distances=maxjax.Distances(1.5),
    )


@pytest.mark.parametrize(
    ("name", "autopilot"),
    [("house.plan", maxjax.Autopilot.px4()), ("house.waypoints", maxjax.Autopilot.arducopter()), ("house.kmz", None)],
)
def test_the_files_show_what_was_planned(
    tmp_path: Path, found: maxjax.Inspection, name: str, autopilot: maxjax.Autopilot | None
) -> None:
    """Each flight has a file of its own; the photos of all of them show as much as planned, to a thousandth."""
    flown = maxjax.export_inspection(tmp_path / name, found, earth=EARTH, autopilot=autopilot)
    stem, dot = name.split(".")
    assert [file.name for file in flown.files] == [f"{stem}_{k + 1}.{dot}" for k in range(len(found.missions))]
    assert all(file.is_file() for file in flown.files)
    assert flown.coverage is not None
    assert len(flown.photos) == len(found.photos)
    np.testing.assert_allclose(flown.photos.position, found.photos.position, atol=1e-3)
    assert flown.coverage.share() == pytest.approx(found.coverage.share(), abs=1e-3)
    assert "as flown" in str(flown)


@pytest.mark.parametrize("autopilot", [maxjax.Autopilot.px4(), maxjax.Autopilot.arducopter()])
def test_pymavlink_and_mavsdk_find_each_photo(
    tmp_path: Path,
    found: maxjax.Inspection,
    link: tuple[Any, Any],  # noqa: F811 (the fixture)
    autopilot: maxjax.Autopilot,
) -> None:
    """In both formats, flight by flight, each at a waypoint that is held at."""
    mavwp = pytest.importorskip("pymavlink.mavwp", reason="needs pymavlink (extra dev)")
    plans, lists = (
        maxjax.export_inspection(tmp_path / f"house{ending}", found, earth=EARTH, autopilot=autopilot).files
        for ending in (".plan", ".waypoints")
    )
    for k, (plan, waypoints) in enumerate(zip(plans, lists, strict=True)):
        loader = mavwp.MAVWPLoader()
        loader.load(str(waypoints))
        given = [
            link[0].import_qgroundcontrol_mission(str(plan)).mission_items,
            link[0].import_mission_planner_mission(str(waypoints)).mission_items,
            [loader.wp(number) for number in range(loader.count())],
        ]
        for items in given:
            photos = [number for number, item in enumerate(items) if item.command == 2000]
            assert len(photos) == int((found.flight == k).sum())
            before = [next(item for item in items[number::-1] if item.command == 16) for number in photos]
            assert min(item.param1 for item in before) >= 2.0


def test_what_a_file_does_not_aim_it_does_not_show(found: maxjax.Inspection) -> None:
    """The same waypoints with the gimbal turned up, or without photos: the coverage falls."""
    mission = found.missions[0]
    looks = looks_of(mission)
    shares = []
    for change in ({}, {"pitch": 1.4}, {"photo": False}):
        changed = {k: dataclasses.replace(look, **change) for k, look in looks.items()}
        shares.append(_seen(photos_along(mission.path, changed), found).share())
    assert shares[0] > 1.5 * shares[1]
    assert shares[2] == 0.0


def test_a_format_without_photos(tmp_path: Path, found: maxjax.Inspection) -> None:
    """Lines alone say nothing of photos."""
    flown = maxjax.export_inspection(tmp_path / "house.geojson", found, earth=EARTH)
    assert flown.coverage is None
    assert "holds no photos" in str(flown)
