"""What a file does with a camera, read back: headings, elevations and photos at its waypoints.

Nothing here uses what writes the files. A heading comes from a place that is looked at, else from an item that turns
the vehicle, else from the waypoint itself; what holds at a waypoint holds for its photos.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float64

from maxjax.io.geo.earth import Earth, TangentPlane
from maxjax.planning.look import AimedLook

_WAYPOINT, _YAW, _ROI, _ROI_NONE, _MOUNT, _TRIGGER, _PITCHYAW, _CAPTURE = 16, 115, 195, 197, 205, 206, 1000, 2000
_PLACE = 3  # the frame of items that are places

Points = Float64[np.ndarray, "_ 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Aimed:
    """Where waypoints and places that are looked at lie.

    Attributes:
        earth: where the map lies.
        line: the waypoints, in the map [m].
        lifted: points of the map of places above home.
        home: of the file.
    """

    earth: Earth
    line: Points
    lifted: Callable[[Points, Points], Points]
    home: Points


@dataclasses.dataclass(frozen=True)
class HeadingLook:
    """What is done with a camera, its heading in degrees from true north."""

    heading: float | None
    look: AimedLook

    def turned(self, earth: Earth, place: Float64[np.ndarray, "3"]) -> AimedLook:
        """The look with its yaw in the map [rad]."""
        yaw = None if self.heading is None else yaw_of(earth, place, self.heading)
        return dataclasses.replace(self.look, yaw=yaw)


def yaw_of(earth: Earth, place: Float64[np.ndarray, "3"], heading: float) -> float:
    """The yaw in a map [rad] of a heading at a place of it [degrees from true north, clockwise]."""
    ((latitude, longitude, height),) = earth.geodetic(place[None]).tolist()
    turn = math.radians(heading)
    ahead = TangentPlane(latitude, longitude, height).geodetic(np.array([[math.sin(turn), math.cos(turn), 0.0]]))
    ((x, y, _),) = (earth.local(ahead) - place).tolist()
    return math.atan2(y, x)


def looks_in(items: Iterable[tuple[int, int, list[float]]], where: Aimed) -> dict[int, AimedLook]:
    """Looks at the waypoints of a file's items: command, frame and seven parameters each."""
    found = dict[int, AimedLook]()
    number, pitch, turn = -1, None, None
    target: Points | None = None
    for command, frame, params in items:
        if command == _ROI and frame == _PLACE:
            target = where.lifted(where.home, np.array([params[4:]], np.float64))[0]
        elif command == _ROI_NONE:
            target = None
        elif command in (_MOUNT, _PITCHYAW):
            pitch = math.radians(params[0])
        elif command == _YAW:
            turn = params[0]
        elif command == _WAYPOINT and frame == _PLACE:
            number += 1
            heading, turn = params[3] if turn is None else turn, None
            aimed = AimedLook(yaw_of(where.earth, where.line[number], heading), pitch)
            if target is not None:
                x, y, z = (target - where.line[number]).tolist()
                aimed = AimedLook(math.atan2(y, x), math.atan2(z, math.hypot(x, y)))
        elif command == _CAPTURE:
            found[number] = dataclasses.replace(aimed, photo=True, every=found.get(number, AimedLook()).every)
        elif command == _TRIGGER:
            before = found.get(number, AimedLook(pitch=aimed.pitch))
            found[number] = dataclasses.replace(before, every=float(params[0]))
    return found
