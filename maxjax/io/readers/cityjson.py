"""City models of CityJSON (0.8, 0.9, 1.0, 1.1, 2.0): every object with a geometry, and the terrain.

    x_local = scale · x_file + translate, in metres

A CityJSON file is one list of vertices and objects whose faces are lists of rings of indices into it. `transform`
(scale, translate) undoes the quantisation of the vertices; without it they are coordinates as they stand (1.0 and
before).

Of each object the finest level of detail that has a height is taken, from LoD1 on; where it does not close, the coarser
ones as well, down to one that does. A shell that closes is solid inside, whatever its faces are called, and cavities
count as solid. Where shells do not close, all below their faces is solid, down to the lowest point of the building
with all its parts. An outline whose object has no more than a height among its attributes is a prism. Roads, water and
the use of land are surfaces, and the relief is the terrain. Heights are absolute, in the file's datum.
"""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int

from maxjax.core.files import FileError
from maxjax.io.geo.polygons import convex, covering, fan_of, newell
from maxjax.io.geo.triangles import Triangles
from maxjax.io.geo.units_and_axes import Reference, Stated, reference
from maxjax.io.kinds.bodies import runs
from maxjax.io.kinds.footprints import Fill, Footprint, Footprints, Shells, check_footprints
from maxjax.io.kinds.point_cloud import FARTHEST
from maxjax.io.readers.cityjson_geometry import Face, Shell, Store, Vertices, is_closed, level
from maxjax.io.readers.json_lines import read_document
from maxjax.io.reading import PLAIN, Reading

VERSIONS = ("0.8", "0.9", "1.0", "1.1", "2.0")
_RELIEF = ("TINRelief",)
_LYING = ("Road", "Railway", "Waterway", "TransportSquare", "WaterBody", "LandUse")
# Of buildings, what does not reach down to the ground.
_FIXED = ("Installation", "Furniture", "ConstructiveElement", "Room")
_MICROMETRES = 1e6
_HEIGHTS = ("measuredHeight", "averageHeight", "height")  # attributes
_LEVEL = 1.0  # [m]; an outline is as level as that


@dataclasses.dataclass(frozen=True)
class _Piece:
    """One shell of an object."""

    shell: Shell
    fill: Fill
    base: float
    grounded: bool
    name: str
    building: str


def load_cityjson(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Everything solid and the terrain of a CityJSON file.

    Args:
        path: of the file.
        reading: of its coordinates.

    Raises:
        FileError: if the file is missing, too large, not JSON, not CityJSON of a known version, malformed, or holds
            nothing with a height; as `reference`.
    """
    document = _parse(path)
    try:
        return _read(document, path, reading)
    except FileError:
        raise
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise FileError(f"{path}: malformed CityJSON: {type(error).__name__}: {error}") from error


def _parse(path: Path) -> Mapping[str, Any]:
    document = read_document(path)
    kind = document.get("type") if isinstance(document, dict) else type(document).__name__
    if kind != "CityJSON":
        raise FileError(f"{path}: expected an object of type CityJSON, found {kind!r}")
    version = document.get("version")
    # 1.0.1 is read as 1.0.
    if ".".join(str(version).split(".")[:2]) not in VERSIONS:
        raise FileError(f"{path}: expected CityJSON version {', '.join(VERSIONS)}, found {version!r}")
    return dict(document)


def _read(document: Mapping[str, Any], path: Path, reading: Reading) -> Footprints:
    vertices, how = _vertices(document, path, reading)
    # The vertices of templates are in units of the plane; about a place in degrees they are metres.
    unit = how.unit if how.origin is None else 1.0
    store = Store.of(document, vertices, np.array([unit, unit, how.vertical_unit]))
    things: Mapping[str, Mapping[str, Any]] = dict(document["CityObjects"].items())
    things, unwanted = _asked_for(things, reading.only)
    read = Counter(thing["type"] for thing in things.values())
    shells, relief = _chosen(things, store)
    corners, welded = _welded(store.all())
    outlines = _outlines(things, shells, corners)
    pieces, dropped = _pieces(things, shells, (corners, welded), {prism.name for prism in outlines})
    terrain, _ = _triangles([(face, 0) for shell in relief for face in shell], corners)
    found = Footprints(
        tuple(outlines),
        terrain,
        path.name,
        _arrays(pieces, corners),
        {**read, "shells": len(pieces), "faces": sum(len(p.shell) for p in pieces)}
        | {"triangles of the terrain": len(terrain)},
        {**dropped, **unwanted},
        how,
        _said(pieces, outlines),
    )
    return check_footprints(found, path)


def _asked_for(
    things: Mapping[str, Mapping[str, Any]], only: tuple[str, ...]
) -> tuple[Mapping[str, Mapping[str, Any]], Mapping[str, int]]:
    """The objects of some types (all, of none given) and the relief, and a count of the others."""
    if not only:
        return things, {}
    kept = {name: thing for name, thing in things.items() if thing["type"] in (*only, *_RELIEF)}
    return kept, Counter(
        f"{thing['type']} objects that were not asked for" for name, thing in things.items() if name not in kept
    )


def _vertices(document: Mapping[str, Any], path: Path, reading: Reading) -> tuple[Vertices, Reference]:
    """The file's vertices in metres."""
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
    metadata = document.get("metadata") or {}
    system = metadata.get("referenceSystem") or ""
    code = (metadata.get("crs") or {}).get("epsg")
    stated = Stated(str(system) or (f"EPSG:{code}" if code else None))
    extent = np.zeros((2, 2))
    if len(vertices):
        extent = np.array([vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)])
    how = reference(stated, reading, extent, path)
    return how.metres(vertices), how


