"""The benchmark of the link over a bad radio at a small size, its table, and the socket that makes a radio bad."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import socket
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

pytest.importorskip("mavsdk", reason="needs mavsdk (extra mavlink)")
pytest.importorskip("pymavlink", reason="needs pymavlink (extra dev)")

from benchmarks import link_loss, tables
from benchmarks.common.lossy_socket import LossySocket


@pytest.mark.nightly
def test_a_bad_radio_is_measured_to_the_end(tmp_path: Path) -> None:
    config = dataclasses.replace(link_loss.TINY, out=tmp_path)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:  # MAVSDK: one client a process
        (row,) = pool.submit(link_loss.main, config).result(120.0)
    document = json.loads((tmp_path / "link_loss.json").read_text())
    assert document["rows"] == [row]
    assert row["commands_failed"] == row["flights_ended"] == 0
    assert 0.0 < row["off_path_m"] < 2.0
    assert "| 30 % | 0 | " in tables.link_loss(document)


@pytest.fixture
def partner() -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.bind(("127.0.0.1", 0))
    found.settimeout(0.05)
    return found


def heard(partner: socket.socket) -> list[int]:
    found = []
    while True:
        try:
            found.append(int(partner.recv(100)))
        except TimeoutError:
            return found


def test_a_share_of_packets_is_lost_and_as_many_are_doubled(partner: socket.socket) -> None:
    radio = LossySocket(partner.getsockname()[1], loss=0.3)
    found = []
    for number in range(400):
        radio.send(str(number).encode())
        found += heard(partner) if number % 50 == 49 else []  # a socket keeps a few hundred
    radio.close()
    assert len(set(found)) == pytest.approx(280, abs=30)
    assert len(found) - len(set(found)) == pytest.approx(0.3 * 280, abs=30)
    assert found == sorted(found)


def test_packets_arrive_late_each_way_and_none_without_a_loss_is_missing(partner: socket.socket) -> None:
    radio = LossySocket(partner.getsockname()[1], delay=0.05)
    began = time.monotonic()
    radio.send(b"7")
    partner.sendto(b"8", radio._socket.getsockname())
    answers = []
    while not answers:
        answers = radio.receive()
    assert answers == [b"8"]
    assert time.monotonic() - began > 0.05
    radio.receive()  # sends what is due
    assert heard(partner) == [7]
    radio.close()
