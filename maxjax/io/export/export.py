"""Plans, missions and trajectories as files, the format by the name's ending; each written whole or not at all.

Each is read back as what it is to fly, and judged against the map, before it takes its place.

.plan         QGroundControl's mission       needs a place on Earth
.waypoints    "QGC WPL 110"                  needs a place on Earth
.kmz          DJI's WPML                     needs a place on Earth
_litchi.csv   Litchi's waypoints             needs a place on Earth
.geojson      lines, RFC 7946                needs a place on Earth
.kml          lines, KML 2.2                 needs a place on Earth
.csv          set-points, ENU                needs a trajectory
_ned.csv      set-points, NED                needs a trajectory
.tum          poses                          needs a trajectory
.rosbag       nav_msgs/Path, ROS 2           needs a trajectory
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from maxjax.core.files import atomic_write
from maxjax.core.status import Status
from maxjax.io.airspace.airspace import Airspace
from maxjax.io.export.as_flown import AsFlown, add_to_keep, judge_lines
from maxjax.io.export.autopilot import BOTH, Autopilot
from maxjax.io.export.drawings import drawings_of, geojson_text, kml_text
from maxjax.io.export.endings import FROM_HOME, IN_TIME, ON_EARTH, STOPPING, ending_of
from maxjax.io.export.fastest import fastest, judge_text
from maxjax.io.export.home_ground import feet_of, origin_of, standings_of
from maxjax.io.export.read_back import lines_in_bag
from maxjax.io.export.rosbag import check_rosbags, write_bag
from maxjax.io.export.setpoints import LocalOrigin, setpoint_text, tum_text
from maxjax.io.export.stops import LIMITS, space_out, spacing_remarks
from maxjax.io.export.waypoint_file import Made, WaypointFile
from maxjax.io.geo.accuracy import Accuracy, accuracy_of
from maxjax.io.geo.earth import Earth, on_own_zero
from maxjax.io.load import LoadedMap
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.trajectories.trajectory import Trajectory

_EVERY = 0.05  # between set-points and poses [s]
_SPEED = 5.0  # of a mission whose plan has no trajectory [m/s]; PX4's MPC_XY_CRUISE


@dataclasses.dataclass(frozen=True, eq=False)
class ExportOptions:
    """The keywords of `export`, checked.

    Raises:
        ValueError: if the ground is no height.
    """

    earth: Earth | None = None
    ground: float | None = None
    airspace: Airspace | None = None
    takeoff_and_landing: bool | None = None
    autopilot: Autopilot | None = None

    def __post_init__(self) -> None:
        if self.ground is not None and not math.isfinite(self.ground):
            raise ValueError(f"ground: expected a height in metres, given {self.ground}")

    @property
    def autopilots(self) -> tuple[Autopilot, ...]:
        """Those that a file of waypoints is judged for."""
        return BOTH if self.autopilot is None else (self.autopilot,)


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
    ending = ending_of(file)
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


def export(  # noqa: PLR0913 (the keywords of a public call)
    file: str | Path,
    flight: Plan | Mission | Trajectory,
    *,
    earth: Earth | None = None,
    ground: float | None = None,
    airspace: Airspace | None = None,
    takeoff_and_landing: bool | None = None,
    autopilot: Autopilot | None = None,
) -> AsFlown:
    """Write a trajectory, a plan or a mission for another program; the format by the name's ending.

    `.plan` and `.waypoints` hold the points of the path in the frame GLOBAL_RELATIVE_ALT: heights above the ground at
    home, which lies below the start; the course of the way to each; an acceptance radius of 0.5 m; the time to hold at
    waypoints that are hovered at, or whose corner an autopilot would cut too near to something; and the speed of each
    leg, or that of the trajectory's limits. Points that only cost time are left out (`io.export.thinning`). `.kmz`
    (DJI) and `_litchi.csv` hold the same for aircraft that stop at each point. `.geojson` and `.kml` have a line for
    each leg. Set-points and poses are 0.05 s apart, in the map's coordinates, ENU; where the name ends in `_ned.csv` in
    NED, true north, from the ground below the start.

    Before it takes its place, what is written is read back, put on the map's own ground and judged against the map
    (`io.export.as_flown`); a file that would lead elsewhere is not written.

    Args:
        file: to write or to replace; `.plan`, `.waypoints`, `.kmz`, `_litchi.csv`, `.geojson`, `.kml`, `.csv`, `.tum`
            or `.rosbag`.
        flight: what to write; formats with times need a trajectory.
        earth: where the map lies, for formats with latitudes: `maxjax.TangentPlane`, `maxjax.Projected`, or
            `io.geo.earth.Degrees`. None: where its file says.
        ground: height of the ground at home [m], in the map's coordinates. None: that of the map below the start.
        airspace: whose areas become the geofence of a `.plan`.
        takeoff_and_landing: whether a `.plan` or a `.waypoints` file begins with a take-off, upright to the start, and
            ends with a landing, upright from the goal; a `.kmz` always begins with one. None: with a take-off alone
            where ArduCopter may fly it, whose AUTO does not begin on the ground without one, and the way up is clear.
        autopilot: that a `.plan` or a `.waypoints` file is for: `maxjax.Autopilot.px4()` or `.arducopter()`, with
            parameters of its own or without. None: it is judged for both, each with its defaults.

    Returns:
        What the file makes a vehicle fly.

    Raises:
        ValueError: if the plan has no path, the ground is no height or unknown, the file would come nearer to something
            than the plan may, or for what `check_export` finds.
        ImportError: if a package is missing that the format needs.
        OSError: if it cannot be written.
    """
    options = ExportOptions(earth, ground, airspace, takeoff_and_landing, autopilot)
    return _write(Path(file), flight, options)


def _write(file: Path, flight: Plan | Mission | Trajectory, options: ExportOptions) -> AsFlown:
    """Write what was asked for, and judge it before it takes its place."""
    timed = flight if isinstance(flight, Trajectory) else None
    plan = flight.plan if isinstance(flight, Trajectory) else flight
    ground, landing = options.ground, options.takeoff_and_landing
    earth = plan.map.earth if options.earth is None and isinstance(plan.map, LoadedMap) else options.earth
    check_export(file, on_earth=earth is not None, in_time=timed is not None)
    place = None if earth is None else place_for(file, earth)
    if plan.status != Status.OK:
        raise ValueError(f"{file}: expected a plan that is OK, given {plan.status.name}; nothing was written")
    mission, ending = plan if isinstance(plan, Mission) else Mission.of_plan(plan), ending_of(file)
    standings, near = standings_of(mission, place, ground), tuple(map(str, mission.near))
    true = Accuracy() if place is None or ending not in ON_EARTH else _accuracy(file, place, mission)
    asked = _asked(file, mission, true)
    near += (str(true),) if true.metres else ()
    near += spacing_remarks(mission, asked, LIMITS[ending]) if ending in STOPPING else ()
    if ending == ".rosbag" and timed is not None:
        return dataclasses.replace(_bag(file, timed, mission), remarks=near)
    in_time = timed is not None and ending in IN_TIME
    text: str | bytes = ""
    made: tuple[WaypointFile, Made] | None = None
    if timed is not None and in_time:
        text = _in_time(file, timed, origin_of(file, mission, ground, earth))
    elif earth is None or place is None:
        raise ValueError(f"{file}: expected a map with a place on Earth; give earth=")
    elif ending in FROM_HOME:
        feet, pilots = feet_of(file, mission, ground, landing is True), options.autopilots
        given = WaypointFile(file, asked, place, _speed(flight), feet, options.airspace, pilots, standings, near)
        given = given.taking_off() if landing is None else given
        made = given, given.made()
    else:
        drawings, said = drawings_of(mission, place, _speed(flight)), f"heights {earth.zero}{true.clause}"
        text = kml_text(drawings, file.stem, said) if ending == ".kml" else geojson_text(drawings, said)
    try:
        if made is not None:
            text, flown = fastest(*made)
        else:
            flown = dataclasses.replace(
                judge_text(file, text, asked, timed if in_time else None, standings), remarks=near
            )
    except ValueError as error:
        raise ValueError(f"{error}{_more_to_keep(mission, true)}") from error
    atomic_write(file, text)
    return flown


def _bag(file: Path, trajectory: Trajectory, mission: Mission) -> AsFlown:
    """Write a bag, and judge it before it takes its place."""
    found: list[AsFlown] = []
    motion = trajectory.sampled(_EVERY)
    write_bag(file, motion, lambda bag: found.append(judge_lines(file, lines_in_bag(bag), mission, trajectory)))
    return found[0]


def place_for(file: Path, earth: Earth) -> Earth:
    """Where a map lies, with the heights that a file needs.

    Files with latitudes need heights above sea level; GeoJSON also takes those above the ellipsoid (RFC 7946), and
    set-points only need differences.

    Raises:
        ValueError: where the file needs heights above sea level and the map's zero is not known.
    """
    ending = ending_of(file)
    if ending in ON_EARTH and not (ending == ".geojson" and earth.zero.ellipsoidal):
        earth.zero.height(f"{file}: heights of {ending}")
    return on_own_zero(earth)


def _accuracy(file: Path, earth: Earth, mission: Mission) -> Accuracy:
    """How true a map is where a mission flies; raises a `ValueError` where that is not known."""
    true = accuracy_of(earth, np.asarray(mission.path[0], np.float64))
    if not true.known:
        raise ValueError(
            f"{file}: expected a map whose places are true on Earth, and {true}; state it, as --accuracy 2"
        )
    return true


def _asked(file: Path, mission: Mission, true: Accuracy) -> Mission:
    """The mission that a file is to hold, with what it has to keep there."""
    more, ending = add_to_keep(mission, true.metres), ending_of(file)
    return space_out(file, more, LIMITS[ending]) if ending in STOPPING else more


def _more_to_keep(mission: Mission, true: Accuracy) -> str:
    """What a refusal says of a distance that is more than the radius."""
    if not true.metres:
        return ""
    return f" ({mission.radius:g} m are to be kept, and {true.metres:g} m more: {true}; --accuracy states another)"


def _speed(flight: Plan | Mission | Trajectory) -> float:
    if isinstance(flight, Trajectory):
        return flight.limits.speed
    own = [waypoint.speed or 0.0 for waypoint in flight.waypoints] if isinstance(flight, Mission) else []
    return max([_SPEED, *own])


def write_parameters(file: Path, flown: AsFlown) -> list[Path]:
    """Write the parameters that a file of waypoints relies on beside it, a file for each autopilot.

    Args:
        file: of waypoints.
        flown: what `export` said of it.

    Returns:
        The files: `NAME_arducopter.param` for Mission Planner, `NAME_px4.params` for QGroundControl.

    Raises:
        OSError: if they cannot be written.
    """
    written = []
    for autopilot in flown.autopilots:
        ending, text = autopilot.parameter_file
        beside = file.with_name(f"{file.stem}_{autopilot.name}{ending}")
        atomic_write(beside, text)
        written.append(beside)
    return written


def _in_time(file: Path, trajectory: Trajectory, origin: LocalOrigin | None) -> str:
    motion = trajectory.sampled(_EVERY)
    if ending_of(file) == ".tum":
        return tum_text(motion)
    return setpoint_text(motion, origin)
