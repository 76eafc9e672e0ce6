"""What is written is read back by other people's readers: pymavlink, MAVSDK, rosbags, evo; and goes over MAVLink."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
import math
import socket
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax.io.export.export import export
from maxjax.io.geo.earth import TangentPlane
from maxjax.planning.plan import Plan
from tests.planners import bare_plan

EARTH = TangentPlane(52.07, 4.3, 10.0)
GROUND = 1.5
PATH = np.array([[-40.0, 0.0, 6.0], [-10.0, 25.0, 12.5], [20.0, 25.0, 9.0], [35.0, -10.0, 20.0]])
TIMED = ("a.csv", "a_ned.csv", "a.tum", "a.rosbag")
PLACED = ("a.plan", "a.waypoints", "a.geojson", "a.kml")


@functools.cache
def plan() -> Plan:
    grid = maxjax.Grid((61, 61, 31), 2.0, (-60.0, -60.0, 0.0))
    where = maxjax.VoxelMap.on(grid, np.zeros(grid.shape, bool))
    return bare_plan(where, PATH, length=120.0, clearance=5.0, clearance_at=np.full(len(PATH), 5.0))


@functools.cache
def trajectory() -> maxjax.Trajectory:
    return maxjax.trajectory(plan(), maxjax.FlightLimits(speed=7.0))


def written(folder: Path, name: str) -> Path:
    export(folder / name, trajectory(), earth=EARTH, ground=GROUND, takeoff_and_landing=False)
    return folder / name


def check_places(latitude: Any, longitude: Any, height: Any, tolerance: float = 0.01) -> None:
    """Whether places with heights above the ground at home are the path's, to a centimetre."""
    home = EARTH.geodetic(np.array([[*PATH[0, :2], GROUND]]))[0, 2]
    found = EARTH.local(np.column_stack([latitude, longitude, np.asarray(height) + home]))
    np.testing.assert_allclose(found, PATH, atol=tolerance)


def test_a_plan_file_holds_the_path_to_a_centimetre(tmp_path: Path) -> None:
    mission = json.loads(written(tmp_path, "a.plan").read_text())["mission"]
    speed, *places = mission["items"]
    assert (speed["command"], speed["params"][1]) == (178, 7.0)
    assert {(item["command"], item["frame"], item["AltitudeMode"]) for item in places} == {(16, 3, 1)}
    assert [item["Altitude"] for item in places] == [item["params"][6] for item in places]
    check_places(*np.array([item["params"][4:] for item in places]).T)
    np.testing.assert_allclose(
        EARTH.local(np.array([mission["plannedHomePosition"]]))[0], [-40.0, 0.0, GROUND], atol=0.01
    )


def test_pymavlink_reads_waypoints(tmp_path: Path) -> None:
    mavwp = pytest.importorskip("pymavlink.mavwp", reason="needs pymavlink (extra dev)")
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(written(tmp_path, "a.waypoints"))) == 2 + len(PATH)
    home, speed, *places = (loader.wp(k) for k in range(loader.count()))
    assert (home.frame, home.command, home.current) == (0, 16, 1)
    assert (speed.command, speed.param2) == (178, 7.0)
    assert {(item.frame, item.command, item.param2) for item in places} == {(3, 16, 0.5)}
    check_places([item.x for item in places], [item.y for item in places], [item.z for item in places])


@pytest.fixture(scope="module")
def link() -> Iterator[tuple[Any, Any]]:
    """MAVSDK's ground station and vehicle, on a loopback port of their own."""
    mavsdk = pytest.importorskip("mavsdk", minversion=None, reason="needs mavsdk (extra dev)")
    from mavsdk.plugins.mission_raw import MissionRaw
    from mavsdk.plugins.mission_raw_server import MissionRawServer

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    kinds = mavsdk.ComponentType
    ends = [
        mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        for kind in (kinds.GROUND_STATION, kinds.AUTOPILOT)
    ]
    ends[0].add_any_connection(f"udpin://127.0.0.1:{port}")
    ends[1].add_any_connection(f"udpout://127.0.0.1:{port}")
    server = MissionRawServer(ends[1].server_component())
    system = ends[0].first_autopilot(10.0)
    assert system is not None
    mission = MissionRaw(system)
    yield mission, server
    for one in (mission, server, *ends):
        one.destroy()


