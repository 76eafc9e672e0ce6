"""Camera and gimbal in files, read by pymavlink and as plain XML, and back as what was meant."""

from __future__ import annotations

import csv
import dataclasses
import functools
import io
import json
import math
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax.io.export.export import export
from maxjax.io.geo.earth import TangentPlane
from maxjax.planning.look import AimedLook, Look

EARTH = TangentPlane(47.0, 8.0, 400.0)
PX4, COPTER = maxjax.Autopilot.px4(), maxjax.Autopilot.arducopter()
# To the east and 30 degrees down; to the north-west, level.
LOOKS = (None, AimedLook(0.0, math.radians(-30.0), photo=True), AimedLook(0.75 * math.pi, 0.0, photo=True), None)
LINE = (None, AimedLook(pitch=-0.5 * math.pi, every=4.0), AimedLook(every=0.0), None)


def _aimed(place: tuple[float, float, float], look: AimedLook) -> maxjax.Waypoint:
    """A waypoint of the field's words: a compass heading, and a rest for a photo."""
    heading = None if look.yaw is None else (90.0 - math.degrees(look.yaw)) % 360.0
    hover = 3.0 if look.photo else None
    return maxjax.Waypoint(place, hover=hover, heading=heading, look=Look(look.pitch, look.photo, look.every))


@functools.cache
def mission(looks: tuple[AimedLook | None, ...]) -> maxjax.Mission:
    """Four places over flat ground, at rest where a photo is taken."""
    ground = np.zeros((50, 40, 20), bool)
    ground[:, :, 0] = True
    where = maxjax.VoxelMap.of(ground, spacing=2.0, origin=(1.0, 1.0, -1.0), ground=ground)
    places = [(10.0, 10.0, 8.0), (40.0, 20.0, 10.0), (70.0, 50.0, 14.0), (20.0, 60.0, 9.0)]
    stops = [
        maxjax.Waypoint(place) if look is None else _aimed(place, look)
        for place, look in zip(places, looks, strict=True)
    ]
    found = maxjax.plan_mission(where, stops, planner=maxjax.AStar(), distances=maxjax.Distances(1.0, 1.0))
    # Straight lines, with a corner halfway along each.
    path = np.repeat(np.array(places), 2, axis=0)[:-1]
    path[1::2] += 0.5 * (path[2::2] - path[1::2]) + [0.0, 0.0, 1.5]
    legs = tuple(
        dataclasses.replace(leg, path=path[2 * k : 2 * k + 3], clearance_at=np.full(3, np.inf))
        for k, leg in enumerate(found.legs)
    )
    return dataclasses.replace(found, legs=legs, path=path, places=np.arange(0, 7, 2))


def written(
    folder: Path, name: str, looks: tuple[AimedLook | None, ...], autopilot: maxjax.Autopilot | None = None
) -> Path:
    """A file of the mission."""
    export(folder / name, mission(looks), earth=EARTH, takeoff_and_landing=False, autopilot=autopilot)
    return folder / name


def above_sea(places: list[list[float]]) -> np.ndarray:
    """Places of a file, whose heights count from home at 400 m."""
    return np.array(places) + np.array([0.0, 0.0, 400.0])


def test_arducopter_by_pymavlink(tmp_path: Path) -> None:
    """The gimbal, then the heading, the waypoint, and the photo after its hold."""
    mavwp = pytest.importorskip("pymavlink.mavwp", reason="needs pymavlink (extra dev)")
    loader = mavwp.MAVWPLoader()
    loader.load(str(written(tmp_path, "a.waypoints", LOOKS, COPTER)))
    items = [loader.wp(k) for k in range(loader.count())]
    photos = [k for k, item in enumerate(items) if item.command == 2000]
    assert len(photos) == 2
    for number, (k, heading, pitch) in enumerate(zip(photos, (90.0, 315.0), (-30.0, 0.0), strict=True), 1):
        mount, yaw, waypoint, photo = items[k - 3 : k + 1]
        assert (mount.command, mount.param1, mount.z) == (205, pytest.approx(pitch), 2.0)
        assert (yaw.command, yaw.param4) == (115, 0.0)
        assert yaw.param1 == pytest.approx(heading, abs=1e-3)
        assert (waypoint.command, waypoint.param1) == (16, 3.0)
        assert (photo.param2, photo.param3, photo.param4) == (0.0, 1.0, number)
    assert not [item for item in items if item.command in (195, 1000)]


