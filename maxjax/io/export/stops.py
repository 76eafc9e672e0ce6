"""Waypoints at each of which a vehicle stops, as the programs for DJI's aircraft take them.

    path → places on Earth with heights above home, the course of the way on, the time to hover, the speed of the way on

Nothing is rounded at a corner: the lines between the waypoints are what is flown. These programs take waypoints that
are not too near to one another: one that lies on the line between its neighbours, to `_ASIDE`, is left out where it is.
Where that is not enough, bends of the path are left out as in files of waypoints (`io.export.thinning`), by the least
tolerance that is: lines that remain come no nearer to anything.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from maxjax.io.export.aiming import AimOnEarth, aims_of
from maxjax.io.export.mission_item import courses_of, true_heading
from maxjax.io.export.thinning import thinnings
from maxjax.io.geo.earth import Earth
from maxjax.planning.look import AimedLook
from maxjax.planning.mission import Mission, looks_of
from maxjax.trajectories.clear_curve import project

_ASIDE = 0.01  # of the line by which a waypoint may be missed that is left out [m]


@dataclasses.dataclass(frozen=True)
class StopLimits:
    """What a program takes.

    Attributes:
        program: its name.
        points: most of them.
        apart: least distance from one to the next [m].
        speed: greatest [m/s].
        heights: least and greatest above home [m].
        hover: longest [s].
    """

    program: str
    points: int
    apart: float
    speed: float
    heights: tuple[float, float]
    hover: float


LIMITS = {
    ".kmz": StopLimits("DJI's WPML", 65536, 0.5, 15.0, (-1500.0, 1500.0), math.inf),
    "_litchi.csv": StopLimits("Litchi", 99, 0.5, 15.0, (-200.0, 500.0), 15 * 32.0),
}


@dataclasses.dataclass(frozen=True)
class StopPoint:
    """A waypoint.

    Attributes:
        latitude, longitude: [degrees].
        height: above the ground at home [m].
        course: of the way on, of the last one that to it [degrees from true north].
        aim: what the nose points to on the way on, at the last one that to it; None: along the course.
        hover: how long [s].
        speed: of the way on [m/s].
        look: what is done with the camera there; None: nothing.
        heading: to look at [degrees from true north]; None: that of the way.
    """

    latitude: float
    longitude: float
    height: float
    course: float
    hover: float
    speed: float
    aim: AimOnEarth | None = None
    look: AimedLook | None = None
    heading: float | None = None


@dataclasses.dataclass(frozen=True)
class StopFlight:
    """Waypoints and what is done before, after and in place of them.

    Attributes:
        points: in order.
        return_height: of a return to launch above home [m].
        lands: whether it lands below the last one.
    """

    points: tuple[StopPoint, ...]
    return_height: float
    lands: bool


def space_out(file: Path, mission: Mission, limits: StopLimits) -> Mission:
    """The mission without points of its path that stand too near to others, if lines without them are as clear.

    Raises:
        ValueError: where they are not, or there are too many points or too long a hover for a program.
    """
    found, near = _spaced(mission, limits.apart)
    if near is not None:
        for thinned in reversed([*thinnings(mission)]):
            found, nearer = _spaced(thinned, limits.apart)
            if nearer is None:
                break
        else:
            x, y, z = near.tolist()
            raise ValueError(
                f"{file}: expected waypoints {limits.apart:g} m apart for {limits.program}, given nearer ones at "
                f"x {x:.1f}, y {y:.1f}, z {z:.1f}; choose other waypoints, or write a .plan"
            )
    if len(found.path) > limits.points:
        raise ValueError(
            f"{file}: expected at most {limits.points} waypoints for {limits.program}, given {len(found.path)}; "
            "write a .kmz, or a mission of fewer legs"
        )
    hover = max((waypoint.hover or 0.0 for waypoint in mission.waypoints), default=0.0)
    if hover > limits.hover:
        raise ValueError(
            f"{file}: expected a hover of at most {limits.hover:g} s for {limits.program}, given {hover:g}"
        )
    return found


def _spaced(mission: Mission, apart: float) -> tuple[Mission, Float64[np.ndarray, "3"] | None]:
    """The mission without points that stand too near to others on its lines, and a place where some still do."""
    kept = list[int]()
    for first, last in zip(mission.places[:-1].tolist(), mission.places[1:].tolist(), strict=True):
        kept += _kept(mission.path, first, last, apart)
    kept.append(len(mission.path) - 1)
    path = mission.path[kept]
    gaps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    left_out = project(mission.path, path)[0]
    near = None
    if gaps.min() < apart:
        near = path[int(gaps.argmin())]
    elif left_out.max() > _ASIDE:
        near = mission.path[int(left_out.argmax())]
    return dataclasses.replace(mission, path=path, places=np.searchsorted(kept, mission.places)), near


def _kept(path: Float64[np.ndarray, "n 3"], first: int, last: int, apart: float) -> list[int]:
    """Numbers of the points of a leg that stay, without the last, which the next leg begins with."""
    found = [first]
    for k in range(first + 1, last):
        if min(math.dist(path[k], path[found[-1]]), math.dist(path[k], path[last])) >= apart:
            found.append(k)
        elif project(path[k : k + 1], path[[found[-1], k + 1]])[0][0] > _ASIDE:
            found.append(k)  # which the distance from one to the next then refuses
    return found


def stop_points(
    file: Path, mission: Mission, earth: Earth, home: float, speed: float, limits: StopLimits
) -> tuple[StopPoint, ...]:
    """The points of a mission's path.

    Args:
        file: for messages.
        mission: in the map's coordinates.
        earth: where the map lies.
        home: height of the ground there, in the map's coordinates [m].
        speed: of legs that have none of their own, and the most of those that have [m/s].
        limits: of the program.

    Raises:
        ValueError: for heights that the program does not take.
    """
    path = mission.path
    ground = float(earth.geodetic(np.array([[path[0, 0], path[0, 1], home]]))[0, 2])
    places = earth.geodetic(path) - np.array([0.0, 0.0, ground])
    low, high = limits.heights
    if places[:, 2].min() < low or places[:, 2].max() > high:
        wrong = places[:, 2].min() if places[:, 2].min() < low else places[:, 2].max()
        raise ValueError(
            f"{file}: expected heights from {low:g} to {high:g} m above home for {limits.program}, given {wrong:.1f} m"
        )
    courses, aims = courses_of(earth.geodetic(path)), aims_of(mission, earth)
    speeds = [min(waypoint.speed or speed, speed, limits.speed) for waypoint in mission.waypoints[1:]]
    hovers = dict(zip(mission.places.tolist(), (one.hover or 0.0 for one in mission.waypoints), strict=True))
    found, looks = [], looks_of(mission)
    for k, (latitude, longitude, height) in enumerate(places.tolist()):
        leg = min(int(np.searchsorted(mission.places, k, side="right")) - 1, len(speeds) - 1)
        course = courses[min(k + 1, len(path) - 1)]
        aim, look = aims[leg + 1], looks.get(k)
        if aim is not None and aim.heading is not None:
            course = aim.heading
        heading = None if look is None or look.yaw is None else true_heading(earth, path[k], look.yaw)
        hover = hovers.get(k, 0.0)
        found.append(StopPoint(latitude, longitude, height, course, hover, speeds[leg], aim, look, heading))
    return tuple(found)


def spacing_remarks(mission: Mission, spaced: Mission, limits: StopLimits) -> tuple[str, ...]:
    """A sentence where points are left out that do not lie on the lines that remain."""
    aside = float(project(mission.path, spaced.path)[0].max())
    if aside <= _ASIDE:
        return ()
    return (
        f"{len(mission.path) - len(spaced.path)} of {len(mission.path)} waypoints are left out, since "
        f"{limits.program} takes none nearer than {limits.apart:g} m to another: they lie up to {aside:.2f} m beside "
        "its lines, which come no nearer to anything",
    )


def speed_remarks(mission: Mission, speed: float, limits: StopLimits) -> Sequence[str]:
    """A sentence where legs are to be flown faster than a program takes."""
    fastest = max(min(waypoint.speed or speed, speed) for waypoint in mission.waypoints[1:])
    if fastest <= limits.speed:
        return ()
    return (f"{limits.program} takes speeds up to {limits.speed:g} m/s, and {fastest:g} m/s are asked for",)
