"""A vehicle at the other end of a link: the last message of each kind, commands, set-points.

MAVSDK keeps the connection, sends heartbeats, repeats commands and transfers missions. Set-points are sent one by one:
its Offboard plugin would repeat the last one at 20 Hz by itself, even while whoever computes them hangs, and the
autopilot's own time-out would never come.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import functools
import json
from collections.abc import AsyncIterator, Callable
from time import monotonic
from typing import Any

import numpy as np

from maxjax.link.address import connection_of
from maxjax.link.errors import LinkError
from maxjax.link.flight_modes import MODES, Modes

ARM, SET_MODE, TAKE_OFF, START_MISSION, INTERVAL = 400, 176, 22, 300, 511
_WANTED = {  # and how often [s]
    "LOCAL_POSITION_NED": (32, 0.02), "GLOBAL_POSITION_INT": (33, 0.1), "EXTENDED_SYS_STATE": (245, 0.5),
    "SYS_STATUS": (1, 0.5), "EKF_STATUS_REPORT": (193, 0.5), "ESTIMATOR_STATUS": (230, 0.5),
    "MISSION_CURRENT": (42, 0.5), "HEARTBEAT": (0, 0.0), "STATUSTEXT": (253, 0.0),
}  # fmt: skip
_ACCEPTED = 0
_RESULTS = {1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 5: "in progress", 6: "cancelled"}
_ARMED, _CUSTOM, _AUTOPILOT, _LOCAL_NED = 128, 1, 1, 1
_ALL_BUT_YAW_RATE = 2048  # type_mask: what is ignored
_WARNING = 4  # MAV_SEVERITY
_TRIES = 3  # of a command, each of which MAVSDK repeats itself


def now() -> float:
    """Time by a clock that nobody sets [s]."""
    return monotonic()


@dataclasses.dataclass
class Heard:
    """The last message of a kind: its fields, and when it came [s]."""

    fields: dict[str, Any]
    at: float


class Vehicle:
    """A vehicle that is heard; `connect` makes one."""

    def __init__(self, system: Any, number: int) -> None:
        from mavsdk.plugins.mavlink_direct import MavlinkDirect
        from mavsdk.plugins.mission_raw import MissionRaw

        self.number = number
        self.missions = MissionRaw(system)
        self._direct = MavlinkDirect(system)
        self._heard: dict[str, Heard] = {}
        self._news = asyncio.Event()
        self._since = now()
        self.warning = ""
        loop = asyncio.get_running_loop()

        def hear(message: Any, _: Any) -> None:  # in a thread of MAVSDK
            if message.message_name in _WANTED and (message.system_id, message.component_id) == (number, _AUTOPILOT):
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    loop.call_soon_threadsafe(self._take, message.message_name, message.fields_json)

        self._direct.subscribe_message("", hear)

    def _take(self, name: str, text: str) -> None:
        try:
            fields = json.loads(text)
        except ValueError:
            return
        self._heard[name] = Heard(fields, now())
        if name == "STATUSTEXT" and fields.get("severity", 7) <= _WARNING:
            self.warning = str(fields.get("text", "")).rstrip("\0 ")
        self._news.set()

    def last(self, name: str) -> dict[str, Any]:
        """Fields of the last message of a kind; none where none has come."""
        return self._heard[name].fields if name in self._heard else {}

    def age(self, name: str) -> float:
        """How long ago the last message of a kind has come [s]."""
        return now() - (self._heard[name].at if name in self._heard else self._since)

    async def until(self, true: Callable[[], bool], seconds: float) -> bool:
        """Wait until something is true of what was heard, so long at most; whether it is."""
        end = now() + seconds
        while not true():
            left = end - now()
            if left <= 0.0:
                return False
            self._news.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), min(left, 0.2))
        return True

    @property
    def said(self) -> str:
        """Its last warning, as a clause of a sentence; nothing without any."""
        return f" (it says: {self.warning})" if self.warning else ""

    @property
    def modes(self) -> Modes:
        """Modes of its autopilot; raises a `LinkError` for one that is not known."""
        kind = self.last("HEARTBEAT").get("autopilot", -1)
        if kind not in MODES:
            known = " or ".join(modes.label for modes in MODES.values())
            raise LinkError(f"autopilot: expected {known}, given MAV_AUTOPILOT {kind}; fly it by an exported file")
        return MODES[kind]

    @property
    def mode(self) -> int:
        """Its flight mode, by number."""
        return int(self.last("HEARTBEAT").get("custom_mode", -1))

    @property
    def armed(self) -> bool:
        """Whether its motors are."""
        return bool(int(self.last("HEARTBEAT").get("base_mode", 0)) & _ARMED)

    async def command(self, number: int, *parameters: float) -> str:
        """Send a command until it is answered; what became of it if it was not accepted, else nothing."""
        from mavsdk.plugins.mavlink_direct import MavlinkDirectError, MavlinkMessage

        values = {f"param{k}": value for k, value in enumerate((*parameters, *(7 * [0.0]))[:7], 1)}
        fields = {"target_system": self.number, "target_component": _AUTOPILOT, "command": number, "confirmation": 0}
        message = MavlinkMessage("COMMAND_LONG", 0, 0, self.number, _AUTOPILOT, json.dumps(fields | values))
        for _ in range(_TRIES):
            try:
                answer = await asyncio.to_thread(self._direct.send_command, message)
            except MavlinkDirectError:
                continue
            result = int(json.loads(answer.fields_json).get("result", -1))
            return "" if result == _ACCEPTED else _RESULTS.get(result, f"answered by {result}")
        return "no answer"

    async def set_mode(self, number: int, seconds: float = 3.0) -> bool:
        """Change the mode and wait until a heartbeat says so; whether it does."""
        for _ in range(3):
            answer = await self.command(SET_MODE, float(_CUSTOM), *self.modes.parameters(number))
            if not answer and await self.until(lambda: self.mode == number, seconds):
                return True
        return False

    def send_setpoint(self, time: float, place: Any, yaw: float) -> None:
        """Send one set-point; nothing is repeated.

        Args:
            time: since the link began [s].
            place: (3, 3) position [m], velocity [m/s] and acceleration [m/s²], NED, from its local origin.
            yaw: from north to east [rad].
        """
        from mavsdk.plugins.mavlink_direct import MavlinkDirectError, MavlinkMessage

        names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz")
        if not np.isfinite(place).all() or not np.isfinite(yaw):
            raise ValueError(f"set-point: expected numbers, given {place}, {yaw}")
        fields = {
            "time_boot_ms": int(1e3 * max(time, 0.0)) % 2**32, "target_system": self.number,
            "target_component": _AUTOPILOT, "coordinate_frame": _LOCAL_NED, "type_mask": _ALL_BUT_YAW_RATE,
            **dict(zip(names, (float(value) for row in place for value in row), strict=True)),
            "yaw": float(yaw), "yaw_rate": 0.0,
        }  # fmt: skip
        message = MavlinkMessage(
            "SET_POSITION_TARGET_LOCAL_NED", 0, 0, self.number, _AUTOPILOT, json.dumps(fields, allow_nan=False)
        )
        with contextlib.suppress(MavlinkDirectError):  # as a packet that is lost; what follows from it is watched
            self._direct.send_message(message)


@contextlib.asynccontextmanager
async def connect(address: str, number: int, seconds: float) -> AsyncIterator[Vehicle]:
    """A link to the vehicle of a system number.

    Args:
        address: as `link.address` takes it.
        number: its MAVLink system.
        seconds: how long to wait for its heartbeat.

    Raises:
        LinkError: if it is not heard.
        ValueError: if the address is none.
        ImportError: without mavsdk.
    """
    url = connection_of(address)
    mavsdk = _load_mavsdk()
    ground_station = mavsdk.ComponentType.GROUND_STATION
    client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(ground_station))
    try:
        found = client.add_any_connection(url)
        if found != mavsdk.ConnectionResult.SUCCESS:
            raise LinkError(
                f"{address}: cannot be opened ({found.name.lower()}); another program may listen there", holds=False
            )
        system = await _heartbeat(client, address, number, seconds)
        vehicle = Vehicle(system, number)
        if not await vehicle.until(lambda: bool(vehicle.last("HEARTBEAT")), seconds):
            raise LinkError(f"{address}: expected heartbeats of system {number}, heard one and no more", holds=False)
        for message, every in _WANTED.values():
            if every:
                await vehicle.command(INTERVAL, float(message), 1e6 * every)
        yield vehicle
    finally:
        await asyncio.to_thread(client.destroy)


@functools.cache
def _load_mavsdk() -> Any:
    """MAVSDK, silent: its lines would stand among results. Told so once: it may be using what a second call replaces.

    Raises:
        ImportError: if it is missing; names the extra.
    """
    try:
        import mavsdk
        from mavsdk.logging import log_subscribe
    except ImportError as error:
        raise ImportError("--autopilot: needs mavsdk; pip install 'maxjax[mavlink]'") from error
    log_subscribe(lambda *_: True)
    return mavsdk


async def _heartbeat(client: Any, address: str, number: int, seconds: float) -> Any:
    end, others = now() + seconds, set[int]()
    while now() < end:
        for system in client.get_systems():
            if system.get_system_id() == number and system.has_autopilot():
                return system
            others.add(system.get_system_id())
        await asyncio.sleep(0.05)
    if others - {number}:
        listed = ", ".join(map(str, sorted(others - {number})))
        raise LinkError(
            f"{address}: expected a heartbeat of system {number}, heard system {listed}; give --system", holds=False
        )
    raise LinkError(
        f"{address}: expected a heartbeat within {seconds:g} s, heard none; start the vehicle, and let it send there",
        holds=False,
    )
