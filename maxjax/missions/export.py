"""Plans, missions and trajectories as files, the format by the name's ending; each written whole or not at all.

.plan         QGroundControl's mission       needs a place on Earth
.waypoints    "QGC WPL 110"                  needs a place on Earth
.geojson      lines, RFC 7946                needs a place on Earth
.kml          lines, KML 2.2                 needs a place on Earth
.csv          set-points, ENU                needs a trajectory
_ned.csv      set-points, NED                needs a trajectory
.tum          poses                          needs a trajectory
.rosbag       nav_msgs/Path, ROS 2           needs a trajectory
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from maxjax.core.earth import Earth
from maxjax.core.files import atomic_write
from maxjax.core.status import Status
from maxjax.core.terrain import Terrain
from maxjax.maps.load import LoadedMap
from maxjax.missions.drawings import Drawing, geojson_text, kml_text
from maxjax.missions.items import items_of
from maxjax.missions.qgroundcontrol import plan_text
from maxjax.missions.rosbag import check_rosbags, write_bag
from maxjax.missions.setpoints import setpoint_text, tum_text
from maxjax.missions.waypoint_list import waypoint_text
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.trajectories.trajectory import Trajectory

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
        ValueError: if the ending names no format, or its format needs a place on Earth or times that are missing.
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
    file: str | Path,
    flight: Plan | Mission | Trajectory,
    *,
    earth: Earth | None = None,
    ground: float | None = None,
) -> None:
    """Write a trajectory, a plan or a mission for another program; the format by the name's ending.

    `.plan` and `.waypoints` hold the points of the path in the frame GLOBAL_RELATIVE_ALT: heights above the ground at
    home, which lies below the start; an acceptance radius of 0.5 m; the time to hold at waypoints that are hovered at;
    and the speed of each leg, or that of the trajectory's limits. `.geojson` and `.kml` have a line for each leg.
    Set-points and poses are 0.05 s apart, in the map's coordinates, ENU, or NED where the name ends in `_ned.csv`.

    Args:
        file: to write or to replace; `.plan`, `.waypoints`, `.geojson`, `.kml`, `.csv`, `.tum` or `.rosbag`.
        flight: what to write; formats with times need a trajectory.
        earth: where the map lies, for formats with latitudes: `maxjax.TangentPlane`, `maxjax.Projected`, or
            `core.earth.Degrees`. None: where its file says.
        ground: height of the ground at home [m], in the map's coordinates. None: that of the map below the start.

    Raises:
        ValueError: if the plan has no path, the ground is no height or unknown, or for what `check_export` finds.
        ImportError: if a package is missing that the format needs.
        OSError: if it cannot be written.
    """
    file = Path(file)
    timed = flight if isinstance(flight, Trajectory) else None
    plan = flight.plan if isinstance(flight, Trajectory) else flight
    place = plan.map.earth if earth is None and isinstance(plan.map, LoadedMap) else earth
    check_export(file, on_earth=place is not None, in_time=timed is not None)
    if plan.status != Status.OK:
        raise ValueError(f"{file}: expected a plan that is OK, given {plan.status.name}; nothing was written")
    mission, ending = plan if isinstance(plan, Mission) else Mission.of_plan(plan), file.suffix.lower()
    if ending == ".rosbag" and timed is not None:
        write_bag(file, timed.sampled(_EVERY))
    elif ending in IN_TIME and timed is not None:
        atomic_write(file, _in_time(file, timed))
    elif place is not None:
        atomic_write(file, _on_earth(file, mission, timed, place, _home(file, mission, ground)))


def _home(file: Path, mission: Mission, given: float | None) -> float:
    """Height of the ground at home [m]; raises a `ValueError` where it is unknown and the format counts from it."""
    if given is not None:
        if not math.isfinite(given):
            raise ValueError(f"ground: expected a height in metres, given {given}")
        return given
    x, y, _ = mission.path[0].tolist()
    height = Terrain.of(np.asarray(mission.map.ground), mission.map.grid).at(x, y)
    if math.isnan(height) and file.suffix.lower() in (".plan", ".waypoints"):
        raise ValueError(f"{file}: expected a map with ground below the start; give its height, as ground=0.0")
    return 0.0 if math.isnan(height) else height


def _in_time(file: Path, trajectory: Trajectory) -> str:
    motion = trajectory.sampled(_EVERY)
    if file.suffix.lower() == ".tum":
        return tum_text(motion)
    return setpoint_text(motion, ned=file.stem.lower().endswith("_ned"))


def _on_earth(file: Path, mission: Mission, trajectory: Trajectory | None, earth: Earth, ground: float) -> str:
    ending = file.suffix.lower()
    speed = _SPEED if trajectory is None else trajectory.limits.speed
    if ending == ".plan":
        return plan_text(items_of(mission, earth, speed, ground))
    if ending == ".waypoints":
        return waypoint_text(items_of(mission, earth, speed, ground))
    drawings = _drawings(mission, earth, speed)
    return kml_text(drawings, file.stem) if ending == ".kml" else geojson_text(drawings)


def _drawings(mission: Mission, earth: Earth, speed: float) -> list[Drawing]:
    """A line for each leg, and a point for each waypoint between them."""
    places, drawings = earth.geodetic(mission.path), []
    for k, leg in enumerate(mission.legs):
        first, last = mission.places[k : k + 2].tolist()
        known = {"length_m": leg.length, "radius_m": leg.radius, "clearance_m": _finite(leg.clearance)}
        known["speed_m_s"] = min(mission.waypoints[k + 1].speed or speed, speed)
        drawings.append(Drawing(f"leg {k + 1}", places[first : last + 1], known))
    for k, waypoint in enumerate(mission.waypoints[1:-1], 1):
        at = mission.places[k]
        drawings.append(Drawing(f"waypoint {k}", places[at : at + 1], {"hover_s": waypoint.hover or 0.0}))
    return drawings


def _finite(number: float) -> float | str:
    return number if math.isfinite(number) else "infinite"
