"""QGroundControl's `.plan`: a mission as JSON, version 1 of the file and 2 of its mission."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from maxjax.missions.fences import Fence
from maxjax.missions.items import RELATIVE, Item, Items

_PX4, _QUADROTOR = 12, 2  # MAV_AUTOPILOT and MAV_TYPE
_ALTITUDE_RELATIVE = 1


def plan_text(mission: Items, fences: Sequence[Fence] = ()) -> str:
    """The text of a `.plan` file: a mission, and the fences around it."""
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": _PX4,
            "vehicleType": _QUADROTOR,
            "cruiseSpeed": mission.speed,
            "hoverSpeed": mission.speed,
            "plannedHomePosition": list(mission.home),
            "items": [_item(k, item) for k, item in enumerate(mission.items, 1)],
        },
        "geoFence": {"version": 2, "circles": [], "polygons": [_polygon(fence) for fence in fences]},
        "rallyPoints": {"version": 2, "points": []},
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
        "params": list(item.params),
    }
    if item.frame == RELATIVE:
        height = item.params[-1]
        content |= {"AMSLAltAboveTerrain": None, "Altitude": height, "AltitudeMode": _ALTITUDE_RELATIVE}
    return content
