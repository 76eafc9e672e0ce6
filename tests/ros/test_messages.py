"""Messages of ROS 2 as arrays, against those that `rosbags` makes and serialises, and what is refused of them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from maxjax.ros.inputs import Inputs, goal_of
from maxjax.ros.messages import points_of_cloud, pose_of, set_stamp, yaws_along
from maxjax.ros.settings import NodeSettings
from maxjax.ros.timed_path import DEVIATION, time_path
from maxjax.trajectories.limits import FlightLimits

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
POINTS = np.array([[1.0, -2.0, 3.5], [np.nan, 0.0, 0.0], [1e3, 2e3, -0.25], [0.5, 0.25, 0.125]])


def header(frame: str, time: float) -> Any:
    stamp = SimpleNamespace(sec=0, nanosec=0)
    set_stamp(stamp, time)
    return TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec), frame)


def cloud(kind: str = "<f4", rows: int = 1, frame: str = "lidar", time: float = 1.0) -> Any:
    """With an intensity before x, room behind z, and room behind each row; serialised, and read again."""
    size, width = np.dtype(kind).itemsize, len(POINTS) // rows
    layout = np.dtype({"names": list("xyz"), "formats": [kind] * 3, "offsets": [4, 4 + size, 4 + 2 * size],
                       "itemsize": 4 + 4 * size})  # fmt: skip
    table = np.zeros((rows, width), layout)
    for k, name in enumerate("xyz"):
        table[name] = POINTS[:, k].reshape(rows, width)
    data = np.concatenate([np.pad(row.view(np.uint8), (0, 6)) for row in table])
    field, number = TYPES["sensor_msgs/msg/PointField"], {4: 7, 8: 8}[size]
    fields = [field("intensity", 0, 7, 1), *(field(x, 4 + k * size, number, 1) for k, x in enumerate("xyz"))]
    step = layout.itemsize
    made = TYPES["sensor_msgs/msg/PointCloud2"](
        header(frame, time), rows, width, fields, kind[0] == ">", step, width * step + 6, data, False
    )
    name = "sensor_msgs/msg/PointCloud2"
    return STORE.deserialize_cdr(STORE.serialize_cdr(made, name), name)


def pose(place: Any, quaternion: Any = (0.0, 0.0, 0.0, 1.0)) -> Any:
    return TYPES["geometry_msgs/msg/Pose"](
        TYPES["geometry_msgs/msg/Point"](*place), TYPES["geometry_msgs/msg/Quaternion"](*quaternion)
    )


def odometry(time: float, place: Any, turn: Rotation | None = None, velocity: Any = (0.0, 0.0, 0.0)) -> Any:
    vector = TYPES["geometry_msgs/msg/Vector3"]
    quaternion = (Rotation.identity() if turn is None else turn).as_quat()
    twist = TYPES["geometry_msgs/msg/Twist"](vector(*velocity), vector(0.0, 0.0, 0.0))
    return TYPES["nav_msgs/msg/Odometry"](
        header("map", time),
        "base_link",
        TYPES["geometry_msgs/msg/PoseWithCovariance"](pose(place, quaternion), np.zeros(36)),
        TYPES["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
    )


@pytest.mark.parametrize("rows", [1, 2])
@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
def test_points_come_through(kind: str, rows: int) -> None:
    np.testing.assert_array_equal(points_of_cloud(cloud(kind, rows)), POINTS)


def test_no_points_are_no_points() -> None:
    made = cloud()
    made = dataclasses.replace(made, height=0, width=0, data=np.zeros(0, np.uint8))
    assert points_of_cloud(made).shape == (0, 3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fields": []}, "expected fields x, y and z, given none"),
        ({"data": np.zeros(10, np.uint8)}, "expected 80 bytes for 1 x 4 points, given 10"),
        (
            {"fields": [TYPES["sensor_msgs/msg/PointField"](x, 0, 5, 1) for x in "xyz"]},
            "FLOAT32 or FLOAT64, given type 5",
        ),
    ],
)
def test_what_is_no_cloud_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        points_of_cloud(dataclasses.replace(cloud(), **change))


def test_poses_are_those_of_the_quaternion() -> None:
    turn = Rotation.from_euler("xyz", [0.1, -0.2, 2.0])
    position, rotation = pose_of(pose([1.0, 2.0, 3.0], turn.as_quat()))
    np.testing.assert_array_equal(position, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(rotation, turn.as_matrix(), atol=1e-12)
    for wrong in ([0.0] * 4, [0.0, 0.0, 0.0, 2.0], [math.nan] * 4):
        with pytest.raises(ValueError, match="expected a quaternion of length 1"):
            pose_of(pose([0.0] * 3, wrong))


def test_a_pose_between_two_is_on_the_way_and_velocities_are_those_of_the_map() -> None:
    inputs = Inputs(NodeSettings(oldest=0.5))
    quarter = Rotation.from_euler("z", 90.0, degrees=True)
    assert inputs.state_at(0.0) is None
    inputs.add_odometry(odometry(10.0, [0.0, 0.0, 1.0]))
    inputs.add_odometry(odometry(10.4, [4.0, 0.0, 1.0], quarter, [2.0, 0.0, 0.0]))
    found = inputs.state_at(10.1)
    assert found is not None
    np.testing.assert_allclose(found.position, [1.0, 0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(found.rotation, Rotation.from_euler("z", 22.5, degrees=True).as_matrix(), atol=1e-6)
    np.testing.assert_allclose(found.velocity, [0.0, 0.5, 0.0], atol=1e-6)
    assert inputs.state_at(10.5) is None
    with pytest.raises(ValueError, match=r"later than 10\.400 s, given 10\.400 s"):
        inputs.add_odometry(odometry(10.4, [9.0, 0.0, 0.0]))
    inputs.add_odometry(odometry(11.4, [4.0, 0.0, 1.0]))
    for hole in (9.0, 11.0):
        with pytest.raises(ValueError, match="expected poses around"):
            inputs.state_at(hole)


@pytest.mark.parametrize("frame", ["map", "base_link", "lidar"])
def test_points_are_where_the_sensor_saw_them(frame: str) -> None:
    """By one matrix from the sensor to the map, and back."""
    settings = NodeSettings(sensor_frame="lidar", sensor=(0.5, 0.0, 0.2, 10.0, -20.0, 90.0))
    inputs = Inputs(settings)
    body = Rotation.from_euler("zyx", [50.0, 5.0, -8.0], degrees=True)
    inputs.add_odometry(odometry(1.0, [3.0, 4.0, 5.0], body))
    taken, state = inputs.read_cloud(cloud("<f8", frame=frame), 1.05), inputs.state_at(1.0)
    assert state is not None
    mount = Rotation.from_euler("xyz", settings.sensor[3:], degrees=True)
    there = POINTS[np.isfinite(POINTS).all(axis=1)]
    steps = {"lidar": (mount, (0.5, 0.0, 0.2)), "base_link": (body, (3.0, 4.0, 5.0))}
    for name in ("lidar", "base_link")[("lidar", "base_link", "map").index(frame) :]:
        turn, place = steps[name]
        there = turn.apply(there) + place
    np.testing.assert_allclose(inputs.world_points(taken, state), there, atol=1e-9)
    position, rotation = inputs.sensor_pose(taken, state)
    seen = inputs.sensor_points(taken, state)
    np.testing.assert_allclose(seen[np.isfinite(seen).all(axis=1)] @ rotation.T + position, there, atol=1e-9)


@pytest.mark.parametrize(
    ("given", "now", "words"),
    [
        (cloud(frame="camera"), 1.0, "expected in frame 'map', 'lidar', given 'camera'"),
        (cloud(time=0.0), 1.7e9, "old; check that the clocks agree"),
        (cloud(time=9.0), 1.0, "old; check that the clocks agree"),
    ],
)
def test_clouds_that_cannot_be_placed_are_refused(given: Any, now: float, words: str) -> None:
    inputs = Inputs(NodeSettings(sensor_frame="lidar"))
    with pytest.raises(ValueError, match=words):
        inputs.read_cloud(given, now)
    inputs.read_cloud(cloud(time=5.0), 5.0)
    with pytest.raises(ValueError, match=r"expected a stamp later than 5\.000 s, given 4\.900 s"):
        inputs.read_cloud(cloud(time=4.9), 5.0)


def test_goals_without_a_height_get_one() -> None:
    stamped = TYPES["geometry_msgs/msg/PoseStamped"]
    flat, high = (stamped(header("map", 0.0), pose([1.0, 2.0, z])) for z in (0.0, 9.0))
    settings = NodeSettings(goal_height=6.0)
    np.testing.assert_array_equal(goal_of(flat, settings), [1.0, 2.0, 6.0])
    np.testing.assert_array_equal(goal_of(high, settings), [1.0, 2.0, 9.0])
    np.testing.assert_array_equal(goal_of(flat, NodeSettings()), [1.0, 2.0, 0.0])
    with pytest.raises(ValueError, match="expected in frame 'map', given 'odom'"):
        goal_of(stamped(header("odom", 0.0), pose([0.0] * 3)), settings)


def test_headings_look_along_the_way() -> None:
    up_and_on = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [3.0, 3.0, 2.0], [3.0, 3.0, 5.0], [3.0, 0.0, 5.0]])
    np.testing.assert_allclose(np.degrees(yaws_along(up_and_on)), [45.0, 45.0, 45.0, -90.0, -90.0])
    assert yaws_along(np.zeros((0, 3))).shape == (0,)
    np.testing.assert_array_equal(yaws_along(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])), [0.0, 0.0])


def test_set_points_keep_limits_and_end_at_rest() -> None:
    path = np.array([[1e4, 0.0, 5.0], [1e4 + 8.0, 0.0, 5.0], [1e4 + 8.0, 6.0, 5.0], [1e4 + 8.0, 6.0, 9.0]])
    limits = FlightLimits(speed=4.0, acceleration=3.0)
    found = time_path(path, 2.0, limits)
    np.testing.assert_allclose(found.positions[0], path[0], atol=1e-3)
    np.testing.assert_allclose(found.positions[-1], path[-1], atol=1e-2)
    assert np.linalg.norm(found.velocities[0]) == pytest.approx(2.0, abs=1e-3)
    assert np.linalg.norm(found.velocities[-1]) < 0.05
    assert np.linalg.norm(found.velocities, axis=1).max() <= 4.0 + 1e-3
    fine = np.concatenate([np.linspace(a, b, 800) for a, b in itertools.pairwise(path)])
    apart = np.linalg.norm(found.positions[:, None] - fine[None], axis=-1).min(axis=1)
    assert apart.max() <= DEVIATION + 0.01
    moved = np.diff(found.positions, axis=0) / np.diff(found.times)[:, None]
    np.testing.assert_allclose(moved, 0.5 * (found.velocities[1:] + found.velocities[:-1]), atol=0.5)


def test_a_long_path_is_flown_in_parts_that_end_at_rest() -> None:
    corners = np.cumsum(np.tile([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (400, 1)), axis=0)
    found = time_path(corners, 0.0, FlightLimits(speed=12.0, acceleration=5.0))
    assert np.linalg.norm(found.velocities[-1]) < 0.1
    assert np.linalg.norm(found.positions[-1] - found.positions[0]) > 20.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"sensor": (0.0, 0.0)}, "sensor: expected 6 numbers"),
        ({"frame": ""}, "frame: expected the name"),
        ({"spacing": -1.0}, "spacing: expected a positive"),
        ({"sensor": (math.nan,) * 6}, "sensor: expected finite"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        NodeSettings(**wrong)