def test_mavsdk_reads_both_missions(tmp_path: Path, link: tuple[Any, Any]) -> None:
    mission, _ = link
    plans = mission.import_qgroundcontrol_mission(str(written(tmp_path, "a.plan"))).mission_items
    lists = mission.import_mission_planner_mission(str(written(tmp_path, "a.waypoints"))).mission_items
    for items in (plans, lists):
        places = [item for item in items if item.command == 16 and item.frame == 3]
        latitude, longitude = (1e-7 * np.array([getattr(item, axis) for item in places]) for axis in "xy")
        # MAVLink's degrees come in steps of 1.1 cm.
        check_places(latitude, longitude, [item.z for item in places], tolerance=0.012)


def test_a_mission_goes_over_mavlink(tmp_path: Path, link: tuple[Any, Any]) -> None:
    mission, server = link
    items = mission.import_qgroundcontrol_mission(str(written(tmp_path, "a.plan"))).mission_items
    received: list[Any] = []
    handle = server.subscribe_incoming_mission(lambda *given: received.append(given))
    mission.upload_mission(items)
    deadline = time.monotonic() + 10.0
    while not received and time.monotonic() < deadline:
        time.sleep(0.01)
    server.unsubscribe_incoming_mission(handle)
    arrived = next(part for part in received[0] if hasattr(part, "mission_items")).mission_items
    assert [(i.command, i.frame, i.x, i.y, i.z) for i in arrived] == [
        (i.command, i.frame, i.x, i.y, i.z) for i in items
    ]


@functools.cache
def mission() -> maxjax.Mission:
    """From the second point of the path on slower, with a stop of 4 s there."""
    places = [maxjax.Waypoint((x, y, z)) for x, y, z in PATH[[0, 1, 3]].tolist()]
    places[1:] = [dataclasses.replace(places[1], hover=4.0), dataclasses.replace(places[2], speed=2.5)]
    legs = tuple(dataclasses.replace(plan(), path=p, clearance_at=np.full(len(p), 5.0)) for p in (PATH[:2], PATH[1:]))
    return maxjax.Mission(maxjax.Status.OK, tuple(places), legs, PATH, np.array([0, 1, 3]), 120.0, 5.0, {}, plan().map)


def of_mission() -> maxjax.Trajectory:
    return dataclasses.replace(trajectory(), plan=mission())


def test_a_mission_holds_and_changes_its_speed(tmp_path: Path, link: tuple[Any, Any]) -> None:
    for name in ("b.plan", "b.waypoints"):
        export(tmp_path / name, of_mission(), earth=EARTH, ground=GROUND, takeoff_and_landing=False)
    items = json.loads((tmp_path / "b.plan").read_text())["mission"]["items"]
    assert [item["doJumpId"] for item in items] == [1, 2, 3, 4, 5, 6]
    reader, _ = link
    plans = reader.import_qgroundcontrol_mission(str(tmp_path / "b.plan")).mission_items
    lists = reader.import_mission_planner_mission(str(tmp_path / "b.waypoints")).mission_items
    for found in (plans, lists[-6:]):
        # Command, and the speed or the time to hold.
        assert [(item.command, item.param2 if item.command == 178 else item.param1) for item in found] == [
            (178, 7.0), (16, 0.0), (16, 4.0), (178, 2.5), (16, 0.0), (16, 0.0),
        ]  # fmt: skip
        places = [item for item in found if item.command == 16]
        latitude, longitude = (1e-7 * np.array([getattr(item, axis) for item in places]) for axis in "xy")
        check_places(latitude, longitude, [item.z for item in places], tolerance=0.012)