def test_px4(tmp_path: Path) -> None:
    """The gimbal by its manager, without rates; the heading is the waypoint's own. In both files the same."""
    content = json.loads(written(tmp_path, "a.plan", LOOKS, PX4).read_text())["mission"]["items"]
    photos = [k for k, item in enumerate(content) if item["command"] == 2000]
    for k, heading, pitch in zip(photos, (90.0, -45.0), (-30.0, 0.0), strict=True):
        gimbal, waypoint = content[k - 2 : k]
        assert gimbal["command"] == 1000
        assert gimbal["params"][0] == pytest.approx(pitch)
        assert gimbal["params"][1:] == [0.0, None, None, 0.0, 0.0, 0.0]
        assert math.cos(math.radians(waypoint["params"][3] - heading)) == pytest.approx(1.0)
    rows = [row.split("\t") for row in written(tmp_path, "a.waypoints", LOOKS, PX4).read_text().splitlines()[1:]]
    assert [row[4:8] for row in rows if row[3] == "1000"] == [["-30", "0", "nan", "nan"], ["0", "0", "nan", "nan"]]


def test_both_look_at_places_on_the_line_of_sight(tmp_path: Path) -> None:
    """Ten metres ahead of the camera; after the last photo at none."""
    items = json.loads(written(tmp_path, "a.plan", LOOKS).read_text())["mission"]["items"]
    commands = [item["command"] for item in items]
    assert commands.count(195) == 2
    assert commands[commands.index(2000, commands.index(2000) + 1) + 1] == 197
    targets = EARTH.local(above_sea([item["params"][4:] for item in items if item["command"] == 195]))
    for target, waypoint, look in zip(targets, mission(LOOKS).waypoints[1:3], LOOKS[1:3], strict=True):
        assert look is not None
        way = target - waypoint.position
        assert np.linalg.norm(way) == pytest.approx(10.0, abs=0.02)
        assert math.atan2(way[1], way[0]) == pytest.approx(look.yaw, abs=2e-3)
        assert math.asin(way[2] / 10.0) == pytest.approx(look.pitch, abs=2e-3)


