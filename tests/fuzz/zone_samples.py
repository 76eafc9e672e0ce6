"""Small files of zones in every published format, written from outlines in degrees: twins of public examples."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Sequence
from typing import Any

Ring = Sequence[Sequence[float]]  # longitude and latitude, closed
Limits = tuple[float, str, float, str, str]  # lower, reference, upper, reference, unit


def encoded(document: Any) -> bytes:
    return json.dumps(document).encode()


def collection(*features: Any, **more: Any) -> bytes:
    return encoded({"type": "FeatureCollection", "features": list(features), **more})


def layer_of(limits: Limits) -> dict[str, Any]:
    lower, below, upper, above, unit = limits
    return {"lower": lower, "lowerReference": below, "upper": upper, "upperReference": above, "uom": unit}


def ed318_feature(*geometries: dict[str, Any], **properties: Any) -> dict[str, Any]:
    """As EUROCAE's examples: a geometry, or a collection of layers."""
    whole = geometries[0] if len(geometries) == 1 else {"type": "GeometryCollection", "geometries": list(geometries)}
    known = {"identifier": "Z1", "country": "NLD", "name": [{"text": "school", "lang": "en-GB"}]}
    known |= {"variant": "COMMON", "type": "PROHIBITED", "reason": ["SENSITIVE"], "zoneAuthority": [{"name": "a"}]}
    return {"type": "Feature", "geometry": whole, "properties": known | properties}


def polygon(ring: Ring, limits: Limits | None = None) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [ring]} | ({} if limits is None else {"layer": layer_of(limits)})


def point(centre: Sequence[float], radius: Any, limits: Limits | None = None) -> dict[str, Any]:
    found: dict[str, Any] = {"type": "Point", "coordinates": list(centre)}
    found |= {"extent": {"subType": "Circle", "radius": radius}}
    return found | ({} if limits is None else {"layer": layer_of(limits)})


def ed269_volume(projection: dict[str, Any], limits: Limits) -> dict[str, Any]:
    lower, below, upper, above, unit = limits
    found = {"uomDimensions": unit.upper(), "lowerLimit": lower, "lowerVerticalReference": below}
    return found | {"upperLimit": upper, "upperVerticalReference": above, "horizontalProjection": projection}


def ed269(*features: dict[str, Any]) -> bytes:
    return encoded({"title": "zones", "description": "", "features": list(features)})


def ed269_feature(*volumes: dict[str, Any], **more: Any) -> dict[str, Any]:
    known = {"identifier": "NLD1", "country": "NLD", "name": "school", "type": "COMMON", "restriction": "PROHIBITED"}
    known |= {"reason": ["SENSITIVE"], "applicability": [{"permanent": "YES"}], "zoneAuthority": [{"name": "a"}]}
    return known | {"geometry": list(volumes)} | more


def openaip_item(ring: Ring, lower: tuple[float, int, int], upper: tuple[float, int, int], **more: Any) -> Any:
    keys = ("value", "unit", "referenceDatum")
    limits = {"lowerLimit": dict(zip(keys, lower, strict=True)), "upperLimit": dict(zip(keys, upper, strict=True))}
    known = {"_id": "62614a", "name": "CTR", "type": 4, "icaoClass": 3, "country": "NL", "geometry": polygon(ring)}
    return known | limits | more


def cell(ring: Ring, ceiling: Any, **more: Any) -> dict[str, Any]:
    """A cell of a UAS Facility Map."""
    values = {"OBJECTID": 7, "CEILING": ceiling, "UNIT": "Feet", "APT1_FAAID": "FCM", "APT1_NAME": "Flying Cloud"}
    return {"type": "Feature", "id": 7, "properties": values | more, "geometry": polygon(ring)}


def fence(*rings: tuple[Ring, bool], circles: Sequence[tuple[Sequence[float], float, bool]] = ()) -> bytes:
    """A plan of QGroundControl with a geofence; rings are not closed there, and latitude comes first."""
    areas = [{"inclusion": kept, "polygon": [[y, x] for x, y, *_ in ring[:-1]], "version": 1} for ring, kept in rings]
    rounds = [
        {"inclusion": kept, "circle": {"center": [y, x], "radius": radius}, "version": 1}
        for (x, y), radius, kept in circles
    ]
    document = {"fileType": "Plan", "version": 1, "groundStation": "QGroundControl"}
    document |= {"geoFence": {"circles": rounds, "polygons": areas, "version": 2}}  # type: ignore[dict-item]
    return encoded(document | {"mission": {"items": [], "version": 2}, "rallyPoints": {"points": [], "version": 2}})


def mark(shape: str, name: str = "school") -> str:
    return f"<Placemark><name>{name}</name>{shape}</Placemark>"


def kml_polygon(ring: Ring, height: float = 0.0, mode: str = "", extrude: int = 0, holes: Sequence[Ring] = ()) -> str:
    def text(line: Ring) -> str:
        corners = " ".join(f"{x!r},{y!r},{height:g}" for x, y, *_ in line)
        return f"<LinearRing><coordinates>\n{corners}\n</coordinates></LinearRing>"

    modes = (f"<extrude>{extrude}</extrude>" if extrude else "") + (
        f"<altitudeMode>{mode}</altitudeMode>" if mode else ""
    )
    inner = "".join(f"<innerBoundaryIs>{text(hole)}</innerBoundaryIs>" for hole in holes)
    return f"<Polygon>{modes}<outerBoundaryIs>{text(ring)}</outerBoundaryIs>{inner}</Polygon>"


def kml(*marks: str) -> bytes:
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">'
    return f"{head}<Document><Folder>{''.join(marks)}</Folder></Document></kml>".encode()


def kmz(content: bytes, name: str = "doc.kml") -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
        archive.writestr("files/icon.png", b"none")
    return buffer.getvalue()


def square(west: float, south: float, edge: float = 0.001) -> list[list[float]]:
    east, north = west + edge, south + edge
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


RING, SMALL = square(4.3, 52.0), square(4.3002, 52.0002, 0.0003)
HERE = (4.3005, 52.0005)
ABOVE_GROUND: Limits = (5, "AGL", 120, "AMSL", "m")
SAMPLES: dict[str, Callable[[], bytes]] = {
    "ed318.json": lambda: collection(
        ed318_feature(polygon(RING, ABOVE_GROUND), polygon(SMALL, (0, "AGL", 50, "AGL", "ft"))),
        ed318_feature(point(HERE, 40.0, (10, "WGS84", 90, "WGS84", "m"))),
    ),
    "ed269.json": lambda: ed269(
        ed269_feature(
            ed269_volume({"type": "Polygon", "coordinates": [RING]}, ABOVE_GROUND),
            ed269_volume({"type": "Circle", "center": list(HERE), "radius": 40.0}, (0, "AGL", 100, "AMSL", "ft")),
        )
    ),
    "zones.kml": lambda: kml(
        mark(kml_polygon(RING, 60.0, "relativeToGround", 1, [SMALL])),
        mark("<Point><coordinates>4,52</coordinates></Point>"),
    ),
    "zones.kmz": lambda: kmz(kml(mark(kml_polygon(RING, 60.0, "absolute", 1)))),
    "openaip.json": lambda: encoded(
        [openaip_item(RING, (0, 1, 0), (65, 6, 2)), openaip_item(SMALL, (9, 0, 1), (80, 1, 1))]
    ),
    "uasfm.geojson": lambda: collection(cell(RING, 100), cell(SMALL, 0)),
    "fence.plan": lambda: fence((RING, True), (SMALL, False), circles=[(HERE, 20.0, False)]),
}