def test_mavsdk_reads_camera_and_gimbal(tmp_path: Path, link: tuple[Any, Any]) -> None:
    look = maxjax.Look(pitch=-0.5, photo=True, every=6.0)
    places = list(mission().waypoints)
    places[1] = dataclasses.replace(places[1], heading=90.0, look=look)
    aimed = dataclasses.replace(mission(), waypoints=tuple(places))
    reader, _ = link
    for autopilot, expected in (
        (maxjax.Autopilot.px4(), [1000, 16, 2000, 206]),
        (maxjax.Autopilot.arducopter(), [205, 115, 16, 2000, 206]),
        (None, [195, 16, 2000, 206]),
    ):
        for name in ("c.plan", "c.waypoints"):
            how = {"earth": EARTH, "ground": GROUND, "takeoff_and_landing": False, "autopilot": autopilot}
            export(tmp_path / name, dataclasses.replace(trajectory(), plan=aimed), **how)
        plans = reader.import_qgroundcontrol_mission(str(tmp_path / "c.plan")).mission_items
        lists = reader.import_mission_planner_mission(str(tmp_path / "c.waypoints")).mission_items
        for items in (plans, lists):
            commands = [item.command for item in items]
            last = commands.index(206)
            assert commands[last + 1 - len(expected) : last + 1] == expected
            assert items[last].param1 == 6.0


def test_geojson_and_kml_hold_the_legs_of_a_mission(tmp_path: Path) -> None:
    for name in ("b.geojson", "b.kml"):
        export(tmp_path / name, of_mission(), earth=EARTH)
    features = json.loads((tmp_path / "b.geojson").read_text())["features"]
    assert [feature["geometry"]["type"] for feature in features] == ["LineString", "LineString", "Point"]
    assert [feature["properties"]["name"] for feature in features] == ["leg 1", "leg 2", "waypoint 1"]
    assert [feature["properties"].get("speed_m_s") for feature in features] == [7.0, 2.5, None]
    assert features[2]["properties"]["hover_s"] == 4.0
    lines = [np.atleast_2d(feature["geometry"]["coordinates"]) for feature in features]
    for line, part in zip(lines, (PATH[:2], PATH[1:], PATH[1:2]), strict=True):
        np.testing.assert_allclose(EARTH.local(line[:, [1, 0, 2]]), part, atol=0.01)
    space = {"k": "http://www.opengis.net/kml/2.2"}
    marks = ElementTree.parse(tmp_path / "b.kml").getroot().findall(".//k:Placemark", space)
    assert [mark.findtext("k:name", namespaces=space) for mark in marks] == ["leg 1", "leg 2", "waypoint 1"]
    for mark, line in zip(marks, lines, strict=True):
        text = mark.findtext(".//k:coordinates", namespaces=space)
        assert text is not None
        np.testing.assert_allclose([[float(x) for x in row.split(",")] for row in text.split()], line, atol=1e-9)


def test_geojson_and_kml_hold_the_path(tmp_path: Path) -> None:
    (feature,) = json.loads(written(tmp_path, "a.geojson").read_text())["features"]
    assert feature["geometry"]["type"] == "LineString"
    east, north, up = np.array(feature["geometry"]["coordinates"]).T
    np.testing.assert_allclose(EARTH.local(np.column_stack([north, east, up])), PATH, atol=0.01)
    space = {"k": "http://www.opengis.net/kml/2.2"}
    line = ElementTree.parse(written(tmp_path, "a.kml")).getroot().find(".//k:LineString", space)
    assert line is not None
    assert line.findtext("k:altitudeMode", namespaces=space) == "absolute"
    text = line.findtext("k:coordinates", namespaces=space)
    assert text is not None
    east, north, up = np.array([row.split(",") for row in text.split()], float).T
    np.testing.assert_allclose(EARTH.local(np.column_stack([north, east, up])), PATH, atol=0.01)


