"""Buildings of OpenStreetMap XML as footprints with heights (`tags`) on a plane (`degrees`).

Taken are closed ways and multipolygon relations tagged `building` or `building:part`. The file is read as a stream, so
that memory holds its nodes and ways only; it is UTF-8, without a document type and so without entities.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from xml.parsers import expat

import numpy as np

from maxjax.core.files import FileError, read_text
from maxjax.maps.degrees import on_a_plane
from maxjax.maps.footprints import Footprint, Footprints, chain
from maxjax.maps.readers.osm_heights import span

_SHARED, _DEEPEST = 10, 16
_ENCODINGS = ("utf-8", "utf8", "us-ascii", "ascii")


def load_osm(path: Path) -> Footprints:
    """Buildings of an OSM XML file; buildings without a height or a closed outline are counted and left out.

    Raises:
        FileError: if the file is missing, too large, not XML, not OSM of version 0.6, malformed, or holds no building
            with a height.
    """
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
    return _footprints(content, path)


@dataclasses.dataclass(slots=True)
class _Element:
    """A way or a relation: its nodes or its ways, and its tags."""

    kind: str
    name: str
    members: list[str] = dataclasses.field(default_factory=list)
    tags: dict[str, str] = dataclasses.field(default_factory=dict)


class _Content:
    """Nodes, ways and relations as they come by."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.depth = 0
        self.nodes: dict[str, tuple[float, float]] = {}
        self.found: dict[str, list[_Element]] = {"way": [], "relation": []}
        self.open: _Element | None = None

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
        elif self.depth == 2:
            if name == "node":
                self.nodes[given["id"]] = (float(given["lon"]), float(given["lat"]))
            elif name in self.found:
                self.open = _Element(name, given["id"])
                self.found[name].append(self.open)
        elif self.depth == 3 and self.open is not None:
            if name == "tag":
                self.open.tags[given["k"]] = given["v"]
            elif (self.open.kind, name) == ("way", "nd") or (name == "member" and given["type"] == "way"):
                self.open.members.append(given["ref"])

    def end(self, _name: str) -> None:
        self.depth -= 1
        if self.depth == 1:
            self.open = None


def _footprints(content: _Content, path: Path) -> Footprints:
    nodes = content.nodes
    ways = {way.name: way.members for way in content.found["way"]}
    left = _SHARED * sum(map(len, ways.values()))
    found: list[Footprint] = []
    skipped = 0
    for element in [*content.found["way"], *content.found["relation"]]:
        tags = element.tags
        if {tags.get("building", "no"), tags.get("building:part", "no")} == {"no"}:
            continue
        if element.kind == "relation" and tags.get("type") != "multipolygon":
            continue
        members = [element.name] if element.kind == "way" else element.members
        left -= sum(len(ways.get(way, [])) for way in members)
        if left < 0:
            raise FileError(
                f"{path}: expected ways in at most {_SHARED} buildings each in the mean, found more; damaged"
            )
        # A way that the extract cut off has no nodes here, and its outline does not close.
        steps = [step for way in members for step in zip(ways.get(way, []), ways.get(way, [])[1:], strict=False)]
        rings, heights = chain(steps), span(tags)
        if rings is None or heights is None or not all(node in nodes for ring in rings for node in ring):
            skipped += 1
            continue
        degrees = tuple(np.array([nodes[node] for node in ring]) for ring in rings)
        found.append(Footprint(degrees, *heights, f"{element.kind} {element.name}"))
    return on_a_plane(found, skipped, path)
