"""A mission as MAVLink's mission items, which two file formats hold.

Every point of the path is a NAV_WAYPOINT in the frame GLOBAL_RELATIVE_ALT: latitude, longitude, and height above home;
where the mission hovers, it holds for that time. A DO_CHANGE_SPEED stands before a leg whose speed is another one. The
fourth parameter, the heading, is the course over ground of the way to the point, in degrees from true north. Where a
waypoint says where the nose points, a DO_SET_ROI_LOCATION stands before its leg (`io.export.aiming`), and the heading
is that; a DO_SET_ROI_NONE takes it back.

Where a waypoint says so, the camera is aimed before it and takes photos after it (`io.export.camera_items`); its fourth
parameter is then the heading to look at.

PX4 takes a waypoint for reached within the acceptance radius of its item and turns to the next one; ArduCopter has a
radius of its own (`io.export.autopilot`). Where a corner may not be cut (`io.export.corners`), a hold makes the vehicle
stop. Take-off and landing are upright ways to the first and from the last point, where they are asked for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from maxjax.io.export.aiming import AimOnEarth, aims_of
from maxjax.io.export.camera_items import ROI, ROI_NONE, CameraItems
from maxjax.io.export.mission_item import MISSION, RELATIVE, Item, courses_of
from maxjax.io.geo.earth import Earth
from maxjax.planning.mission import Mission, looks_of

# MAVLink's numbers.
WAYPOINT, LAND, TAKE_OFF, CHANGE_SPEED = 16, 21, 22, 178
_GROUND_SPEED, _SAME_THROTTLE = 1.0, -1.0
_ACCEPTANCE = 0.5  # [m]


@dataclasses.dataclass(frozen=True)
class Items:
    """An item for an autopilot.

    Attributes:
        home: latitude, longitude [degrees] and height above sea level [m] of where it is armed.
        speed: of the first leg [m/s].
        items: what to do, in order.
        rally: latitude, longitude [degrees] and height above home [m] of where a return to launch leads; None: home.
    """

    home: tuple[float, float, float]
    speed: float
    items: tuple[Item, ...]
    rally: tuple[float, float, float] | None = None


@dataclasses.dataclass(frozen=True)
class Feet:
    """Heights of the ground [m], in the map's coordinates.

    Attributes:
        home: below the first point.
        landing: of the ground or the roof below the last point, where there is a landing; None where there is none.
        takes_off: whether there is a take-off.
    """

    home: float
    landing: float | None = None
    takes_off: bool = False


def items_of(
    mission: Mission,
    earth: Earth,
    speed: float,
    feet: Feet,
    stops: Mapping[int, float] = MappingProxyType({}),
    names: tuple[str, ...] = (),
) -> Items:
    """The items of a mission.

    Args:
        mission: one that is OK, in the map's coordinates.
        earth: where the map lies.
        speed: of legs that have none of their own, and the most of those that have [m/s].
        feet: where the ground is.
        stops: how long to hold at points of the path, at least, by number [s].
        names: of the autopilots that are to fly them.
    """
    path = mission.path
    latitude, longitude, height = earth.geodetic(np.array([[path[0, 0], path[0, 1], feet.home]]))[0].tolist()
    on_earth = earth.geodetic(path)
    courses, aims = courses_of(on_earth), aims_of(mission, earth)
    holds = dict(zip(mission.places.tolist(), (waypoint.hover or 0.0 for waypoint in mission.waypoints), strict=True))
    headed = _headed(courses, aims, mission)
    camera = CameraItems(looks_of(mission), path, earth, height, names)

    def place(k: int) -> list[Item]:
        look, (north, east, up) = camera.looks.get(k), on_earth[k].tolist()
        course = headed[k] if look is None or look.yaw is None else camera.heading(k, look.yaw)
        hold = max(holds.get(k, 0.0), stops.get(k, 0.0))
        waypoint = Item(WAYPOINT, RELATIVE, (hold, _ACCEPTANCE, 0.0, course, north, east, up - height))
        return [*camera.before(k), waypoint, *camera.after(k)]

    speeds = [min(waypoint.speed or speed, speed) for waypoint in mission.waypoints[1:]]
    items, last, aim = list[Item](), None, None
    for leg, own in enumerate(speeds):
        if own != last:
            items.append(Item(CHANGE_SPEED, MISSION, (_GROUND_SPEED, own, _SAME_THROTTLE, 0.0, 0.0, 0.0, 0.0)))
        if leg == 0:
            items += [*_turn(None, aims[0], height), *place(int(mission.places[0]))]
            aim = aims[0]
        items += _turn(aim, aims[leg + 1], height)
        for k in range(mission.places[leg] + 1, mission.places[leg + 1] + 1):
            items += place(k)
        last, aim = own, aims[leg + 1]
    if feet.takes_off:
        north, east, up = on_earth[0].tolist()
        items.insert(0, Item(TAKE_OFF, RELATIVE, (0.0, 0.0, 0.0, courses[0], north, east, up - height)))
    if feet.landing is not None:
        foot = earth.geodetic(np.array([[path[-1, 0], path[-1, 1], feet.landing]]))[0].tolist()
        items.append(Item(LAND, RELATIVE, (0.0, 0.0, 0.0, courses[-1], foot[0], foot[1], foot[2] - height)))
    return Items((latitude, longitude, height), speeds[0], tuple(items))


def _headed(courses: list[float], aims: list[AimOnEarth | None], mission: Mission) -> list[float]:
    """Headings of all points of the path: the courses, or the aim's of the leg to each."""
    found = list(courses)
    for first, last, aim in zip([-1, *mission.places[:-1].tolist()], mission.places.tolist(), aims, strict=True):
        if aim is not None and aim.heading is not None:
            found[first + 1 : last + 1] = [aim.heading] * (last - first)
    return found


def _turn(before: AimOnEarth | None, aim: AimOnEarth | None, home: float) -> list[Item]:
    """What turns the nose from one aim to another; heights count from home's [m]."""
    if aim == before:
        return []
    if aim is None:
        return [Item(ROI_NONE, MISSION, (0.0,) * 7)]
    return [Item(ROI, RELATIVE, (0.0, 0.0, 0.0, 0.0, aim.latitude, aim.longitude, aim.height - home))]