def test_setpoints_are_the_trajectory(tmp_path: Path) -> None:
    columns = ["t", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az", "yaw"]
    with open(written(tmp_path, "a.csv"), newline="") as file:
        head, *rows = csv.reader(file)
    assert head == columns
    table = np.array(rows, float)
    motion = trajectory().at(np.minimum(table[:, 0], trajectory().duration))
    for first, values in ((1, motion.position), (4, motion.velocity), (7, motion.acceleration)):
        np.testing.assert_allclose(table[:, first : first + 3], values, atol=2e-5)
    assert np.abs(np.angle(np.exp(1j * (table[:, 10] - motion.yaw)))).max() < 1e-5


def test_ned_counts_from_the_ground_below_the_start(tmp_path: Path) -> None:
    file = written(tmp_path, "a_ned.csv")
    table = np.genfromtxt(file, delimiter=",", names=True)
    assert table.dtype.names == ("t", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az", "yaw")
    ned = np.loadtxt(file, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(ned[:, 1], table["x"])
    motion = trajectory().at(np.minimum(ned[:, 0], trajectory().duration))
    foot = np.array([*PATH[0, :2], GROUND])
    for first, values in ((1, motion.position - foot), (4, motion.velocity), (7, motion.acceleration)):
        east, north, up = values.T
        # 40 m from where the map touches the Earth, the vertical leans by 1e-5.
        np.testing.assert_allclose(ned[:, first : first + 3], np.column_stack([north, east, -up]), atol=2e-3)
    assert np.abs(np.angle(np.exp(1j * (motion.yaw + ned[:, 10] - 0.5 * math.pi)))).max() < 1e-4
    assert np.abs(ned[:, 10]).max() <= math.pi + 1e-6


def test_evo_reads_poses(tmp_path: Path) -> None:
    reader = pytest.importorskip("evo.tools.file_interface", reason="needs evo (extra dev)")
    poses = reader.read_tum_trajectory_file(str(written(tmp_path, "a.tum")))
    motion = trajectory().at(np.minimum(poses.timestamps, trajectory().duration))
    np.testing.assert_allclose(poses.positions_xyz, motion.position, atol=1e-5)
    forwards = np.array([pose[:3, 0] for pose in poses.poses_se3])
    np.testing.assert_allclose(forwards[:, :2], np.column_stack([np.cos(motion.yaw), np.sin(motion.yaw)]), atol=1e-4)


def test_rosbags_reads_the_path(tmp_path: Path) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs rosbags (extra ros)")
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    for _ in range(2):  # the second replaces the first
        folder = written(tmp_path, "a.rosbag")
        with rosbag2.Reader(folder) as bag:
            ((connection, _, raw),) = bag.messages()
            path = types.deserialize_cdr(raw, connection.msgtype)
        assert (connection.topic, connection.msgtype, path.header.frame_id) == ("/path", "nav_msgs/msg/Path", "map")
        stamps = np.array([p.header.stamp.sec + 1e-9 * p.header.stamp.nanosec for p in path.poses])
        motion = trajectory().at(np.minimum(stamps, trajectory().duration))
        found = [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in path.poses]
        np.testing.assert_allclose(found, motion.position, atol=1e-6)
    assert [one.name for one in tmp_path.iterdir()] == ["a.rosbag"]


@pytest.mark.parametrize("name", ["a", "a.txt", "a.csv.gz", "nowhere/a.csv"])
def test_names_that_cannot_be_written_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match=r"expected a (name|folder)"):
        written(tmp_path, name)


def test_a_format_that_needs_more_says_so(tmp_path: Path) -> None:
    for name in PLACED:
        with pytest.raises(ValueError, match="expected a place on Earth"):
            export(tmp_path / name, trajectory())
    for name in TIMED:
        with pytest.raises(ValueError, match="expected a trajectory"):
            export(tmp_path / name, plan(), earth=EARTH)
    assert not list(tmp_path.iterdir())


def test_a_plan_without_a_path_is_not_written(tmp_path: Path) -> None:
    failed = dataclasses.replace(
        plan(), status=maxjax.Status.NO_VALID_PATH, path=np.zeros((0, 3)), clearance_at=np.zeros(0)
    )
    for name in (*PLACED, *TIMED):
        with pytest.raises(ValueError, match="expected a plan that is OK, given NO_VALID_PATH"):
            export(tmp_path / name, dataclasses.replace(trajectory(), plan=failed), earth=EARTH)
    assert not list(tmp_path.iterdir())


def test_a_bag_replaces_bags_only(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags (extra ros)")
    (tmp_path / "a.rosbag").mkdir()
    (tmp_path / "a.rosbag" / "thesis.tex").write_text("years of work")
    with pytest.raises(OSError, match="or a ROS 2 bag to replace"):
        written(tmp_path, "a.rosbag")
    assert (tmp_path / "a.rosbag" / "thesis.tex").read_text() == "years of work"
