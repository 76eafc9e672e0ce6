"""A path as MAVLink's mission items, which two file formats hold.

Every point of the path is a NAV_WAYPOINT in the frame GLOBAL_RELATIVE_ALT: latitude, longitude, and height above home.
A vehicle takes a waypoint for reached within its acceptance radius and turns to the next one, so that this is how far
it may cut a corner; by default autopilots take several metres, which no plan has to spare. What happens before the
first and after the last waypoint (take-off, landing) is not planned, and not written.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.missions.earth import Earth

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
class Waypoints:
    """A mission.

    Attributes:
        home: latitude, longitude [degrees] and height above sea level [m] of where it is armed.
        speed: to fly at [m/s].
        items: what to do, in order.
    """

    home: tuple[float, float, float]
    speed: float
    items: tuple[Item, ...]


def waypoints(path: Float64[np.ndarray, "n 3"], earth: Earth, speed: float, ground: float = 0.0) -> Waypoints:
    """A mission along a path.

    Args:
        path: [m], the map's coordinates.
        earth: where the map lies.
        speed: to fly at [m/s].
        ground: height [m] of the ground at home, below the first point, in the map's coordinates.
    """
    foot = np.array([[path[0, 0], path[0, 1], ground]])
    latitude, longitude, height = earth.geodetic(foot)[0].tolist()
    places = earth.geodetic(path)
    items = [Item(CHANGE_SPEED, MISSION, (_GROUND_SPEED, speed, _SAME_THROTTLE, 0.0, 0.0, 0.0, 0.0))]
    items += [
        Item(WAYPOINT, RELATIVE, (0.0, _ACCEPTANCE, 0.0, None, north, east, up - height))
        for north, east, up in places.tolist()
    ]
    return Waypoints((latitude, longitude, height), speed, tuple(items))
