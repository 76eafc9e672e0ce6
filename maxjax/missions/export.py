"""Plans and trajectories as files, the format by the name's ending; each written whole or not at all.

.plan         QGroundControl's mission       needs a place on Earth
.waypoints    "QGC WPL 110"                  needs a place on Earth
.geojson      line, RFC 7946                 needs a place on Earth
.kml          line, KML 2.2                  needs a place on Earth
.csv          set-points, ENU                needs a trajectory
_ned.csv      set-points, NED                needs a trajectory
.tum          poses                          needs a trajectory
.rosbag       nav_msgs/Path, ROS 2           needs a trajectory
"""

from __future__ import annotations

import math
from pathlib import Path

from maxjax.core.serialize import atomic_write
from maxjax.core.status import Status
from maxjax.missions.drawings import geojson_text, kml_text
from maxjax.missions.earth import Earth
from maxjax.missions.qgroundcontrol import plan_text
from maxjax.missions.rosbag import check_rosbags, write_bag
from maxjax.missions.setpoints import setpoint_text, tum_text
from maxjax.missions.waypoint_list import waypoint_text
from maxjax.missions.waypoints import waypoints
from maxjax.planning.plan import Plan
from maxjax.planning.trajectory import Trajectory

ON_EARTH = (".plan", ".waypoints", ".geojson", ".kml")
IN_TIME = (".csv", ".tum", ".rosbag")
_EVERY = 0.05  # between set-points and poses [s]
_SPEED = 5.0  # of a mission whose plan has no trajectory [m/s]; PX4's MPC_XY_CRUISE


def check_export(file: Path, *, on_earth: bool, in_time: bool = True) -> None:
    """Find out before the work whether a plan can be written to a file.

    Args:
        file: to write.
        on_earth: whether it is known where the map lies.
        in_time: whether there will be a trajectory.

    Raises:
        ValueError: for an ending that is no format's, or one whose format needs what is not there.
        ImportError: where a package is missing that the format needs.
    """
    ending = file.suffix.lower()
    if ending not in ON_EARTH + IN_TIME:
        known = ", ".join((*ON_EARTH, *IN_TIME))
        raise ValueError(f"{file}: expected a name that ends in one of {known}, given {ending or 'no ending'!r}")
    if ending in ON_EARTH and not on_earth:
        raise ValueError(f"{file}: expected a place on Earth for {ending}: latitude, longitude and height of the map")
    if ending in IN_TIME and not in_time:
        raise ValueError(f"{file}: expected a trajectory for {ending}; make one with maxjax.trajectory")
    if not file.absolute().parent.is_dir():
        raise ValueError(f"{file}: expected a folder {file.absolute().parent} to write it to; make it first")
    if ending == ".rosbag":
        check_rosbags()


def export(
    file: str | Path, plan: Plan, trajectory: Trajectory | None = None, earth: Earth | None = None, ground: float = 0.0
) -> None:
    """Write a plan, or its trajectory, for another program; the format by the name's ending.

    Missions (`.plan`, `.waypoints`) hold the points of the plan's path in the frame GLOBAL_RELATIVE_ALT: heights above
    the ground at home, which lies below the start; an acceptance radius of 0.5 m; and the speed of the trajectory's
    limits. Set-points and poses are 0.05 s apart, in the map's coordinates, ENU, or NED where the name ends in
    `_ned.csv`.

    Args:
        file: to write or to replace; `.plan`, `.waypoints`, `.geojson`, `.kml`, `.csv`, `.tum` or `.rosbag`.
        plan: one that is OK.
        trajectory: of this plan, for formats with times, and for the speed of missions.
        earth: where the map lies, for formats with latitudes: `maxjax.TangentPlane`, `maxjax.Projected`, or
            `missions.earth.Degrees`.
        ground: height of the ground at home [m], in the map's coordinates.

    Raises:
        ValueError: for a plan without a path, a ground that is no height, or what `check_export` finds.
        ImportError: where a package is missing that the format needs.
        OSError: if it cannot be written.
    """
    file = Path(file)
    check_export(file, on_earth=earth is not None, in_time=trajectory is not None)
    if plan.status != Status.OK:
        raise ValueError(f"{file}: expected a plan that is OK, given {plan.status.name}; nothing was written")
    if not math.isfinite(ground):
        raise ValueError(f"ground: expected a height in metres, given {ground}")
    ending = file.suffix.lower()
    if ending == ".rosbag" and trajectory is not None:
        write_bag(file, trajectory.sampled(_EVERY))
    elif ending in IN_TIME and trajectory is not None:
        atomic_write(file, _in_time(file, trajectory))
    elif earth is not None:
        atomic_write(file, _on_earth(file, plan, trajectory, earth, ground))


def _in_time(file: Path, trajectory: Trajectory) -> str:
    motion = trajectory.sampled(_EVERY)
    if file.suffix.lower() == ".tum":
        return tum_text(motion)
    return setpoint_text(motion, ned=file.stem.lower().endswith("_ned"))


def _on_earth(file: Path, plan: Plan, trajectory: Trajectory | None, earth: Earth, ground: float) -> str:
    ending = file.suffix.lower()
    speed = _SPEED if trajectory is None else trajectory.limits.speed
    if ending == ".plan":
        return plan_text(waypoints(plan.path, earth, speed, ground))
    if ending == ".waypoints":
        return waypoint_text(waypoints(plan.path, earth, speed, ground))
    places = earth.geodetic(plan.path)
    if ending == ".kml":
        return kml_text(places, file.stem)
    return geojson_text(places, {"length_m": plan.length, "radius_m": plan.radius, "clearance_m": _finite(plan)})


def _finite(plan: Plan) -> float | str:
    return plan.clearance if math.isfinite(plan.clearance) else "infinite"
