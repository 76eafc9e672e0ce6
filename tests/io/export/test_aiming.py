"""Headings and points of interest in files of waypoints, read with other readers."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.io.export.aiming import aims_of
from maxjax.io.export.export import export
from maxjax.io.geo.earth import Projected
from maxjax.io.geo.vertical_zero import VerticalZero
from tests.io.export.test_exports import EARTH, GROUND, PATH, mission, trajectory

SEEN = (5.0, 60.0, 14.0)
GEOD = pyproj.Geod(ellps="WGS84")


def aimed(folder: Path, name: str, **last: Any) -> Path:
    """A file of a mission that looks at a point on its first leg, and as asked on its last."""
    start, middle, end = mission().waypoints
    waypoints = (start, dataclasses.replace(middle, look_at=SEEN), dataclasses.replace(end, **last))
    whole = dataclasses.replace(mission(), waypoints=waypoints)
    timed = dataclasses.replace(trajectory(), plan=whole)
    export(folder / name, timed, earth=EARTH, ground=GROUND, takeoff_and_landing=False)
    return folder / name


def items(file: Path) -> list[tuple[int, list[float]]]:
    return [(item["command"], item["params"]) for item in json.loads(file.read_text())["mission"]["items"]]


def test_a_region_of_interest_stands_before_its_leg_and_is_taken_back(tmp_path: Path) -> None:
    found = items(aimed(tmp_path, "a.plan"))
    assert [command for command, _ in found] == [178, 16, 195, 16, 178, 197, 16, 16]
    region = found[2][1]
    home = EARTH.geodetic(np.array([[*PATH[0, :2], GROUND]]))[0, 2]
    np.testing.assert_allclose(EARTH.local(np.array([[*region[4:6], region[6] + home]]))[0], SEEN, atol=0.01)
    # The heading of the waypoint is that to the point, by the geodesic.
    _, (_, _, _, heading, north, east, _) = found[3]
    azimuth, _, away = GEOD.inv(east, north, region[5], region[4])
    assert heading == pytest.approx(azimuth % 360.0, abs=0.01)
    assert away == pytest.approx(math.dist(PATH[1, :2], SEEN[:2]), abs=0.05)


@pytest.mark.parametrize("heading", [0.0, 90.0, -135.0, 350.0])
def test_a_heading_is_a_region_far_ahead(tmp_path: Path, heading: float) -> None:
    found = items(aimed(tmp_path, "a.plan", heading=heading))
    assert [command for command, _ in found] == [178, 16, 195, 16, 178, 195, 16, 16]
    region = found[5][1]
    for _, params in found[6:]:
        assert (params[3] - heading + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.1)
        azimuth, _, _ = GEOD.inv(params[5], params[4], region[5], region[4])
        assert (azimuth - heading + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.6)


def test_headings_count_from_the_north_of_the_map_and_are_written_from_true_north() -> None:
    """At 90 km from its middle meridian, UTM's north is a degree off."""
    projection = pyproj.Proj("EPSG:32632")
    east, north = projection(10.3, 52.0)
    waypoint = maxjax.Waypoint((east, north, 10.0), heading=0.0)
    whole = dataclasses.replace(mission(), waypoints=(waypoint,))
    (found,) = aims_of(whole, Projected("EPSG:32632", VerticalZero(0.0)))
    convergence = projection.get_factors(10.3, 52.0).meridian_convergence
    assert abs(convergence) > 0.9
    assert found is not None
    assert found.heading == pytest.approx(convergence % 360.0, abs=0.05)


def test_dji_and_litchi_turn_to_the_point_on_the_way_there(tmp_path: Path) -> None:
    space = {"k": "http://www.opengis.net/kml/2.2", "w": "http://www.dji.com/wpmz/1.0.6"}
    with zipfile.ZipFile(aimed(tmp_path, "a.kmz")) as archive:
        marks = ElementTree.fromstring(archive.read("wpmz/waylines.wpml")).findall(".//k:Placemark", space)
    params = [mark.find("w:waypointHeadingParam", space) for mark in marks]
    modes = [param.findtext("w:waypointHeadingMode", None, space) for param in params if param is not None]
    assert modes == ["towardPOI", "followWayline", "followWayline", "followWayline"]
    assert params[0] is not None
    latitude, longitude, _ = params[0].findtext("w:waypointPoiPoint", "", space).split(",")
    rows = list(csv.DictReader(io.StringIO(aimed(tmp_path, "a_litchi.csv").read_text())))
    assert [float(row["poi_latitude"]) != 0.0 for row in rows] == [True, False, False, False]
    for north, east in ((latitude, longitude), (rows[0]["poi_latitude"], rows[0]["poi_longitude"])):
        place = EARTH.local(np.array([[float(north), float(east), EARTH.geodetic(np.array([SEEN]))[0, 2]]]))[0]
        np.testing.assert_allclose(place[:2], SEEN[:2], atol=0.02)


def test_pymavlink_and_mission_planner_read_regions(tmp_path: Path) -> None:
    mavwp = pytest.importorskip("pymavlink.mavwp", reason="needs pymavlink (extra dev)")
    loader = mavwp.MAVWPLoader()
    loader.load(str(aimed(tmp_path, "a.waypoints")))
    assert [loader.wp(k).command for k in range(loader.count())] == [16, 178, 16, 195, 16, 178, 197, 16, 16]


def test_without_an_aim_nothing_is_written(tmp_path: Path) -> None:
    export(
        tmp_path / "b.plan",
        dataclasses.replace(trajectory(), plan=mission()),
        earth=EARTH,
        ground=GROUND,
        takeoff_and_landing=False,
    )
    assert {command for command, _ in items(tmp_path / "b.plan")} == {16, 178}
