"""Zones of GeoJSON in words of ED-318 (EUROCAE) and of QGroundControl.

    {"type": "Feature", "properties": {"name": "school", "type": "PROHIBITED", "lower": 0, "lowerReference": "AGL",
     "upper": 120, "upperReference": "AMSL", "uom": "m"}, "geometry": {"type": "Polygon", "coordinates": …}}

Limits stand among the properties, or as ED-318 has them in the `layer` of the geometry, of which a GeometryCollection
has several. A Point is a circle by its `extent`, or by a property `radius` [m]. `inclusion: true` is a zone to keep in;
any other is kept out of, but for the type NO_RESTRICTION, which is left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from maxjax.core.files import brief
from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.zone import (
    MALFORMED,
    Limit,
    Published,
    UnclearError,
    Zone,
    ZoneFile,
    inclusion_of,
    limit_of,
    quote,
    unclear,
)
from maxjax.io.airspace.zone_shapes import zone_of_circle, zone_of_rings
from maxjax.io.geo.earth import geojson_crs

FREE = "NO_RESTRICTION"
_DEEPEST = 8
_THIN = ("MultiPoint", "LineString", "MultiLineString")  # what has no area


def is_geojson(file: ZoneFile) -> bool:
    """Whether a file is GeoJSON of features."""
    return isinstance(file.document, dict) and file.document.get("type") in ("FeatureCollection", "Feature")


def features_of(file: ZoneFile) -> list[Any]:
    """The features of GeoJSON.

    Raises:
        UnclearError: if they are no list.
    """
    found = file.document.get("features", [file.document])
    if not isinstance(found, list):
        raise UnclearError(f"expected a list of features, found {brief(repr(found))[:80]}")
    return found


def read_ed318(file: ZoneFile) -> Published:
    """Zones of GeoJSON; raises a ValueError where nothing in it can be read."""
    coordinates = Coordinates(crs=geojson_crs(file.document, file.path))
    zones, left_out = list[Zone](), Counter[str]()
    for number, feature in enumerate(features_of(file)):
        name = quote(number)
        try:
            values = feature.get("properties") or {}
            if str(values.get("type", "")).upper() == FREE:
                left_out[f"zones that restrict nothing ({FREE})"] += 1
                continue
            name = quote(values.get("name"), values.get("identifier"), feature.get("id"), number)
            inclusion_of(values.get("inclusion", False))
            for part, layer in parts_of(feature.get("geometry"), values):
                if part["type"] in _THIN or (part["type"] == "Point" and _radius(part, values) is None):
                    left_out[f"{part['type']} features, which have no area"] += 1
                else:
                    zones.append(_zone(name, part, layer, values, coordinates))
        except MALFORMED as error:
            zones.append(unclear(name, error))
    return Published(tuple(zones), left_out)


def parts_of(geometry: Any, layer: Any, depth: int = 0) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """The geometries of a geometry, each with what holds its limits.

    Raises:
        UnclearError: for one of no known type.
    """
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon", "Point", "GeometryCollection", *_THIN) or depth > _DEEPEST:
        raise UnclearError(f"expected a Polygon, a MultiPolygon or a Point with an extent, found {brief(repr(kind))}")
    layer = geometry.get("layer") or layer
    if kind != "GeometryCollection":
        yield geometry, layer
        return
    if not geometry["geometries"]:
        raise UnclearError("expected a Polygon in a GeometryCollection, found none")
    for part in geometry["geometries"]:
        yield from parts_of(part, layer, depth + 1)


def polygons_in(geometry: dict[str, Any]) -> Any:
    """Lists of rings of a Polygon or a MultiPolygon.

    Raises:
        UnclearError: for another geometry.
    """
    if geometry["type"] not in ("Polygon", "MultiPolygon"):
        raise UnclearError(f"expected a Polygon or a MultiPolygon, found a {geometry['type']}")
    return [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]


def _zone(
    name: str, part: dict[str, Any], layer: dict[str, Any], values: dict[str, Any], coordinates: Coordinates
) -> Zone:
    """The zone of one geometry of a feature."""
    kept = values.get("inclusion", False)
    timed = bool(values.get("limitedApplicability"))
    if part["type"] == "Point":
        circle = part["coordinates"], _radius(part, values)
        return zone_of_circle(name, coordinates, circle, lambda: _limits(layer), keep_in=kept, timed=timed)
    rings = polygons_in(part)
    return zone_of_rings(name, coordinates, rings, lambda: _limits(layer), keep_in=kept, timed=timed)


def _limits(layer: dict[str, Any]) -> tuple[Limit | None, Limit | None]:
    """The lower and the upper limit of a layer."""
    low, high = (
        limit_of(layer.get(end), layer.get("uom"), layer.get(f"{end}Reference"), end) for end in ("lower", "upper")
    )
    return low, high


def _radius(part: dict[str, Any], values: dict[str, Any]) -> Any:
    """The radius of a point's circle, as the file has it; None for a point without one."""
    extent = part.get("extent")
    if extent is None:
        return values.get("radius")
    if not str(extent.get("subType", "circle")).lower().startswith("circle"):
        raise UnclearError(f"expected an extent of subType Circle, found {brief(repr(extent.get('subType')))}")
    radius = extent.get("radius")
    return "" if radius is None else radius
