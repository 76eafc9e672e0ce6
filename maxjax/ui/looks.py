"""What a camera does at a waypoint, by the keys of a mission's file.

pitch = -30.0         of the gimbal [degrees], 0 level, -90 straight down
photo = true          one there, at rest
photo_every = 5.0     on the way on [m]; 0: none from there on
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from maxjax.planning.look import Look
from maxjax.planning.waypoint import Waypoint

LOOK_KEYS = ("pitch", "photo", "photo_every")


def look_of(table: Mapping[str, Any]) -> Look | None:
    """The look of a waypoint's keys, whose numbers are finite; None where it has none of them.

    Raises:
        ValueError: as `Look`.
    """
    given = {key: table[key] for key in LOOK_KEYS if key in table}
    if not given:
        return None
    pitch = math.radians(given["pitch"]) if "pitch" in given else None
    return Look(pitch, bool(given.get("photo", False)), given.get("photo_every"))


def waypoint_table(waypoint: Waypoint) -> dict[str, Any]:
    """A waypoint as JSON holds it: what it has, by the keys of a mission's file, its place as `position`.

    What it lands on is not in it: that is an option of the mission.
    """
    table = {
        field.name: getattr(waypoint, field.name)
        for field in dataclasses.fields(waypoint)
        if field.name not in ("look", "touchdown", "alternatives")
    }
    others = tuple(other.position for other in waypoint.choices[1:] if other.touchdown is None)
    table |= {"alternatives": others} if others else {}
    look = waypoint.look
    if look is None:
        return table
    told = {
        "pitch": None if look.pitch is None else round(math.degrees(look.pitch), 9),
        "photo": look.photo,
        "photo_every": look.every,
    }
    return table | {key: value for key, value in told.items() if value is not None}
