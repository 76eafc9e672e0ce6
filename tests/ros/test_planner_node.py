"""The ROS 2 node over DDS on loopback: a client sees verified paths, and is told what it sent wrong."""

from __future__ import annotations

import itertools
import os
import random
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rclpy", reason="needs the extra ros2: pip install 'maxjax[ros2]'")

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2, PointField
from trajectory_msgs.msg import MultiDOFJointTrajectory

from maxjax.ros.node import PlannerNode
from maxjax.ros.settings import NodeSettings
from tests.test_replanner import AFTER, GRID, at, wall

BEFORE = at(3.0, 3.0, 2.5)  # aside of the gate, and below it
MOUNT = (0.3, 0.0, -0.2, 0.0, 0.0, 30.0)
SETTINGS = NodeSettings(
    sensor_frame="lidar", sensor=MOUNT, center=tuple(GRID.origin + 0.5 * GRID.spacing * (np.array(GRID.shape) - 1)),
    shape=GRID.shape, spacing=GRID.spacing, radius=1.0, margin=4.0, speed=4.0, deadline=1.0, oldest=2.0,
)  # fmt: skip
HEADING = Rotation.from_euler("z", 20.0, degrees=True)
WAIT = 20.0  # for what comes within a second on a machine at rest [s]


class Vehicle(Node):
    """A client with a simulated sensor: publishes odometry, clouds and goals, and keeps what it hears."""

    def __init__(self, context: Any) -> None:
        super().__init__("vehicle", context=context)
        self.place, self.frame, self.lag = np.array(BEFORE), "lidar", 0.0
        self.cloud = self.create_publisher(PointCloud2, "cloud", qos_profile_sensor_data)
        self.odometry = self.create_publisher(Odometry, "odometry", 50)
        self.goal = self.create_publisher(PoseStamped, "goal_pose", 1)
        self.heard: dict[str, list[Any]] = {"path": [], "trajectory": [], "/diagnostics": []}
        for name, kind in (("path", Path), ("trajectory", MultiDOFJointTrajectory), ("/diagnostics", DiagnosticArray)):
            self.create_subscription(kind, name, self.heard[name].append, 10)

    def move(self) -> None:
        message = Odometry()
        message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), "map"
        message.child_frame_id = "base_link"
        pose = message.pose.pose
        pose.position.x, pose.position.y, pose.position.z = map(float, self.place)
        *_, pose.orientation.z, pose.orientation.w = HEADING.as_quat()
        self.odometry.publish(message)

    def scan(self, points: np.ndarray) -> None:
        """Points of the world, as the sensor has them."""
        turn = HEADING * Rotation.from_euler("xyz", MOUNT[3:], degrees=True)
        seen = turn.inv().apply(points - self.place - HEADING.apply(MOUNT[:3]))
        message = PointCloud2(height=1, width=len(seen), point_step=16, row_step=16 * len(seen), is_dense=True)
        message.fields = [PointField(name=x, offset=4 * k, datatype=7, count=1) for k, x in enumerate("xyz")]
        message.data = np.pad(seen, ((0, 0), (0, 1))).astype("<f4").tobytes()
        now = self.get_clock().now().nanoseconds - int(1e9 * self.lag)
        message.header.stamp.sec, message.header.stamp.nanosec = now // 10**9, now % 10**9
        message.header.frame_id = self.frame
        self.cloud.publish(message)

    def aim(self, place: np.ndarray, frame: str = "map") -> None:
        message = PoseStamped()
        message.header.frame_id = frame
        message.pose.position.x, message.pose.position.y, message.pose.position.z = map(float, place)
        self.goal.publish(message)

    def last(self) -> tuple[bytes, str]:
        """Level and sentence of the diagnostics."""
        status = self.heard["/diagnostics"][-1].status[0]
        return status.level, status.message


@pytest.fixture(scope="module")
def link() -> Iterator[SimpleNamespace]:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=random.SystemRandom().randrange(1, 100))
    node, vehicle = PlannerNode(SETTINGS, context=context), Vehicle(context)
    executors = []
    for one in (node, vehicle):
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(one)
        threading.Thread(target=executor.spin, daemon=True).start()
        executors.append(executor)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    yield SimpleNamespace(node=node, vehicle=vehicle)
    for executor in executors:
        executor.shutdown(timeout_sec=5.0)
    for one in (node, vehicle):
        one.destroy_node()
    rclpy.shutdown(context=context)


