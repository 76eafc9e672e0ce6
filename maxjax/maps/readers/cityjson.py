"""Footprints from CityJSON (0.8, 0.9, 1.0, 1.1, 2.0).

    x_local = scale · x_file + translate − origin

A CityJSON file is one list of vertices and objects whose faces are lists of rings of indices into it. `transform`
(scale, translate) undoes the quantisation of the vertices; without it they are metres as they stand (1.0 and before).

The footprint of a building is the union of its ground surfaces; where faces have no semantics, of its level faces
within half a metre of its lowest vertex. Of faces that share an edge only the outline stays: an edge that two of them
have is inside, and the others are chained into rings. Heights are absolute, in the file's datum; a pitched roof counts
up to its ridge.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from maxjax.core.files import FileError, parse_json, read_text
from maxjax.maps.footprints import Footprint, Footprints, chain, localised
from maxjax.maps.model import FARTHEST

VERSIONS = ("0.8", "0.9", "1.0", "1.1", "2.0")
# How a geometry's boundaries are nested: levels of lists above a face.
_NESTING = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}
_LEVEL = 0.5  # a level face belongs to the floor up to so far above the lowest vertex [m]
_SLOPE = 0.7  # a face is level if its normal's vertical share exceeds this

Face = list[list[int]]


def load_cityjson(path: Path) -> Footprints:
    """Buildings and terrain of a CityJSON file.

    Of an object with several levels of detail the finest of solids and surfaces from LoD1 on is taken; LoD0 has no
    height.

    Raises:
        FileError: if the file is missing, too large, not JSON, not CityJSON of a known version, malformed, or holds no
            building with a height.
    """
    document = _parse(path)
    try:
        return _read(document, path)
    except FileError:
        raise
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise FileError(f"{path}: malformed CityJSON: {type(error).__name__}: {error}") from error


def _parse(path: Path) -> Mapping[str, Any]:
    document = parse_json(read_text(path), path)
    kind = document.get("type") if isinstance(document, dict) else type(document).__name__
    if kind != "CityJSON":
        raise FileError(f"{path}: expected an object of type CityJSON, found {kind!r}")
    version = document.get("version")
    # 1.0.1 is read as 1.0.
    if ".".join(str(version).split(".")[:2]) not in VERSIONS:
        raise FileError(f"{path}: expected CityJSON version {', '.join(VERSIONS)}, found {version!r}")
    return dict(document)


def _read(document: Mapping[str, Any], path: Path) -> Footprints:
    vertices = np.asarray(document["vertices"], np.float64).reshape(-1, 3)
    if "transform" in document:
        transform = document["transform"]
        scale, translate = (np.asarray(transform[key], float).reshape(3) for key in ("scale", "translate"))
        vertices = vertices * scale + translate
    elif str(document["version"])[:3] in ("1.1", "2.0"):
        raise FileError(f"{path}: expected a transform, which CityJSON {document['version']} requires, found none")
    if not (np.abs(vertices) <= FARTHEST).all():
        wrong = int(np.flatnonzero(~(np.abs(vertices) <= FARTHEST).all(axis=1))[0])
        raise FileError(
            f"{path}: vertex {wrong}: expected metres within {FARTHEST:g}, found {vertices[wrong].tolist()}"
        )
    found: list[Footprint] = []
    owners: list[str] = []
    triangles: list[list[int]] = []
    skipped = 0
    for name, thing in document["CityObjects"].items():
        if thing["type"] == "TINRelief":
            triangles += [
                face[0] for g in thing.get("geometry", []) for face, _ in _faces(g, len(vertices)) if len(face[0]) == 3
            ]
        # A building without a geometry of its own is the sum of its parts.
        elif thing["type"] in ("Building", "BuildingPart") and thing.get("geometry"):
            footprint = _footprint(name, thing["geometry"], vertices)
            if footprint is None:
                skipped += 1
                continue
            found.append(footprint)
            # One parent by name until 0.9, a list of them since.
            owners.append(thing.get("parent") or (thing.get("parents") or [name])[0])
    terrain = vertices[np.array(triangles, int).reshape(-1, 3)]
    lowest: dict[str, float] = {}
    for footprint, owner in zip(found, owners, strict=True):
        lowest[owner] = min(footprint.base, lowest.get(owner, footprint.base))
    found = [dataclasses.replace(part, base=lowest[owner]) for part, owner in zip(found, owners, strict=True)]
    return localised(found, terrain, skipped, path, _crs(document))


def _crs(document: Mapping[str, Any]) -> str | None:
    """The EPSG code of the metadata: the last number of `referenceSystem`, or until 0.9 of `crs`."""
    metadata = document.get("metadata") or {}
    named = metadata.get("referenceSystem") or metadata.get("crs") or ""
    codes = re.findall(r"\d{4,6}(?!\d)", str(named))
    return f"EPSG:{codes[-1]}" if codes else None


def _footprint(name: str, geometries: list[dict[str, Any]], vertices: np.ndarray) -> Footprint | None:
    """The finest geometry that has a height; None if there is none."""
    solid = [g for g in geometries if g["type"] in _NESTING and float(g["lod"]) >= 1]
    if not solid:
        return None
    faces = list(_faces(max(solid, key=lambda g: float(g["lod"])), len(vertices)))
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


def _faces(geometry: dict[str, Any], count: int) -> Iterator[tuple[Face, str | None]]:
    """Every face with the type of its semantic surface; its rings are indices of `count` vertices."""
    semantics = geometry.get("semantics") or {}
    types = [surface["type"] for surface in semantics.get("surfaces", [])]

    def walk(boundaries: list[Any], values: list[Any] | None, depth: int) -> Iterator[tuple[Face, str | None]]:
        # A null stands for a whole shell or solid without semantics.
        labels = [None] * len(boundaries) if values is None else values
        for part, label in zip(boundaries, labels, strict=True):
            if depth:
                yield from walk(part, label, depth - 1)
            else:
                for index in (index for ring in part for index in ring):
                    if type(index) is not int or not 0 <= index < count:
                        raise ValueError(f"expected the number of a vertex, 0 to {count - 1}, found {index!r}")
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
