"""What the node is told, checked: where the vehicle was when, and clouds at the time of their stamps.

    position(t) = (1 − u) p₀ + u p₁,   rotation(t) = R₀ exp(u log(R₀ᵀ R₁)),   u = (t − t₀) / (t₁ − t₀)

between the two poses around t, if these are not further apart than poses may be. Stamps of clouds are the ends of their
scans. What cannot be used raises a ValueError that says what was expected and given; nothing is changed by it.
"""

from __future__ import annotations

import bisect
import dataclasses
from collections import deque
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation, Slerp

from maxjax.ros.messages import points_of_cloud, pose_of, seconds_of
from maxjax.ros.settings import NodeSettings

# Poses that are kept.
_POSES = 400
# How far a stamp may be ahead of the clock [s].
_AHEAD = 0.1


@dataclasses.dataclass(frozen=True, eq=False)
class VehicleState:
    """Where the vehicle is at a time [s]: position [m] and rotation (its frame → the map's), velocity [m/s]."""

    time: float
    position: Float64[np.ndarray, "3"]
    rotation: Float64[np.ndarray, "3 3"]
    velocity: Float64[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Cloud:
    """A cloud at the time of its stamp [s]: points in the frame that it came in [m], and that frame's name."""

    time: float
    points: Float64[np.ndarray, "n 3"]
    frame: str


class Inputs:
    """The last poses of the vehicle, and the frames of what arrives."""

    def __init__(self, settings: NodeSettings) -> None:
        self.settings = settings
        self.body = ""
        self._states: deque[VehicleState] = deque(maxlen=_POSES)
        self._last_cloud = -np.inf

    @property
    def latest(self) -> VehicleState | None:
        """Where the vehicle was last; None: nobody said."""
        return self._states[-1] if self._states else None

    def add_odometry(self, odometry: Any) -> None:
        """Take a nav_msgs/Odometry, whose velocity is in the frame of the vehicle.

        Raises:
            ValueError: for another frame, a stamp that is not later than the last one, or numbers that are no pose.
        """
        expected, given = self.settings.frame, odometry.header.frame_id
        if given != expected:
            raise ValueError(f"odometry: expected in frame '{expected}', given '{given}'; set the parameter frame")
        time = seconds_of(odometry.header.stamp)
        if self._states and time <= self._states[-1].time:
            raise ValueError(
                f"odometry: expected a stamp later than {self._states[-1].time:.3f} s, given {time:.3f} s; after a "
                "clock was set back the node is to be cleaned up and configured anew"
            )
        position, rotation = pose_of(odometry.pose.pose)
        linear = odometry.twist.twist.linear
        velocity = rotation @ np.array([linear.x, linear.y, linear.z])
        if not np.isfinite(velocity).all():
            raise ValueError(f"odometry: expected a finite velocity, given {velocity.tolist()}")
        self.body = odometry.child_frame_id
        self._states.append(VehicleState(time, position, rotation, velocity))

    def read_cloud(self, cloud: Any, now: float) -> Cloud:
        """Take a sensor_msgs/PointCloud2 at a time of the node's clock [s].

        Raises:
            ValueError: for an unknown frame, a stamp that is none, runs back, or is too old or ahead, or no points.
        """
        time, frame, own = seconds_of(cloud.header.stamp), cloud.header.frame_id, self.settings
        if frame not in {own.frame, own.sensor_frame or own.frame, self.body or own.frame}:
            known = ", ".join(f"'{name}'" for name in (own.frame, self.body, own.sensor_frame) if name)
            raise ValueError(f"cloud: expected in frame {known}, given '{frame}'; set sensor_frame and sensor")
        if time <= self._last_cloud:
            raise ValueError(f"cloud: expected a stamp later than {self._last_cloud:.3f} s, given {time:.3f} s")
        if not -_AHEAD <= now - time <= own.oldest:
            raise ValueError(
                f"cloud: expected a stamp up to {own.oldest:g} s old, given one {now - time:.3f} s old; check that the "
                "clocks agree (use_sim_time)"
            )
        points = points_of_cloud(cloud)
        self._last_cloud = time
        return Cloud(time, points, frame)

    def state_at(self, time: float) -> VehicleState | None:
        """Where the vehicle was at a time [s]; None: no pose is known from then on yet.

        Raises:
            ValueError: if poses around that time are missing.
        """
        states = list(self._states)
        after = bisect.bisect_left([state.time for state in states], time)
        if after == len(states):
            return None
        second = states[after]
        if second.time == time:
            return second
        if after == 0 or second.time - states[after - 1].time > self.settings.oldest:
            raise ValueError(
                f"odometry: expected poses around {time:.3f} s at most {self.settings.oldest:g} s apart, given none"
            )
        first = states[after - 1]
        share = (time - first.time) / (second.time - first.time)
        turn = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([first.rotation, second.rotation])))(share)
        return VehicleState(
            time,
            (1.0 - share) * first.position + share * second.position,
            turn.as_matrix(),
            (1.0 - share) * first.velocity + share * second.velocity,
        )

    def sensor_pose(
        self, cloud: Cloud, state: VehicleState
    ) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3 3"]]:
        """Position [m] and rotation of the sensor in the map's frame; those of the vehicle for clouds in its frame."""
        if cloud.frame == self.body and cloud.frame != self.settings.sensor_frame:
            return state.position, state.rotation
        place, turn = self.settings.mount
        return np.asarray(state.position + state.rotation @ place), np.asarray(state.rotation @ turn)

    def world_points(self, cloud: Cloud, state: VehicleState) -> Float64[np.ndarray, "n 3"]:
        """Points in the map's frame [m], without those that are not finite."""
        points: np.ndarray = cloud.points[np.isfinite(cloud.points).all(axis=1)]
        if cloud.frame == self.settings.frame:
            return points
        position, rotation = self.sensor_pose(cloud, state)
        moved: np.ndarray = points @ rotation.T + position
        return moved

    def sensor_points(self, cloud: Cloud, state: VehicleState) -> Float64[np.ndarray, "n 3"]:
        """Points in the frame of the sensor [m]; those that are not finite stay so."""
        if cloud.frame != self.settings.frame:
            return cloud.points
        position, rotation = self.sensor_pose(cloud, state)
        moved: np.ndarray = (cloud.points - position) @ rotation
        return moved


def goal_of(goal: Any, settings: NodeSettings) -> Float64[np.ndarray, "3"]:
    """Position of a geometry_msgs/PoseStamped [m].

    Raises:
        ValueError: for another frame than the map's, or numbers that are no pose.
    """
    if goal.header.frame_id != settings.frame:
        raise ValueError(f"goal: expected in frame '{settings.frame}', given '{goal.header.frame_id}'")
    position, _ = pose_of(goal.pose)
    if position[2] == 0.0 and np.isfinite(settings.goal_height):
        position[2] = settings.goal_height
    return position
