"""The loop on board: ros2 launch docs/samples/planner.launch.py cloud:=/lidar/points odometry:=/odom."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

ARGUMENTS = {"cloud": "/lidar/points", "odometry": "/odom", "frame": "map", "radius": "1.0", "movers": "false"}


def generate_launch_description() -> LaunchDescription:
    """The node, with its topics and the parameters that are set most."""
    declared = [DeclareLaunchArgument(name, default_value=value) for name, value in ARGUMENTS.items()]
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    told = ["-r", ["cloud:=", given["cloud"]], "-r", ["odometry:=", given["odometry"]]]
    for name in ("frame", "radius", "movers"):
        told += ["-p", [f"{name}:=", given[name]]]
    return LaunchDescription([*declared, ExecuteProcess(cmd=["maxjax", "ros", "--ros-args", *told], output="screen")])
