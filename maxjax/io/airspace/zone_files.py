"""Areas to keep out of or to keep in, from GeoJSON, in words of ED-318 and of QGroundControl's geofence.

    {"type": "Feature", "properties": {"name": "school", "type": "PROHIBITED", "lower": 0, "lowerReference": "AGL",
     "upper": 120, "upperReference": "AMSL", "uom": "m"}, "geometry": {"type": "Polygon", "coordinates": …}}

Heights stand among the properties, or as ED-318 has them in the `layer` of the geometry. `inclusion: true` is an area
to keep in; any other is kept out of, but for the type NO_RESTRICTION, which is left out. Times are not read: an area
always holds.

Coordinates are longitude and latitude (RFC 7946), or those of the file's `crs`. An outline is cut to what lies
around the map before it becomes metres: far away a plane is none. An area across 180 degrees is split there, as
RFC 7946 asks, and joined again (`io.airspace.antimeridian`).
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from maxjax.core.files import FileError, brief, parse_json, read_text
from maxjax.core.grid import Grid
from maxjax.io.airspace.airspace import Airspace, Area
from maxjax.io.airspace.antimeridian import check_span, join_at_seam
from maxjax.io.airspace.outlines import check_outline, cut_to, insert_points
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.earth import Earth, Projected, geojson_crs

_FOOT = 0.3048  # [m]
_ROOM = 0.1  # around the map [degrees]; some 10 km
_LONGEST = 0.01  # edge [degrees], so that a straight line in degrees is one in metres to a few centimetres
_HIGHEST = 1e5  # [m]


def load_airspace(
    path: str | os.PathLike[str],
    earth: Earth,
    grid: Grid,
    *,
    floor: float | None = None,
    ceiling: float | None = None,
    highest: float | None = None,
) -> Airspace:
    """Areas of a GeoJSON file as an `Airspace`; those that lie outside the map are left out.

    Args:
        path: the file (docs/airspace.md).
        earth: where the map lies, as the file of a loaded map says.
        grid: the map's.
        floor, ceiling, highest: as in `Airspace`.

    Raises:
        FileError: if the file cannot be used, or nothing in it lies in the map (a ValueError).
        ValueError: for heights that are none.
    """
    file = Path(path)
    document = parse_json(read_text(file), file)
    kind = document.get("type") if isinstance(document, dict) else type(document).__name__
    if kind not in ("FeatureCollection", "Feature"):
        raise FileError(f"{file}: expected a FeatureCollection of GeoJSON, found {brief(kind)!r}")
    try:
        areas, remarks = _areas(document, file, earth, grid)
    except (AttributeError, IndexError, KeyError, OverflowError, RecursionError, TypeError, ValueError) as error:
        if isinstance(error, FileError):
            raise FileError(brief(error)) from error.__cause__
        raise FileError(f"{file}: malformed GeoJSON: {type(error).__name__}: {brief(error)}") from error
    return Airspace(floor, ceiling, highest, areas, remarks)


def _areas(document: dict[str, Any], file: Path, earth: Earth, grid: Grid) -> tuple[tuple[Area, ...], tuple[str, ...]]:
    code = geojson_crs(document, file)
    box = _box(earth, grid)
    found, outside, unlimited = list[Area](), 0, list[str]()
    for number, feature in enumerate(document.get("features", [document])):
        values = feature.get("properties") or {}
        if str(values.get("type", "")).upper() == "NO_RESTRICTION":
            continue
        name = _name(feature, number)
        here = f"{file}: {name}"
        heights = _heights(values, feature["geometry"] or {}, earth, here)
        kept = values.get("inclusion", False)
        if not isinstance(kept, bool):
            raise FileError(f"{here}: expected inclusion true or false, found {kept!r}")
        for rings in join_at_seam(list(_polygons(feature["geometry"], code, here))):
            near = _near(rings, box, here)
            if near is None:
                outside += 1
                continue
            outlines = [_in_map(ring, earth) for ring in near]
            try:
                found.append(Area(name, tuple(outlines), kept, **heights))
            except ValueError as error:
                raise FileError(f"{file}: {error}") from error
            unlimited += [] if heights else [name]
    if not found:
        (west, south), (east, north) = box
        raise FileError(
            f"{file}: expected an area in the map, longitude {west:.4f} to {east:.4f} and latitude {south:.4f} to "
            f"{north:.4f}, found {outside} outside; longitude comes first in GeoJSON"
        )
    remarks = [f"areas of {file.name} that lie outside the map are left out: {outside}"] if outside else []
    if unlimited:
        names = ", ".join(dict.fromkeys(unlimited))
        remarks.append(f"areas of {file.name} without heights hold at all of them: {names}")
    return tuple(found), tuple(remarks)


def _in_map(ring: Ring, earth: Earth) -> Ring:
    """An outline in the map [m]; longitudes may lie beyond 180 degrees."""
    east, north = ring.T
    east = east - 360.0 * np.round(east / 360.0)
    found: Ring = earth.local(np.column_stack([north, east, np.full(len(ring), earth.height)]))[:, :2]
    return found


def _name(feature: dict[str, Any], number: int) -> str:
    values = feature.get("properties") or {}
    name = values.get("name") or values.get("identifier") or feature.get("id") or number
    if isinstance(name, list):  # of ED-318, in several languages
        name = name[0].get("text") or number
    return repr(str(name))


def _heights(values: dict[str, Any], geometry: dict[str, Any], earth: Earth, here: str) -> dict[str, Any]:
    """Those of an `Area`, by name."""
    layer = geometry.get("layer") or values
    unit = str(layer.get("uom") or "m").lower()
    if unit not in ("m", "ft"):
        raise FileError(f"{here}: expected uom m or ft, found {unit!r}")
    scale = 1.0 if unit == "m" else _FOOT
    found: dict[str, Any] = {}
    for ours, theirs in (("floor", "lower"), ("ceiling", "upper")):
        height, reference = layer.get(theirs), layer.get(f"{theirs}Reference") or "AGL"
        if reference not in ("AGL", "AMSL"):
            raise FileError(f"{here}: expected {theirs}Reference AGL or AMSL, found {reference!r}")
        if height is None:
            continue
        if isinstance(height, bool) or not isinstance(height, int | float) or not abs(height) <= _HIGHEST:
            raise FileError(f"{here}: expected {theirs} as a height, at most {_HIGHEST:g}, found {height!r}")
        above_ground = reference == "AGL"
        # The ground itself has no height to keep.
        level = scale * height if above_ground else scale * height - earth.height
        found[ours] = -math.inf if ours == "floor" and above_ground and height <= 0 else level
        found[f"{ours}_above_ground"] = above_ground
    return found


def _polygons(geometry: Any, code: str | None, here: str) -> Iterator[list[Ring]]:
    """Rings of each polygon, in degrees, last point not repeated."""
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise FileError(f"{here}: expected a Polygon or a MultiPolygon, found {kind!r}; draw circles as polygons")
    polygons = [geometry["coordinates"]] if kind == "Polygon" else geometry["coordinates"]
    if not polygons or not all(polygons):
        raise FileError(f"{here}: expected an outline, found none")
    for polygon in polygons:
        rings = []
        for given in polygon:
            ring = np.array([[float(x), float(y)] for x, y, *_ in given]).reshape(-1, 2)
            if len(ring) < 4 or (ring[0] != ring[-1]).any():
                raise FileError(
                    f"{here}: expected outlines of 4 or more points that end where they begin, found another"
                )
            if not np.isfinite(ring).all():
                raise FileError(f"{here}: expected finite coordinates, found {ring[~np.isfinite(ring).all(axis=1)][0]}")
            if code is not None:
                flat = np.column_stack([ring, np.zeros(len(ring))])
                ring = Projected(code).geodetic(flat)[:, 1::-1]
            off = ~((np.abs(ring[:, 0]) <= 360.0) & (np.abs(ring[:, 1]) <= 90.0))
            if off.any():
                raise FileError(
                    f"{here}: expected longitude and latitude in degrees, found {ring[off][0].tolist()}; "
                    "longitude comes first: swapped?"
                )
            check_span(ring[:-1], here)
            rings.append(ring[:-1])
        yield rings


def _box(earth: Earth, grid: Grid) -> Float[np.ndarray, "2 2"]:
    """Least and greatest longitude and latitude of a map [degrees]."""
    (x0, y0, z), (x1, y1, _) = grid.lower, grid.upper
    places = earth.geodetic(np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1)]))[:, 1::-1]
    places[:, 0] -= 360.0 * np.round((places[:, 0] - places[0, 0]) / 360.0)
    return np.array([places.min(axis=0), places.max(axis=0)])


def _near(rings: list[Ring], box: Float[np.ndarray, "2 2"], here: str) -> list[Ring] | None:
    """The part of a polygon around the map; None for one that lies elsewhere."""
    middle = float(box[:, 0].mean())
    turns = round((middle - 0.5 * float(rings[0][:, 0].min() + rings[0][:, 0].max())) / 360.0)
    copies = [[ring + np.array([360.0 * (turns + k), 0.0]) for ring in rings] for k in (-1, 0, 1)]
    near = [copy for copy in copies if _meet(copy[0], box)]
    if not near:
        if _meet(rings[0][:, ::-1], box):
            raise FileError(f"{here}: expected longitude first, then latitude: swapped, it lies in the map")
        return None
    check_outline(rings, here)
    room = np.array([[-_ROOM], [_ROOM]])
    cut = [cut_to(ring, box + room) for ring in _as_one(near, middle)]
    return [insert_points(ring, _LONGEST) for ring in cut if len(ring) >= 3]


def _as_one(copies: list[list[Ring]], longitude: float) -> list[Ring]:
    """One polygon of an area's copies, of which an area around the Earth has two beside a longitude at 180 degrees."""
    if len(copies) == 1:
        return copies[0]
    turn = np.array([360.0 * round((longitude - 180.0) / 360.0), 0.0])
    joined = join_at_seam([[ring - turn for ring in copy] for copy in copies])
    return [ring + turn for polygon in joined for ring in polygon]


def _meet(outline: Ring, box: Float[np.ndarray, "2 2"]) -> bool:
    return bool((outline.min(axis=0) <= box[1]).all() and (outline.max(axis=0) >= box[0]).all())
