"""The FAA's UAS Facility Maps, as GeoJSON of its portal: cells with the height up to which a flight may be granted.

{"properties": {"CEILING": 200, "UNIT": "Feet", "APT1_NAME": …}, "geometry": {"type": "Polygon", …}}

closed = above CEILING feet over the ground of the cell
"""

from __future__ import annotations

from typing import Any

from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.ed318 import features_of, is_geojson, parts_of, polygons_in
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
from maxjax.io.geo.earth import geojson_crs

_CEILING = "CEILING"


def is_facility_map(file: ZoneFile) -> bool:
    """Whether a feature of GeoJSON has a CEILING."""
    if not is_geojson(file):
        return False
    found = file.document.get("features", [file.document])
    features = [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    return any(isinstance(one.get("properties"), dict) and _CEILING in one["properties"] for one in features)


def read_facility_map(file: ZoneFile) -> Published:
    """The closed part of each cell."""
    coordinates = Coordinates(crs=geojson_crs(file.document, file.path))
    zones = list[Zone]()
    for number, feature in enumerate(features_of(file)):
        name = quote(number)
        try:
            values = feature.get("properties") or {}
            airport = (values.get(f"APT1_{key}") for key in ("NAME", "ICAO", "FAAID"))
            name = quote(f"cell {values.get('OBJECTID', number)} {next(filter(None, airport), '')}".strip())
            for part, _ in parts_of(feature.get("geometry"), None):
                zones.append(_cell(name, values, part, coordinates))
        except MALFORMED as error:
            zones.append(unclear(name, error))
    return Published(tuple(zones))


def _cell(name: str, values: dict[str, Any], part: dict[str, Any], coordinates: Coordinates) -> Zone:
    """The part of a cell above its ceiling."""
    return zone_of_rings(name, coordinates, polygons_in(part), lambda: _limits(values))


def _limits(values: dict[str, Any]) -> tuple[Limit, None]:
    """What is closed begins at the ceiling, and does not end."""
    lower = limit_of(values.get(_CEILING), values.get("UNIT") or "ft", "AGL", _CEILING)
    if lower is None:
        raise UnclearError(f"expected a {_CEILING} in feet, found none")
    return lower, None
