"""What has to hold before anything is sent that moves a vehicle, each waited for or refused with a sentence.

A vehicle shows "healthy" before its first check: its estimator and its local position have to be there as well.
"""

from __future__ import annotations

import math

import numpy as np

from maxjax.io.export.setpoints import LocalOrigin
from maxjax.io.geo.earth import Earth
from maxjax.link.errors import LinkError
from maxjax.link.frame import LocalFrame
from maxjax.link.vehicle import Vehicle

_PREARM = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
_ESTIMATES = {1: "attitude", 2: "horizontal velocity", 16: "horizontal position", 32: "height"}
_IN_AIR = (2, 3, 4)  # MAV_LANDED_STATE
_FRESH = 1.0  # [s]


async def wait_until_ready(vehicle: Vehicle, seconds: float) -> None:
    """Wait until a vehicle stands on the ground, disarmed, and knows where it is.

    Raises:
        LinkError: if it is armed or in the air, or not ready within so many seconds.
    """
    label = vehicle.modes.label
    _check_at_rest(vehicle)
    if not await vehicle.until(lambda: not _missing(vehicle), seconds):
        raise LinkError(
            f"{label}: expected it ready within {seconds:g} s, still without {', '.join(_missing(vehicle))}"
            f"{vehicle.said}; "
            "wait for its position under open sky and clear its checks",
            holds=False,
        )
    _check_at_rest(vehicle)


def _check_at_rest(vehicle: Vehicle) -> None:
    """Raise a `LinkError` for a vehicle that is in use."""
    label, place = vehicle.modes.label, vehicle.last("GLOBAL_POSITION_INT")
    height = f", {1e-3 * place['relative_alt']:.1f} m above home" if place else ""
    if vehicle.last("EXTENDED_SYS_STATE").get("landed_state", 1) in _IN_AIR:
        raise LinkError(
            f"{label}: expected it on the ground, it flies ({vehicle.modes.name_of(vehicle.mode)}{height}); "
            "nothing was sent to it: land and disarm it first",
            holds=False,
        )
    if vehicle.armed:
        raise LinkError(
            f"{label}: expected it disarmed, it is armed ({vehicle.modes.name_of(vehicle.mode)}{height}); "
            "nothing was sent to it: disarm it first",
            holds=False,
        )


def _missing(vehicle: Vehicle) -> list[str]:
    """What a vehicle is not ready for."""
    found = []
    for name, said in (("LOCAL_POSITION_NED", "local position"), ("GLOBAL_POSITION_INT", "global position")):
        if not vehicle.last(name) or vehicle.age(name) > _FRESH:
            found.append(f"{said} ({name})")
    estimate = vehicle.last("EKF_STATUS_REPORT") or vehicle.last("ESTIMATOR_STATUS")
    flags = int(estimate.get("flags", 0))
    absent = [said for bit, said in _ESTIMATES.items() if not flags & bit]
    if absent:
        found.append(f"an estimate of {', '.join(absent)} (EKF)")
    status = vehicle.last("SYS_STATUS")
    checked = int(status.get("onboard_control_sensors_present", 0)) & _PREARM
    if not status or (checked and not int(status["onboard_control_sensors_health"]) & _PREARM):
        found.append("passed pre-arm checks (SYS_STATUS)")
    return found


def frame_at_home(
    vehicle: Vehicle, earth: Earth, start: tuple[float, float], ground: float, apart: float
) -> LocalFrame:
    """The frame of a vehicle that stands at home, on the ground below the start.

    Args:
        vehicle: one that is ready.
        earth: where the map lies.
        start: x and y of the start in the map [m].
        ground: height of the ground there [m].
        apart: how far from there it may stand [m].

    Raises:
        LinkError: if it stands elsewhere.
    """
    place, local = vehicle.last("GLOBAL_POSITION_INT"), vehicle.last("LOCAL_POSITION_NED")
    latitude, longitude = 1e-7 * place["lat"], 1e-7 * place["lon"]
    home = np.array([[*start, ground]])
    north, east, height = earth.geodetic(home)[0].tolist()
    ((x, y, _),) = earth.local(np.array([[latitude, longitude, height]])).tolist()
    distance = math.hypot(x - start[0], y - start[1])
    if not distance <= apart:
        raise LinkError(
            f"home: expected the vehicle within {apart:g} m of the start, latitude {north:.7f}, longitude {east:.7f}, "
            f"it stands {distance:.1f} m away, at {latitude:.7f}, {longitude:.7f}; carry it there, or plan from there",
            holds=False,
        )
    offset = np.array([local["x"], local["y"], local["z"]], np.float64)
    return LocalFrame(LocalOrigin((x, y, ground), earth), offset)
