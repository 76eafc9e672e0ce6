"""A mission to a vehicle and back: every item that it stores is compared with the one that was sent.

ArduCopter keeps its own home in place of the first item, and of a waypoint no acceptance radius and no yaw; its hold
counts whole seconds (`io.export.autopilot`).
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from typing import Any

from maxjax.io.export.camera_items import ROI
from maxjax.io.export.items import CHANGE_SPEED, LAND, TAKE_OFF, WAYPOINT
from maxjax.link.errors import LinkError
from maxjax.link.vehicle import Vehicle

_TRIES = 3
_PLACED = (WAYPOINT, LAND, TAKE_OFF)
_TURN = 2.0  # in the last digit of a degree, 1e-7: a centimetre or two
_HEIGHT = 0.02  # ArduCopter stores centimetres [m]


async def transfer(vehicle: Vehicle, plan: str) -> list[Any]:
    """Send the mission, the fence and the rally points of a `.plan`, and read the mission back.

    Args:
        vehicle: to send it to.
        plan: text of the file.

    Returns:
        The mission's items, as MAVSDK has them.

    Raises:
        LinkError: if something is refused, or an item comes back as another one.
    """
    from mavsdk.plugins.mission_raw import MissionRawError

    missions = vehicle.missions
    try:
        found = await asyncio.to_thread(missions.import_qgroundcontrol_mission_from_string, plan)
    except MissionRawError as error:
        raise LinkError(f"mission: MAVSDK does not read it ({error.result.name})", holds=False) from error
    sent = list(found.mission_items)
    await _retried("mission", missions.upload_mission, sent)
    for what, upload, items in (
        ("fence", missions.upload_geofence, found.geofence_items),
        ("rally points", missions.upload_rally_points, found.rally_items),
    ):
        if items:
            await _retried(what, upload, items)
    stored = await _retried("mission", missions.download_mission)
    ardupilot = vehicle.modes.label == "ArduCopter"
    if wrong := differences(sent, stored, ardupilot=ardupilot):
        raise LinkError(
            f"mission: expected {vehicle.modes.label} to store what it was sent, {wrong[0]}"
            + (f", and {len(wrong) - 1} more" if len(wrong) > 1 else "")
            + "; nothing was armed: look at its firmware and its parameters",
            holds=False,
        )
    return sent


async def _retried(what: str, action: Any, *given: Any) -> Any:
    """A transfer, which is tried again where packets are lost, or a doubled one of the transfer before breaks it."""
    from mavsdk.plugins.mission_raw import MissionRawError, MissionRawResult

    for left in reversed(range(_TRIES)):
        try:
            return await asyncio.to_thread(action, *given)
        except MissionRawError as error:
            lost = error.result in (MissionRawResult.TIMEOUT, MissionRawResult.PROTOCOL_ERROR)
            if lost and left:
                continue
            said = error.result.name.lower().replace("_", " ")
            hint = "come nearer, or use a better radio" if lost else "the autopilot does not fly such items"
            items = f"{len(given[0])} items" if given else "a request for its items"
            raise LinkError(
                f"{what}: expected the vehicle to answer {items}, given: {said}; nothing was armed: {hint}", holds=False
            ) from error
    raise AssertionError("unreachable")


def differences(sent: Sequence[Any], stored: Sequence[Any], *, ardupilot: bool) -> list[str]:
    """What differs between items, a phrase each.

    Args:
        sent, stored: items of MAVLink, with the fields of MISSION_ITEM_INT.
        ardupilot: whether the first one is the vehicle's own home, and waypoints keep their hold alone.
    """
    if len(sent) != len(stored):
        return [f"given {len(stored)} items for {len(sent)}"]
    found = []
    for k, (ours, theirs) in enumerate(zip(sent, stored, strict=True)):
        if ardupilot and k == 0:
            continue
        for name in _compared(ours, ardupilot=ardupilot):
            expected, given = float(getattr(ours, name)), float(getattr(theirs, name))
            if ardupilot and name == "param1":
                expected = math.floor(expected)
            if not (math.isnan(expected) or abs(expected - given) <= _allowed(name)):
                found.append(f"item {k}: expected {name} {expected:.9g}, given {given:.9g}")
    return found


def _compared(item: Any, *, ardupilot: bool) -> tuple[str, ...]:
    if item.command == ROI:
        return "command", "frame", "x", "y", "z"
    if item.command not in _PLACED:
        return ("command", "param2") if item.command == CHANGE_SPEED else ("command", "param1", "param2")
    if ardupilot:
        return ("command", "frame", "param1", "x", "y", "z") if item.command == WAYPOINT else ("command", "frame", "z")
    return ("command", "frame", "param1", "param2", "param3", "param4", "x", "y", "z")


def _allowed(name: str) -> float:
    return {"x": _TURN, "y": _TURN, "z": _HEIGHT}.get(name, 1e-4)
