"""Messages of ROS 2 as arrays and back: clouds, poses, paths, trajectories. Nothing here imports ROS.

A message is what has the fields of its definition (sensor_msgs, nav_msgs, geometry_msgs, trajectory_msgs): those of
rclpy, and those that are read from a bag. Frames are checked by `ros.inputs`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

# sensor_msgs/PointField: types by number.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
# Of a quaternion, from length 1.
_UNIT = 1e-2
# Nanoseconds in a second.
_NANO = 1_000_000_000


def seconds_of(stamp: Any) -> float:
    """A time of a header [s]."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def set_stamp(stamp: Any, seconds: float) -> None:
    """Set a time of a message [s]; not before zero."""
    whole = max(round(seconds * _NANO), 0)
    stamp.sec, stamp.nanosec = whole // _NANO, whole % _NANO


def points_of_cloud(cloud: Any) -> Float64[np.ndarray, "n 3"]:
    """Points of a sensor_msgs/PointCloud2 [m], in its frame; those that are not finite stay so.

    Raises:
        ValueError: if it has no x, y and z of a number's type, or fewer bytes than its size says.
    """
    fields = {field.name: field for field in cloud.fields}
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise ValueError(
            f"cloud: expected fields x, y and z, given {', '.join(fields) or 'none'}; {missing[0]} is missing"
        )
    order = ">" if cloud.is_bigendian else "<"
    for name in "xyz":
        if fields[name].datatype not in (7, 8):
            raise ValueError(f"cloud: expected {name} as FLOAT32 or FLOAT64, given type {fields[name].datatype}")
    kinds = [order + _TYPES[fields[name].datatype] for name in "xyz"]
    layout = np.dtype({
        "names": list("xyz"), "formats": kinds, "offsets": [fields[name].offset for name in "xyz"],
        "itemsize": cloud.point_step,
    })  # fmt: skip
    data = np.frombuffer(bytes(cloud.data), np.uint8)
    needed = 0 if not cloud.height else (cloud.height - 1) * cloud.row_step + cloud.width * cloud.point_step
    if len(data) < needed:
        raise ValueError(f"cloud: expected {needed} bytes for {cloud.height} x {cloud.width} points, given {len(data)}")
    rows = [
        np.frombuffer(data, layout, count=cloud.width, offset=row * cloud.row_step) for row in range(cloud.height)
    ] or [np.zeros(0, layout)]
    every = np.concatenate(rows)
    return np.stack([every[name].astype(np.float64) for name in "xyz"], axis=-1)


def pose_of(pose: Any) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3 3"]]:
    """Position [m] and rotation (own frame -> header's) of a geometry_msgs/Pose.

    Raises:
        ValueError: for numbers that are not finite, or a quaternion that is no rotation.
    """
    at, turn = pose.position, pose.orientation
    position = np.array([at.x, at.y, at.z], np.float64)
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], np.float64)
    if not np.isfinite(position).all():
        raise ValueError(f"pose: expected a finite position, given {position.tolist()}")
    if not abs(np.linalg.norm(quaternion) - 1.0) <= _UNIT:
        raise ValueError(f"pose: expected a quaternion of length 1 (x y z w), given {quaternion.tolist()}")
    return position, Rotation.from_quat(quaternion).as_matrix()


def fill_path(path: Any, points: Float64[np.ndarray, "n 3"], new_pose: Any) -> None:
    """Fill a nav_msgs/Path: poses along points [m], each turned to the next one.

    Args:
        path: whose header is set.
        points: none: no path.
        new_pose: makes a geometry_msgs/PoseStamped.
    """
    headings = yaws_along(points)
    path.poses = []
    for point, yaw in zip(points, headings, strict=True):
        pose = new_pose()
        pose.header = path.header
        place, turn = pose.pose.position, pose.pose.orientation
        place.x, place.y, place.z = map(float, point)
        turn.z, turn.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        path.poses.append(pose)


def fill_point(point: Any, state: Sequence[Float64[np.ndarray, "3"]], yaw: float, seconds: float) -> None:
    """Fill a trajectory_msgs/MultiDOFJointTrajectoryPoint that has one transform, velocity and acceleration.

    Args:
        point: to fill.
        state: position [m], velocity [m/s] and acceleration [m/s²].
        yaw: [rad].
        seconds: from the start of the trajectory [s].
    """
    position, velocity, acceleration = state
    transform = point.transforms[0]
    for target, value in (
        (transform.translation, position),
        (point.velocities[0].linear, velocity),
        (point.accelerations[0].linear, acceleration),
    ):
        target.x, target.y, target.z = map(float, value)
    transform.rotation.z, transform.rotation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    set_stamp(point.time_from_start, seconds)


def yaws_along(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
    """Headings along points [rad]: of the way to the next one that lies aside; upright ways keep the one before."""
    ways = np.diff(points, axis=0)[:, :2]
    aside = np.linalg.norm(ways, axis=1) > 1e-3
    if not aside.any():
        return np.zeros(len(points))
    every = np.arctan2(ways[:, 1], ways[:, 0])
    source = np.maximum.accumulate(np.where(aside, np.arange(len(ways)), -1))
    source = np.where(source < 0, np.argmax(aside), source)
    yaws: np.ndarray = every[source]
    return np.append(yaws, yaws[-1])
