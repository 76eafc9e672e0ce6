"""Zones of ED-269 (EUROCAE), the JSON before ED-318: each feature has volumes, of a polygon or a circle each.

    {"features": [{"name": "school", "restriction": "PROHIBITED", "geometry": [{"uomDimensions": "M",
     "lowerLimit": 0, "lowerVerticalReference": "AGL", "upperLimit": 120, "upperVerticalReference": "AGL",
     "horizontalProjection": {"type": "Circle", "center": [4.3, 52.0], "radius": 250}}]}]}

Radii are metres: some files have feet where the limits are in feet, and a metre is the longer of the two.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from maxjax.core.files import brief
from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.ed318 import FREE
from maxjax.io.airspace.zone import (
    MALFORMED,
    Limit,
    Published,
    UnclearError,
    Zone,
    ZoneFile,
    limit_of,
    quote,
    unclear,
)
from maxjax.io.airspace.zone_shapes import zone_of_circle, zone_of_rings

_COORDINATES = Coordinates(closed=False, split=False)


def is_ed269(file: ZoneFile) -> bool:
    """Whether a file is JSON of zones with lists of volumes."""
    return any(isinstance(zone, dict) and isinstance(zone.get("geometry"), list) for zone in _zones_in(file))


def read_ed269(file: ZoneFile) -> Published:
    """Zones of ED-269."""
    zones, left_out = list[Zone](), Counter[str]()
    for number, feature in enumerate(_zones_in(file)):
        name = quote(number)
        try:
            if str(feature.get("restriction", "")).upper() == FREE:
                left_out[f"zones that restrict nothing ({FREE})"] += 1
                continue
            name = quote(feature.get("name"), feature.get("identifier"), number)
            volumes = feature.get("geometry")
            if not isinstance(volumes, list) or not volumes:
                zones.append(unclear(name, UnclearError("expected a geometry of volumes, found none")))
                continue
            times = feature.get("applicability") or []
            times = [times] if isinstance(times, dict) else times
            timed = not all(str(one.get("permanent", "")).upper() == "YES" for one in times)
            zones += [_zone(name, volume, timed) for volume in volumes]
        except MALFORMED as error:
            zones.append(unclear(name, error))
    return Published(tuple(zones), left_out)


def _zones_in(file: ZoneFile) -> list[Any]:
    """The zones of a file: its features, or a list of some other name or of none."""
    given = file.document
    if isinstance(given, dict):
        given = next((given[key] for key in ("features", "UASZoneList") if key in given), [given])
    return given if isinstance(given, list) else []


def _zone(name: str, volume: dict[str, Any], timed: bool) -> Zone:
    """The zone of one volume."""
    shape = volume["horizontalProjection"]
    kind = shape.get("type")
    if kind == "Circle":
        circle = shape.get("center"), shape.get("radius")
        return zone_of_circle(name, _COORDINATES, circle, lambda: _limits(volume), timed=timed)
    if kind != "Polygon":
        return unclear(name, UnclearError(f"expected a Polygon or a Circle, found {brief(repr(kind))}"))
    return zone_of_rings(name, _COORDINATES, [shape.get("coordinates")], lambda: _limits(volume), timed=timed)


def _limits(volume: dict[str, Any]) -> tuple[Limit | None, Limit | None]:
    """The lower and the upper limit of a volume."""
    unit = volume.get("uomDimensions")
    low, high = (
        limit_of(volume.get(f"{end}Limit"), unit, volume.get(f"{end}VerticalReference"), end)
        for end in ("lower", "upper")
    )
    return low, high
