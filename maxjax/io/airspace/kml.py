"""Zones of KML, and of KMZ, which is KML in a ZIP archive: the polygons of all placemarks, to keep out of.

    clampToGround, or without extrude      all heights
    relativeToGround with extrude 1        from the ground to the highest third coordinate above it
    absolute with extrude 1                from the ground to the highest third coordinate above sea level

KML has no word for a zone: an outline that hangs at a height is closed at all. A LinearRing on its own is an outline,
too. Points, lines and pictures have no area, and are counted; documents with a type, and so with entities, are refused.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from maxjax.core.files import FileError, brief
from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.zone import (
    MALFORMED,
    Limit,
    Published,
    Zone,
    ZoneFile,
    limit_of,
    quote,
    unclear,
)
from maxjax.io.airspace.zone_shapes import zone_of_rings
from maxjax.io.archives import DAMAGED_ZIP

_COORDINATES = Coordinates(closed=False, split=False)
_MOST_BYTES = 2**26  # of KML in an archive
_MOST_FILES = 10_000
_DEEPEST = 64
_ZIP = b"PK\x03\x04"
_BLANK = b"\xef\xbb\xbf\xff\xfe\0 \t\r\n"
_COMMA = re.compile(r"\s*,\s*")
_AREAS = ("Polygon", "LinearRing")
_WITHOUT_AREA = ("Point", "LineString", "Track", "MultiTrack", "Model")
_OTHERS = ("GroundOverlay", "PhotoOverlay", "ScreenOverlay", "NetworkLink")


def is_kmz(file: ZoneFile) -> bool:
    """Whether a file is a ZIP archive."""
    return file.content.startswith(_ZIP)


def is_kml(file: ZoneFile) -> bool:
    """Whether a file is XML."""
    return file.content.lstrip(_BLANK).startswith(b"<")


def read_kmz(file: ZoneFile) -> Published:
    """Zones of all KML in an archive.

    Raises:
        FileError: if the archive is damaged, holds no KML, or more of it than 64 MiB.
    """
    zones, left_out = list[Zone](), Counter[str]()
    try:
        with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
            members = archive.infolist()
            chosen = [member for member in members if Path(member.filename).suffix.lower() == ".kml"]
            size = sum(member.file_size for member in chosen)
            if len(members) > _MOST_FILES or size > _MOST_BYTES:
                raise FileError(
                    f"{file.path}: expected at most {_MOST_FILES} files and {_MOST_BYTES} bytes of KML in the archive, "
                    f"found {len(members)} and {size}; crop it"
                )
            if not chosen:
                raise FileError(f"{file.path}: expected a .kml in the archive (KMZ), found none")
            for member in chosen:
                with archive.open(member) as stream:
                    content = stream.read(_MOST_BYTES + 1)
                if len(content) > _MOST_BYTES:
                    raise FileError(f"{file.path}: {brief(member.filename)} holds more than it says; damaged")
                found = read_kml(ZoneFile(file.path, content, None))
                zones += found.zones
                left_out.update(found.left_out)
    except DAMAGED_ZIP as error:
        raise FileError(f"{file.path}: expected an intact ZIP archive (KMZ): {brief(error)}") from error
    return Published(tuple(zones), left_out)


def read_kml(file: ZoneFile) -> Published:
    """Zones of KML.

    Raises:
        FileError: if it is no XML, or XML of something else.
    """
    root = _parsed(file)
    zones, left_out = list[Zone](), Counter[str]()
    for number, mark in enumerate(_all(root, "Placemark")):
        name = quote(_text(mark, "name"), mark.get("id"), number)
        for shape in _shapes(mark):
            if shape.tag in _AREAS:
                zones.append(_zone(name, shape))
            else:
                left_out[f"{shape.tag} placemarks, which have no area"] += 1
    for kind in _OTHERS:
        if count := len(_all(root, kind)):
            left_out[f"{kind} elements"] += count
    return Published(tuple(zones), left_out)


def _zone(name: str, shape: Element) -> Zone:
    """The zone of a polygon or a ring."""
    try:
        if shape.tag == "LinearRing":
            rings = [shape]
        else:
            rings = [ring for edge in ("outerBoundaryIs", "innerBoundaryIs") for ring in _rings(shape, edge)]
        lines = [_points(_text(ring, "coordinates") or "") for ring in rings]
    except MALFORMED as error:
        return unclear(name, error)
    return zone_of_rings(name, _COORDINATES, [lines], lambda: (None, _upper(shape, lines)))


def _upper(shape: Element, lines: list[list[list[str]]]) -> Limit | None:
    """Where a zone ends; None where it does not."""
    mode = _text(shape, "altitudeMode") or "clampToGround"
    solid = _text(shape, "extrude") in ("1", "true")
    reference = {"relativeToGround": "AGL", "absolute": "AMSL"}.get(mode)
    if not solid or reference is None:
        return None
    limits = [limit_of(point[2], "m", reference, "altitude") for line in lines for point in line if len(point) > 2]
    heights = [limit.value for limit in limits if limit is not None]
    if not heights or (reference == "AGL" and max(heights) <= 0.0):
        return None
    return Limit(max(heights), "m", reference)


def _points(text: str) -> list[list[str]]:
    """Points of coordinates."""
    return [point.split(",") for point in _COMMA.sub(",", text).split()]


def _shapes(mark: Element) -> list[Element]:
    """The geometries of a placemark, those of collections one by one."""
    found, waiting = list[Element](), list(mark)
    while waiting:
        element = waiting.pop(0)
        if element.tag in ("MultiGeometry", "MultiPolygon"):
            waiting = [*element, *waiting]
        elif element.tag in (*_AREAS, *_WITHOUT_AREA):
            found.append(element)
    return found


def _rings(shape: Element, edge: str) -> list[Element]:
    """The rings of a polygon's outer or inner edge."""
    return [ring for one in shape if one.tag == edge for ring in one if ring.tag == "LinearRing"]


def _text(element: Element, tag: str) -> str | None:
    """The text of a child; None without it."""
    return next(((one.text or "").strip() for one in element if one.tag == tag), None)


def _all(root: Element, tag: str) -> list[Element]:
    return [element for element in root.iter() if element.tag == tag]


def _parsed(file: ZoneFile) -> Element:
    """The elements of a file, without the prefixes of their names."""
    builder, depth = TreeBuilder(), 0

    def start(name: str, given: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise FileError(f"{file.path}: expected elements within {_DEEPEST} levels, found more; damaged")
        builder.start(name.rpartition(":")[2], given)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name.rpartition(":")[2])

    def refuse(*_: Any) -> None:
        raise FileError(f"{file.path}: expected no document type and no entities, found some")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(file.content, True)
        root = builder.close()
    except (expat.ExpatError, LookupError) as error:
        raise FileError(f"{file.path}: expected KML, which is XML: {brief(error)}") from error
    if root.tag != "kml":
        raise FileError(
            f"{file.path}: expected KML, found XML of <{brief(root.tag)[:80]}>; save it as KML or as ED-318 (GeoJSON)"
        )
    return root
