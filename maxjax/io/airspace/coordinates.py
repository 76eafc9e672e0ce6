"""Outlines as files write them: lists of points as rings in degrees, and a box around what is not clear.

The last point repeats the first, or does not where a format leaves it out. Longitude comes first, or latitude. An edge
across 180 degrees is split there, as GeoJSON asks, or leads the short way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float

from maxjax.io.airspace.antimeridian import check_span
from maxjax.io.airspace.zone import Polygon, UnclearError, number_of
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.earth import Projected

_DEEPEST = 8


@dataclasses.dataclass(frozen=True)
class Coordinates:
    """How a format writes the coordinates of outlines.

    Attributes:
        latitude_first: of points; False: longitude is first.
        closed: whether the last point has to repeat the first.
        split: whether edges across 180 degrees have to be split there; False: they lead the short way.
        crs: system of the coordinates, as EPSG:28992; None: degrees.
    """

    latitude_first: bool = False
    closed: bool = True
    split: bool = True
    crs: str | None = None

    def polygons(self, given: Any) -> Iterable[Polygon]:
        """Polygons of lists of rings of points.

        Raises:
            UnclearError: for rings that are none, or do not lie on Earth.
        """
        if not given or not all(given):
            raise UnclearError("expected an outline, found none")
        return [[self.ring(points) for points in polygon] for polygon in given]

    def ring(self, points: Any) -> Ring:
        """A ring of points in degrees, longitude first; raises as `polygons`."""
        ring = np.array([[float(x), float(y)] for x, y, *_ in points]).reshape(-1, 2)
        repeats = len(ring) > 1 and bool((ring[0] == ring[-1]).all())
        if self.closed and not (repeats and len(ring) >= 4):
            raise UnclearError("expected outlines of 4 or more points that end where they begin, found another")
        ring = ring[:-1] if repeats else ring
        if len(ring) < 3:
            raise UnclearError(f"expected outlines of 3 or more points, found {len(ring)}")
        ring = self._on_earth(ring)
        if self.split:
            check_span(ring)
            return ring
        ring[1:, 0] = ring[0, 0] + np.cumsum((np.diff(ring[:, 0]) + 180.0) % 360.0 - 180.0)
        return ring

    def place(self, point: Any) -> Float[np.ndarray, " 2"]:
        """Longitude and latitude of a point [degrees]; raises as `polygons`."""
        x, y, *_ = point
        found: Float[np.ndarray, " 2"] = self._on_earth(np.array([[float(x), float(y)]]))[0]
        return found

    def reach(self, given: Any) -> list[Polygon]:
        """A box around all points in nested lists.

        Raises:
            ValueError: where one of them is none: what they reach is then unknown.
        """
        points = np.array(list(_points(given, 0)), np.float64).reshape(-1, 2)
        return box_around(self._on_earth(points))

    def _on_earth(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points in degrees, longitude first; raises an `UnclearError` for one that is not on Earth."""
        if not np.isfinite(points).all():
            off = points[~np.isfinite(points).all(axis=1)][0]
            raise UnclearError(f"expected finite coordinates, found {off.tolist()}")
        if self.crs is not None:
            flat = np.column_stack([points, np.zeros(len(points))])
            points = Projected(self.crs).geodetic(flat)[:, 1::-1]
        elif self.latitude_first:
            points = points[:, ::-1]
        points = np.array(points)
        off = ~((np.abs(points[:, 0]) <= 360.0) & (np.abs(points[:, 1]) <= 90.0))
        if off.any():
            first = "latitude" if self.latitude_first else "longitude"
            raise UnclearError(
                f"expected longitude and latitude in degrees, found {points[off][0].tolist()}; "
                f"{first} comes first: swapped?"
            )
        return points


def box_around(points: Float[np.ndarray, "n 2"]) -> list[Polygon]:
    """The box around some places [degrees], as one polygon; all around the Earth, if they lie far apart.

    Raises:
        UnclearError: for no places.
    """
    if len(points) == 0:
        raise UnclearError("expected an outline, found none")
    (west, south), (east, north) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    if east - west > 180.0:
        west, east = -180.0, 180.0
    return [[np.array([[west, south], [east, south], [east, north], [west, north]])]]


def _points(given: Any, depth: int) -> Iterable[tuple[float, float]]:
    """Pairs of numbers in nested lists; raises a `ValueError` for anything else in them."""
    if depth > _DEEPEST or not isinstance(given, list | tuple):
        raise ValueError("expected lists of points")
    if given and not isinstance(given[0], list | tuple):
        if len(given) < 2:
            raise ValueError("expected two coordinates")
        yield number_of(given[0]), number_of(given[1])
        return
    for part in given:
        yield from _points(part, depth + 1)