def until(vehicle: Vehicle, points: np.ndarray, done: Callable[[], bool]) -> None:
    """Fly on, ten clouds a second, until something is so."""
    end = time.monotonic() + WAIT
    for name in vehicle.heard:
        vehicle.heard[name].clear()
    while not done():
        assert time.monotonic() < end, [vehicle.last() if vehicle.heard["/diagnostics"] else "nothing heard"]
        vehicle.move()
        vehicle.scan(points)
        time.sleep(0.1)


def cloud_of(occupied: np.ndarray) -> np.ndarray:
    place: np.ndarray = np.array(GRID.origin) + GRID.spacing * np.argwhere(occupied)
    return place


def says(vehicle: Vehicle, words: str) -> Callable[[], bool]:
    return lambda: any(words in one.status[0].message for one in list(vehicle.heard["/diagnostics"]))


def test_a_client_flies_through_the_gate(link: SimpleNamespace) -> None:
    vehicle, points = link.vehicle, cloud_of(wall())
    until(vehicle, points, says(vehicle, "no goal yet"))
    vehicle.aim(AFTER)
    until(vehicle, points, lambda: len(vehicle.heard["path"]) > 2 and bool(vehicle.heard["path"][-1].poses))
    path, trajectory = vehicle.heard["path"][-1], vehicle.heard["trajectory"][-1]
    assert path.header.frame_id == trajectory.header.frame_id == "map"
    assert trajectory.joint_names == ["base_link"]
    places = np.array([[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in path.poses])
    np.testing.assert_allclose(places[0], BEFORE, atol=0.02)
    np.testing.assert_allclose(places[-1], AFTER, atol=0.02)
    fine = np.concatenate([np.linspace(a, b, 500) for a, b in itertools.pairwise(places)])
    # Voxels are cubes around the points.
    apart = np.maximum(np.abs(fine[:, None] - points[None]) - 0.5 * GRID.spacing, 0.0)
    assert np.linalg.norm(apart, axis=-1).min() >= 1.0 - 1e-3
    flown = np.array([[getattr(p.transforms[0].translation, x) for x in "xyz"] for p in trajectory.points])
    times = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in trajectory.points])
    assert np.linalg.norm(flown[:, None] - fine[None], axis=-1).min(axis=1).max() <= 0.12
    np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-6)
    speeds = np.linalg.norm(np.diff(flown, axis=0), axis=1) / 0.1
    assert speeds.max() <= 4.0 + 0.05
    np.testing.assert_allclose(flown[-1], AFTER, atol=0.05)
    last = trajectory.points[-1].velocities[0].linear
    assert np.linalg.norm([last.x, last.y, last.z]) < 0.05
    assert vehicle.last()[0] in (b"\x00", b"\x01")


def test_a_closed_gate_ends_the_path(link: SimpleNamespace) -> None:
    vehicle = link.vehicle
    closed = cloud_of(wall(open_gate=False))
    until(vehicle, closed, says(vehicle, "no path"))
    until(vehicle, closed, lambda: len(vehicle.heard["path"]) > 2)
    assert not vehicle.heard["path"][-1].poses
    assert not vehicle.heard["trajectory"][-1].points
    assert vehicle.last()[0] == b"\x02"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frame": "camera"}, "cloud: expected in frame 'map', 'base_link', 'lidar', given 'camera'"),
        ({"lag": 60.0}, "cloud: expected a stamp"),
        ({"lag": -60.0}, "cloud: expected a stamp up to 2 s old"),
        ({"place": np.array([np.nan, 0.0, 0.0])}, "pose: expected a finite position"),
    ],
)
def test_what_cannot_be_used_is_told(link: SimpleNamespace, change: dict[str, Any], words: str) -> None:
    vehicle = link.vehicle
    before = {name: getattr(vehicle, name) for name in change}
    vars(vehicle).update(change)
    until(vehicle, cloud_of(wall()), says(vehicle, words))
    vars(vehicle).update(before)
    until(vehicle, cloud_of(wall()), lambda: bool(vehicle.heard["path"]))


def test_a_goal_in_another_frame_is_told(link: SimpleNamespace) -> None:
    link.vehicle.aim(AFTER, frame="odom")
    until(link.vehicle, cloud_of(wall()), says(link.vehicle, "goal: expected in frame 'map', given 'odom'"))


def test_who_is_not_active_answers_nothing(link: SimpleNamespace) -> None:
    vehicle, points = link.vehicle, cloud_of(wall())
    assert link.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    time.sleep(0.3)
    vehicle.heard["path"].clear()
    for _ in range(10):
        vehicle.move()
        vehicle.scan(points)
        time.sleep(0.05)
    assert not vehicle.heard["path"]
    assert link.node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    until(vehicle, points, lambda: bool(vehicle.heard["path"]))
