"""Buildings as footprints with heights, and their reader for CityJSON (0.8, 0.9, 1.0, 1.1, 2.0).

    x_local = scale · x_file + translate − origin          inside a footprint: even-odd rule over all its rings

A CityJSON file is one list of vertices and objects whose faces are lists of rings of indices into it. `transform`
(scale, translate) undoes the quantisation of the vertices; without it they are metres as they stand (1.0 and before).

The footprint of a building is the union of its ground surfaces; where faces have no semantics, of its level faces
within half a metre of its lowest vertex. Of faces that share an edge only the outline stays: an edge that two of them
have is inside, and the others are chained into rings. Heights are absolute, in the file's datum; a pitched roof counts
up to its ridge.
"""

from __future__ import annotations

import dataclasses
import json
from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from maxjax.maps.model import MAX_FILE_BYTES, MapError

VERSIONS = ("0.8", "0.9", "1.0", "1.1", "2.0")
# How a geometry's boundaries are nested: levels of lists above a face.
_NESTING = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}
_LEVEL = 0.5  # a level face belongs to the floor up to so far above the lowest vertex [m]
_SLOPE = 0.7  # a face is level if its normal's vertical share exceeds this

Ring = Float[np.ndarray, "_ 2"]
Face = list[list[int]]


@dataclasses.dataclass(frozen=True)
class Footprint:
    """One building, or part of one, as an upright prism.

    Attributes:
        rings: outlines and holes, last point not repeated [m]; inside is where an odd number of them surround.
        base: height of the floor [m].
        top: height of the highest point of the roof [m].
        name: the file's.
    """

    rings: tuple[Ring, ...]
    base: float
    top: float
    name: str


@dataclasses.dataclass(frozen=True)
class Footprints:
    """The buildings of a file in a local ENU frame, metres.

    Attributes:
        buildings: at least one.
        terrain: triangles of the terrain [m]; none in OpenStreetMap.
        origin: of the local frame. CityJSON: file coordinates [m], the middle of the buildings to the metre, height
            0. OpenStreetMap: longitude, latitude [degrees] and 0. Heights are not shifted.
        skipped: buildings left out, because they have no height or no closed outline.
        source: the file's name.
    """

    buildings: tuple[Footprint, ...]
    terrain: Float[np.ndarray, "t 3 3"]
    origin: Float[np.ndarray, "3"]
    skipped: int
    source: str


def load_cityjson(path: Path) -> Footprints:
    """Buildings and terrain of a CityJSON file.

    Of an object with several levels of detail the finest of solids and surfaces from LoD1 on is taken; LoD0 has no
    height.

    Raises:
        MapError: if the file is missing, too large, not JSON, not CityJSON of a known version, malformed, or holds no
            building with a height.
    """
    document = _parse(path)
    try:
        return _read(document, path)
    except MapError:
        raise
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise MapError(f"{path}: malformed CityJSON: {type(error).__name__}: {error}") from error


