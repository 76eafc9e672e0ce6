"""Outlines across 180 degrees: polygons that are split there, as RFC 7946 asks, joined to the one that they are.

    boundary of the union = edges of the parts, less what two parts share along the seam

Parts west of the seam keep their longitudes; those east of it follow beyond 180.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from maxjax.io.airspace.zone import Polygon, UnclearError
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.rings import chain, signed_area

_SEAM = 180.0  # [degrees]
_ON = 1e-9  # of the seam [degrees]; a tenth of a millimetre

_Point = tuple[float, float]
_Edge = tuple[_Point, _Point]


def check_span(ring: Ring) -> None:
    """Raise an `UnclearError` for an edge that leads around more than half the Earth, but for all of it.

    It is either a way across 180 degrees that is not split there, or means what nobody draws.
    """
    wide = np.abs(np.diff(ring[:, 0], append=ring[:1, 0]))
    if ((wide > _SEAM) & (wide < 2.0 * _SEAM)).any():
        k = int(np.argmax((wide > _SEAM) & (wide < 2.0 * _SEAM)))
        a, b = float(ring[k, 0]), float(ring[(k + 1) % len(ring), 0])
        raise UnclearError(
            f"expected edges across 180 degrees to be split there (RFC 7946), found one from longitude {a:g} "
            f"to {b:g}; split it, or write {b + 2.0 * math.copysign(_SEAM, a):g} for {b:g}"
        )


def join_at_seam(polygons: list[Polygon]) -> list[Polygon]:
    """Polygons of one area, those that share a part of the seam as one.

    Args:
        polygons: outlines and holes each, longitude and latitude [degrees], last point not repeated.
    """
    if len(polygons) < 2:
        return polygons
    parts = [_turned(polygon) for polygon in polygons]
    levels = sorted({point[1] for part in parts for ring in part for point in ring.tolist() if point[0] == _SEAM})
    edges = [[edge for ring in part for edge in _split(ring, levels)] for part in parts]
    seams = [{frozenset(edge) for edge in own if edge[0][0] == edge[1][0] == _SEAM} for own in edges]
    group = list(range(len(parts)))
    for one, other in itertools.combinations(range(len(parts)), 2):
        if seams[one] & seams[other] and _side(polygons[one]) != _side(polygons[other]):
            group = [group[one] if own == group[other] else own for own in group]
    joined = []
    for own in dict.fromkeys(group):
        members = [k for k, of in enumerate(group) if of == own]
        if len(members) == 1:
            joined.append(polygons[members[0]])
        else:
            joined.append(_outline_first(chain(edge for k in members for edge in edges[k]) or []))
    return joined


def _side(polygon: Polygon) -> float:
    """180 or −180 where a polygon ends on the seam, and NaN where it does not, or on both sides."""
    longitudes = np.concatenate([ring[:, 0] for ring in polygon])
    sides = {float(np.sign(at)) for at in longitudes if abs(abs(at) - _SEAM) <= _ON}
    return _SEAM * sides.pop() if len(sides) == 1 else math.nan


def _turned(polygon: Polygon) -> Polygon:
    """The same with the seam at 180, if it ends on it at −180."""
    side, found = _side(polygon), []
    for ring in polygon:
        turned = ring + np.array([2.0 * _SEAM if side < 0 else 0.0, 0.0])
        turned[np.abs(turned[:, 0] - _SEAM) <= _ON, 0] = _SEAM
        found.append(turned)
    return found


def _split(ring: Ring, levels: list[float]) -> Iterator[_Edge]:
    """The edges of a ring, those on the seam cut at the latitudes of all points there."""
    points: list[_Point] = [(x, y) for x, y in ring.tolist()]
    for a, b in zip(points, [*points[1:], points[0]], strict=True):
        low, high = sorted((a[1], b[1]))
        cuts = [y for y in levels if low < y < high] if a[0] == b[0] == _SEAM else []
        stops = [a, *((_SEAM, y) for y in (cuts if a[1] < b[1] else reversed(cuts))), b]
        yield from ((p, q) for p, q in itertools.pairwise(stops) if p != q)


def _outline_first(rings: list[list[_Point]]) -> Polygon:
    """The ring that surrounds the others before these."""
    return sorted(map(np.array, rings), key=lambda ring: -abs(signed_area(ring)))
