"""`maxjax ros`: the loop on board as a ROS 2 node; its settings are ROS parameters."""

from __future__ import annotations

from maxjax.ui.cli.options import RosOptions


def run_ros(options: RosOptions) -> int:
    """Run the node until Ctrl-C. Returns 0.

    Raises:
        ValueError: for parameters that cannot be used.
        ImportError: without ROS 2 for Python.
    """
    try:
        from maxjax.ros.node import run_node
    except ImportError as error:
        raise ImportError(
            f"ros: expected ROS 2 for Python, given none ({error}); source a ROS 2 installation, or install "
            "maxjax[ros2], whose wheels are for Linux on x86-64"
        ) from error
    run_node(options.ros_arguments, managed=options.managed)
    return 0
