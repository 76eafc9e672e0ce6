"""A mission flight that was recorded, played again as the vehicle: the link says the same to it, and of it."""

from __future__ import annotations

import dataclasses
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mavsdk", reason="needs mavsdk (extra mavlink)")
pytest.importorskip("pymavlink", reason="needs pymavlink (extra dev)")

from benchmarks.common.link_course import PATH, fly, free_port
from maxjax.link.session import LinkFlight
from tests.link.recorded_session import SESSION, Replay, asked_of, read_session


@dataclasses.dataclass(frozen=True)
class Played:
    """What the link said to the vehicle, to who flies it, and what became of the flight."""

    said: list[tuple[Any, ...]]
    wrong: str
    told: list[str]
    flight: LinkFlight


def play(folder: Path) -> Played:
    """Fly the same mission against the recorded vehicle."""
    told, port = list[str](), free_port()
    with Replay(read_session(SESSION), port) as vehicle:
        flight = fly(vehicle, folder, lambda _, said: told.append(said), arm=True)
        return Played(vehicle.said, vehicle.wrong, told, flight)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """The flight, in a process of its own: MAVSDK does not take several clients in one."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(play, tmp_path_factory.mktemp("session")).result(60.0)


def test_the_link_commands_and_transfers_the_same_in_the_same_order(played: Played) -> None:
    assert played.wrong == ""
    assert played.flight.sentence == ""
    assert played.said == asked_of(read_session(SESSION))


def test_it_tells_of_the_flight_what_the_vehicle_told(played: Played) -> None:
    told = [event.message for event in read_session(SESSION) if event.told]
    items = [one.seq for one in told if one.get_type() == "MISSION_CURRENT"]
    assert played.told[0] == "ArduCopter, system 1: waits for it to be ready"
    shown = [int(line.split()[1]) for line in played.told[1:]]
    assert set(shown) <= set(items)
    assert shown == sorted(shown)
    assert played.told[-1].startswith(f"item {items[-2]} of 6, ")
    looks = played.flight.looks
    assert [stage for stage, _ in groupby(look.stage for look in looks)] == ["ready", "mission", "landed"]
    assert [mode for mode, _ in groupby(look.mode for look in looks)] == ["STABILIZE", "AUTO"]
    assert [look.remark for look in looks if look.remark] == ["ready", "6 items uploaded, read back and compared"]
    # Each look is near to a place that the vehicle told: north, east and down from 3 m north, 2 m west of its start.
    track = [[PATH[0, 0] + one.y - 2.0, one.x + 3.0, -one.z] for one in told if one.get_type() == "LOCAL_POSITION_NED"]
    for look in looks:
        assert np.linalg.norm(np.array(track) - look.position, axis=1).min() < 1.0


def test_the_session_is_small_and_holds_a_whole_flight() -> None:
    events = read_session(SESSION)
    assert len(SESSION.read_bytes()) <= 60_000
    assert {event.told for event in events} == {True, False}
    armed = [bool(one.message.base_mode & 128) for one in events if one.told and one.message.get_type() == "HEARTBEAT"]
    assert [state for state, _ in groupby(armed)] == [False, True, False]