@pytest.mark.parametrize("autopilot", [None, PX4, COPTER])
def test_photos_by_distance(tmp_path: Path, autopilot: maxjax.Autopilot | None) -> None:
    """They begin behind the line's first waypoint, with one at once, and end behind its last."""
    items = json.loads(written(tmp_path, "a.plan", LINE, autopilot).read_text())["mission"]["items"]
    triggers = [(k, item["params"][:3]) for k, item in enumerate(items) if item["command"] == 206]
    assert [params for _, params in triggers] == [[4.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
    for (k, _), waypoint in zip(triggers, mission(LINE).waypoints[1:3], strict=True):
        place = EARTH.local(above_sea([items[k - 1]["params"][4:]]))[0]
        np.testing.assert_allclose(place, waypoint.position, atol=0.02)


def test_dji_turns_aims_waits_and_photographs(tmp_path: Path) -> None:
    """In this order at each place; photos by distance are an action of all waypoints of the line."""
    space = {"w": "http://www.dji.com/wpmz/1.0.6"}
    with zipfile.ZipFile(written(tmp_path, "a.kmz", LOOKS)) as archive:
        root = ElementTree.fromstring(archive.read("wpmz/waylines.wpml"))
    groups = root.findall(".//w:actionGroup", space)
    assert len(groups) == 2
    for group, heading, pitch in zip(groups, ("90.00", "-45.00"), ("-30.00", "0.00"), strict=True):
        actions = [action.findtext("w:actionActuatorFunc", "", space) for action in group.findall("w:action", space)]
        assert actions == ["rotateYaw", "gimbalRotate", "hover", "takePhoto"]
        assert group.findtext(".//w:aircraftHeading", "", space) == heading
        assert group.findtext(".//w:gimbalPitchRotateAngle", "", space) == pitch
    with zipfile.ZipFile(written(tmp_path, "b.kmz", LINE)) as archive:
        root = ElementTree.fromstring(archive.read("wpmz/waylines.wpml"))
    (line,) = [
        g for g in root.iterfind(".//w:actionGroup", space) if g.find(".//w:actionTriggerParam", space) is not None
    ]
    assert line.findtext(".//w:actionTriggerType", "", space) == "multipleDistance"
    assert line.findtext(".//w:actionTriggerParam", "", space) == "4"
    assert [line.findtext(f"w:actionGroup{end}Index", "", space) for end in ("Start", "End")] == ["2", "4"]


def test_litchi(tmp_path: Path) -> None:
    """Heading, gimbal, and the action of a photo; an interval of distance on the line."""
    rows = list(csv.DictReader(io.StringIO(written(tmp_path, "a_litchi.csv", LOOKS).read_text())))
    east = rows[2]
    assert (east["heading(deg)"], east["gimbalmode"], east["gimbalpitchangle"]) == ("90.00", "2", "-30.00")
    assert [east[f"actiontype{k}"] for k in (1, 2, 3)] == ["0", "1", "-1"]
    rows = list(csv.DictReader(io.StringIO(written(tmp_path, "b_litchi.csv", LINE).read_text())))
    assert [row["photo_distinterval"] for row in rows] == ["-1", "-1", "4", "4", "-1", "-1", "-1"]


@pytest.mark.parametrize(
    ("name", "autopilot"),
    [
        ("a.plan", None),
        ("a.plan", PX4),
        ("a.plan", COPTER),
        ("a.waypoints", None),
        ("a.waypoints", PX4),
        ("a.waypoints", COPTER),
        ("a.kmz", None),
        ("a_litchi.csv", None),
    ],
)
@pytest.mark.parametrize("looks", [LOOKS, LINE])
def test_what_is_read_back_is_what_was_meant(
    tmp_path: Path, name: str, autopilot: maxjax.Autopilot | None, looks: tuple[AimedLook | None, ...]
) -> None:
    """Headings and elevations of photos to a hundredth of a degree, distances as they are."""
    flown = export(tmp_path / name, mission(looks), earth=EARTH, takeoff_and_landing=False, autopilot=autopilot)
    assert len(flown.line) >= 4
    for waypoint, look in zip(mission(looks).waypoints, looks, strict=True):
        k = int(np.linalg.norm(flown.line - waypoint.position, axis=1).argmin())
        found = flown.looks.get(k)
        if look is None:
            assert found is None or not (found.photo or found.every)
            continue
        assert found is not None
        assert found.photo == look.photo
        assert (found.every or 0.0) == (look.every or 0.0)
        if look.photo and look.yaw is not None and look.pitch is not None:
            assert found.yaw is not None
            assert math.cos(found.yaw - look.yaw) == pytest.approx(1.0, abs=1e-7)
            assert found.pitch == pytest.approx(look.pitch, abs=2e-4)
        if look.pitch is not None and look.every:
            assert found.pitch == pytest.approx(look.pitch, abs=2e-4)


def test_a_photo_is_taken_at_rest(tmp_path: Path) -> None:
    """A mission whose photos have no time to hover holds as long as its autopilots need to come to rest."""
    flown_through = tuple(None if look is None else look for look in LOOKS)
    given = mission(flown_through)
    waypoints = tuple(dataclasses.replace(waypoint, hover=None) for waypoint in given.waypoints)
    moving = dataclasses.replace(given, waypoints=waypoints)
    export(tmp_path / "a.plan", moving, earth=EARTH, takeoff_and_landing=False)
    items = json.loads((tmp_path / "a.plan").read_text())["mission"]["items"]
    held = [items[k - 1]["params"][0] for k, item in enumerate(items) if item["command"] == 2000]
    assert held == [2.0, 2.0]
