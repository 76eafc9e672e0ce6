"""Waypoints for Litchi's Mission Hub: a line of CSV each, in metres.

Heights count from where the aircraft takes off (altitudemode 0). A hover is the action "stay for", in milliseconds, up
to 32 s each; what the nose points to is a point of interest. What holds for all of a mission, its path mode and its
heading mode among it, stands outside of the file.
"""

from __future__ import annotations

import math

from maxjax.io.export.stops import StopFlight, StopPoint

_ACTIONS, _STAY, _LONGEST = 15, 0, 32_000  # of a waypoint; "stay for"; of one of them [ms]
_HEAD = (
    "latitude,longitude,altitude(m),heading(deg),curvesize(m),rotationdir,gimbalmode,gimbalpitchangle,"
    + "".join(f"actiontype{k},actionparam{k}," for k in range(1, _ACTIONS + 1))
    + "altitudemode,speed(m/s),poi_latitude,poi_longitude,poi_altitude(m),poi_altitudemode,"
    + "photo_timeinterval,photo_distinterval"
)


def litchi_text(flight: StopFlight) -> str:
    """The text of a `_litchi.csv` file."""
    return "\n".join([_HEAD, *map(_row, flight.points)]) + "\n"


def _row(point: StopPoint) -> str:
    left, actions = math.ceil(1000.0 * point.hover), list[str]()
    while left > 0:
        actions += [str(_STAY), str(min(left, _LONGEST))]
        left -= _LONGEST
    actions += ["-1", "0"] * (_ACTIONS - len(actions) // 2)
    place = [f"{point.latitude:.10f}", f"{point.longitude:.10f}", f"{point.height:.4f}", f"{point.course:.2f}"]
    turn_and_gimbal, rest = ["0", "0", "0", "0"], ["0", "0", "0", "0", "-1", "-1"]
    if point.aim is not None:
        rest[:2] = [f"{point.aim.latitude:.10f}", f"{point.aim.longitude:.10f}"]
    return ",".join([*place, *turn_and_gimbal, *actions, "0", f"{point.speed:.6g}", *rest])
