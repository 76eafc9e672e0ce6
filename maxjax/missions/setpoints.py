"""Set-points for offboard control as CSV, and poses as TUM files.

CSV: `t,x,y,z,vx,vy,vz,ax,ay,az,yaw` in seconds, metres and radians, ENU with yaw from east to north; in NED, north,
east, down (MAVLink's LOCAL_NED), yaw from north to east. Yaw lies in [−π, π]. A row is what the message
SET_POSITION_TARGET_LOCAL_NED takes. TUM: `t x y z qx qy qz qw` without a head, the quaternion that of the yaw.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from maxjax.trajectories.trajectory import Motion

_COLUMNS = "t,x,y,z,vx,vy,vz,ax,ay,az,yaw"


def setpoint_text(motion: Motion, *, ned: bool = False) -> str:
    """The text of a CSV file of set-points."""
    vectors = [motion.position, motion.velocity, motion.acceleration]
    yaw = motion.yaw
    if ned:
        vectors = [values[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for values in vectors]
        yaw = 0.5 * np.pi - yaw
    wrapped = np.arctan2(np.sin(yaw), np.cos(yaw))
    return _COLUMNS + "\n" + _rows(np.column_stack([motion.time, *vectors, wrapped]), ",")


def tum_text(motion: Motion) -> str:
    """The text of a TUM file."""
    nothing = np.zeros_like(motion.yaw)
    turn = [nothing, nothing, np.sin(0.5 * motion.yaw), np.cos(0.5 * motion.yaw)]
    return _rows(np.column_stack([motion.time, motion.position, *turn]), " ")


def _rows(table: Float64[np.ndarray, "n m"], between: str) -> str:
    return "".join(between.join(f"{value:.6f}" for value in row) + "\n" for row in table.tolist())
