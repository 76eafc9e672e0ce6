"""OpenStreetMap in protocol buffers (.osm.pbf), by osmium (extra `gis`): the elements of `osm_elements`.

Read twice, since relations come last: once for the ways that they are made of, once for everything with tags. The
places of nodes that have none stay in osmium.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from maxjax.core.files import FileError, brief, check_regular
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.readers.osm_elements import Element, Elements, check_plain, solids_in
from maxjax.io.reading import PLAIN, Reading

_MISSING = "reading .osm.pbf needs the extra gis: pip install 'maxjax[gis]'"


def load_pbf(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Standing objects of a .osm.pbf file.

    Raises:
        FileError: if the extra is missing, the file is damaged, or holds nothing with a height; if a reference system
            or a unit is given.
    """
    check_plain(reading, path)
    check_regular(path)
    try:
        import osmium
    except ImportError as error:
        raise FileError(f"{path}: {_MISSING}") from error
    elements, parts = Elements(), set[int]()
    try:
        relations: Iterable[Any] = osmium.FileProcessor(str(path), osmium.osm.RELATION)
        for relation in relations:
            parts |= {member.ref for member in relation.members if member.type == "w"}
        things: Iterable[Any] = osmium.FileProcessor(str(path)).with_locations()
        for thing in things:
            if not thing.deleted and (len(thing.tags) or (thing.is_way() and thing.id in parts)):
                elements.add(_element(thing, elements))
    except FileError:
        raise
    except Exception as error:  # of a library that says so in many classes
        raise FileError(f"{path}: expected an intact .osm.pbf file: {brief(error)}") from error
    return solids_in(elements, reading, path)


def _element(thing: Any, elements: Elements) -> Element:
    """An element of osmium; the places of its corners are kept where they are in the file."""
    tags = {tag.k: tag.v for tag in thing.tags}
    if thing.is_node():
        name = f"n{thing.id}"
        elements.nodes[name] = (thing.location.lon, thing.location.lat)
        return Element("node", name, tags=tags)
    if thing.is_way():
        corners = []
        for node in thing.nodes:
            corners.append(str(node.ref))
            if node.location.valid():
                elements.nodes[corners[-1]] = (node.location.lon, node.location.lat)
        return Element("way", str(thing.id), corners, tags=tags)
    members = [member for member in thing.members if member.type == "w"]
    return Element(
        "relation", str(thing.id), [str(member.ref) for member in members], [member.role for member in members], tags
    )
