"""The geofence of a plan of QGroundControl: polygons and circles to stay inside of, or out of, at all heights.

    {"fileType": "Plan", "geoFence": {"polygons": [{"inclusion": true, "polygon": [[52.0, 4.3], …]}],
     "circles": [{"inclusion": false, "circle": {"center": [52.0, 4.3], "radius": 80}}]}}

Latitude comes first. Several fences to stay inside of open what lies in one of them, as PX4 takes them.
"""

from __future__ import annotations

from typing import Any

from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.zone import (
    MALFORMED,
    Published,
    UnclearError,
    Zone,
    ZoneFile,
    inclusion_of,
    no_limits,
    unclear,
)
from maxjax.io.airspace.zone_shapes import zone_of_circle, zone_of_rings

_COORDINATES = Coordinates(latitude_first=True, closed=False, split=False)


def is_plan(file: ZoneFile) -> bool:
    """Whether a file is a plan of QGroundControl."""
    given = file.document
    return isinstance(given, dict) and (given.get("fileType") == "Plan" or isinstance(given.get("geoFence"), dict))


def read_plan_fence(file: ZoneFile) -> Published:
    """The fences of a plan.

    Raises:
        UnclearError: if it has no geofence.
    """
    fence = file.document.get("geoFence")
    if not isinstance(fence, dict):
        raise UnclearError("expected a geoFence in the plan, found none; draw one in QGroundControl")
    zones = [_polygon(f"'fence polygon {k}'", one) for k, one in enumerate(fence.get("polygons") or [])]
    zones += [_circle(f"'fence circle {k}'", one) for k, one in enumerate(fence.get("circles") or [])]
    if fence.get("polygon"):  # version 1 has one, to stay inside of
        zones.append(_polygon("'fence'", {"inclusion": True, "polygon": fence["polygon"]}))
    kept = sum(zone.keep_in for zone in zones)
    remarks = (
        f"{kept} fences of {file.path.name} are to stay inside of: the way keeps inside of one of them; "
        "ArduPilot asks for all of them, unless FENCE_OPTIONS takes their union",
    )
    return Published(tuple(zones), remarks=remarks if kept > 1 else ())


def _polygon(name: str, given: Any) -> Zone:
    try:
        points = [[given["polygon"]]]
        return zone_of_rings(name, _COORDINATES, points, no_limits, keep_in=inclusion_of(given.get("inclusion")))
    except MALFORMED as error:
        return unclear(name, error)


def _circle(name: str, given: Any) -> Zone:
    try:
        kept, circle = inclusion_of(given.get("inclusion")), (given["circle"]["center"], given["circle"]["radius"])
        return zone_of_circle(name, _COORDINATES, circle, no_limits, keep_in=kept)
    except MALFORMED as error:
        return unclear(name, error)
