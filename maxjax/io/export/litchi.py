"""Waypoints for Litchi's Mission Hub: a line of CSV each, in metres.

Heights count from where the aircraft takes off (altitudemode 0). A hover is the action "stay for", in milliseconds, up
to 32 s each; photos are an action at a waypoint, or an interval of distance on the way on; what the nose points to is a
point of interest. What holds for all of a mission, its path mode and its heading mode among it, stands outside of the
file.
"""

from __future__ import annotations

import math

from maxjax.io.export.stops import StopFlight, StopPoint
from maxjax.planning.look import AimedLook

_ACTIONS, _STAY, _LONGEST = 15, 0, 32_000  # of a waypoint; "stay for"; of one of them [ms]
_PHOTO, _INTERPOLATE = 1, 2  # "take photo"; the gimbal mode that has an angle
_HEAD = (
    "latitude,longitude,altitude(m),heading(deg),curvesize(m),rotationdir,gimbalmode,gimbalpitchangle,"
    + "".join(f"actiontype{k},actionparam{k}," for k in range(1, _ACTIONS + 1))
    + "altitudemode,speed(m/s),poi_latitude,poi_longitude,poi_altitude(m),poi_altitudemode,"
    + "photo_timeinterval,photo_distinterval"
)


def litchi_text(flight: StopFlight) -> str:
    """The text of a `_litchi.csv` file."""
    rows, every = [_HEAD], 0.0
    for point in flight.points:
        # The interval of a waypoint is that of the way on, be there others on it.
        every = every if point.look is None or point.look.every is None else point.look.every
        rows.append(_row(point, every))
    return "\n".join(rows) + "\n"


def _row(point: StopPoint, every: float) -> str:
    left, actions = math.ceil(1000.0 * point.hover), list[str]()
    look = AimedLook() if point.look is None else point.look
    while left > 0:
        actions += [str(_STAY), str(min(left, _LONGEST))]
        left -= _LONGEST
    actions += [str(_PHOTO), "0"] if look.photo else []
    actions += ["-1", "0"] * (_ACTIONS - len(actions) // 2)
    heading = point.course if point.heading is None else point.heading
    place = [f"{point.latitude:.10f}", f"{point.longitude:.10f}", f"{point.height:.4f}", f"{heading:.2f}"]
    aim = ["0", "0"] if look.pitch is None else [str(_INTERPOLATE), f"{math.degrees(look.pitch):.2f}"]
    there = point.aim
    seen = ["0", "0"] if there is None else [f"{there.latitude:.10f}", f"{there.longitude:.10f}"]
    interval = f"{every:.6g}" if every > 0.0 else "-1"
    return ",".join([*place, "0", "0", *aim, *actions, "0", f"{point.speed:.6g}", *seen, "0", "0", "-1", interval])
