"""A vehicle behind a MAVLink endpoint: a point mass in wind, with the messages and rules of ArduCopter or of PX4.

    ẍ = sat(a) − c (ẋ − w)|ẋ − w|,   |a| ≤ `thrust` in the plane          NED, semi-implicit Euler at 50 Hz

It knows nothing of maxjax. It sends to the address that the link listens at, over loopback; what it sends and receives
may be late, lost or doubled, and `faults` make it misbehave when they are asked to.
"""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.common.lossy_socket import LossySocket

Vector = Float64[np.ndarray, "3"]

STEP = 0.02
METRE = 1.0 / 111319.49  # of a degree of latitude
MODES = {
    "arducopter": {"STABILIZE": 0, "AUTO": 3, "GUIDED": 4, "LOITER": 5, "RTL": 6, "LAND": 9, "BRAKE": 17},
    "px4": {"POSCTL": 3 << 16, "LOITER": 3 << 24 | 4 << 16, "AUTO": 4 << 24 | 4 << 16, "RTL": 5 << 24 | 4 << 16,
            "LAND": 6 << 24 | 4 << 16, "GUIDED": 6 << 16},
}  # fmt: skip
HEALTHY = 0x10000000 | 0x2F
EKF_READY = 1 | 2 | 4 | 8 | 16 | 32


