"""A MAVLink mission item, and courses over ground for it."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float64

from maxjax.io.geo.earth import Earth, TangentPlane

GLOBAL, MISSION, RELATIVE = 0, 2, 3
"""Frames by MAVLink's numbers."""
_UPRIGHT = 1e-3  # from one point to the next, below which a way has no course [m]


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


def courses_of(places: Float64[np.ndarray, "n 3"]) -> list[float]:
    """Course of the way to each point, and from the first one [degrees from true north, 0 to 360].

    An upright way has that of the one before, the first ones that of the first that leads anywhere; without any, 0.

    Args:
        places: latitude, longitude [degrees] and height [m].
    """
    found: list[float | None] = [None]
    for here, there in itertools.pairwise(places):
        ((east, north, _),) = TangentPlane(*here.tolist()).local(there[None]).tolist()
        upright = math.hypot(east, north) < _UPRIGHT
        found.append(found[-1] if upright else math.degrees(math.atan2(east, north)) % 360.0)
    first = next((course for course in found if course is not None), 0.0)
    return [first if course is None else course for course in found]


def true_heading(earth: Earth, place: Float64[np.ndarray, "3"], yaw: float) -> float:
    """A yaw of the map [rad] at a place of it [m], in degrees from true north, clockwise."""
    ahead = place + np.array([math.cos(yaw), math.sin(yaw), 0.0])
    return courses_of(earth.geodetic(np.stack([place, ahead])))[1]
