"""The vehicle's own north, east and down, and the map.

    p_ned = o + N E D of (p − foot)       foot: where it stands before it is armed, on the ground of the map
                                          o: what its LOCAL_POSITION_NED says there

Its local origin is where its estimator began, not home; heights count from the ground below it, since a receiver's
height is off by metres. North is true north.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Float64

from maxjax.io.export.setpoints import LocalOrigin
from maxjax.trajectories.trajectory import Motion

Point = Float64[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True, eq=False)
class LocalFrame:
    """The frame of LOCAL_POSITION_NED.

    Attributes:
        origin: the foot, and where the map lies.
        offset: north, east and down of the foot in the vehicle's frame [m].
    """

    origin: LocalOrigin
    offset: Point

    def states(self, motion: Motion) -> tuple[Float64[np.ndarray, "t 3 3"], Float64[np.ndarray, " t"]]:
        """Position, velocity and acceleration (NED) and yaw (from north to east, within ±π) of a motion in the map."""
        vectors, yaw = self.origin.turned(motion)
        ned = np.stack([values[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for values in vectors], axis=1)
        ned[:, 0] += self.offset
        turned = 0.5 * np.pi - yaw
        return ned, np.arctan2(np.sin(turned), np.cos(turned))

    def in_map(self, position: Point) -> Point:
        """A point of the map [m], by the vehicle's north, east and down [m]."""
        north, east, down = (position - self.offset).tolist()
        aside, foot = np.array([east, north, -down]), np.array(self.origin.point)
        point = foot + self._inverse @ aside
        for _ in range(2):  # what of it is not linear: 2 m at 5 km
            point = point + self._inverse @ (aside - self.origin.enu(point[None])[0])
        return np.asarray(point, np.float64)

    @functools.cached_property
    def _inverse(self) -> Float64[np.ndarray, "3 3"]:
        foot = np.array(self.origin.point)
        axes = 0.5 * (self.origin.enu(foot + np.eye(3)) - self.origin.enu(foot - np.eye(3)))
        return np.asarray(np.linalg.inv(axes.T), np.float64)
