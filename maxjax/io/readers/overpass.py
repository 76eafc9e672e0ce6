"""OpenStreetMap as Overpass writes it in JSON: the elements of `osm_elements`, with or without places in them.

{"elements": [{"type": "way", "id": 7, "nodes": [1, 2, …], "geometry": [{"lat": …, "lon": …}, …], "tags": {…}}, …]}
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from maxjax.core.files import FileError, parse_json, read_text
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.readers.osm_elements import Element, Elements, check_plain, is_deleted, solids_in
from maxjax.io.reading import PLAIN, Reading


def load_overpass(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Standing objects of a JSON file of Overpass.

    Raises:
        FileError: if the file is missing, too large, malformed, or holds nothing with a height; if a reference system
            or a unit is given.
    """
    check_plain(reading, path)
    document = parse_json(read_text(path), path)
    if not isinstance(document, dict) or not isinstance(document.get("elements"), list):
        raise FileError(f"{path}: expected the elements of Overpass, found none")
    elements = Elements()
    try:
        for given in document["elements"]:
            if not is_deleted(given) and given["type"] in elements.found:
                _add(elements, given)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: malformed JSON of Overpass: {type(error).__name__}: {error}") from error
    return solids_in(elements, reading, path)


def _add(elements: Elements, given: dict[str, Any]) -> None:
    tags = {str(key): str(value) for key, value in (given.get("tags") or {}).items()}
    element = Element(given["type"], str(given["id"]), tags=tags)
    if element.kind == "node":
        elements.nodes[element.name] = (float(given["lon"]), float(given["lat"]))
    elif element.kind == "way":
        places = [_place(corner) for corner in given.get("geometry") or []]
        element.members = [str(name) for name in given.get("nodes") or []] or [
            f"{element.name} {k}" for k, _ in enumerate(places)
        ]
        elements.nodes |= {name: place for name, place in zip(element.members, places, strict=False) if place}
    else:
        for member in given.get("members") or []:
            if member["type"] == "way":
                name = str(member["ref"])
                element.members.append(name)
                element.roles.append(member.get("role", ""))
                places = [_place(corner) for corner in member.get("geometry") or []]
                if places and all(places):
                    elements.outlines.setdefault(name, [elements.place(*place) for place in places if place])
    elements.add(element)


def _place(corner: dict[str, Any] | None) -> tuple[float, float] | None:
    """Longitude and latitude of a corner; None for one that Overpass has cut off."""
    return None if corner is None else (float(corner["lon"]), float(corner["lat"]))
