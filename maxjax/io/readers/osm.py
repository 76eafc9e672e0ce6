"""OpenStreetMap XML: whatever stands (`standing`), as solids on a plane (`tagged`).

Taken are ways, nodes and relations. A closed way is an area, unless its kind is a line (walls, rows of trees); a
relation is the union of its outer rings, each without the inner rings that lie in it. The file is read as a stream, so
that memory holds its nodes and ways only; it is UTF-8, without a document type and so without entities. What has tags
and is none of these is counted by its kind; what was deleted in an editor is not there.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from pathlib import Path
from xml.parsers import expat

import numpy as np

from maxjax.core.files import FileError, read_text
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.rings import chain, surrounds
from maxjax.io.geo.units_and_axes import Stated
from maxjax.io.kinds.footprints import Footprints, around
from maxjax.io.readers.standing import Kind, flat_name, is_underground, kind_of
from maxjax.io.readers.tagged import Tagged, solids_of
from maxjax.io.reading import PLAIN, Reading

_SHARED, _DEEPEST = 10, 16
_ENCODINGS = ("utf-8", "utf8", "us-ascii", "ascii")
_INNER = "inner"
_AREAS = ("multipolygon", "building", "boundary", "site", "")


def load_osm(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Standing objects of an OSM XML file; those without a height or a closed outline are counted by their kind.

    Raises:
        FileError: if the file is missing, too large, not XML, not OSM of version 0.6, malformed, or holds nothing with
            a height; if a reference system or a unit is given.
    """
    if reading.crs or reading.unit or reading.vertical_unit:
        raise FileError(f"{path}: OpenStreetMap is in degrees of EPSG:4326 and in metres; leave --crs and units out")
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
    things, dropped = _things(content, path)
    return solids_of(things, dropped, Stated("EPSG:4326", heights="metres"), reading, path)


@dataclasses.dataclass(slots=True)
class _Element:
    """A node, a way or a relation: its nodes or its ways with their roles, and its tags."""

    kind: str
    name: str
    members: list[str] = dataclasses.field(default_factory=list)
    roles: list[str] = dataclasses.field(default_factory=list)
    tags: dict[str, str] = dataclasses.field(default_factory=dict)


class _Content:
    """Nodes, ways and relations as they come by."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.depth = 0
        self.nodes: dict[str, tuple[float, float]] = {}
        self.found: dict[str, list[_Element]] = {"node": [], "way": [], "relation": []}
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
        elif self.depth == 2 and not _deleted(given):
            if name == "node":
                self.nodes[given["id"]] = (float(given["lon"]), float(given["lat"]))
            if name in self.found:
                self.open = _Element(name, given["id"])
                if name != "node":
                    self.found[name].append(self.open)
        elif self.depth == 3 and self.open is not None:
            if name == "tag":
                self.open.tags[given["k"]] = given["v"]
            elif (self.open.kind, name) == ("way", "nd") or (name == "member" and given["type"] == "way"):
                self.open.members.append(given["ref"])
                self.open.roles.append(given.get("role", ""))

    def end(self, _name: str) -> None:
        self.depth -= 1
        if self.depth == 1:
            # Most nodes are corners of ways, and have no tags.
            if self.open is not None and self.open.kind == "node" and self.open.tags:
                self.found["node"].append(self.open)
            self.open = None


def _things(content: _Content, path: Path) -> tuple[list[Tagged], dict[str, int]]:
    """Standing objects, and those without a closed outline, by their kind."""
    nodes = content.nodes
    ways = {way.name: way.members for way in content.found["way"]}
    left = _SHARED * sum(map(len, ways.values()))
    found: list[Tagged] = []
    dropped: Counter[str] = Counter()
    for element in (one for kind in ("way", "relation", "node") for one in content.found[kind]):
        kind = kind_of(element.tags)
        if kind is None:
            dropped.update([flat_name(element.tags)] if element.tags else [])
            continue
        if is_underground(element.tags):
            dropped[f"{kind.name} underground"] += 1
            continue
        if element.kind == "relation" and (what := element.tags.get("type", "")) not in _AREAS:
            dropped[f"{kind.name} in relations of type {what}"] += 1
            continue
        name = f"{element.kind} {element.name}"
        if element.kind == "node":
            place = np.array([nodes[element.name]], np.float64)
            found.append(Tagged("line", (place,), kind, element.tags, name))
            continue
        members = [element.name] if element.kind == "way" else element.members
        left -= sum(len(ways.get(way, [])) for way in members)
        if left < 0:
            raise FileError(
                f"{path}: expected ways in at most {_SHARED} buildings each in the mean, found more; damaged"
            )
        # A way that the extract cut off has no nodes here.
        if not all(way in ways and all(node in nodes for node in ways[way]) for way in members):
            dropped[f"{kind.name} with an open outline"] += 1
            continue
        lines = [[nodes[node] for node in ways[way]] for way in members]
        if element.kind == "way" and lines[0] and (kind.line or _is_line(lines[0], kind)):
            found.append(Tagged("line", (np.array(lines[0], np.float64),), kind, element.tags, name))
            continue
        roles = element.roles if element.kind == "relation" else [""]
        outer = _rings([line for line, role in zip(lines, roles, strict=True) if role != _INNER])
        inner = _rings([line for line, role in zip(lines, roles, strict=True) if role == _INNER])
        if not outer or inner is None:
            dropped[f"{kind.name} with an open outline"] += 1
            continue
        for ring in outer:
            holes = [hole for hole in inner if _within(hole, ring)]
            found.append(Tagged("area", (ring, *holes), kind, element.tags, name))
    return found, dict(dropped)


def _deleted(given: dict[str, str]) -> bool:
    """Whether an editor or the history has deleted an element."""
    return given.get("action") == "delete" or given.get("visible") == "false"


def _is_line(corners: list[tuple[float, float]], kind: Kind) -> bool:
    """Whether a way is a line of things; an open outline of a building is none, but cut off."""
    return corners[0] != corners[-1] and kind.key != "building"


def _rings(lines: list[list[tuple[float, float]]]) -> list[Ring] | None:
    """Lines as rings: those that close by themselves, and the others joined; None where some do not close."""
    found: list[list[tuple[float, float]]] = []
    rest: list[tuple[tuple[float, float], tuple[float, float]]] = []
    for line in lines:
        if len(line) > 3 and line[0] == line[-1]:
            rings = around(line[:-1])
            if rings is None:
                return None
            found += rings
        else:
            rest += itertools.pairwise(line)
    if rest:
        joined = chain(rest)
        if joined is None:
            return None
        found += joined
    return [np.array(ring, np.float64) for ring in found]


def _within(ring: Ring, other: Ring) -> bool:
    """Whether a ring lies in another: whether most of its corners do."""
    return 2 * sum(surrounds(other, corner) for corner in ring) > len(ring)
