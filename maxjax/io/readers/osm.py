"""OpenStreetMap XML: whatever stands (`standing`), as solids on a plane (`tagged`).

Taken are ways, nodes and relations (`osm_elements`), from exports, editors, and Overpass with or without `out geom`,
which writes the places of corners into ways and relations. The file is read as a stream, so that memory holds its nodes
and ways only; it is UTF-8, without a document type and so without entities. What was deleted in an editor is not there.
"""

from __future__ import annotations

from pathlib import Path
from xml.parsers import expat

from maxjax.core.files import FileError, read_text
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.readers.osm_elements import Element, Elements, check_plain, is_deleted, solids_in
from maxjax.io.reading import PLAIN, Reading

_DEEPEST = 16
_ENCODINGS = ("utf-8", "utf8", "us-ascii", "ascii")


def load_osm(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Standing objects of an OSM XML file; those without a height or a closed outline are counted by their kind.

    Raises:
        FileError: if the file is missing, too large, not XML, not OSM of version 0.6, malformed, or holds nothing with
            a height; if a reference system or a unit is given.
    """
    check_plain(reading, path)
    content = _Content(path)
    parser = expat.ParserCreate("utf-8")  # whatever is declared: what is not UTF-8 is refused
    parser.XmlDeclHandler = content.declare
    parser.StartDoctypeDeclHandler = content.refuse
    parser.StartElementHandler = content.start
    parser.EndElementHandler = content.end
    try:
        parser.Parse(read_text(path), True)
    except expat.ExpatError as error:
        raise FileError(f"{path}: expected XML: {error}") from error
    except (KeyError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: malformed OSM: {type(error).__name__}: {error}") from error
    return solids_in(content.elements, reading, path)


class _Content:
    """Nodes, ways and relations as they come by."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.depth = 0
        self.elements = Elements()
        self.open: Element | None = None
        self.outline: list[str] | None = None  # of a member that has its own corners

    def declare(self, _version: str, encoding: str | None, _standalone: int) -> None:
        if encoding and encoding.lower() not in _ENCODINGS:
            raise FileError(f"{self.path}: expected the encoding UTF-8, found {encoding!r}")

    def refuse(self, *_: object) -> None:
        raise FileError(f"{self.path}: expected no document type and no entities, found some")

    def start(self, name: str, given: dict[str, str]) -> None:
        self.depth += 1
        if self.depth == 1:
            if name != "osm" or given.get("version") != "0.6":
                raise FileError(
                    f"{self.path}: expected <osm version='0.6'>, found <{name} version={given.get('version')!r}>"
                )
        elif self.depth > _DEEPEST:
            raise FileError(f"{self.path}: expected elements within {_DEEPEST} levels, found more; damaged")
        elif self.depth == 2 and not is_deleted(given):
            if name == "node":
                self.elements.nodes[given["id"]] = (float(given["lon"]), float(given["lat"]))
            if name in self.elements.found:
                self.open = Element(name, given["id"])
        elif self.depth == 3 and self.open is not None:
            self._part(self.open, name, given)
        elif self.depth == 4 and name == "nd" and self.outline is not None and "lat" in given:
            self.outline.append(self.elements.place(float(given["lon"]), float(given["lat"])))

    def _part(self, element: Element, name: str, given: dict[str, str]) -> None:
        """A tag, a corner of a way or a member of a relation."""
        if name == "tag":
            element.tags[given["k"]] = given["v"]
        elif (element.kind, name) == ("way", "nd"):
            corner = given.get("ref", "")
            if "lat" in given:
                place = (float(given["lon"]), float(given["lat"]))
                corner = corner or self.elements.place(*place)
                self.elements.nodes[corner] = place
            element.members.append(corner)
        elif name == "member" and given["type"] == "way":
            element.members.append(given["ref"])
            element.roles.append(given.get("role", ""))
            self.outline = []

    def end(self, _name: str) -> None:
        self.depth -= 1
        if self.depth == 2 and self.open is not None and self.outline is not None:
            if self.outline:
                self.elements.outlines.setdefault(self.open.members[-1], self.outline)
            self.outline = None
        if self.depth == 1:
            if self.open is not None:
                self.elements.add(self.open)
            self.open = None
