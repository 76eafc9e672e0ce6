"""Settings of the node; each is a ROS parameter of the same name, whose type is that of its default."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation


@dataclasses.dataclass(frozen=True)
class NodeSettings:
    """Settings of the node.

    Attributes:
        frame: of the map: z up, metres. Odometry, goals and all that is published are in it.
        sensor_frame: of clouds, where it is neither `frame` nor that of the vehicle.
        sensor: place of the sensor on the vehicle, x y z [m], and its roll, pitch and yaw [deg].
        center: middle of the map [m]; not finite: where the vehicle is at first.
        shape: of the map [voxels].
        spacing: of its voxels [m].
        ground: height below which all is ground [m]; not finite: nothing is.
        radius, margin: to keep [m].
        speed, acceleration: greatest ones of what is published [m/s], [m/s²].
        deadline: of an answer, from the arrival of its cloud on [s].
        oldest: greatest age of a cloud, and greatest time between poses around it [s].
        goal_height: of goals that have none, as RViz gives them (z = 0) [m]; not finite: goals are taken as they are.
        movers: whether to look for movers, and to publish motions that keep away from them.
        mover_speed, mover_acceleration: what they keep on each axis [m/s], [m/s²].
        mover_size: longest edge of the box around one [m].
        channels, columns: of the sensor that looks for movers.
        elevation_min, elevation_max: of its beams [deg].
        range: of the sensor [m].

    Raises:
        ValueError: for a setting that cannot be used.
    """

    frame: str = "map"
    sensor_frame: str = ""
    sensor: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    center: tuple[float, ...] = (math.nan, math.nan, math.nan)
    shape: tuple[int, ...] = (101, 101, 41)
    spacing: float = 1.0
    ground: float = math.nan
    radius: float = 1.0
    margin: float = 4.0
    speed: float = 5.0
    acceleration: float = 3.0
    deadline: float = 0.1
    oldest: float = 0.5
    goal_height: float = math.nan
    movers: bool = False
    mover_speed: float = 8.8
    mover_acceleration: float = 2.2
    mover_size: float = 1.0
    channels: int = 64
    columns: int = 512
    elevation_min: float = -45.0
    elevation_max: float = 45.0
    range: float = 100.0

    def __post_init__(self) -> None:
        for name, count in (("sensor", 6), ("center", 3), ("shape", 3)):
            given = getattr(self, name)
            if len(given) != count:
                raise ValueError(f"{name}: expected {count} numbers, given {given!r}")
        if not self.frame:
            raise ValueError(f"frame: expected the name of the map's frame, given {self.frame!r}")
        if not all(math.isfinite(x) for x in self.sensor):
            raise ValueError(f"sensor: expected finite numbers x y z [m] roll pitch yaw [deg], given {self.sensor}")
        for name in ("spacing", "radius", "speed", "acceleration", "deadline", "oldest"):
            given = getattr(self, name)
            if not 0.0 < given < math.inf:
                raise ValueError(f"{name}: expected a positive finite number, given {given!r}")

    @property
    def mount(self) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3 3"]]:
        """Place of the sensor in the frame of the vehicle [m], and the rotation from its frame to that."""
        return np.array(self.sensor[:3]), Rotation.from_euler("xyz", self.sensor[3:], degrees=True).as_matrix()
