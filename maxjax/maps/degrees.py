"""Footprints in longitude and latitude, as metres on a plane.

    east = N(φ₀) cos φ₀ (λ − λ₀)        north = M(φ₀) (φ − φ₀)

the plane that touches the WGS 84 ellipsoid at the origin (λ₀, φ₀), the middle of the buildings: N and M are its radii
of curvature along the parallel and the meridian. Meridians converge: at Los Angeles a point 1 km from the origin is off
by up to 0.1 m, and a window of 200 m that near to it is distorted by two centimetres at most. Longitudes are taken as
the nearest to that of the first corner, so that a town across the antimeridian is as wide as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from maxjax.core.earth import project
from maxjax.core.files import FileError
from maxjax.maps.footprints import Footprint, Footprints, checked_heights

_WIDEST = 1.0  # [degrees]; some 100 km, where the plane is off by hundreds of metres already
_NORTHERNMOST = 85.0  # [degrees]; farther on, a degree of longitude is hardly a length


def on_a_plane(buildings: Sequence[Footprint], skipped: int, path: Path) -> Footprints:
    """Footprints of rings in degrees (longitude, latitude), heights in metres.

    Raises:
        FileError: if there is none, or coordinates are not on Earth, too far north or south, or too far apart.
    """
    checked_heights(buildings, skipped, path)
    corners = np.concatenate([ring for building in buildings for ring in building.rings])
    off = ~((np.abs(corners[:, 0]) <= 180.0) & (np.abs(corners[:, 1]) <= _NORTHERNMOST))
    if off.any():
        longitude, latitude = corners[off][0]
        raise FileError(
            f"{path}: expected longitudes within 180 and latitudes within {_NORTHERNMOST:g} degrees, "
            f"found {longitude}, {latitude}; swapped, or no degrees?"
        )
    first = corners[0, 0]

    def unwrapped(ring: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return np.asarray(ring - np.array([360.0, 0.0]) * np.round((ring[:, :1] - first) / 360.0))

    corners = unwrapped(corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if (high - low).max() > _WIDEST:
        raise FileError(
            f"{path}: expected buildings within {_WIDEST:g} degree of each other, found longitudes {low[0]} to "
            f"{high[0]} and latitudes {low[1]} to {high[1]}; crop it"
        )
    middle = 0.5 * (low + high)
    moved = tuple(
        Footprint(tuple(project(unwrapped(ring), middle) for ring in b.rings), b.base, b.top, b.name) for b in buildings
    )
    origin = np.array([*middle, 0.0])
    return Footprints(moved, np.zeros((0, 3, 3)), origin, skipped, path.name, "EPSG:4326", geographic=True)
