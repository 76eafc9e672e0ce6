"""A city and a quadrotor behind the calls of Cosys-AirSim: msgpack-RPC over loopback, a LiDAR by C MuJoCo.

    v̇ = sat((v_c − v) / 0.3 s),  |v̇| ≤ 5 m/s²        v_c: as commanded, or towards a point ahead on the path; 50 Hz

Of maxjax it knows nothing: a city is a MuJoCo model. Time goes on by a tenth of a second with each scan that is taken,
so that a flight is the same on every machine; a take-off and a hover are over when they are answered. What is served is
NED from where the vehicle started, x forward, y right and z down on the vehicle; the sensor looks to its left.
"""

from __future__ import annotations

import contextlib
import math
import socket
import threading
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

msgpack = pytest.importorskip("msgpack", reason="needs msgpack (cosysairsim, extra dev)")

STEP, SCAN = 0.02, 0.1  # [s]
SLOWNESS, PUSH, GRAVITY = 0.3, 5.0, 9.81
TAKEOFF = 3.0  # height above the start [m]
YAW = math.radians(40.0)  # of the vehicle, from north to east
MOUNT, TURN = np.array([0.1, 0.0, -0.3]), Rotation.from_euler("z", -90.0, degrees=True)  # of the sensor, on the vehicle
CHANNELS, COLUMNS, RANGE = 24, 300, 80.0
ELEVATIONS = (-45.0, 45.0)  # [deg]
OWN = 0.4  # of the lowest beams, a tenth meets the vehicle's own arm so far away [m]
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # NED to ENU, and back


