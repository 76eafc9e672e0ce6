"""The ROS 2 node over DDS: from the publication of a cloud to the arrival of its path, ten clouds a second.

    python -m benchmarks.ros_node            # two cores: two minutes, with compiling

The node is a process of its own (`maxjax ros`), as users run it. A client flies along what it hears through a downtown
that the node does not know, and publishes odometry and clouds of a simulated LiDAR of 32,768 rays. Measuring a cloud is
not counted; DDS, waiting for the odometry, planning and verifying are. A cloud without an answer within a second is
lost.

Expected: an answer to each cloud, most of them before the next one.
"""

from __future__ import annotations

import dataclasses
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, save
from maxjax.core.grid import Index3, Point3
from maxjax.sim.sensors.level_scan import measure
from maxjax.sim.worlds.scenes import Scene, make_scene

_LOST = 1.0  # [s]
_READY = 400.0  # programs are compiled by then [s]
_ARRIVED = 2.0  # [m]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        city: seed of the simulated downtown.
        start, goal: [m].
        center: middle of the map [m].
        shape: of the map [voxels].
        spacing: of its voxels [m].
        speed: of the vehicle along its path [m/s].
        period: between clouds [s].
        cycles: clouds at most.
        out: where the JSON goes.
    """

    city: int = 0
    start: Point3 = (-68.0, 2.0, 6.8)
    goal: Point3 = (4.0, 6.0, 6.5)
    center: Point3 = (-32.0, 4.0, 38.0)
    shape: Index3 = (101, 101, 41)
    spacing: float = 2.0
    speed: float = 5.0
    period: float = 0.1
    cycles: int = 300
    out: Path = RESULTS


TINY = Config(cycles=3, shape=(48, 48, 24))


@contextmanager
def running_node(config: Config) -> Iterator[None]:
    """The node as a process, on a domain of its own."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(1, 100))
    given = {"center": list(config.center), "shape": list(config.shape), "spacing": config.spacing, "margin": 8.0,
             "ground": 0.0, "speed": config.speed, "deadline": config.period}  # fmt: skip
    told = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-m", "maxjax", "ros", "--ros-args", *told]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(timeout=20.0)


class Client:
    """Publishes what a vehicle would, and hears what it is to fly."""

    def __init__(self) -> None:
        import rclpy
        from geometry_msgs.msg import PoseStamped
        from nav_msgs.msg import Odometry
        from nav_msgs.msg import Path as PathMessage
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import PointCloud2, PointField

        rclpy.init()
        self._ros, self._kinds = rclpy, (Odometry, PointCloud2, PointField, PoseStamped)
        self.node = rclpy.create_node("client")
        self._cloud = self.node.create_publisher(PointCloud2, "cloud", qos_profile_sensor_data)
        self._odometry = self.node.create_publisher(Odometry, "odometry", 50)
        self._goal = self.node.create_publisher(PoseStamped, "goal_pose", 1)
        self.path: Any = None
        self.node.create_subscription(PathMessage, "path", self._hear, 10)

    def _hear(self, path: Any) -> None:
        self.path = path

    def aim(self, goal: Point3) -> None:
        """Publish the goal."""
        message = self._kinds[3]()
        message.header.frame_id = "map"
        message.pose.position.x, message.pose.position.y, message.pose.position.z = goal
        self._goal.publish(message)

    def ask(self, place: Float64[np.ndarray, " 3"], points: Float64[np.ndarray, "n 3"]) -> float:
        """Publish where the vehicle is and what it sees; how long the path took [s], infinity: none came."""
        odometry, cloud, field, _ = self._kinds
        pose, scan = odometry(), cloud(height=1, width=len(points), point_step=12, row_step=12 * len(points))
        pose.header.stamp = scan.header.stamp = self.node.get_clock().now().to_msg()
        pose.header.frame_id, pose.child_frame_id = "map", "base_link"
        pose.pose.pose.position.x, pose.pose.pose.position.y, pose.pose.pose.position.z = map(float, place)
        scan.header.frame_id = "map"
        scan.fields = [field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyz")]
        scan.data = points.astype("<f4").tobytes()
        self.path, began = None, time.perf_counter()
        self._odometry.publish(pose)
        self._cloud.publish(scan)
        while self.path is None and time.perf_counter() - began < _LOST:
            self._ros.spin_once(self.node, timeout_sec=0.02)
        return time.perf_counter() - began if self.path is not None else float("inf")

    def close(self) -> None:
        """Leave."""
        self.node.destroy_node()
        self._ros.shutdown()


def main(config: Config) -> list[Row]:
    """Fly the loop; save and return its row."""
    scene = make_scene("downtown", config.city)
    with running_node(config):
        client = Client()
        place, took = np.array(config.start), []
        points = _seen_from(scene, place)
        ready = time.perf_counter() + _READY
        client.aim(config.goal)
        while client.ask(place, points) == float("inf"):
            if time.perf_counter() > ready:
                raise TimeoutError(f"ros_node: expected an answer within {_READY:g} s, given none")
            client.aim(config.goal)
        for _ in range(config.cycles):
            points = _seen_from(scene, place)
            took.append(client.ask(place, points))
            if client.path is not None and client.path.poses:
                place = _along(client.path, config.speed * config.period)
            if np.linalg.norm(place - np.array(config.goal)) <= _ARRIVED:
                break
            time.sleep(max(config.period - min(took[-1], config.period), 0.0))
        client.close()
    heard = 1e3 * np.array([x for x in took if np.isfinite(x)])
    row: Row = {
        "clouds": len(took),
        "lost": len(took) - len(heard),
        "points": len(points),
        "p50_ms": round(float(np.median(heard)), 1),
        "p99_ms": round(float(np.percentile(heard, 99)), 1),
        "max_ms": round(float(heard.max()), 1),
        "left_m": round(float(np.linalg.norm(place - np.array(config.goal))), 1),
    }
    save("ros_node", config, [row], config.out)
    return [row]


def _seen_from(scene: Scene, place: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "n 3"]:
    x, y, z = place.tolist()
    return measure(scene, (x, y, z)).points.astype(np.float64)


def _along(path: Any, distance: float) -> Float64[np.ndarray, " 3"]:
    """The place on a nav_msgs/Path so far from its start, or its end."""
    places = np.array([[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in path.poses])
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    return np.array([np.interp(distance, reach, axis) for axis in places.T])


if __name__ == "__main__":
    main(configured(TINY))