def read_bytes(path: Path) -> bytes:
    """A file whole.

    Raises:
        MapError: if it cannot be read or is too large.
    """
    try:
        if (size := path.stat().st_size) > MAX_FILE_BYTES:
            raise MapError(f"{path}: {size} bytes, expected at most {MAX_FILE_BYTES}; crop it")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, MapError):
            raise
        raise MapError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _parse(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(read_bytes(path))
    except (RecursionError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise MapError(f"{path}: expected JSON: {error}") from error
    kind = document.get("type") if isinstance(document, dict) else type(document).__name__
    if kind != "CityJSON":
        raise MapError(f"{path}: expected an object of type CityJSON, found {kind!r}")
    version = document.get("version")
    # 1.0.1 is read as 1.0.
    if ".".join(str(version).split(".")[:2]) not in VERSIONS:
        raise MapError(f"{path}: expected CityJSON version {', '.join(VERSIONS)}, found {version!r}")
    return dict(document)


def _read(document: Mapping[str, Any], path: Path) -> Footprints:
    vertices = np.asarray(document["vertices"], np.float64).reshape(-1, 3)
    if "transform" in document:
        transform = document["transform"]
        vertices = vertices * np.asarray(transform["scale"], float) + np.asarray(transform["translate"], float)
    elif str(document["version"])[:3] in ("1.1", "2.0"):
        raise MapError(f"{path}: expected a transform, which CityJSON {document['version']} requires, found none")
    found: list[Footprint] = []
    triangles: list[list[int]] = []
    skipped = 0
    for name, thing in document["CityObjects"].items():
        if thing["type"] == "TINRelief":
            triangles += [face[0] for g in thing.get("geometry", []) for face, _ in _faces(g) if len(face[0]) == 3]
        # A building without a geometry of its own is the sum of its parts.
        elif thing["type"] in ("Building", "BuildingPart") and thing.get("geometry"):
            footprint = _footprint(name, thing["geometry"], vertices)
            found += [] if footprint is None else [footprint]
            skipped += footprint is None
    terrain = vertices[np.array(triangles, int).reshape(-1, 3)]
    return localised(found, terrain, skipped, path)


def localised(
    buildings: Sequence[Footprint], terrain: Float[np.ndarray, "t 3 3"], skipped: int, path: Path
) -> Footprints:
    """The same around the middle of the buildings, to the metre.

    Raises:
        MapError: if there is no building.
    """
    if not buildings:
        raise MapError(f"{path}: expected a building with an outline and a height, found none ({skipped} without)")
    corners = np.concatenate([ring for building in buildings for ring in building.rings])
    middle = np.round(0.5 * (corners.min(0) + corners.max(0)))
    moved = [dataclasses.replace(b, rings=tuple(ring - middle for ring in b.rings)) for b in buildings]
    origin = np.array([*middle, 0.0])
    return Footprints(tuple(moved), terrain - origin, origin, skipped, path.name)


def _footprint(name: str, geometries: list[dict[str, Any]], vertices: np.ndarray) -> Footprint | None:
    """The finest geometry that has a height; None if there is none."""
    solid = [g for g in geometries if g["type"] in _NESTING and float(g["lod"]) >= 1]
    if not solid:
        return None
    faces = list(_faces(max(solid, key=lambda g: float(g["lod"]))))
    heights = np.array([vertices[i, 2] for face, _ in faces for ring in face for i in ring])
    floor = [face for face, semantics in faces if semantics == "GroundSurface"]
    if not floor:
        level = heights.min() + _LEVEL
        floor = [
            face
            for face, _ in faces
            if max(vertices[i, 2] for i in face[0]) <= level and _uprightness(vertices[face[0]]) > _SLOPE
        ]
    edges = [(a, b) for face in floor for ring in face for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)]
    rings = chain(edges)
    base = min((vertices[i, 2] for face in floor for ring in face for i in ring), default=heights.min())
    if rings is None or heights.max() <= base:
        return None
    return Footprint(tuple(vertices[ring, :2] for ring in rings), float(base), float(heights.max()), name)


def _faces(geometry: dict[str, Any]) -> Iterator[tuple[Face, str | None]]:
    """Every face with the type of its semantic surface."""
    semantics = geometry.get("semantics") or {}
    types = [surface["type"] for surface in semantics.get("surfaces", [])]

    def walk(boundaries: list[Any], values: list[Any] | None, depth: int) -> Iterator[tuple[Face, str | None]]:
        # A null stands for a whole shell or solid without semantics.
        labels = [None] * len(boundaries) if values is None else values
        for part, label in zip(boundaries, labels, strict=True):
            if depth:
                yield from walk(part, label, depth - 1)
            else:
                yield part, None if label is None else types[label]

    depth = _NESTING.get(geometry["type"])
    if depth is not None:
        yield from walk(geometry["boundaries"], semantics.get("values"), depth)


def _uprightness(corners: Float[np.ndarray, "n 3"]) -> float:
    """Vertical share of a face's normal, by Newell's sum; 0 for a face without area."""
    local = corners - corners[0]
    normal = np.cross(local, np.roll(local, -1, axis=0)).sum(0)
    length = float(np.linalg.norm(normal))
    return abs(float(normal[2])) / length if length else 0.0


def chain[T: Hashable](edges: Iterable[tuple[T, T]]) -> list[list[T]] | None:
    """Edges to closed rings, edges that occur an even number of times left out.

    Where more than two edges meet, the rings may be paired either way: under the even-odd rule they enclose the same.

    Returns:
        The rings, first point not repeated; None if there is none, or some edges do not close.
    """
    odd: dict[frozenset[T], tuple[T, T]] = {}
    for a, b in edges:
        key = frozenset((a, b))
        if len(key) == 2 and odd.pop(key, None) is None:
            odd[key] = (a, b)
    around: dict[T, list[T]] = defaultdict(list)
    for a, b in odd.values():
        around[a].append(b)
        around[b].append(a)
    if not around or any(len(ends) % 2 for ends in around.values()):
        return None
    rings = []
    for first in list(around):
        while around[first]:
            ring, at = [first], first
            while (ahead := around[at].pop()) != first:
                around[ahead].remove(at)
                ring.append(ahead)
                at = ahead
            around[first].remove(at)
            rings.append(ring)
    return rings
