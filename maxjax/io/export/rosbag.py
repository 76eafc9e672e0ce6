"""A trajectory as `nav_msgs/Path` in a ROS 2 bag: one message on /path, frame `map`, ENU, a stamp a pose."""

from __future__ import annotations

import math
import os
import secrets
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from maxjax.trajectories.trajectory import Motion

_TOPIC, _FRAME = "/path", "map"


def check_rosbags() -> None:
    """Find out whether bags can be written.

    Raises:
        ImportError: without rosbags.
    """
    try:
        import rosbags  # noqa: F401
    except ImportError as error:
        raise ImportError("ROS 2 bags need the extra ros: pip install 'maxjax[ros]'") from error


def write_bag(folder: Path, motion: Motion, check: Callable[[Path], object]) -> None:
    """Write a bag, which is a folder, whole or not at all.

    Args:
        folder: to make; an existing bag of this name is replaced.
        motion: of the trajectory.
        check: called with the bag before it takes its place; where it raises, nothing is written.

    Raises:
        ImportError: without rosbags.
        OSError: if it cannot be written, or if what stands there is no bag.
    """
    check_rosbags()
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    if folder.exists() and not (folder / "metadata.yaml").is_file():
        raise OSError(f"{folder}: expected no such file, or a ROS 2 bag to replace; choose another name")
    types = get_typestore(Stores.ROS2_HUMBLE)
    message = _message(types.types, motion)
    # A bag names its own files after its folder, so that it gets its name before its place.
    temporary = folder.parent / f".{secrets.token_hex(8)}.tmp"
    try:
        temporary.mkdir()
        with Writer(temporary / folder.name, version=8) as bag:
            topic = bag.add_connection(_TOPIC, message.__msgtype__, typestore=types)
            bag.write(topic, 0, types.serialize_cdr(message, message.__msgtype__))
        check(temporary / folder.name)
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(temporary / folder.name, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _message(types: Mapping[str, Any], motion: Motion) -> Any:
    """The message `nav_msgs/Path`."""

    def header(time: float) -> Any:
        seconds, part = divmod(round(time * 1e9), 10**9)
        return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, part), _FRAME)

    poses = []
    for time, (x, y, z), yaw in zip(motion.time.tolist(), motion.position.tolist(), motion.yaw.tolist(), strict=True):
        turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
        pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](x, y, z), turn)
        poses.append(types["geometry_msgs/msg/PoseStamped"](header(time), pose))
    return types["nav_msgs/msg/Path"](header(0.0), poses)
