"""Nodes, ways and relations of OpenStreetMap, whatever file they come from, as things that stand.

A closed way is an area, unless its kind is a line (walls, rows of trees); a relation is the union of its outer rings,
each without the inner rings that lie in it. What has tags and is no standing thing is counted by its kind.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from maxjax.core.files import FileError
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.rings import chain, surrounds
from maxjax.io.geo.units_and_axes import Stated
from maxjax.io.kinds.footprints import Footprints, around
from maxjax.io.readers.standing import Kind, flat_name, is_underground, kind_of
from maxjax.io.readers.tagged import Tagged, solids_of
from maxjax.io.reading import Reading

_SHARED = 10
_INNER = "inner"
_AREAS = ("multipolygon", "building", "boundary", "site", "")


@dataclasses.dataclass(slots=True)
class Element:
    """A node, a way or a relation.

    Attributes:
        kind: node, way or relation.
        name: its number.
        members: names of its nodes, or of its ways.
        roles: of these.
        tags: of the element.
    """

    kind: str
    name: str
    members: list[str] = dataclasses.field(default_factory=list)
    roles: list[str] = dataclasses.field(default_factory=list)
    tags: dict[str, str] = dataclasses.field(default_factory=dict)


class Elements:
    """All elements of a file.

    Attributes:
        nodes: longitude and latitude of each [degrees].
        found: elements by their kind; of nodes those with tags.
        outlines: corners of ways that are not in the file themselves, but in a relation.
    """

    def __init__(self) -> None:
        self.nodes: dict[str, tuple[float, float]] = {}
        self.found: dict[str, list[Element]] = {"node": [], "way": [], "relation": []}
        self.outlines: dict[str, list[str]] = {}

    def place(self, longitude: float, latitude: float) -> str:
        """The name of a node that has none, by its place."""
        name = f"{longitude!r} {latitude!r}"
        self.nodes[name] = (longitude, latitude)
        return name

    def add(self, element: Element) -> None:
        """Keep an element; a node without tags is a corner of ways alone."""
        if element.kind != "node" or element.tags:
            self.found[element.kind].append(element)


def check_plain(reading: Reading, path: Path) -> None:
    """Raise a `FileError` where a user gives coordinates of OpenStreetMap a system or a unit."""
    if reading.crs or reading.unit or reading.vertical_unit:
        raise FileError(f"{path}: OpenStreetMap is in degrees of EPSG:4326 and in metres; leave --crs and units out")


def solids_in(elements: Elements, reading: Reading, path: Path) -> Footprints:
    """What stands among some elements; raises as `solids_of`."""
    things, dropped = _things(elements, path)
    return solids_of(things, dropped, Stated("EPSG:4326", heights="metres"), reading, path)


def is_deleted(given: Mapping[str, object]) -> bool:
    """Whether an editor or the history has deleted an element."""
    return given.get("action") == "delete" or given.get("visible") in ("false", False)


def _things(content: Elements, path: Path) -> tuple[list[Tagged], dict[str, int]]:
    """Standing objects, and those without a closed outline, by their kind."""
    nodes = content.nodes
    ways = content.outlines | {way.name: way.members for way in content.found["way"] if way.members}
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