def _from(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


@dataclasses.dataclass
class Faults:
    """What goes wrong; all of it may be changed while it flies."""

    loss: float = 0.0  # share of packets lost, each way, and as many doubled
    delay: float = 0.0  # of each packet, each way [s]
    ekf: int = EKF_READY
    healthy: bool = True
    local: bool = True  # whether LOCAL_POSITION_NED is sent
    refused: int | None = None  # number of a mission item that is refused
    altered: int | None = None  # number of a mission item that is stored otherwise
    silent: bool = False  # nothing is sent
    clock: float = 0.0  # added to the time since boot [s]
    deny_arming: str = ""


@dataclasses.dataclass
class Endpoint:
    """The vehicle; a context manager that runs it in a thread."""

    port: int
    latitude: float
    longitude: float
    altitude: float = 10.0
    autopilot: str = "arducopter"
    system: int = 1
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    thrust: float = 5.0
    drag: float = 0.05
    origin: tuple[float, float] = (3.0, -2.0)  # of LOCAL_POSITION_NED, north and east of where it stands [m]
    faults: Faults = dataclasses.field(default_factory=Faults)
    armed: bool = False
    mode: str = "STABILIZE"
    start_height: float = 0.0
    events: list[tuple[float, Callable[[Endpoint], None]]] = dataclasses.field(default_factory=list)
    tap: Callable[[bytes], object] = lambda _: None  # told of each packet, whichever way it goes

    def __post_init__(self) -> None:
        self.mode = "POSCTL" if self.autopilot == "px4" and self.mode == "STABILIZE" else self.mode
        self.position = np.array([-self.origin[0], -self.origin[1], -self.start_height])
        self.velocity = np.zeros(3)
        self.target: tuple[Vector, Vector, Vector] | None = None
        self.heard = -math.inf  # the last set-point
        self.timed_out = 0
        self.items: list[Any] = []
        self.incoming: tuple[int, list[Any]] = (0, [])
        self.current = 0
        self.held = 0.0
        self.arm_requests = 0
        self._partner: Sequence[int] = (245, 190)
        self._kind, self._asked = 0, 0.0
        self.stopped = self.position.copy()
        self.set_points: list[tuple[float, Vector]] = []
        self.track: list[tuple[float, Vector]] = []
        self.takeoff = 0.0
        self.flown_since: float | None = None
        self._stop = threading.Event()

    def __enter__(self) -> Endpoint:
        self._socket = LossySocket(self.port, self.faults.loss, self.faults.delay)
        self._link = mavlink.MAVLink(self, srcSystem=self.system, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._began = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5.0)
        self._socket.close()

    # What it sends.

    def write(self, packet: bytes) -> None:
        """One packet to the link; called by pymavlink."""
        self.tap(packet)
        if not self.faults.silent:
            self._socket.send(packet)

    @property
    def _boot(self) -> int:
        return int(1000 * (time.monotonic() - self._began + 100.0 + self.faults.clock)) % 2**32

    def _say(self, tick: int) -> None:
        faults, (n, e, d), (vn, ve, vd) = self.faults, self.position.tolist(), self.velocity.tolist()
        custom = MODES[self.autopilot][self.mode]
        kind = 12 if self.autopilot == "px4" else 3
        if tick % 10 == 0:
            base = 1 | (128 if self.armed else 0)
            self._link.heartbeat_send(2, kind, base, custom, 4 if self.armed else 3)
            health = HEALTHY if faults.healthy else HEALTHY & ~0x10000000
            self._link.sys_status_send(HEALTHY, HEALTHY, health, 100, 12000, 100, 80, 0, 0, 0, 0, 0, 0)
            landed = 1 if d > -0.1 and not self.velocity.any() else 2
            self._link.extended_sys_state_send(0, landed)
            if self.autopilot == "px4":
                self._link.estimator_status_send(1000 * self._boot, faults.ekf, 0, 0, 0, 0, 0, 0, 0, 0)
            else:
                self._link.ekf_status_report_send(faults.ekf, 0.1, 0.1, 0.1, 0.1, 0.0)
            self._link.mission_current_send(self.current)
        if tick % 3 == 0:
            north, east = n + self.origin[0], e + self.origin[1]
            scale = math.cos(math.radians(self.latitude))
            place = int(1e7 * (self.latitude + METRE * north)), int(1e7 * (self.longitude + METRE * east / scale))
            velocity = (int(100 * v) for v in (vn, ve, vd))
            heights = int(1000 * (self.altitude - d)), int(-1000 * d)
            self._link.global_position_int_send(self._boot, *place, *heights, *velocity, 0)
        if faults.local:
            self._link.local_position_ned_send(self._boot, n, e, d, vn, ve, vd)

    def say(self, text: str, severity: int = 2) -> None:
        """A STATUSTEXT."""
        self._link.statustext_send(severity, text.encode())

    # What it does.

    def _run(self) -> None:
        tick = 0
        while not self._stop.is_set():
            self._receive()
            now = time.monotonic() - self._began
            self._ask_again(now)
            while tick * STEP < now:
                self._move(tick * STEP)
                self._say(tick)
                tick += 1
                due = [event for event in self.events if self.flown_since is not None
                       and tick * STEP - self.flown_since >= event[0]]  # fmt: skip
                for event in due:
                    self.events.remove(event)
                    event[1](self)

    def _move(self, now: float) -> None:
        place, speed, push = self.position, self.velocity, np.zeros(3)
        if self.armed and self.mode == "GUIDED" and self.target is not None:
            place, speed, push = self.target
            if now - self.heard > (3.0 if self.autopilot == "arducopter" else 1.0):
                self.timed_out += 1
                self.set_mode("LOITER" if self.autopilot == "px4" else "BRAKE")
        elif self.armed and self.mode == "AUTO" and self.items:
            place, speed = self._auto()
        elif self.armed and self.mode == "GUIDED" and self.takeoff:
            place = np.array([*self.stopped[:2], max(-self.takeoff, self.position[2] - 1.5)])
        elif self.armed and self.mode in ("LAND", "RTL"):
            place = self.position + np.array([0.0, 0.0, 1.0])
        elif self.armed:
            place = self.stopped
        else:
            self.velocity[:] = 0.0
            return
        wanted = push + 2.5 * (speed - self.velocity) + 2.0 * (place - self.position)
        size = float(np.linalg.norm(wanted[:2]))
        wanted[:2] *= min(1.0, self.thrust / max(size, 1e-9))
        wanted[2] = min(max(wanted[2], -4.0), 4.0)
        air = self.velocity - np.array(self.wind)
        drag = -self.drag * air * np.linalg.norm(air) if self.position[2] < -0.2 else np.zeros(3)
        if self.mode != "AUTO" and self.autopilot:  # an integrator finds the steady wind
            wanted[:2] = self._with_wind(wanted[:2], drag[:2])
        self.velocity = self.velocity + STEP * (wanted + drag)
        self.position = self.position + STEP * self.velocity
        if self.position[2] > 0.0:
            self.position[2], self.velocity = 0.0, np.zeros(3)
            if self.mode in ("LAND", "RTL") or (self.mode == "AUTO" and self.current >= len(self.items)):
                self.armed = False
        if round(now / STEP) % 3 == 0:
            self.track.append((now, self.position.copy()))

    def _with_wind(self, wanted: Float64[np.ndarray, "2"], drag: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "2"]:
        """Thrust against the drag as well, as far as there is any."""
        whole = wanted - drag
        return np.asarray(whole * min(1.0, self.thrust / max(float(np.linalg.norm(whole)), 1e-9)))

    def _auto(self) -> tuple[Vector, Vector]:
        """Where the current item leads, at 5 m/s."""
        while self.current < len(self.items) and self.items[self.current].command not in (16, 21, 22):
            self.current += 1
        if self.current >= len(self.items):
            return self.position, np.zeros(3)
        item = self.items[self.current]
        scale = math.cos(math.radians(self.latitude))
        place = np.array([
            (1e-7 * item.x - self.latitude) / METRE - self.origin[0],
            (1e-7 * item.y - self.longitude) * scale / METRE - self.origin[1],
            -item.z,
        ])  # fmt: skip
        if item.command == 22:
            place[:2] = self.position[:2]
        way = place - self.position
        distance = float(np.linalg.norm(way))
        if distance < (0.3 if item.command == 22 else 1.0) and item.command != 21:
            self._link.mission_item_reached_send(self.current)
            self.current += 1
        if item.command == 21 and self.position[2] > -0.1:
            self.current += 1
            self.armed, self.velocity = False, np.zeros(3)
        speed = way / max(distance, 1e-9) * min(5.0, distance)
        return self.position + 0.4 * speed, speed

    def set_mode(self, name: str) -> None:
        """Change the mode, as an operator or a failsafe does."""
        self.mode, self.target, self.stopped, self.takeoff = name, None, self.position.copy(), 0.0
        if name == "AUTO":
            self.current = 0 if self.autopilot == "px4" else 1

    # What it hears.

    def _receive(self) -> None:
        for data in self._socket.receive():
            self.tap(data)
            for message in self._parser.parse_buffer(data) or []:
                handler = getattr(self, "_on_" + message.get_type().lower(), None)
                if handler is not None and getattr(message, "target_system", self.system) in (0, self.system):
                    handler(message)

    def _on_command_long(self, message: Any) -> None:
        parameters = [getattr(message, f"param{k}") for k in range(1, 8)]
        self._link.command_ack_send(message.command, self._obey(message.command, parameters))

    def _on_command_int(self, message: Any) -> None:
        parameters = [message.param1, message.param2, message.param3, message.param4, message.x, message.y, message.z]
        self._link.command_ack_send(message.command, self._obey(message.command, parameters))

    def _obey(self, command: int, given: list[float]) -> int:
        if command == 400:
            return self._arm(given[0] > 0.5)
        if command == 176:
            custom = int(given[1]) if self.autopilot == "arducopter" else int(given[2]) << 24 | int(given[1]) << 16
            if self.autopilot == "px4":
                custom = int(given[1]) << 16 | int(given[2]) << 24
            name = next((name for name, number in MODES[self.autopilot].items() if number == custom), None)
            if name is None or (name == "GUIDED" and self.autopilot == "px4" and self.heard < 0.0):
                return 2
            if name != self.mode:
                self.set_mode(name)
            return 0
        if command == 22 and self.armed and self.mode == "GUIDED":
            self.takeoff, self.flown_since = given[6], self.flown_since or time.monotonic() - self._began
            return 0
        if command == 300 and self.armed and self.items:
            self.set_mode("AUTO")
            return 0
        return 0 if command in (511, 512, 300) else 3

    def _arm(self, yes: bool) -> int:
        if yes:
            self.arm_requests += 1
            if self.faults.deny_arming:
                self.say(self.faults.deny_arming)
                return 4
            self.flown_since = self.flown_since or time.monotonic() - self._began
            self.stopped = self.position.copy()
        self.armed = yes
        return 0

    def _on_set_position_target_local_ned(self, message: Any) -> None:
        now = time.monotonic() - self._began
        self.heard = now
        place = np.array([message.x, message.y, message.z])
        self.set_points.append((now, place))
        if self.mode == "GUIDED" and self.armed and (self.autopilot == "px4" or self.position[2] < -0.5):
            velocity = np.array([message.vx, message.vy, message.vz])
            self.target = place, velocity, np.array([message.afx, message.afy, message.afz])

    def _ask_again(self, now: float) -> None:
        """The item that is missing, every quarter of a second: packets may be lost."""
        count, items = self.incoming
        if len(items) < count and now > self._asked + 0.25:
            self._asked = now
            self._link.mission_request_int_send(*self._partner, len(items), self._kind)

    def _on_mission_count(self, message: Any) -> None:
        self._partner, self._kind, self._asked = _from(message), message.mission_type, time.monotonic() - self._began
        if message.count == 0:
            self._link.mission_ack_send(*_from(message), 0, message.mission_type)
            return
        self.incoming = (message.count, [])
        self._link.mission_request_int_send(*_from(message), 0, message.mission_type)

    def _on_mission_item_int(self, message: Any) -> None:
        count, items = self.incoming
        if message.seq == len(items) and len(items) < count:
            if message.mission_type == 0 and message.seq == self.faults.refused:
                self._link.mission_ack_send(*_from(message), 3, 0)  # MAV_MISSION_UNSUPPORTED
                self.incoming = (0, [])
                return
            if message.mission_type == 0 and message.seq == self.faults.altered:
                message.z += 5.0
            items.append(message)
        if len(items) < count:
            self._asked = time.monotonic() - self._began
            self._link.mission_request_int_send(*_from(message), len(items), message.mission_type)
            return
        if message.mission_type == 0:
            self.items = list(items)
        self._link.mission_ack_send(*_from(message), 0, message.mission_type)

    def _on_mission_request_list(self, message: Any) -> None:
        self._link.mission_count_send(*_from(message), len(self.items) if message.mission_type == 0 else 0,
                                      message.mission_type)  # fmt: skip

    def _on_mission_request_int(self, message: Any) -> None:
        if message.seq < len(self.items):
            item = self.items[message.seq]
            kept = [item.param1, item.param2, item.param3, item.param4]
            if self.autopilot == "arducopter" and item.command == 16:
                kept = [float(int(item.param1)), 0.0, 0.0, 0.0]
            place = item.x, item.y, item.z
            if self.autopilot == "arducopter" and message.seq == 0:
                place = int(1e7 * self.latitude), int(1e7 * self.longitude), self.altitude
            self._link.mission_item_int_send(
                *_from(message), message.seq, item.frame, item.command, 0, 1, *kept, *place, 0
            )
