"""Circles on Earth as polygons: around the circle where one keeps out of it, within it where one keeps in.

    corner k lies at azimuth 2 π k / n and distance r / cos²(π / n), to keep out, or r cos(π / n), to keep in

A regular polygon of n edges about a circle has its corners at r / cos(π / n). An edge is straight in degrees, and bends
off the shortest way by no more than the other factor as long as the circle keeps three radii from the poles. Nearer,
all that is as near to the pole stands for it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from maxjax.io.airspace.zone import Polygon, UnclearError

_A, _F = 6378137.0, 1.0 / 298.257223563  # half axis [m] and flattening of WGS84
_CORNERS = 90
_LARGEST = 1e6  # radius [m]
_METRES = 110e3  # of a degree of latitude, at least
_ROUNDS = 5  # each is a thousand times nearer


def circle_around(centre: Float[np.ndarray, " 2"], radius: float, *, keep_in: bool = False) -> Polygon:
    """The polygon of a circle, in degrees; longitudes may lie beyond 180.

    Args:
        centre: longitude and latitude [degrees].
        radius: on the ground [m].
        keep_in: whether it lies within the circle; False: around it.

    Raises:
        UnclearError: for a radius that is none, or a circle near a pole to keep in.
    """
    if not 0.0 < radius <= _LARGEST:
        raise UnclearError(f"expected a radius of 0 to {_LARGEST:g} m, found {radius:g}")
    longitude, latitude = float(centre[0]), float(centre[1])
    if (90.0 - abs(latitude)) * _METRES < 3.0 * radius:
        if keep_in:
            raise UnclearError(f"expected a circle to keep in that is far from the poles, found latitude {latitude:g}")
        edge = np.sign(latitude) * max(abs(latitude) - radius / _METRES, -90.0)
        south, north = sorted((float(edge), 90.0 if latitude > 0 else -90.0))
        return [np.array([[-180.0, south], [180.0, south], [180.0, north], [-180.0, north]])]
    bend = np.cos(np.pi / _CORNERS)
    azimuth = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    return [_at(longitude, latitude, azimuth, radius * bend if keep_in else radius / bend**2)]


def _at(
    longitude: float, latitude: float, azimuth: Float[np.ndarray, " n"], distance: float
) -> Float[np.ndarray, "n 2"]:
    """Places in some directions and at one distance from a place (Vincenty's direct formula)."""
    b = _A * (1.0 - _F)
    reduced = np.arctan((1.0 - _F) * np.tan(np.radians(latitude)))
    from_equator = np.arctan2(np.tan(reduced), np.cos(azimuth))
    sine = np.cos(reduced) * np.sin(azimuth)
    squared = (1.0 - sine**2) * (_A**2 - b**2) / b**2
    p = 1.0 + squared / 16384.0 * (4096.0 + squared * (-768.0 + squared * (320.0 - 175.0 * squared)))
    q = squared / 1024.0 * (256.0 + squared * (-128.0 + squared * (74.0 - 47.0 * squared)))
    arc = np.full(len(azimuth), distance / b) / p
    for _ in range(_ROUNDS):
        middle = np.cos(2.0 * from_equator + arc)
        turn = np.cos(arc) * (2.0 * middle**2 - 1.0)
        turn -= q / 6.0 * middle * (4.0 * np.sin(arc) ** 2 - 3.0) * (4.0 * middle**2 - 3.0)
        arc = distance / b / p + q * np.sin(arc) * (middle + 0.25 * q * turn)
    middle = np.cos(2.0 * from_equator + arc)
    rise = np.sin(reduced) * np.cos(arc) + np.cos(reduced) * np.sin(arc) * np.cos(azimuth)
    back = np.sin(reduced) * np.sin(arc) - np.cos(reduced) * np.cos(arc) * np.cos(azimuth)
    north = np.arctan2(rise, (1.0 - _F) * np.hypot(sine, back))
    east = np.arctan2(
        np.sin(arc) * np.sin(azimuth), np.cos(reduced) * np.cos(arc) - np.sin(reduced) * np.sin(arc) * np.cos(azimuth)
    )
    c = _F / 16.0 * (1.0 - sine**2) * (4.0 + _F * (4.0 - 3.0 * (1.0 - sine**2)))
    bent = arc + c * np.sin(arc) * (middle + c * np.cos(arc) * (2.0 * middle**2 - 1.0))
    east -= (1.0 - c) * _F * sine * bent
    return np.column_stack([longitude + np.degrees(east), np.degrees(north)])
