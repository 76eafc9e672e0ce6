"""Roofs that a request may end on: what it names, where that is about, and the places on them in the map.

names and places  →  corners that the map's window has to hold  →  (with the map) places to land on
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.inspection.landing_place import Landing, LandingPlace, find_landing
from maxjax.inspection.targets import choose
from maxjax.io import Contents
from maxjax.io.geo.earth import Earth
from maxjax.io.kinds.contents import facts
from maxjax.io.kinds.faces import faces_of
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.kinds.mesh import Mesh
from maxjax.ui.request import Request

Roof = str | tuple[float, float]
_ON_EARTH = ("agl", "home", "amsl")  # frames of latitudes and longitudes


def roof_targets(request: Request, earth: Earth | None) -> tuple[Roof, ...]:
    """What a request may land on: names, and a place in the coordinates of the map [m].

    Raises:
        ValueError: as `Request.roofs`; for a place on Earth of a map that lies nowhere on it.
    """
    found = list[Roof]()
    for roof in request.roofs:
        if isinstance(roof, str) or request.frame not in _ON_EARTH:
            found.append(roof)
            continue
        if earth is None:
            raise ValueError(f"--land-at: expected x and y, as the map lies nowhere on Earth, given {roof}")
        x, y, _ = earth.local(np.array([[*roof, 0.0]]))[0].tolist()
        found.append((x, y))
    return tuple(found)


def hints_of(source: Contents, roofs: Sequence[Roof], frame: str, earth: Earth | None) -> tuple[Point3, ...]:
    """A place above each roof, in a frame, so that the map is read with it.

    Raises:
        ValueError: for a building that is not in the file, or a file that has no buildings.
    """
    if not roofs:
        return ()
    extent = facts(source).extent
    if not isinstance(source, Footprints | Mesh):
        named = next((roof for roof in roofs if isinstance(roof, str)), None)
        if named is not None:
            raise ValueError(f"--land-on: expected a map that names its buildings, given {named!r}; give --land-at X Y")
        points = [(*roof, float(extent[1, 2])) for roof in roofs if not isinstance(roof, str)]
    else:
        faces, points = faces_of(source), []
        for roof in roofs:
            corners = faces.triangles[choose(faces, roof).faces].reshape(-1, 3)
            x, y, _ = (0.5 * (corners.min(axis=0) + corners.max(axis=0))).tolist()
            points.append((x, y, float(corners[:, 2].max())))
    return tuple(_in_frame(point, frame, earth, float(extent[0, 2])) for point in points)


def _in_frame(point: Point3, frame: str, earth: Earth | None, lowest: float) -> Point3:
    """About the numbers of a point in a frame; heights above ground count from the lowest of the map [m]."""
    x, y, z = point
    if frame in ("map", "local-agl") or earth is None:
        return (x, y, z) if frame == "map" else (x, y, z - lowest)
    north, east, up = earth.geodetic(np.array([point]))[0].tolist()
    return north, east, up if frame == "amsl" else z - lowest


def land_on(
    where: VoxelMap, roofs: Sequence[Roof], landing: Landing, radius: float
) -> tuple[tuple[LandingPlace, ...], tuple[str, ...]]:
    """Places on roofs, those that have one, and what is wrong with the others.

    Args:
        where: the map.
        roofs: names and places.
        landing: what a place has to have.
        radius: that the vehicle keeps [m].

    Raises:
        ValueError: if no roof has such a place, there is no such building, or less is asked for than the radius.
    """
    if roofs and landing.radius < radius:
        raise ValueError(
            f"--landing-radius: expected at least the radius that the vehicle keeps, {radius:g} m, given "
            f"{landing.radius:g}"
        )
    found, refused = list[LandingPlace](), list[str]()
    for roof in roofs:
        try:
            found.append(find_landing(where, roof, landing))
        except ValueError as error:
            refused.append(str(error))
    if roofs and not found:
        raise ValueError("; ".join(refused))
    return tuple(found), tuple(refused)
