"""Buildings of GeoJSON: polygons with heights (`tags`) among their properties.

Coordinates are longitude and latitude (RFC 7946); a file of the older form may name a projected system in metres as its
`crs`. Heights are `height` [m] or `building:levels` (also `levels`), floors `ele` [m]; third coordinates are ignored.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.core.earth import geojson_crs
from maxjax.core.files import FileError, parse_json, read_text
from maxjax.maps.degrees import on_a_plane
from maxjax.maps.footprints import Footprint, Footprints, chain, localised
from maxjax.maps.readers.osm_heights import span


def load_geojson(path: Path) -> Footprints:
    """Buildings of a GeoJSON file; polygons without a height or a closed outline are counted and left out.

    Raises:
        FileError: if the file is missing, too large, not GeoJSON, malformed, or holds no polygon with a height.
    """
    document = parse_json(read_text(path), path)
    kind = document.get("type") if isinstance(document, dict) else type(document).__name__
    if kind not in ("FeatureCollection", "Feature"):
        raise FileError(f"{path}: expected a FeatureCollection of GeoJSON, found {kind!r}")
    try:
        return _read(document, path)
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: malformed GeoJSON: {type(error).__name__}: {error}") from error


def _read(document: dict[str, Any], path: Path) -> Footprints:
    code = geojson_crs(document, path)
    found: list[Footprint] = []
    skipped = 0
    for number, feature in enumerate(document.get("features", [document])):
        geometry = feature.get("geometry") or {}
        if geometry.get("type") not in ("Polygon", "MultiPolygon"):
            continue
        values = feature.get("properties") or {}
        tags = {key: str(value) for key, value in values.items() if isinstance(value, str | int | float)}
        heights = span({"building:levels": tags.get("levels", ""), **tags})
        rings = list(_rings(geometry))
        if heights is None or not rings:
            skipped += 1
            continue
        name = str(feature.get("id") or values.get("name") or number)
        found.append(Footprint(tuple(rings), *heights, name))
    if code is None:
        return on_a_plane(found, skipped, path)
    return localised(found, np.zeros((0, 3, 3)), skipped, path, code)


def _rings(geometry: dict[str, Any]) -> Iterator[np.ndarray]:
    """Outlines and holes, last point not repeated; edges that occur twice are gone."""
    polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    for polygon in polygons:
        for ring in polygon:
            corners = [(float(x), float(y)) for x, y, *_ in ring]
            for outline in chain(itertools.pairwise(corners)) or []:
                yield np.array(outline)
