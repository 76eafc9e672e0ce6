"""The node: a managed one, as ROS 2 has them (lifecycle), that answers each cloud with a verified path.

    cloud (sensor_msgs/PointCloud2)         →  path (nav_msgs/Path), to the goal
    odometry (nav_msgs/Odometry)               trajectory (trajectory_msgs/MultiDOFJointTrajectory), to fly
    goal_pose (geometry_msgs/PoseStamped)      /diagnostics (diagnostic_msgs/DiagnosticArray)

    unconfigured → configure: parameters are read, programs compiled → inactive → activate → active

A cloud waits for the odometry around its stamp, and only the newest one does. Where there is no path, an empty one is
published, and an empty trajectory: brake. Where clouds or odometry cease, diagnostics say so; what was published last
ends at rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, Transform, Twist
from nav_msgs.msg import Odometry, Path
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from maxjax.ros.inputs import Cloud, Inputs, goal_of
from maxjax.ros.messages import fill_path, fill_point, set_stamp, yaws_along
from maxjax.ros.planning import Answer, CloudPlanner, summary_of
from maxjax.ros.settings import NodeSettings

# As sensors publish: the newest one, and none twice. Poses are many, and all are wanted.
_CLOUDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_POSES = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_RELIABLE = QoSProfile(depth=1)
# How often silence is looked for, and how long it may last [s].
_WATCH, _SILENT = 0.5, 1.0
_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class PlannerNode(LifecycleNode):  # type: ignore[misc]
    """A `maxjax.Replanner` as a ROS 2 node.

    Args:
        settings: parameters where nobody gives others.
        name: of the node.
        options: of `rclpy.node.Node`.
    """

    def __init__(self, settings: NodeSettings = NodeSettings(), name: str = "maxjax", **options: Any) -> None:  # noqa: B008
        super().__init__(name, **options)
        for field in dataclasses.fields(settings):
            given = getattr(settings, field.name)
            self.declare_parameter(field.name, list(given) if isinstance(given, tuple) else given)
        self.settings = settings
        self._inputs = Inputs(settings)
        self._planner: CloudPlanner | None = None
        self._goal: np.ndarray | None = None
        self._waiting: Cloud | None = None
        self._active = False
        self._told = ""
        self._refused = 0
        self._heard = 0.0
        self._made: list[tuple[Any, Any]] = []

    # --- Transitions. ---

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters, listen, and compile where the middle of the map is known."""
        self._goal = self._waiting = self._planner = None
        try:
            self.settings = self._read_settings()
            self._inputs = Inputs(self.settings)
            if np.isfinite(self.settings.center).all():
                self._prepare(np.array(self.settings.center))
        except ValueError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        path = self.create_publisher(Path, "path", _RELIABLE)
        trajectory = self.create_publisher(MultiDOFJointTrajectory, "trajectory", _RELIABLE)
        self._diagnostics, self._path, self._trajectory = diagnostics, path, trajectory
        listeners = (
            self.create_subscription(PointCloud2, "cloud", self._on_cloud, _CLOUDS),
            self.create_subscription(Odometry, "odometry", self._on_odometry, _POSES),
            self.create_subscription(PoseStamped, "goal_pose", self._on_goal, _RELIABLE),
        )
        self._made = [(self.destroy_publisher, x) for x in (diagnostics, path, trajectory)]
        self._made += [(self.destroy_subscription, x) for x in listeners]
        self._made.append((self.destroy_timer, self.create_timer(_WATCH, self._watch)))
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Answer from now on."""
        self._active, self._heard = True, self._now()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Answer no more."""
        self._active, self._waiting = False, None
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the map and the goal, and listen no more."""
        for destroy, made in self._made:
            destroy(made)
        self._made, self._planner = [], None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As for a clean-up."""
        return self.on_cleanup(state)

    # --- What arrives. ---

    def _on_odometry(self, message: Odometry) -> None:
        try:
            self._inputs.add_odometry(message)
        except ValueError as error:
            self._refuse(error)
            return
        latest = self._inputs.latest
        if self._planner is None and self._active and latest is not None:
            self._prepare(latest.position)
        if self._waiting is not None:
            self._answer(self._waiting)

    def _on_goal(self, message: PoseStamped) -> None:
        try:
            self._goal = goal_of(message, self.settings)
        except ValueError as error:
            self._refuse(error)

    def _on_cloud(self, message: PointCloud2) -> None:
        if not self._active:
            return
        try:
            cloud = self._inputs.read_cloud(message, self._now())
        except ValueError as error:
            self._refuse(error)
            return
        self._heard = self._now()
        self._answer(cloud)

    # --- What is answered. ---

    def _prepare(self, middle: np.ndarray) -> None:
        """Make the planner of a map around a place, and compile: minutes the first time on a machine."""
        self.get_logger().info("compiling, or reading what was compiled before: minutes the first time on a machine")
        planner = CloudPlanner(self.settings, middle)
        planner.warm_up()
        self._planner = planner
        self.get_logger().info("ready")

    def _answer(self, cloud: Cloud) -> None:
        self._waiting = None
        if self._planner is None or self._goal is None:
            return
        try:
            state = self._inputs.state_at(cloud.time)
        except ValueError as error:
            self._refuse(error)
            return
        if state is None:
            self._waiting = cloud
            return
        answer = self._planner.answer(cloud, state, self._goal, self._inputs)
        self._publish(answer)
        level, sentence, values = summary_of(answer)
        values["behind_cloud_s"] = f"{self._now() - cloud.time:.3f}"
        values["refused_messages"] = str(self._refused)
        self._tell(level, sentence, values)

    def _publish(self, answer: Answer) -> None:
        path = Path()
        path.header.frame_id = self.settings.frame
        set_stamp(path.header.stamp, answer.begins)
        fill_path(path, answer.path, PoseStamped)
        trajectory = MultiDOFJointTrajectory()
        trajectory.header, trajectory.joint_names = path.header, [self._inputs.body or "base_link"]
        setpoints = answer.setpoints
        if setpoints is not None:
            rows = zip(setpoints.positions, setpoints.velocities, setpoints.accelerations, strict=True)
            yaws = yaws_along(setpoints.positions)
            for state, yaw, seconds in zip(rows, yaws, setpoints.times, strict=True):
                point = MultiDOFJointTrajectoryPoint(
                    transforms=[Transform()], velocities=[Twist()], accelerations=[Twist()]
                )
                fill_point(point, state, float(yaw), float(seconds))
                trajectory.points.append(point)
        self._path.publish(path)
        self._trajectory.publish(trajectory)

    def _watch(self) -> None:
        """Say what is missing."""
        if not self._active:
            return
        silent = self._now() - self._heard
        if self._inputs.latest is None:
            self._tell(2, "no odometry yet", {})
        elif self._goal is None:
            self._tell(1, "no goal yet: publish a geometry_msgs/PoseStamped on goal_pose", {})
        elif silent > _SILENT:
            self._tell(2, f"no cloud that can be used for {silent:.1f} s: {self._told or 'none came'}", {})

    def _refuse(self, error: ValueError) -> None:
        """Count a message that cannot be used, and say why, once in a row."""
        self._refused += 1
        if str(error).split(", given")[0] != self._told.split(", given")[0]:
            self.get_logger().warning(str(error))
        self._told = str(error)
        if self._active:
            self._tell(1, str(error), {"refused_messages": str(self._refused)})

    def _tell(self, level: int, sentence: str, values: dict[str, str]) -> None:
        status = DiagnosticStatus(level=_LEVELS[level], name=f"{self.get_name()}: planner", message=sentence)
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _read_settings(self) -> NodeSettings:
        given: dict[str, Any] = {}
        for field in dataclasses.fields(NodeSettings):
            value = self.get_parameter(field.name).value
            given[field.name] = tuple(value) if isinstance(getattr(NodeSettings, field.name), tuple) else value
        return NodeSettings(**given)


def run_node(arguments: Sequence[str], *, managed: bool = False) -> None:
    """Run the node until Ctrl-C.

    Args:
        arguments: of ROS, as `--ros-args -p radius:=0.8 -r cloud:=/lidar/points`.
        managed: wait for transitions; else it configures and activates itself.

    Raises:
        ValueError: for parameters that cannot be used.
    """
    rclpy.init(args=list(arguments))
    node = PlannerNode()
    try:
        if not managed:
            if node.trigger_configure() != TransitionCallbackReturn.SUCCESS:
                raise ValueError("ros: expected parameters that can be used; the log says which one cannot")
            node.trigger_activate()
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
