"""A mission as MAVLink's mission items, which two file formats hold.

Every point of the path is a NAV_WAYPOINT in the frame GLOBAL_RELATIVE_ALT: latitude, longitude, and height above home;
where the mission hovers, it holds for that time. A DO_CHANGE_SPEED stands before a leg whose speed is another one.

A vehicle takes a waypoint for reached within its acceptance radius and turns to the next one, so that this is how far
it may cut a corner; by default autopilots take several metres, which no plan has to spare. What happens before the
first and after the last waypoint (take-off, landing) is not planned, and not written.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax.core.earth import Earth
from maxjax.planning.mission import Mission

# MAVLink's numbers.
WAYPOINT, CHANGE_SPEED = 16, 178
GLOBAL, MISSION, RELATIVE = 0, 2, 3
_GROUND_SPEED, _SAME_THROTTLE = 1.0, -1.0
_ACCEPTANCE = 0.5  # [m]


@dataclasses.dataclass(frozen=True)
class Item:
    """A mission item.

    Attributes:
        command, frame: MAVLink's numbers.
        params: seven; the last three are latitude, longitude [degrees] and height [m] where it is a place. None: the
            vehicle's own choice.
    """

    command: int
    frame: int
    params: tuple[float | None, ...]


@dataclasses.dataclass(frozen=True)
class Items:
    """What an autopilot is sent.

    Attributes:
        home: latitude, longitude [degrees] and height above sea level [m] of where it is armed.
        speed: of the first leg [m/s].
        items: what to do, in order.
    """

    home: tuple[float, float, float]
    speed: float
    items: tuple[Item, ...]


def items_of(mission: Mission, earth: Earth, speed: float, ground: float = 0.0) -> Items:
    """The items of a mission.

    Args:
        mission: one that is OK, in the map's coordinates.
        earth: where the map lies.
        speed: of legs that have none of their own, and the most of those that have [m/s].
        ground: height [m] of the ground at home, below the first point, in the map's coordinates.
    """
    path = mission.path
    foot = np.array([[path[0, 0], path[0, 1], ground]])
    latitude, longitude, height = earth.geodetic(foot)[0].tolist()
    holds = dict(zip(mission.places.tolist(), (waypoint.hover or 0.0 for waypoint in mission.waypoints), strict=True))
    places = [
        Item(WAYPOINT, RELATIVE, (holds.get(k, 0.0), _ACCEPTANCE, 0.0, None, north, east, up - height))
        for k, (north, east, up) in enumerate(earth.geodetic(path).tolist())
    ]
    speeds = [min(waypoint.speed or speed, speed) for waypoint in mission.waypoints[1:]]
    items, last = [], None
    for k, own in enumerate(speeds):
        if own != last:
            items.append(Item(CHANGE_SPEED, MISSION, (_GROUND_SPEED, own, _SAME_THROTTLE, 0.0, 0.0, 0.0, 0.0)))
        items += places[mission.places[k] + (k > 0) : mission.places[k + 1] + 1]
        last = own
    return Items((latitude, longitude, height), speeds[0], tuple(items))
