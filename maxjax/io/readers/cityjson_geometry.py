"""Geometry of CityJSON as shells: lists of faces, a face a list of rings, a ring the numbers of its vertices.

    instance    reference point + M (x, y, z, 1) of a template's vertices
    closed  iff every edge lies in an even number of the shell's faces, and no face is there twice

Lines and points are rings of two and of one vertex.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from itertools import chain, pairwise
from typing import Any

import numpy as np
from jaxtyping import Float64

Face = list[list[int]]
Shell = list[Face]
Vertices = Float64[np.ndarray, "n 3"]

# Levels of lists above a ring's or a line's numbers.
_SURFACES, _SOLID, _SOLIDS = ("MultiSurface", "CompositeSurface"), ("Solid",), ("MultiSolid", "CompositeSolid")


@dataclasses.dataclass
class Store:
    """Vertices of a file [m], to which those of instances are added, and its templates."""

    vertices: list[np.ndarray]
    templates: list[Mapping[str, Any]]
    template_vertices: Float64[np.ndarray, "m 3"]
    units: Float64[np.ndarray, " 3"]
    own: int
    count: int

    @classmethod
    def of(cls, document: Mapping[str, Any], vertices: Vertices, units: Float64[np.ndarray, " 3"]) -> Store:
        """Contents of a document.

        Args:
            document: of CityJSON.
            vertices: its own [m].
            units: metres of a unit of its templates' vertices along x, y and z.
        """
        # Until 0.9 the vertices of templates had one key, too.
        held = document.get("geometry-templates") or {}
        corners = np.asarray(held.get("vertices-templates") or [], np.float64).reshape(-1, 3)
        return cls([vertices], list(held.get("templates") or []), corners, units, len(vertices), len(vertices))

    def all(self) -> Vertices:
        """All vertices [m]."""
        return np.concatenate(self.vertices)

    def shells(self, geometry: Mapping[str, Any]) -> list[Shell]:
        """Shells of a geometry; of one that is none, an error."""
        if geometry["type"] != "GeometryInstance":
            found = list(_shells(geometry))
            _check(found, self.own)
            return found
        template = self.template(geometry)
        found = list(_shells(template))
        _check(found, len(self.template_vertices))
        (point,) = geometry["boundaries"]
        _check([[[[point]]]], self.own)
        matrix = np.asarray(geometry["transformationMatrix"], np.float64).reshape(4, 4)
        flat = np.column_stack([self.template_vertices, np.ones(len(self.template_vertices))]) @ matrix.T
        # The reference point is one of the file's, and what is about it in the file's units.
        placed = self.vertices[0][point] + flat[:, :3] / flat[:, 3:] * self.units
        if not np.isfinite(placed).all():
            raise ValueError("expected a transformationMatrix that gives finite coordinates")
        shift = self.count
        self.vertices.append(placed)
        self.count += len(placed)
        return [[[[index + shift for index in ring] for ring in face] for face in shell] for shell in found]

    def template(self, geometry: Mapping[str, Any]) -> Mapping[str, Any]:
        """The template of a GeometryInstance; any other geometry itself."""
        if geometry["type"] != "GeometryInstance":
            return geometry
        number = geometry["template"]
        if type(number) is not int or not 0 <= number < len(self.templates):
            raise ValueError(f"expected the number of a template, 0 to {len(self.templates) - 1}, found {number!r}")
        return self.templates[number]


def level(geometry: Mapping[str, Any]) -> float:
    """Level of detail of a geometry; 1 where it names none."""
    found = re.match(r"\d+(?:\.\d+)?", str(geometry.get("lod", "1")))
    return float(found[0]) if found else 1.0


def is_closed(shell: Shell) -> bool:
    """Whether a shell bounds a volume."""
    edges: dict[tuple[int, int], int] = {}
    faces = set()
    for face in shell:
        key = frozenset(chain.from_iterable(face))
        if key in faces or len(face[0]) < 3:
            return False
        faces.add(key)
        for ring in face:
            for a, b in pairwise([*ring, ring[0]]):
                if a != b:
                    edge = (a, b) if a < b else (b, a)
                    edges[edge] = edges.get(edge, 0) + 1
    return bool(edges) and not any(count % 2 for count in edges.values())


def _shells(geometry: Mapping[str, Any]) -> Iterator[Shell]:
    kind, boundaries = geometry["type"], geometry["boundaries"]
    if kind == "MultiPoint":
        yield [[[point]] for point in boundaries]
    elif kind == "MultiLineString":
        yield [[[a, b]] for line in boundaries for a, b in pairwise(line if len(line) > 1 else [*line, *line])]
    elif kind in _SURFACES:
        yield boundaries
    elif kind in _SOLID:
        yield from boundaries
    elif kind in _SOLIDS:
        for solid in boundaries:
            yield from solid
    else:
        raise ValueError(f"expected a geometry of a known type, found {kind!r}")


def _check(shells: Any, count: int) -> None:
    """Raise a ValueError where a corner is no vertex."""
    for shell in shells:
        for face in shell:
            if not face:
                raise ValueError("expected a face of one ring at least, found none")
            for ring in face:
                if not ring:
                    raise ValueError("expected a ring of corners, found an empty one")
                for index in ring:
                    if type(index) is not int or not 0 <= index < count:
                        raise ValueError(f"expected the number of a vertex, 0 to {count - 1}, found {index!r}")