class AirSim:
    """The simulator; a context manager that serves one client in a thread.

    Args:
        city: static geoms.
        start: where the vehicle stands [m], ENU.
        scans: after so many it is gone, in the middle of a call.
    """

    def __init__(self, city: mujoco.MjModel, start: np.ndarray, scans: float = math.inf) -> None:
        self.city, self.start, self.scans = city, np.asarray(start, float), scans
        self.data = mujoco.MjData(city)
        mujoco.mj_kinematics(city, self.data)
        # NED from the start.
        self.position, self.velocity, self.acceleration = np.zeros(3), np.zeros(3), np.zeros(3)
        self.time = 0.0
        self.track: list[np.ndarray] = []
        self.names: list[str] = []
        self._command: Callable[[], np.ndarray] = lambda: np.zeros(3)
        self._calls: dict[str, Callable[..., Any]] = {
            "ping": lambda: True,
            "enableApiControl": lambda *_: None,
            "armDisarm": lambda *_: True,
            "takeoff": self._take_off,
            "hover": self._hover,
            "moveByVelocity": self._move_by_velocity,
            "moveOnPath": self._move_on_path,
            "getLidarData": self._scan,
            "getMultirotorState": self._state,
        }

    def __enter__(self) -> AirSim:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        threading.Thread(target=self._serve, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError, EOFError):
            link, _ = self._listener.accept()
            with link:
                unpacker = msgpack.Unpacker()
                while data := link.recv(1 << 16):
                    unpacker.feed(data)
                    for _, number, name, given in unpacker:
                        link.sendall(msgpack.packb([1, number, *self._answer(name, given)]))

    def _answer(self, name: str, given: list[Any]) -> tuple[str | None, Any]:
        """An error, or a result."""
        self.names.append(name)
        if name == "getLidarData":
            self.scans -= 1
            if self.scans < 0:
                raise EOFError
        if name not in self._calls:
            return f"{name}: no such call", None
        return None, self._calls[name](*given)

    # What it is told.

    def _take_off(self, *_: Any) -> bool:
        self._move_on_path([{"x_val": 0.0, "y_val": 0.0, "z_val": -TAKEOFF}], 2.0)
        self._go_on(3.0)
        return True

    def _hover(self, *_: Any) -> bool:
        self._command = lambda: np.zeros(3)
        self._go_on(2.0)
        return True

    def _move_by_velocity(self, x: float, y: float, z: float, duration: float, *_: Any) -> bool:
        until, wanted = self.time + duration, np.array([x, y, z])
        self._command = lambda: wanted if self.time < until else np.zeros(3)
        return True

    def _move_on_path(self, given: list[dict[str, float]], speed: float, *_: Any) -> bool:
        """Towards a point 0.6 s ahead on the path from here, slowly over its last two metres."""
        path = np.array([self.position, *([point["x_val"], point["y_val"], point["z_val"]] for point in given)])
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        flown = [0.0]

        def at(length: float) -> np.ndarray:
            return np.array([np.interp(length, along, column) for column in path.T])

        def command() -> np.ndarray:
            ahead = flown[0] + np.linspace(0.0, 2.0, 41)
            distances = np.linalg.norm(np.array([at(s) for s in ahead]) - self.position, axis=1)
            flown[0] = min(float(ahead[np.argmin(distances)]), float(along[-1]))
            pace = 1.0 if speed > 3.0 and along[-1] - flown[0] < 2.0 else speed
            way = at(flown[0] + max(0.6 * speed, 0.75)) - self.position
            distance = float(np.linalg.norm(way))
            return way * min(pace / max(distance, 1e-9), 1.0 / SLOWNESS)

        self._command = command
        return True

    # What it does.

    def _go_on(self, duration: float) -> None:
        for _ in range(round(duration / STEP)):
            push = (self._command() - self.velocity) / SLOWNESS
            self.acceleration = push * min(1.0, PUSH / max(float(np.linalg.norm(push)), 1e-9))
            self.velocity = self.velocity + STEP * self.acceleration
            self.position = self.position + STEP * self.velocity
            self.time += STEP
            self.track.append(self.start + SWAP @ self.position)

    @property
    def _attitude(self) -> Rotation:
        """Vehicle to NED: it leans as it accelerates."""
        down = np.array([0.0, 0.0, GRAVITY]) - self.acceleration
        down /= np.linalg.norm(down)
        right = np.cross(down, [math.cos(YAW), math.sin(YAW), 0.0])
        right /= np.linalg.norm(right)
        return Rotation.from_matrix(np.stack([np.cross(right, down), right, down], axis=1))

    # What it tells.

    def _state(self, *_: Any) -> dict[str, Any]:
        kinematics = {
            "position": _vector(self.position),
            "orientation": _quaternion(self._attitude),
            "linear_velocity": _vector(self.velocity),
        }
        return {"kinematics_estimated": kinematics, "timestamp": round(1e9 * self.time)}

    def _scan(self, *_: Any) -> dict[str, Any]:
        self._go_on(SCAN)
        rays = _directions()
        to_ned = self._attitude * TURN
        origin = self.start + SWAP @ (self.position + self._attitude.apply(MOUNT))
        distances, geoms = np.empty(len(rays)), np.empty(len(rays), np.int32)
        mujoco.mj_multiRay(
            *(self.city, self.data, origin, (to_ned.apply(rays) @ SWAP).ravel(), None, True, -1),
            *(geoms, distances, None, len(rays), RANGE),
        )
        distances[: COLUMNS // 10] = OWN
        points = np.where(distances[:, None] >= 0.0, distances[:, None] * rays, 0.0)
        mount = {"position": _vector(MOUNT), "orientation": _quaternion(TURN)}
        return {"point_cloud": points.ravel().tolist(), "time_stamp": round(1e9 * self.time), "pose": mount}


def _directions() -> np.ndarray:
    """Of all beams, on the sensor: x forward, y right, z down."""
    up, round_ = np.deg2rad(np.linspace(*ELEVATIONS, CHANNELS))[:, None], np.linspace(0.0, 2 * np.pi, COLUMNS, False)
    x, y = np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_)
    return np.stack([x, y, np.broadcast_to(-np.sin(up), x.shape)], axis=-1).reshape(-1, 3)


def _vector(given: np.ndarray) -> dict[str, float]:
    return dict(zip(("x_val", "y_val", "z_val"), given.tolist(), strict=True))


def _quaternion(given: Rotation) -> dict[str, float]:
    return dict(zip(("x_val", "y_val", "z_val", "w_val"), given.as_quat().tolist(), strict=True))
