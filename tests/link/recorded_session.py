"""A session of a vehicle and the link, recorded, and played again to the link as the vehicle's side of it.

    python -m tests.link.recorded_session       # flies a mission, and writes session.tlog anew

The file is a .tlog as ground stations write: eight bytes of time since 1970 [µs], big-endian, and a packet, both ways
in one file. What the vehicle tells often is thinned. When it is played, what the vehicle said follows at its times, but
waits for what the link had said before it: each of its commands, and each message of a transfer, with the same content.
While it waits, it repeats the last telemetry of each kind.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.common.link_course import at_home, fly, free_port
from benchmarks.common.mavlink_endpoint import mavlink

SESSION = Path(__file__).with_name("session.tlog")
FASTER = 2.0  # than it was recorded
_PATIENCE = 10.0  # for what the link is to say [s]
_AGAIN = 0.3  # between telemetry while it waits [s]
_STAMP = struct.Struct(">Q")
_OFTEN = {"LOCAL_POSITION_NED": 0.2, "GLOBAL_POSITION_INT": 0.5}  # of what is kept [s]; of other telemetry:
_ELSE = 1.0
_TELEMETRY = ("SYS_STATUS", "EXTENDED_SYS_STATE", "EKF_STATUS_REPORT", "HEARTBEAT", "MISSION_CURRENT")
_COMMANDS = (511, 176, 400, 300, 22)  # intervals, mode, arming, start, take-off: MAVSDK asks for more by itself
_ASKED_BY_MAVSDK = 512


class Event(NamedTuple):
    """A packet: when [s], whether the vehicle sent it, its bytes and what they mean."""

    at: float
    told: bool
    packet: bytes
    message: Any


class Recorder:
    """Gathers packets with the time at which they pass."""

    def __init__(self) -> None:
        self.rows: list[bytes] = []
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._kept: dict[str, tuple[float, Any]] = {}

    def __call__(self, packet: bytes) -> None:
        """Take one packet, of either side."""
        now = time.time()
        for message in self._parser.parse_buffer(bytearray(packet)) or []:
            if self._is_news(message, now):
                self.rows.append(_STAMP.pack(int(1e6 * now)) + bytes(message.get_msgbuf()))

    def _is_news(self, message: Any, now: float) -> bool:
        """Whether it is no telemetry, its content is new, or the last of its kind is old enough."""
        name, told = message.get_type(), message.get_srcComponent() == 1
        if not told or (name not in _OFTEN and name not in _TELEMETRY):
            return name != "BAD_DATA"
        before, content = self._kept.get(name, (0.0, None))
        fresh = name not in _OFTEN and content != message.to_dict()
        if now - before < _OFTEN.get(name, _ELSE) and not fresh:
            return False
        self._kept[name] = now, message.to_dict()
        return True


def write_session(file: Path) -> None:
    """Fly the mission of the link's tests, and write what was said."""
    recorder = Recorder()
    with tempfile.TemporaryDirectory() as folder, at_home(free_port(), tap=recorder) as vehicle:
        flight = fly(vehicle, Path(folder), arm=True)
    if flight.sentence:
        raise SystemExit(flight.sentence)
    file.write_bytes(b"".join(recorder.rows))


def read_session(file: Path) -> list[Event]:
    """What was said, in order; times from the first packet on."""
    content, parser, found = file.read_bytes(), mavlink.MAVLink(None), list[Event]()
    first, place = _STAMP.unpack_from(content)[0], 0
    while place < len(content):
        (at,) = _STAMP.unpack_from(content, place)
        place = begin = place + _STAMP.size
        message = None
        while message is None:
            message = parser.parse_char(content[place : place + 1])
            place += 1
        told = message.get_srcComponent() == 1
        found.append(Event(1e-6 * (at - first), told, content[begin:place], message))
    return found


def asked_of(events: list[Event]) -> list[tuple[Any, ...]]:
    """What the link said in a session, in order."""
    contents = [content_of(event.message) for event in events if not event.told]
    return [content for content in contents if content is not None]


def content_of(message: Any) -> tuple[Any, ...] | None:
    """What the link says by a message of a command or of a transfer; None: something else."""
    name, said = message.get_type(), message.to_dict()
    if name == "COMMAND_LONG" and message.command in _COMMANDS:
        return name, message.command, *(round(said[f"param{k}"], 3) for k in range(1, 8))
    if name == "MISSION_ITEM_INT":
        keys = ("seq", "frame", "command", "param1", "param2", "param3", "x", "y", "z")
        return name, *(round(said[key], 3) for key in keys)
    if name.startswith("MISSION_"):
        return name, *(said.get(key) for key in ("seq", "count", "type"))
    return None


class Replay:
    """The vehicle's side of a session; a context manager that plays it in a thread.

    Attributes:
        said: of the link, in order, each message once.
        wrong: what was waited for in vain.
    """

    def __init__(self, events: list[Event], port: int) -> None:
        self.events, self.port = events, port
        self.said: list[tuple[Any, ...]] = []
        self.wrong = ""
        self._stop = threading.Event()
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._answers = mavlink.MAVLink(self, srcSystem=1, srcComponent=1)

    def __enter__(self) -> Replay:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.002)
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5.0)
        self._socket.close()

    def write(self, packet: bytes) -> None:
        """One packet to the link."""
        with contextlib.suppress(OSError):
            self._socket.sendto(packet, ("127.0.0.1", self.port))

    def _play(self) -> None:
        late, began = 0.0, time.monotonic()  # what waiting has taken
        last = dict[str, bytes]()  # telemetry
        for event in self.events:
            due, content = event.at / FASTER, None if event.told else content_of(event.message)
            if content is not None:
                if not self._waits_for(content, last):
                    return
                late = max(late, time.monotonic() - began - due)
            elif event.told:
                while time.monotonic() - began < due + late and not self._stop.is_set():
                    self._listen()
                self.write(event.packet)
                if event.message.get_type() in (*_OFTEN, *_TELEMETRY):
                    last[event.message.get_type()] = event.packet
        while not self._stop.is_set():
            self._listen()

    def _waits_for(self, content: tuple[Any, ...], last: dict[str, bytes]) -> bool:
        """Whether the link says something in time."""
        end, again = time.monotonic() + _PATIENCE, 0.0
        while content not in self.said and not self._stop.is_set():
            self._listen()
            if time.monotonic() > end:
                self.wrong = f"expected {content}, given {self.said[-1:]}"
                return False
            if time.monotonic() > again:
                again = time.monotonic() + _AGAIN
                for packet in last.values():
                    self.write(packet)
        return True

    def _listen(self) -> None:
        try:
            data, _ = self._socket.recvfrom(4096)
        except (TimeoutError, OSError):
            return
        for message in self._parser.parse_buffer(data) or []:
            content = content_of(message)
            if content is not None and content not in self.said[-3:]:
                self.said.append(content)
            elif message.get_type() == "COMMAND_LONG" and message.command == _ASKED_BY_MAVSDK:
                self._answers.command_ack_send(message.command, 0)


if __name__ == "__main__":
    write_session(SESSION)
