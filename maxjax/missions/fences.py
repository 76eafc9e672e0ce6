"""A geofence of the areas of an airspace: polygons without heights and without holes, as autopilots know them.

    keep in    its outline, to stay inside of; each of its holes, to stay out of
    keep out   its outline, to stay out of

A fence holds at every height. So one that the planned way itself crosses, because it leads over or under its area,
would stop the flight: it is left out, and named.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.airspace.airspace import Airspace, Area
from maxjax.core.earth import Earth
from maxjax.core.geometry.columns import Ring


@dataclasses.dataclass(frozen=True, eq=False)
class Fence:
    """A polygon to stay inside of, or out of.

    Attributes:
        corners: (n, 2) latitude and longitude [degrees], the last not repeated.
        inclusion: whether to stay inside.
    """

    corners: Float64[np.ndarray, "n 2"]
    inclusion: bool


def fences_of(
    airspace: Airspace | None, path: Float64[np.ndarray, "n 3"], earth: Earth
) -> tuple[list[Fence], tuple[str, ...]]:
    """The fences of an airspace, and a sentence on each area that has none.

    Args:
        airspace: whose areas; None: there are none.
        path: planned [m].
        earth: where the map lies.
    """
    found, remarks = list[Fence](), list[str]()
    for area in () if airspace is None else airspace.areas:
        for ring, inclusion in _outlines(area):
            if not inclusion and _crosses(path[:, :2], ring):
                remarks.append(
                    f"the area {area.name} is no fence: fences have no heights, and the way leads over or under it"
                )
                continue
            # Far above or below, a place has other coordinates: on the level of the way.
            flat = np.column_stack([ring, np.full(len(ring), path[:, 2].mean())])
            found.append(Fence(earth.geodetic(flat)[:, :2], inclusion))
    return found, tuple(remarks)


def _outlines(area: Area) -> list[tuple[Ring, bool]]:
    """The rings of an area that are fences, and whether to stay inside of each."""
    if not area.keep_in:
        return [(area.rings[0], False)]
    return [(ring, k == 0) for k, ring in enumerate(area.rings)]


def _crosses(path: Float64[np.ndarray, "n 2"], ring: Ring) -> bool:
    """Whether a way has a point inside of a ring, or crosses an edge of it."""
    a, b = ring, np.roll(ring, -1, axis=0)
    x, y = path[:, :1], path[:, 1:]
    spans = (a[:, 1] <= y) != (b[:, 1] <= y)
    run = np.where(spans, b[:, 1] - a[:, 1], 1.0)
    right = a[:, 0] + (y - a[:, 1]) / run * (b[:, 0] - a[:, 0]) > x
    if ((spans & right).sum(axis=1) % 2).any():
        return True
    p, d = path[:-1, None], np.diff(path, axis=0)[:, None]
    e = b - a
    turn = d[..., 0] * e[:, 1] - d[..., 1] * e[:, 0]
    safe = np.where(turn == 0, 1.0, turn)
    t = ((a - p)[..., 0] * e[:, 1] - (a - p)[..., 1] * e[:, 0]) / safe
    u = ((a - p)[..., 0] * d[..., 1] - (a - p)[..., 1] * d[..., 0]) / safe
    return bool(((turn != 0) & (t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)).any())
