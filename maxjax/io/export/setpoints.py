"""Set-points for offboard control as CSV, and poses as TUM files.

CSV: `t,x,y,z,vx,vy,vz,ax,ay,az,yaw` in seconds, metres and radians, in the map's coordinates, ENU with yaw from east to
north. In NED (MAVLink's LOCAL_NED) north, east and down count from a local origin, as autopilots hold them in float32,
and yaw from north to east; north is true north: a map's grid north is turned to it,

    p = east, north on the plane at the origin, and the rise above it,    v = J ẋ,    a = J ẍ,    J = ∂p/∂x.

The rise is a difference of heights, as autopilots have it: whoever keeps z stays level, while the plane itself leaves
the Earth by 2 m at 5 km.

A line below the head names the origin. Yaw lies in [−π, π]. A row is what the message SET_POSITION_TARGET_LOCAL_NED
takes. TUM: `t x y z qx qy qz qw` without a head, the quaternion that of the yaw.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Point3
from maxjax.io.geo.earth import Earth, TangentPlane, on_own_zero
from maxjax.trajectories.trajectory import Motion

_COLUMNS = "t,x,y,z,vx,vy,vz,ax,ay,az,yaw"


@dataclasses.dataclass(frozen=True)
class LocalOrigin:
    """Where north, east and down count from.

    Attributes:
        point: in the map [m].
        earth: where the map lies; None where that is unknown: its y axis is then taken for true north.
    """

    point: Point3
    earth: Earth | None

    def text(self) -> str:
        """The line of a file that names it."""
        stands = "on the ground below the start"
        if self.earth is None:
            x, y, z = self.point
            return (
                f"# origin: x {x:.6f}, y {y:.6f}, z {z:.6f} m of the map, {stands}; no place on Earth is known: "
                "the map's y axis is taken for true north\n"
            )
        north, east, up = on_own_zero(self.earth).geodetic(np.array([self.point]))[0].tolist()
        height = f"height {up:.6f} m {self.earth.zero}"
        return f"# origin: latitude {north:.10f}, longitude {east:.10f}, {height}, {stands}; x is true north\n"

    def enu(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Metres east, north and above the origin, of points of the map."""
        if self.earth is None:
            aside: Float64[np.ndarray, "n 3"] = points - np.array(self.point)
            return aside
        earth = on_own_zero(self.earth)
        north, east, up = earth.geodetic(np.array([self.point]))[0].tolist()
        places = earth.geodetic(points)
        found: Float64[np.ndarray, "n 3"] = TangentPlane(north, east, up).local(places)
        found[:, 2] = places[:, 2] - up
        return found

    def turned(self, motion: Motion) -> tuple[list[Float64[np.ndarray, "n 3"]], Float64[np.ndarray, " n"]]:
        """Position, velocity and acceleration east, north and up, and the yaw from east to north, of a motion."""
        points = motion.position
        axes = [0.5 * (self.enu(points + step) - self.enu(points - step)) for step in np.eye(3)]
        heading = np.column_stack([np.cos(motion.yaw), np.sin(motion.yaw), np.zeros_like(motion.yaw)])
        velocity, acceleration, ahead = (
            np.sum([axis * values[:, k : k + 1] for k, axis in enumerate(axes)], axis=0)
            for values in (motion.velocity, motion.acceleration, heading)
        )
        return [self.enu(points), velocity, acceleration], np.arctan2(ahead[:, 1], ahead[:, 0])


def setpoint_text(motion: Motion, ned: LocalOrigin | None = None) -> str:
    """The text of a CSV file of set-points.

    Args:
        motion: of a trajectory.
        ned: where NED counts from; None: ENU in the map's coordinates.
    """
    vectors, yaw, said = [motion.position, motion.velocity, motion.acceleration], motion.yaw, ""
    if ned is not None:
        vectors, yaw = ned.turned(motion)
        vectors = [values[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for values in vectors]
        yaw, said = 0.5 * np.pi - yaw, ned.text()
    wrapped = np.arctan2(np.sin(yaw), np.cos(yaw))
    return _COLUMNS + "\n" + said + _rows(np.column_stack([motion.time, *vectors, wrapped]), ",")


def tum_text(motion: Motion) -> str:
    """The text of a TUM file."""
    nothing = np.zeros_like(motion.yaw)
    turn = [nothing, nothing, np.sin(0.5 * motion.yaw), np.cos(0.5 * motion.yaw)]
    return _rows(np.column_stack([motion.time, motion.position, *turn]), " ")


def _rows(table: Float64[np.ndarray, "n m"], between: str) -> str:
    return "".join(between.join(f"{value:.6f}" for value in row) + "\n" for row in table.tolist())
