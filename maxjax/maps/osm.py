"""Buildings of OpenStreetMap XML as footprints with heights.

    east = N(φ₀) cos φ₀ (λ − λ₀)        north = M(φ₀) (φ − φ₀)

the plane that touches the WGS 84 ellipsoid at the origin (λ₀, φ₀), the middle of the buildings: N and M are its radii
of curvature along the parallel and the meridian. Meridians converge: at Los Angeles a point 1 km from the origin is off
by up to 0.1 m, and a window of 200 m that near to it is distorted by two centimetres at most.

Taken are closed ways and multipolygon relations tagged `building` or `building:part`. Height: `height` [m], else
3 m for each of `building:levels`. Floor: `ele`; else, where Los Angeles County's import gives an `elevation`, that less
the height, for there it is the roof's (over the blocks of Venice it rises with the height, one to one); else 0. What
hangs in the air (`min_height`) is taken as solid down to the floor.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from maxjax.maps.footprints import Footprint, Footprints, chain, localised
from maxjax.maps.model import MapError, read_bytes

_LEVEL = 3.0  # height of a storey [m]
_NUMBER = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*m?\s*")
# WGS 84: equatorial radius [m], first eccentricity squared.
_RADIUS, _ECCENTRICITY = 6_378_137.0, 6.694379990141317e-3


def load_osm(path: Path) -> Footprints:
    """Buildings of an OSM XML file; buildings without a height or a closed outline are counted and left out.

    Raises:
        MapError: if the file is missing, too large, not XML, not OSM of version 0.6, malformed, or holds no building
            with a height.
    """
    try:
        root = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise MapError(f"{path}: expected XML: {error}") from error
    if root.tag != "osm" or root.get("version") != "0.6":
        raise MapError(f"{path}: expected <osm version='0.6'>, found <{root.tag} version={root.get('version')!r}>")
    try:
        return _read(root, path)
    except (KeyError, ValueError) as error:
        if isinstance(error, MapError):
            raise
        raise MapError(f"{path}: malformed OSM: {type(error).__name__}: {error}") from error


def _read(root: ElementTree.Element, path: Path) -> Footprints:
    nodes = {n.attrib["id"]: (float(n.attrib["lon"]), float(n.attrib["lat"])) for n in root.iterfind("node")}
    ways = {w.attrib["id"]: [nd.attrib["ref"] for nd in w.iterfind("nd")] for w in root.iterfind("way")}
    found: list[Footprint] = []
    skipped = 0
    for element in [*root.iterfind("way"), *root.iterfind("relation")]:
        tags = {tag.attrib["k"]: tag.attrib["v"] for tag in element.iterfind("tag")}
        if {tags.get("building", "no"), tags.get("building:part", "no")} == {"no"}:
            continue
        if element.tag == "relation" and tags.get("type") != "multipolygon":
            continue
        members = (
            [element.attrib["id"]]
            if element.tag == "way"
            else [m.attrib["ref"] for m in element.iterfind("member") if m.attrib["type"] == "way"]
        )
        # A way that the extract cut off has no nodes here, and its outline does not close.
        steps = [step for way in members for step in zip(ways.get(way, []), ways.get(way, [])[1:], strict=False)]
        rings, height = chain(steps), _height(tags)
        if rings is None or height is None or not all(node in nodes for ring in rings for node in ring):
            skipped += 1
            continue
        floor, roof = _number(tags, "ele"), _number(tags, "elevation")
        base = floor if floor is not None else 0.0 if roof is None else roof - height
        degrees = tuple(np.array([nodes[node] for node in ring]) for ring in rings)
        found.append(Footprint(degrees, base, base + height, f"{element.tag} {element.attrib['id']}"))
    if not found:
        return localised(found, np.zeros((0, 3, 3)), skipped, path)  # raises
    corners = np.concatenate([ring for building in found for ring in building.rings])
    middle = 0.5 * (corners.min(0) + corners.max(0))
    metres = tuple(Footprint(tuple(project(ring, middle) for ring in b.rings), b.base, b.top, b.name) for b in found)
    return Footprints(metres, np.zeros((0, 3, 3)), np.array([*middle, 0.0]), skipped, path.name)


def project(degrees: Float[np.ndarray, "n 2"], origin: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
    """Longitude and latitude [degrees] to east and north of the origin [m]."""
    latitude = math.radians(origin[1])
    root = math.sqrt(1.0 - _ECCENTRICITY * math.sin(latitude) ** 2)
    across, along = _RADIUS / root, _RADIUS * (1.0 - _ECCENTRICITY) / root**3
    metres: np.ndarray = np.radians(degrees - origin) * np.array([across * math.cos(latitude), along])
    return metres


def _height(tags: Mapping[str, str]) -> float | None:
    """Height above the floor [m]; None where it is not given or not above zero."""
    levels = _number(tags, "building:levels")
    height = _number(tags, "height") or (None if levels is None else _LEVEL * levels)
    return height if height is not None and height > 0 else None


def _number(tags: Mapping[str, str], key: str) -> float | None:
    """A tag's value in metres; None where it is missing or in words or other units."""
    match = _NUMBER.fullmatch(tags.get(key, ""))
    return None if match is None else float(match[1])
