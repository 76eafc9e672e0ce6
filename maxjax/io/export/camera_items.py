"""Camera and gimbal as MAVLink's mission items, before and after the waypoints that they belong to.

    aim            before the waypoint          photo           after it: taken when the hold there is over
    PX4            DO_GIMBAL_MANAGER_PITCHYAW; the heading is the waypoint's own
    ArduCopter     DO_MOUNT_CONTROL, CONDITION_YAW: its waypoints have no heading
    for both       DO_SET_ROI_LOCATION, a place on the line of sight, to which both turn vehicle and gimbal
    a photo        IMAGE_START_CAPTURE          by distance     DO_SET_CAM_TRIGG_DIST, 0 to end

ArduCopter begins the first item after a waypoint before it turns to the next one, and the others behind that: a photo
comes first, so that it is taken at rest, and a heading last, or the next waypoint's start would undo it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64

from maxjax.io.export.mission_item import MISSION, RELATIVE, Item, true_heading
from maxjax.io.geo.earth import Earth
from maxjax.planning.look import AimedLook

YAW, ROI, ROI_NONE, MOUNT, TRIGGER, PITCHYAW, CAPTURE = 115, 195, 197, 205, 206, 1000, 2000
AHEAD = 10.0
"""How far along a line of sight the place lies that is looked at [m]."""
_TARGETING = 2.0  # MAV_MOUNT_MODE_MAVLINK_TARGETING


@dataclasses.dataclass(frozen=True, eq=False)
class CameraItems:
    """Items of the looks along a path.

    Attributes:
        looks: by number of the path's point.
        path: in the map [m].
        earth: where the map lies.
        height: of the ground at home, as Earth counts it [m].
        names: of the autopilots that the file is for.
    """

    looks: Mapping[int, AimedLook]
    path: Float64[np.ndarray, "n 3"]
    earth: Earth
    height: float
    names: tuple[str, ...]

    def before(self, k: int) -> list[Item]:
        """Items that aim the camera for a point of the path."""
        look = self.looks.get(k)
        if look is None:
            return [_command(ROI_NONE)] if self._follows_roi(k) else []
        aims = look.pitch is not None and look.yaw is not None
        if aims and self.names not in (("px4",), ("arducopter",)):
            return [self._roi(k, look)]
        found = []
        if look.pitch is not None:
            pitch = math.degrees(look.pitch)
            if self.names == ("arducopter",):
                found.append(_command(MOUNT, pitch, 0.0, 0.0, 0.0, 0.0, 0.0, _TARGETING))
            else:
                found.append(_command(PITCHYAW, pitch, 0.0, math.nan, math.nan))
        if look.yaw is not None and self.names == ("arducopter",):
            found.append(_command(YAW, self.heading(k, look.yaw)))
        return found

    def after(self, k: int) -> list[Item]:
        """Items that take photos at a point of the path, or from there on."""
        look = self.looks.get(k, AimedLook())
        found = []
        if look.photo:
            number = sum(self.looks[j].photo for j in self.looks if j <= k)
            found.append(_command(CAPTURE, 0.0, 0.0, 1.0, float(number)))
        if look.every is not None:
            found.append(_command(TRIGGER, look.every, 0.0, float(look.every > 0.0)))
        return found

    def heading(self, k: int, yaw: float) -> float:
        """A yaw at a point of the path, in degrees from true north."""
        return true_heading(self.earth, self.path[k], yaw)

    def _follows_roi(self, k: int) -> bool:
        """Whether the camera still looks at a place that it was to look at before."""
        earlier = [j for j in self.looks if j < k]
        last = self.looks[max(earlier)] if earlier else AimedLook()
        both = self.names not in (("px4",), ("arducopter",))
        return both and last.pitch is not None and last.yaw is not None and max(earlier) == k - 1

    def _roi(self, k: int, look: AimedLook) -> Item:
        pitch, yaw = look.pitch or 0.0, look.yaw or 0.0
        way = np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)])
        north, east, up = self.earth.geodetic((self.path[k] + AHEAD * way)[None])[0].tolist()
        return Item(ROI, RELATIVE, (0.0, 0.0, 0.0, 0.0, north, east, up - self.height))


def _command(number: int, *params: float) -> Item:
    """An item that is no place."""
    return Item(number, MISSION, (*params, *(0.0,) * (7 - len(params))))
