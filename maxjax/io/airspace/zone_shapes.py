"""Zones of the shapes that formats share: rings of points, and circles.

What of a shape is not clear becomes the fault of its zone (`zone_of`), and the box around its points what it may cover.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from maxjax.io.airspace.circles import circle_around
from maxjax.io.airspace.coordinates import Coordinates
from maxjax.io.airspace.zone import Limit, Zone, number_of, zone_of

Limits = Callable[[], tuple[Limit | None, Limit | None]]


def zone_of_rings(
    name: str, coordinates: Coordinates, rings: Any, limits: Limits, *, keep_in: bool = False, timed: bool = False
) -> Zone:
    """The zone of lists of rings of points; arguments as those of `zone_of`."""
    return zone_of(
        name,
        lambda: coordinates.polygons(rings),
        limits,
        lambda: coordinates.reach(rings),
        keep_in=keep_in,
        timed=timed,
    )


def zone_of_circle(
    name: str,
    coordinates: Coordinates,
    circle: tuple[Any, Any],
    limits: Limits,
    *,
    keep_in: bool = False,
    timed: bool = False,
) -> Zone:
    """The zone of a circle, its centre and its radius [m] as the file has them; arguments as those of `zone_of`."""
    centre, radius = circle
    return zone_of(
        name,
        lambda: [circle_around(coordinates.place(centre), number_of(radius), keep_in=keep_in)],
        limits,
        keep_in=keep_in,
        timed=timed,
    )