def _chosen(
    things: Mapping[str, Mapping[str, Any]], store: Store
) -> tuple[dict[str, list[tuple[float, list[Shell]]]], list[Shell]]:
    """Shells of each object by level of detail, the finest first, and those of the relief."""
    found: dict[str, list[tuple[float, list[Shell]]]] = {}
    relief: list[Shell] = []
    for name, thing in things.items():
        levels: dict[float, list[Shell]] = defaultdict(list)
        for geometry in thing.get("geometry") or []:
            shells = [shell for shell in store.shells(geometry) if shell]
            if shells:
                levels[level(store.template(geometry))] += shells
        if thing["type"] in _RELIEF:
            relief += [shell for shells in levels.values() for shell in shells]
        elif levels:
            found[name] = sorted(levels.items(), reverse=True)
    return found, relief


def _pieces(
    things: Mapping[str, Mapping[str, Any]],
    found: Mapping[str, list[tuple[float, list[Shell]]]],
    joined: tuple[Vertices, Int[np.ndarray, " n"]],
    prisms: set[str],
) -> tuple[list[_Piece], dict[str, int]]:
    """Shells that become voxels, and a count by kind of objects that do not."""
    corners, welded = joined
    number = welded.tolist()
    root = {name: _root(name, things) for name in things}
    lowest: dict[str, float] = {}
    for name, levels in found.items():
        used = {i for _, shells in levels for shell in shells for face in shell for ring in face for i in ring}
        bottom = float(corners[welded[list(used)], 2].min())
        lowest[root[name]] = min(bottom, lowest.get(root[name], bottom))
    pieces: list[_Piece] = []
    for name, levels in found.items():
        kind = str(things[name]["type"])
        grounded = ("Building" in kind or kind == "OtherConstruction") and not kind.endswith(_FIXED)
        for _, shells in levels if kind in _LYING else _solid(levels, corners):
            all_closed = True
            for shell in shells:
                merged = [[[number[i] for i in ring] for ring in face] for face in shell]
                solid = is_closed(merged)
                thin = kind in _LYING or all(len(face[0]) < 3 for face in merged)
                fill = Fill.INSIDE if solid else Fill.SURFACE if thin else Fill.BELOW
                all_closed &= solid
                pieces.append(_Piece(merged, fill, lowest[root[name]], grounded, name, root[name]))
            if all_closed or kind in _LYING:
                break
    standing = {root[name] for name in prisms.union(piece.name for piece in pieces)}
    dropped: Counter[str] = Counter()
    for name, thing in things.items():
        kind = str(thing["type"])
        if root[name] in standing or kind in _RELIEF or kind in ("CityObjectGroup", *_LYING):
            continue
        if name in found or (root[name] == name and not any(root[other] == name for other in found)):
            noun = "buildings" if kind in ("Building", "BuildingPart") else f"{kind} objects"
            dropped[f"{noun} without a height"] += 1
    return pieces, dict(dropped)


def _solid(levels: list[tuple[float, list[Shell]]], corners: Vertices) -> list[tuple[float, list[Shell]]]:
    """Levels of detail from LoD1 on; where there is none, of LoD0 those that are no outline."""
    fine = [one for one in levels if one[0] >= 1.0]
    return fine or [(number, shells) for number, shells in levels if _rise(shells, corners) > _LEVEL]


def _rise(shells: list[Shell], corners: Vertices) -> float:
    """Height from the lowest to the highest corner of shells [m]."""
    return float(np.ptp(corners[[i for shell in shells for face in shell for ring in face for i in ring], 2]))


def _outlines(
    things: Mapping[str, Mapping[str, Any]], found: Mapping[str, list[tuple[float, list[Shell]]]], corners: Vertices
) -> list[Footprint]:
    """Prisms over the outlines of objects that have nothing but these and a height among their attributes."""
    solid = {_root(name, things) for name, levels in found.items() if _solid(levels, corners)}
    prisms = []
    for name, levels in found.items():
        root = _root(name, things)
        told = [((things.get(one) or {}).get("attributes") or {}).get(key) for one in (name, root) for key in _HEIGHTS]
        heights = [float(height) for height in told if isinstance(height, int | float) and height > 0]
        if root in solid or things[name]["type"] in _LYING or not heights:
            continue
        for face in (face for _, shells in levels for shell in shells for face in shell if len(face[0]) > 2):
            base = float(corners[face[0], 2].min())
            rings = tuple(corners[ring][:, :2] for ring in face)
            prisms.append(Footprint(rings, base, base + max(heights), name))
    return prisms


