"""Zones placed in a map: what lies near it as areas [m], what is not clear closed as far as it may reach.

    clear, to keep out of or in       its outline between its limits
    not clear, to keep out of         all that it may cover: a box around its points, or the whole map
    not clear, to keep in             opens nothing

An outline is cut to what lies around the map before it becomes metres: far away a plane is none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from maxjax.core.files import FileError
from maxjax.core.grid import Grid
from maxjax.io.airspace.airspace import Area
from maxjax.io.airspace.antimeridian import join_at_seam
from maxjax.io.airspace.coordinates import box_around
from maxjax.io.airspace.outlines import check_outline, cut_to, insert_points
from maxjax.io.airspace.zone import MALFORMED, Polygon, Published, Zone, sentence_of
from maxjax.io.airspace.zone_heights import heights_in, remarks_on
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.earth import Earth, on_own_zero
from maxjax.io.geo.rings import signed_area
from maxjax.io.geo.vertical_zero import UnknownZeroError

_ROOM = 0.1  # around the map [degrees]; some 10 km
_LONGEST = 0.01  # edge [degrees], so that a straight line in degrees is one in metres to a few centimetres
_NORTHERNMOST = 89.5  # [degrees]; nearer to a pole, straight lines in degrees are none
_TOLD = 8  # names in a remark
_THIN = 1e-9  # [degrees]; an outline of that width in the mean has no area

Box = Float[np.ndarray, "2 2"]


@dataclasses.dataclass
class _Placed:
    """What has become of the zones of a file."""

    areas: list[Area] = dataclasses.field(default_factory=list)
    clear: int = 0
    outside: int = 0
    faults: list[tuple[Zone, str]] = dataclasses.field(default_factory=list)
    swapped: list[str] = dataclasses.field(default_factory=list)
    unlimited: list[str] = dataclasses.field(default_factory=list)
    flat: list[str] = dataclasses.field(default_factory=list)
    near: list[Zone] = dataclasses.field(default_factory=list)


def areas_in(published: Published, earth: Earth, grid: Grid, file: Path) -> tuple[tuple[Area, ...], tuple[str, ...]]:
    """Areas in a map, and sentences on what a user should know of them.

    Args:
        published: zones of a file.
        earth: where the map lies.
        grid: the map's.
        file: for messages.

    Raises:
        FileError: if no zone is clear, none lies in the map, or none of those to keep in does.
        UnknownZeroError: as `heights_in`.
    """
    box = _box(earth, grid, file)
    if not published.zones:
        raise FileError(f"{file}: expected a Polygon, a MultiPolygon or a circle to keep out of or in, found "
                        f"{_counts(published.left_out) or 'none'}")  # fmt: skip
    found = _Placed()
    for zone in published.zones:
        _place(zone, earth, grid, box, found)
    _check_any(published, found, box, file)
    return tuple(found.areas), tuple(_remarks(published, found, earth, file.name))


def _place(zone: Zone, earth: Earth, grid: Grid, box: Box, found: _Placed) -> None:
    """Add the areas of a zone to those that are found."""
    fault = zone.fault
    held = dataclasses.replace(zone, lower=None, upper=None) if fault else zone
    areas, outside, flat = list[Area](), 0, False
    try:
        polygons = join_at_seam(list(zone.polygons))
        areas, outside = _areas(held, polygons, earth, box)
        flat = bool(areas) and any(_is_flat(polygon[0]) for polygon in polygons)
    except UnknownZeroError:
        raise
    except MALFORMED as error:
        fault = "; ".join(filter(None, (fault, sentence_of(error))))
        held = dataclasses.replace(zone, lower=None, upper=None)
        areas, outside = _areas(held, [box_around(np.concatenate(one))[0] for one in zone.polygons], earth, box)
    if fault:
        found.faults.append((zone, fault))
        if zone.keep_in:
            return
        areas = areas if zone.polygons else [Area(zone.name, (_whole(grid),))]
    else:
        found.clear += 1
        found.swapped += [zone.name] if outside and _swapped(polygons, box) else []
        found.unlimited += [zone.name] if areas and zone.lower is zone.upper is None else []
    found.outside += outside
    found.areas += areas
    found.near += [zone] if areas else []
    found.flat += [zone.name] if flat else []


def _areas(zone: Zone, polygons: list[Polygon], earth: Earth, box: Box) -> tuple[list[Area], int]:
    """Areas of some polygons with the limits of a zone, and how many of them lie outside of the map.

    Raises:
        ValueError: for an outline that is not clear, and lies near the map.
        UnknownZeroError: as `heights_in`.
    """
    near = [_near(polygon, box) for polygon in polygons]
    heights = heights_in(zone, earth) if any(near) else {}
    areas = [
        Area(zone.name, tuple(_in_map(ring, earth) for ring in rings), zone.keep_in, **heights)
        for rings in near
        if rings
    ]
    return areas, sum(not rings for rings in near)


def _check_any(published: Published, found: _Placed, box: Box, file: Path) -> None:
    """Raise a `FileError` where a file says nothing clear of the map."""
    if not found.clear:
        zone, fault = found.faults[0]
        raise FileError(f"{file}: {zone.name}: {fault}")
    (west, south), (east, north) = box
    where = f"longitude {west:.4f} to {east:.4f} and latitude {south:.4f} to {north:.4f}"
    kept = [zone for zone in published.zones if zone.keep_in]
    if not found.areas or (kept and not any(area.keep_in for area in found.areas)):
        what = "an area to keep in" if kept else "an area"
        unclear = sum(zone.keep_in for zone, _ in found.faults)
        also = f" and {unclear} that are not clear ({found.faults[0][1]})" if unclear else ""
        swapped = "swapped, it lies in the map: " if found.swapped else ""
        raise FileError(
            f"{file}: expected {what} in the map, {where}, found {found.outside} outside{also}; "
            f"{swapped}longitude comes first in GeoJSON"
        )


def _remarks(published: Published, found: _Placed, earth: Earth, source: str) -> list[str]:
    """Sentences on zones that are left out, or hold otherwise than their file may say."""
    remarks = [f"areas of {source} that lie outside the map are left out: {found.outside}"] if found.outside else []
    if found.swapped:
        remarks.append(
            f"areas of {source} that lie in the map if longitude and latitude are swapped: {_names(found.swapped)}"
        )
    if found.unlimited:
        remarks.append(f"areas of {source} without heights hold at all of them: {_names(found.unlimited)}")
    if published.left_out:
        remarks.append(f"left out of {source}: {_counts(published.left_out)}")
    if found.flat:
        remarks.append(f"areas of {source} whose outline has no area close what it touches: {_names(found.flat)}")
    if timed := [zone.name for zone in found.near if zone.timed]:
        remarks.append(f"times are not read: areas of {source} that name some hold always: {_names(timed)}")
    for zone, fault in found.faults[:_TOLD]:
        does = "opens nothing" if zone.keep_in else "is closed as far as it may reach"
        if not zone.keep_in and not zone.polygons:
            does = "closes the whole map, as where it lies is not clear"
        remarks.append(f"{zone.name} of {source} {does}: {fault}")
    if len(found.faults) > _TOLD:
        remarks.append(f"areas of {source} that are not clear, and are not named: {len(found.faults) - _TOLD}")
    return [*remarks, *remarks_on(found.near, earth, source), *published.remarks]


def _names(names: list[str]) -> str:
    """Some names, the first of many."""
    names = list(dict.fromkeys(names))
    more = f" and {len(names) - _TOLD} more" if len(names) > _TOLD else ""
    return ", ".join(names[:_TOLD]) + more


def _counts(counted: Mapping[str, int]) -> str:
    """Numbers of things, by kind."""
    return ", ".join(f"{count} {kind}" for kind, count in counted.items())


def _is_flat(ring: Ring) -> bool:
    """Whether an outline has no area."""
    return abs(signed_area(ring)) <= _THIN * float(np.ptp(ring, axis=0).sum())


def _swapped(polygons: list[Polygon], box: Box) -> bool:
    return any(_meet(polygon[0][:, ::-1], box) for polygon in polygons)


def _whole(grid: Grid) -> Ring:
    """An outline around a map [m]."""
    (x0, y0, _), (x1, y1, _) = grid.lower, grid.upper
    room = grid.spacing
    return np.array([[x0 - room, y0 - room], [x1 + room, y0 - room], [x1 + room, y1 + room], [x0 - room, y1 + room]])


def _in_map(ring: Ring, earth: Earth) -> Ring:
    """An outline in the map [m]; longitudes may lie beyond 180 degrees."""
    east, north = ring.T
    east = east - 360.0 * np.round(east / 360.0)
    flat = on_own_zero(earth)
    found: Ring = flat.local(np.column_stack([north, east, np.full(len(ring), flat.zero.number)]))[:, :2]
    return found


def _box(earth: Earth, grid: Grid, file: Path) -> Box:
    """Least and greatest longitude and latitude of a map [degrees]."""
    (x0, y0, z), (x1, y1, _) = grid.lower, grid.upper
    places = earth.geodetic(np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1)]))[:, 1::-1]
    if not np.abs(places[:, 1]).max() <= _NORTHERNMOST:
        raise FileError(
            f"{file}: expected a map within {_NORTHERNMOST:g} degrees of the equator for areas, found one at latitude "
            f"{places[0, 1]:.3f}; plan without --airspace there"
        )
    places[:, 0] -= 360.0 * np.round((places[:, 0] - places[0, 0]) / 360.0)
    return np.array([places.min(axis=0), places.max(axis=0)])


def _near(rings: Polygon, box: Box) -> list[Ring]:
    """The part of a polygon around the map; none for one that lies elsewhere."""
    middle = float(box[:, 0].mean())
    turns = round((middle - 0.5 * float(rings[0][:, 0].min() + rings[0][:, 0].max())) / 360.0)
    copies = [[ring + np.array([360.0 * (turns + k), 0.0]) for ring in rings] for k in (-1, 0, 1)]
    near = [copy for copy in copies if _meet(copy[0], box)]
    if not near:
        return []
    check_outline(rings)
    room = np.array([[-_ROOM], [_ROOM]])
    cut = [cut_to(ring, box + room) for ring in _as_one(near, middle)]
    return [insert_points(ring, _LONGEST) for ring in cut if len(ring) >= 3]


def _as_one(copies: list[Polygon], longitude: float) -> Polygon:
    """One polygon of an area's copies, of which an area around the Earth has two beside a longitude at 180 degrees."""
    if len(copies) == 1:
        return copies[0]
    turn = np.array([360.0 * round((longitude - 180.0) / 360.0), 0.0])
    joined = join_at_seam([[ring - turn for ring in copy] for copy in copies])
    return [ring + turn for polygon in joined for ring in polygon]


def _meet(outline: Ring, box: Box) -> bool:
    return bool((outline.min(axis=0) <= box[1]).all() and (outline.max(axis=0) >= box[0]).all())
