"""GeoJSON: polygons, lines and points with heights among their properties (`tagged`), and whatever else stands.

Coordinates are longitude and latitude (RFC 7946); a file of the older form may name another system as its `crs`. The
features may stand on lines of their own (`json_lines`).
Heights are those of OpenStreetMap's tags (`tag_heights`), plain numbers in the unit of heights that is stated; floors
are `ele`, else third coordinates where a file has any: the lowest, and what is on it reaches as far above the highest.
Each polygon of several is its own, with its holes: where they overlap, both are solid.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.core.files import FileError
from maxjax.io.geo.earth import geojson_system
from maxjax.io.geo.units_and_axes import Stated
from maxjax.io.kinds.footprints import Footprints, around
from maxjax.io.readers.json_lines import read_document
from maxjax.io.readers.standing import ANYTHING, BUILDING, is_underground, kind_of
from maxjax.io.readers.tag_heights import with_other_tags
from maxjax.io.readers.tagged import Tagged, solids_of
from maxjax.io.reading import PLAIN, Reading

_DEEPEST = 16


def load_geojson(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Standing objects of a GeoJSON file; shapes without a height or a closed outline are counted by their kind.

    Raises:
        FileError: if the file is missing, too large, not GeoJSON, malformed, or holds nothing with a height; as
            `reference`.
    """
    document = read_document(path)
    kind = document.get("type") if isinstance(document, dict) else type(document).__name__
    if kind not in ("FeatureCollection", "Feature"):
        raise FileError(f"{path}: expected a FeatureCollection of GeoJSON, found {kind!r}")
    try:
        return _read(document, reading, path)
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: malformed GeoJSON: {type(error).__name__}: {error}") from error


def _read(document: dict[str, Any], reading: Reading, path: Path) -> Footprints:
    features = document.get("features", [document])
    return solids_of_features(features, geojson_system(document) or "EPSG:4326", reading, path)


def solids_of_features(
    features: Sequence[dict[str, Any]], system: str | None, reading: Reading, path: Path
) -> Footprints:
    """Features as GeoJSON has them as solids; raises as `solids_of`.

    Args:
        features: properties and a geometry each.
        system: of their coordinates; None: not known.
        reading: what the user says.
        path: for messages.
    """
    found: list[Tagged] = []
    dropped: Counter[str] = Counter()
    for number, feature in enumerate(features):
        values = feature.get("properties") or {}
        tags = with_other_tags({k: str(value) for k, value in values.items() if isinstance(value, str | int | float)})
        name = str(feature.get("id") or values.get("name") or number)
        kind = kind_of(tags)
        if is_underground(tags):
            dropped[f"{(kind or BUILDING).name} underground"] += 1
            continue
        for geometry in _simple(feature.get("geometry") or {}, 0):
            shape = geometry["type"]
            if shape == "Polygon":
                outline, *holes = [around(_ring(line)) for line in geometry["coordinates"]] or [None]
                if outline is None:
                    dropped["polygons without a closed outline"] += 1
                    continue
                # A hole as large as all would leave nothing of what has a height.
                kept = [hole for hole in holes if hole and _edges(hole) != _edges(outline)]
                parts = tuple(np.array(ring, np.float64) for ring in chain.from_iterable([outline, *kept]))
                found.append(Tagged("area", parts, kind or BUILDING, tags, name, _levels(geometry["coordinates"][0])))
            elif shape in ("LineString", "Point"):
                line = geometry["coordinates"]
                line = line if shape == "LineString" else [line]
                corners = np.array(_corners(line), np.float64).reshape(-1, 2)
                if len(corners):
                    found.append(Tagged("line", (corners,), kind or ANYTHING, tags, name, _levels(line)))
            else:
                raise FileError(f"{path}: feature {name}: expected a geometry of GeoJSON, found {shape!r}")
    return solids_of(found, dropped, Stated(system, heights="metres"), reading, path)


def _simple(geometry: dict[str, Any], depth: int) -> Iterator[dict[str, Any]]:
    """Polygons, lines and points of a geometry."""
    kind = geometry.get("type")
    if depth > _DEEPEST:
        raise ValueError(f"expected collections within {_DEEPEST} levels")
    if kind == "GeometryCollection":
        for part in geometry["geometries"]:
            yield from _simple(part, depth + 1)
    elif isinstance(kind, str) and kind.startswith("Multi"):
        for part in geometry["coordinates"]:
            yield {"type": kind.removeprefix("Multi"), "coordinates": part}
    elif geometry:
        yield geometry


def _ring(line: list[Any]) -> list[tuple[float, float]]:
    """Corners of a polygon's ring, which closes, whether its first corner is repeated or not."""
    corners = _corners(line)
    return corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners


def _levels(line: list[Any]) -> tuple[float, float] | None:
    """The lowest and the highest third coordinate of a line's corners; None where some have none."""
    levels = [float(corner[2]) for corner in line if len(corner) > 2]
    return (min(levels), max(levels)) if levels and len(levels) == len(line) else None


def _edges(rings: list[list[tuple[float, float]]]) -> set[frozenset[tuple[float, float]]]:
    return {frozenset(edge) for ring in rings for edge in pairwise([*ring, ring[0]])}


def _corners(line: list[Any]) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y, *_ in line]
