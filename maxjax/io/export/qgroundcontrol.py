"""QGroundControl's `.plan`: a mission as JSON, version 1 of the file and 2 of its mission."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.fences import Fence
from maxjax.io.export.items import Items
from maxjax.io.export.mission_item import RELATIVE, Item

_FIRMWARE = {"px4": 12, "arducopter": 3}  # MAV_AUTOPILOT
_QUADROTOR = 2  # MAV_TYPE
_ALTITUDE_RELATIVE = 1


def plan_text(
    mission: Items,
    fences: Sequence[Fence] = (),
    autopilots: Sequence[Autopilot] = (),
    remarks: Sequence[str] = (),
) -> str:
    """The text of a `.plan` file.

    Args:
        mission: what to do.
        fences: around it.
        autopilots: for whom it was judged; their parameters stand in it. The first one is whom it is made for.
        remarks: sentences that stand in it, for whoever reads it; ground stations pass over them.
    """
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "maxjax": {
            "parameters": {one.name: dict(one.parameters) for one in autopilots},
            "remarks": list(remarks),
        },
        "mission": {
            "version": 2,
            "firmwareType": _FIRMWARE[autopilots[0].name if autopilots else "px4"],
            "vehicleType": _QUADROTOR,
            "cruiseSpeed": mission.speed,
            "hoverSpeed": mission.speed,
            "plannedHomePosition": list(mission.home),
            "items": [_item(k, item) for k, item in enumerate(mission.items, 1)],
        },
        "geoFence": {"version": 2, "circles": [], "polygons": [_polygon(fence) for fence in fences]},
        "rallyPoints": {"version": 2, "points": [] if mission.rally is None else [list(mission.rally)]},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _polygon(fence: Fence) -> dict[str, Any]:
    return {"inclusion": fence.inclusion, "polygon": fence.corners.tolist(), "version": 1}


def _item(number: int, item: Item) -> dict[str, Any]:
    content: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        # JSON has no NaN: QGroundControl takes null for it.
        "params": [None if value is None or math.isnan(value) else value for value in item.params],
    }
    if item.frame == RELATIVE:
        height = item.params[-1]
        content |= {"AMSLAltAboveTerrain": None, "Altitude": height, "AltitudeMode": _ALTITUDE_RELATIVE}
    return content
