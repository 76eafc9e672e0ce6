"""The parts of the link, each by itself: addresses, modes, frames, comparison of items, the clearance kept, the log."""

from __future__ import annotations

import asyncio
import csv
import itertools
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="needs pymavlink (extra dev)")

from benchmarks.common.link_course import EARTH, GROUND, PATH, trajectory
from maxjax.io.export.setpoints import LocalOrigin
from maxjax.io.geo.earth import TangentPlane
from maxjax.link.address import connection_of, is_address
from maxjax.link.clearance_watch import ClearanceWatch
from maxjax.link.errors import LinkError
from maxjax.link.flight_log import COLUMNS, Look, open_log
from maxjax.link.flight_modes import MODES
from maxjax.link.flight_task import FlightTask
from maxjax.link.frame import LocalFrame
from maxjax.link.mission_transfer import differences, transfer


@pytest.mark.parametrize(
    ("address", "connection"),
    [
        ("udp://127.0.0.1:14550", "udpin://127.0.0.1:14550"),
        ("udp://:14550", "udpin://127.0.0.1:14550"),  # not on all interfaces
        ("udpin://0.0.0.0:14550", "udpin://0.0.0.0:14550"),  # told so
        ("udpout://10.0.0.7:14540", "udpout://10.0.0.7:14540"),
        ("tcp://127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("serial:///dev/ttyUSB0:57600", "serial:///dev/ttyUSB0:57600"),
    ],
)
def test_addresses_as_mavsdk_takes_them(address: str, connection: str) -> None:
    assert is_address(address)
    assert connection_of(address) == connection


@pytest.mark.parametrize("address", ["px4", "udp://", "udp://1.2.3.4", "udp://h:99999", "tcp://:5760", "http://h:80"])
def test_other_addresses_are_refused(address: str) -> None:
    with pytest.raises(ValueError, match=r"--autopilot: expected"):
        connection_of(address)


def test_modes_are_those_of_pymavlink() -> None:
    mavutil = pytest.importorskip("pymavlink.mavutil", reason="needs pymavlink (extra dev)")
    for number, name in MODES[3].names.items():
        theirs = mavutil.mode_mapping_acm[number]
        assert theirs == name
    for name, theirs in (("mission", "MISSION"), ("setpoints", "OFFBOARD"), ("hold", "LOITER")):
        base, main, sub = mavutil.px4_map[theirs]
        number = getattr(MODES[12], name)
        assert (number >> 16 & 0xFF, number >> 24) == (main, sub)
        assert MODES[12].parameters(number) == (float(main), float(sub))
        assert base & 1  # custom modes


def test_a_frame_leads_there_and_back_and_north_is_true() -> None:
    frame = LocalFrame(LocalOrigin((-14.0, 0.0, GROUND), EARTH), np.array([5.0, -3.0, 0.7]))
    motion = trajectory().at([0.0, 3.0, 6.0])
    states, yaw = frame.states(motion)
    # On the plane at the place itself x is east, y north: 14 m further east, 3 m up.
    np.testing.assert_allclose(states[0, 0], [5.0, -3.0, 0.7 - 3.0], atol=1e-4)
    np.testing.assert_allclose(states[:, 0, 1] + 3.0, motion.position[:, 0] + 14.0, atol=1e-3)
    np.testing.assert_allclose(states[:, 1, 1], motion.velocity[:, 0], atol=1e-3)
    np.testing.assert_allclose(yaw, np.pi / 2, atol=1e-5)  # meridians meet
    for state, place in zip(states, motion.position, strict=True):
        np.testing.assert_allclose(frame.in_map(state[0]), place, atol=1e-6)


def test_a_frame_is_right_kilometres_away_from_the_middle_of_a_turned_map() -> None:
    far = TangentPlane(60.0, 20.0, 5.0)
    frame = LocalFrame(LocalOrigin((4000.0, -3000.0, 2.0), far), np.zeros(3))
    for east, north, up in itertools.product((0.0, 900.0), (-900.0, 300.0), (0.0, 80.0)):
        point = np.array([4000.0 + east, -3000.0 + north, 2.0 + up])
        place = far.geodetic(point[None])
        home = far.geodetic(np.array([[4000.0, -3000.0, 2.0]]))[0]
        aside = TangentPlane(*home.tolist()).local(place)[0]
        ned = np.array([aside[1], aside[0], -(place[0, 2] - home[2])])
        np.testing.assert_allclose(frame.in_map(ned), point, atol=1e-4)


def item(command: int, **changes: Any) -> Any:
    fields = {"command": command, "frame": 3, "x": 520000000, "y": 43000000, "z": 20.0}
    return types.SimpleNamespace(**fields | dict.fromkeys(("param1", "param2", "param3", "param4"), 0.0) | changes)


def test_items_that_differ_are_named() -> None:
    sent = [item(16, z=0.0), item(178, param2=5.0), item(16, param1=2.7, param2=0.5, param4=90.0), item(21)]
    as_copter = [item(16, x=1), item(178, param2=5.0), item(16, param1=2.0, x=520000001), item(21)]
    assert differences(sent, sent, ardupilot=False) == []
    assert differences(sent, as_copter, ardupilot=True) == []
    assert len(differences(sent, as_copter, ardupilot=False)) == 5
    for change in ({"z": 21.0}, {"x": 520000100}, {"y": 1}, {"param1": 0.0}, {"frame": 0}, {"command": 17}):
        stored = [*as_copter[:2], item(**{"command": 16, "param1": 2.0} | change), as_copter[3]]
        (wrong,) = differences(sent, stored, ardupilot=True)
        assert wrong.startswith(f"item 2: expected {next(iter(change))}")
    assert differences(sent, sent[:3], ardupilot=True) == ["given 3 items for 4"]


@pytest.mark.parametrize(
    ("ends", "sentence"),
    [
        (("TIMEOUT", "PROTOCOL_ERROR"), ""),
        (("PROTOCOL_ERROR",) * 3, "given: protocol error; nothing was armed: come nearer, or use a better radio"),
        (("UNSUPPORTED",), "given: unsupported; nothing was armed: the autopilot does not fly such items"),
    ],
)
def test_a_transfer_is_tried_again_where_packets_are_lost_or_doubled(ends: tuple[str, ...], sentence: str) -> None:
    raw = pytest.importorskip("mavsdk.plugins.mission_raw", reason="needs mavsdk (extra mavlink)")
    left = list(ends)

    def upload(_: object) -> None:
        if left:
            raise raw.MissionRawError(raw.MissionRawResult[left.pop(0)], "upload_mission()")

    found = types.SimpleNamespace(mission_items=[], geofence_items=[], rally_items=[])
    missions = types.SimpleNamespace(
        import_qgroundcontrol_mission_from_string=lambda _: found,
        upload_mission=upload,
        upload_geofence=upload,
        upload_rally_points=upload,
        download_mission=list,
    )
    vehicle: Any = types.SimpleNamespace(missions=missions, modes=MODES[12])
    if sentence:
        with pytest.raises(LinkError, match=sentence):
            asyncio.run(transfer(vehicle, "{}"))
    else:
        assert asyncio.run(transfer(vehicle, "{}")) == []
    assert left == []


def test_what_has_to_be_kept_is_the_radius_or_what_an_end_has() -> None:
    watch = ClearanceWatch(trajectory().map, 2.0, 0.5)
    # The wall's cubes begin at y = 7.
    assert watch.distance(np.array([0.0, 4.0, 3.0])) == pytest.approx(3.0)
    assert watch.least(np.array([0.0, 4.0, 3.0])) == 2.0
    assert watch.least(np.array([0.0, 5.5, 3.0])) == pytest.approx(1.0)
    assert watch.least(np.array([0.0, 6.8, 3.0])) == 0.0
    # Ground is left out.
    assert watch.distance(np.array([0.0, 4.0, 0.1])) == pytest.approx(3.0)


def look(time: float, remark: str = "") -> Look:
    return Look(time, "follow", "GUIDED", True, PATH[0], PATH[0] + [0.0, 3.0, 4.0], 0.5, 7.0, 80, remark)


def test_a_log_is_whole_whatever_ends_it(tmp_path: Path) -> None:
    file = tmp_path / "flight.csv"
    file.write_text("an earlier one")

    def fly() -> None:
        with open_log(file) as log:
            log.add(look(0.0))
            assert file.read_text() == "an earlier one"
            log.add(look(0.05, 'said "stop", then went'))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly()
    with open(file, newline="") as rows:
        head, first, last = csv.reader(rows)
    assert tuple(head) == COLUMNS
    assert (first[0], last[0]) == ("0.000", "0.050")
    assert last[head.index("error_m")] == "5.000"
    assert last[-1] == 'said "stop", then went'
    assert [one.name for one in tmp_path.iterdir()] == ["flight.csv"]


@pytest.mark.parametrize(("change", "said"), [
    ({"system": 0}, "--system: expected a MAVLink system"),
    ({"tolerance": 0.0}, "--tolerance: expected a positive"),
    ({"ground": float("nan")}, "expected a map with ground below the start"),
])  # fmt: skip
def test_a_task_is_checked_where_it_is_made(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    given = {"ground": GROUND, "address": "udp://:14550", "out": tmp_path} | change
    with pytest.raises(ValueError, match=said):
        FlightTask(trajectory(), EARTH, **given)