def _root(name: str, things: Mapping[str, Mapping[str, Any]]) -> str:
    """The object that another is part of, at the top; one parent by name until 0.9, a list of them since."""
    seen = set()
    while name not in seen:
        seen.add(name)
        thing = things.get(name) or {}
        above = [thing["parent"]] if thing.get("parent") else thing.get("parents") or []
        above = [one for one in above if (things.get(one) or {}).get("type") != "CityObjectGroup"]
        if not above:
            return name
        name = above[0]
    return min(seen)


def _said(pieces: list[_Piece], outlines: list[Footprint]) -> tuple[str, ...]:
    """Remarks for the user."""
    sentences = []
    if still := sum(piece.fill == Fill.BELOW for piece in pieces):
        sentences.append(
            f"{still} of {len(pieces)} shells do not close: all below their faces is solid, down to the building's "
            "lowest point"
        )
    if outlines:
        flat = len({prism.name for prism in outlines})
        sentences.append(f"{flat} objects are outlines alone, and as tall as their attributes say, in metres")
    return tuple(sentences)


def _welded(vertices: Vertices) -> tuple[Vertices, Int[np.ndarray, " n"]]:
    """Vertices, and of each the first one that agrees with it to a micrometre."""
    if not len(vertices):
        return vertices, np.zeros(0, np.int64)
    order, fresh = runs(np.round((vertices - vertices[0]) * _MICROMETRES))
    index = np.empty(len(vertices), np.int64)
    index[order] = order[fresh][np.cumsum(fresh) - 1]
    return vertices, index


def _arrays(pieces: list[_Piece], corners: Vertices) -> Shells:
    owned = [(face, k) for k, piece in enumerate(pieces) for face in piece.shell]
    faces, of_face = _triangles(owned, corners)
    inside = [(face, k) for face, k in owned if pieces[k].fill == Fill.INSIDE]
    rings = [(ring, k) for face, k in inside for ring in (face if len(face) == 1 else _turned(face, corners))]
    bounds, of_bound = _fans(rings, corners)
    return Shells(
        faces,
        of_face,
        bounds,
        of_bound,
        np.array([piece.fill for piece in pieces], np.int64),
        np.array([piece.base for piece in pieces], np.float64),
        np.array([piece.grounded for piece in pieces], bool),
        tuple(piece.name for piece in pieces),
        tuple(piece.building for piece in pieces),
    )


def _turned(face: Face, corners: Vertices) -> Face:
    """A face whose holes go around the other way than its outline."""
    outer = newell(corners[face[0]])
    return [face[0], *(ring[::-1] if newell(corners[ring]) @ outer > 0 else ring for ring in face[1:])]


def _grouped(rings: Iterable[tuple[list[int], int]]) -> dict[int, tuple[list[list[int]], list[int]]]:
    """Rings and what they belong to by their number of corners."""
    found: dict[int, tuple[list[list[int]], list[int]]] = defaultdict(lambda: ([], []))
    for ring, owner in rings:
        rows, owners = found[len(ring)]
        rows.append(ring)
        owners.append(owner)
    return found


def _fans(rings: Iterable[tuple[list[int], int]], corners: Vertices) -> tuple[Triangles, Int[np.ndarray, " t"]]:
    """Triangles around the first corners of rings, and what each belongs to."""
    triangles, owner = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for count, (rows, owners) in _grouped(rings).items():
        fan = fan_of(count)
        triangles.append(corners[np.array(rows)[:, fan]].reshape(-1, 3, 3))
        owner.append(np.repeat(owners, len(fan)))
    return np.concatenate(triangles), np.concatenate(owner)


def _triangles(faces: Iterable[tuple[Face, int]], corners: Vertices) -> tuple[Triangles, Int[np.ndarray, " t"]]:
    """Triangles that cover faces and nothing else, and what each belongs to."""
    faces = list(faces)
    parts: list[tuple[Float64[np.ndarray, "t 3 3"], Int[np.ndarray, " t"]]] = []
    difficult = [(face, owner) for face, owner in faces if len(face) > 1]
    plain = []
    for count, (rows, owners) in _grouped((face[0], owner) for face, owner in faces if len(face) == 1).items():
        if count < 3:  # a point or a line
            index = np.array(rows)[:, [0, -1, -1]]
            parts.append((corners[index], np.array(owners)))
            continue
        right = convex(corners[np.array(rows)])
        plain += [(row, owner) for row, owner, held in zip(rows, owners, right, strict=True) if held]
        difficult += [([row], owner) for row, owner, held in zip(rows, owners, right, strict=True) if not held]
    parts.append(_fans(plain, corners))
    for face, owner in difficult:
        covered = covering([corners[ring] for ring in face])
        parts.append((covered, np.full(len(covered), owner)))
    triangles, owners_of = (np.concatenate(part) for part in zip(*parts, strict=True))
    return triangles, owners_of.astype(np.int64)
