"""Where the nose points, as files of waypoints say it.

    a point of interest    itself                                        DO_SET_ROI_LOCATION, `poi` columns, towardPOI
    a heading              a point so far ahead that it hardly moves     likewise, and the heading of the waypoint

Autopilots that store no heading of a waypoint (ArduCopter) keep a region of interest over all that follow, until it is
taken back. One mechanism so serves them all. A heading is off by 0.6 degrees at most within 100 m of the waypoint.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from maxjax.io.export.mission_item import courses_of
from maxjax.io.geo.earth import Earth
from maxjax.planning.mission import Mission
from maxjax.planning.waypoint import Waypoint

_AHEAD = 10_000.0  # [m]


@dataclasses.dataclass(frozen=True)
class AimOnEarth:
    """What the nose points to.

    Attributes:
        latitude, longitude: [degrees].
        height: above the ellipsoid or the sea, as `earth.geodetic` has it [m].
        heading: from the waypoint there [degrees from true north, 0 to 360]; None where it stands above or below.
    """

    latitude: float
    longitude: float
    height: float
    heading: float | None


def aims_of(mission: Mission, earth: Earth) -> list[AimOnEarth | None]:
    """What the nose points to on the leg to each waypoint, of the start while it rests there; None: along the course.

    A waypoint with a look is aimed with its camera, at the waypoint (`io.export.camera_items`), and has None here.

    Args:
        mission: in the map's coordinates.
        earth: where the map lies.
    """
    return [_aim(one, earth) if one.aims and one.look is None else None for one in mission.waypoints]


def _aim(waypoint: Waypoint, earth: Earth) -> AimOnEarth:
    here = np.array([waypoint.position])
    yaw = float(waypoint.yaw_from(here)[0])
    ahead = here + _AHEAD * np.array([[math.cos(yaw), math.sin(yaw), 0.0]])
    there = ahead if waypoint.look_at is None else np.array([waypoint.look_at])
    ((latitude, longitude, height),) = earth.geodetic(there).tolist()
    heading = None if math.isnan(yaw) else courses_of(earth.geodetic(np.concatenate([here, there])))[1]
    return AimOnEarth(latitude, longitude, height, heading)
