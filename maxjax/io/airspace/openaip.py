"""Airspaces of openAIP, as its interface and its exports have them: items, or features of GeoJSON.

    {"name": "CTR", "type": 4, "geometry": {"type": "Polygon", "coordinates": …},
     "lowerLimit": {"value": 0, "unit": 1, "referenceDatum": 0}, "upperLimit": {"value": 65, "unit": 6, …}}

    unit            0 m, 1 ft, 6 flight level
    referenceDatum  0 ground, 1 sea level, 2 standard pressure

All are kept out of, but for regions of information, which hold everywhere and restrict nothing. Where the file has a
second limit (`lowerLimitMin`, `upperLimitMax`), the zone has none there.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from maxjax.core.files import brief
from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.ed318 import is_geojson, parts_of, polygons_in
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
from maxjax.io.airspace.zone_shapes import zone_of_rings

_UNITS = {0: "m", 1: "ft", 6: "FL"}
_DATUMS = {0: "AGL", 1: "AMSL", 2: "STD"}
_INFORMATION = {10: "FIR", 11: "UIR", 33: "FIS sector"}
_COORDINATES = Coordinates(closed=False, split=False)
_LIMITS = ("lowerLimit", "upperLimit", "lowerCeiling", "upperCeiling")


def is_openaip(file: ZoneFile) -> bool:
    """Whether a file holds items with limits as openAIP has them."""
    return any(isinstance(values.get(limit), dict) for values, _ in _items(file) for limit in _LIMITS)


def read_openaip(file: ZoneFile) -> Published:
    """Airspaces of openAIP."""
    zones, left_out = list[Zone](), Counter[str]()
    for number, (values, geometry) in enumerate(_items(file)):
        kind = values.get("type")
        if isinstance(kind, int) and kind in _INFORMATION:
            left_out[f"regions of information ({_INFORMATION[kind]})"] += 1
            continue
        name = quote(values.get("name"), values.get("_id"), number)
        try:
            for part, _ in parts_of(geometry, None):
                zones.append(_zone(name, values, part))
        except MALFORMED as error:
            zones.append(unclear(name, error))
    return Published(tuple(zones), left_out)


def _items(file: ZoneFile) -> list[tuple[dict[str, Any], Any]]:
    """Properties and geometry of each item; what is none has neither."""
    given = file.document
    items: Any = given.get("items") if isinstance(given, dict) else given
    if is_geojson(file):
        features = given.get("features", [given])
        features = features if isinstance(features, list) else []
        items = [{**_dict(_dict(one).get("properties")), "geometry": _dict(one).get("geometry")} for one in features]
    return [(_dict(one), _dict(one).get("geometry")) for one in items] if isinstance(items, list) else []


def _dict(given: Any) -> dict[str, Any]:
    """The object itself; an empty one for anything else."""
    return given if isinstance(given, dict) else {}


def _zone(name: str, values: dict[str, Any], part: dict[str, Any]) -> Zone:
    """The zone of one geometry of an item."""
    return zone_of_rings(
        name,
        _COORDINATES,
        polygons_in(part),
        lambda: (_limit(values, "lower", "Min"), _limit(values, "upper", "Max")),
        timed=bool(values.get("hoursOfOperation") or values.get("byNotam") or values.get("onRequest")),
    )


def _limit(values: dict[str, Any], end: str, second: str) -> Limit | None:
    """The lower or the upper limit of an item."""
    given = values.get(f"{end}Limit") or values.get(f"{end}Ceiling")
    if given is None or values.get(f"{end}Limit{second}"):
        return None
    unit, datum = given.get("unit"), given.get("referenceDatum")
    for code, known in ((unit, _UNITS), (datum, _DATUMS)):
        if not isinstance(code, str) and (isinstance(code, bool) or code not in known):
            raise UnclearError(f"expected codes of a unit and a datum in {end}Limit, found {brief(repr(given))}")
    return limit_of(given.get("value"), _UNITS.get(unit, unit), _DATUMS.get(datum, datum), end)
