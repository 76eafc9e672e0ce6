"""Flights over loopback, by MAVSDK at one end and pymavlink at the other: missions, set-points, and what ends them."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

pytest.importorskip("mavsdk", reason="needs mavsdk (extra mavlink)")
pytest.importorskip("pymavlink", reason="needs pymavlink (extra dev)")

from benchmarks.common.link_course import PATH
from tests.link.flights import FLIGHTS, Flown, fly_named

Flights = Callable[[str], Flown]


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flights]:
    """Every flight by its name, when it is over; three fly at a time, in processes of their own."""
    folder = tmp_path_factory.mktemp("flights")
    with ProcessPoolExecutor(3, multiprocessing.get_context("spawn")) as pool:
        running = {name: pool.submit(fly_named, name, folder / name) for name in FLIGHTS}
        yield lambda name: running[name].result(120.0)
        for one in running.values():
            one.cancel()


@pytest.mark.parametrize("name", ["mission", "mission of PX4", "lossy mission"])
def test_a_mission_is_uploaded_started_and_flown(flights: Flights, name: str) -> None:
    found = flights(name)
    assert found.flight.sentence == ""
    assert found.commands[-5:] == (22, 178, 16, 16, 21)
    assert found.arm_requests >= 1
    assert not found.armed
    assert np.hypot(*(found.flight.looks[-1].position - PATH[-1])[:2]) < 0.5
    on_way = [look for look in found.flight.looks if look.stage == "mission" and look.position[2] > 2.8]
    assert max(look.error for look in on_way) < 0.6
    assert found.rows[-1]["stage"] == "landed"


def test_in_a_head_wind_time_alone_lags_metres_and_waiting_keeps_the_tolerance(flights: Flights) -> None:
    waits, by_time = flights("waits"), flights("by time")
    assert waits.flight.sentence == by_time.flight.sentence == ""
    assert by_time.errors.max() > 5.0
    assert 1.0 < waits.errors.max() < 2.1
    paces = np.array([look.pace for look in waits.flight.looks if look.stage == "follow"])
    assert paces.min() < 0.7
    # At rest on the last set-point, and left in the hold of its own.
    assert np.linalg.norm(waits.flight.looks[-1].position - PATH[-1]) < 0.5
    assert waits.mode == "BRAKE"
    assert by_time.timed_out == waits.timed_out == 0


def test_set_points_come_twenty_times_a_second_and_never_go_back(flights: Flights) -> None:
    points = flights("waits").set_points
    assert 0.04 < np.median(np.diff(points[:, 0])) < 0.1
    assert np.diff(points[:, 2]).min() > -0.05


def test_lost_packets_and_a_clock_that_jumps_change_nothing(flights: Flights) -> None:
    found = flights("lossy")
    assert found.flight.sentence == ""
    assert found.errors.max() < 1.5
    assert found.mode == "LOITER"
    assert found.timed_out == 0


@pytest.mark.parametrize(
    ("name", "sentence", "mode"),
    [
        ("interrupted", "interrupted: the vehicle is told to hold", "BRAKE"),
        ("taken over", "mode: expected GUIDED, given LOITER", "LOITER"),
        ("battery", "mode: expected OFFBOARD, given RETURN (it says: Battery 1 is low", "RTL"),
        ("blown aside", "clearance: expected 1.00 m, as judged, given 0.", "BRAKE"),
        ("silent", "telemetry: expected a position every 1 s", "BRAKE"),
    ],
)
def test_what_ends_a_flight_is_a_sentence_and_leaves_the_vehicle_in_a_mode_of_its_own(
    flights: Flights, name: str, sentence: str, mode: str
) -> None:
    found = flights(name)
    assert found.flight.sentence.startswith(sentence)
    assert found.mode == mode
    assert found.armed
    assert found.flight.interrupted == (name == "interrupted")
    # The log is whole, and says why.
    rows = found.rows
    assert len(rows) == len(found.flight.looks)
    assert any(row["remark"] == found.flight.sentence for row in rows[-2:])
    assert {file.name for file in found.folder.iterdir()} == {"flight.csv"}


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("unheard", "expected a heartbeat within 1 s, heard none; start the vehicle"),
        ("another system", "expected a heartbeat of system 1, heard system 7; give --system"),
        ("armed", "ArduCopter: expected it disarmed, it is armed (STABILIZE"),
        ("in the air", "ArduCopter: expected it on the ground, it flies (LOITER, 20.0 m above home)"),
        ("elsewhere", "home: expected the vehicle within 2 m of the start, latitude 52.0700000, longitude 4.29"),
        ("no estimate", "still without an estimate of horizontal position, height (EKF)"),
        ("no local position", "still without local position (LOCAL_POSITION_NED)"),
        ("not healthy", "still without passed pre-arm checks (SYS_STATUS)"),
        ("item refused", "mission: expected the vehicle to answer 6 items, given: unsupported; nothing was armed"),
        ("item altered", "mission: expected ArduCopter to store what it was sent, item 3: expected z 3, given 8"),
    ],
)
def test_what_is_not_ready_is_refused_before_anything_is_armed(flights: Flights, name: str, sentence: str) -> None:
    found = flights(name)
    assert sentence in found.flight.sentence
    assert found.arm_requests == 0
    assert len(found.set_points) == 0
    assert found.rows == [] or found.rows[-1]["stage"] == "ready"


def test_an_autopilot_that_does_not_arm_says_why(flights: Flights) -> None:
    found = flights("arming refused")
    assert "arming: expected it to be accepted, given: failed (it says: PreArm: Compass" in found.flight.sentence
    assert not found.armed


@pytest.mark.parametrize("name", ["not asked", "not asked, set-points"])
def test_nothing_is_armed_unless_that_is_asked_for(flights: Flights, name: str) -> None:
    found = flights(name)
    assert (found.flight.sentence, found.arm_requests, len(found.set_points)) == ("", 0, 0)
    assert (found.folder / "flight.plan").is_file() == (name == "not asked")
