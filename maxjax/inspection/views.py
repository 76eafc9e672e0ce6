"""Photos that can be taken: a place, a heading and the elevation of the line of sight.

    forward = (cos p cos y, cos p sin y, sin p)      right = (sin y, −cos y, 0)      up = right × forward

Yaw y counts from east to north, as everywhere in the house, pitch p from the horizon upwards [rad]. A gimbal keeps the
width of the photo level, so that yaw and pitch say all. A camera that looks straight down has the top of its photos
towards its heading.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64

_STEEP = 1e-6  # of a direction's horizontal share, below which it has no heading


@dataclasses.dataclass(frozen=True, eq=False)
class Views:
    """Places and directions of some photos.

    Attributes:
        position: (n, 3) of the camera [m], ENU.
        yaw: (n,) heading of the line of sight [rad], from east to north.
        pitch: (n,) its elevation [rad], −π/2 straight down.
    """

    position: Float64[np.ndarray, "n 3"]
    yaw: Float64[np.ndarray, " n"]
    pitch: Float64[np.ndarray, " n"]

    @classmethod
    def towards(cls, position: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]) -> Views:
        """Views along some directions; one that is upright heads north."""
        across = np.hypot(direction[:, 0], direction[:, 1])
        steep = across <= _STEEP * np.abs(direction[:, 2])
        yaw = np.where(steep, 0.5 * math.pi, np.arctan2(direction[:, 1], direction[:, 0]))
        return cls(position, yaw, np.arctan2(direction[:, 2], np.where(steep, 0.0, across)))

    def __len__(self) -> int:
        return len(self.position)

    @property
    def axes(self) -> Float64[np.ndarray, "n 3 3"]:
        """Right, up and forward of each, as rows."""
        (cy, sy), (cp, sp) = ((np.cos(angle), np.sin(angle)) for angle in (self.yaw, self.pitch))
        right = np.stack([sy, -cy, np.zeros_like(sy)], axis=1)
        forward = np.stack([cp * cy, cp * sy, sp], axis=1)
        return np.stack([right, np.cross(right, forward), forward], axis=1)

    def some(self, rows: np.ndarray) -> Views:
        """Some of them, by their numbers or a mask."""
        return Views(self.position[rows], self.yaw[rows], self.pitch[rows])

    def joined(self, others: Views) -> Views:
        """These and others."""
        pairs = ((getattr(self, name), getattr(others, name)) for name in ("position", "yaw", "pitch"))
        return Views(*(np.concatenate(pair) for pair in pairs))
