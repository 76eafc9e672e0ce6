"""A geofence of the areas of an airspace: polygons without heights and without holes, as autopilots know them.

    keep in    its outline, to stay inside of; each of its holes, to stay out of
    keep out   its outline, to stay out of; with holes, the pieces of it without holes (`io.export.pieces`)

A fence holds at every height. So one that the planned way itself crosses, because it leads over or under its area,
would stop the flight: it is left out, and named. One that a return to launch crosses is named as well.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.io.airspace.airspace import Airspace
from maxjax.io.export.pieces import pieces_of
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.earth import Earth

_APART = 2.0  # between places from which a return is judged [m]


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
    """The fences of an airspace, and a sentence on each area that has none, or another one than it is.

    Args:
        airspace: whose areas; None: there are none.
        path: planned [m].
        earth: where the map lies.
    """
    found, remarks = list[Fence](), list[str]()
    height = float(path[:, 2].mean())  # far above or below, a place has other coordinates: on the level of the way
    for area in () if airspace is None else airspace.areas:
        kept_in = area.rings[:1] if area.keep_in else ()
        kept_out = [ring for ring in area.rings[1:] if not _crosses(path[:, :2], (ring,))] if area.keep_in else []
        over = len(kept_out) < len(area.rings) - 1 if area.keep_in else _crosses(path[:, :2], area.rings)
        if not area.keep_in and not over:
            kept_out = list(area.rings) if len(area.rings) == 1 else pieces_of(area.rings)
        if over:
            what = "a hole of the area" if area.keep_in else "the area"
            remarks.append(
                f"{what} {area.name} is no fence: fences have no heights, and the way leads over or under it"
            )
        if not area.keep_in and len(kept_out) > 1:
            remarks.append(f"the area {area.name} has holes, which no fence has: {len(kept_out)} fences stand for it")
        if any(_crosses(np.stack([place, path[0, :2]]), (ring,)) for ring in kept_out for place in _along(path)):
            remarks.append(f"a return to launch crosses the fence of the area {area.name} from some places of the way")
        for ring, inclusion in [*((ring, True) for ring in kept_in), *((ring, False) for ring in kept_out)]:
            flat = np.column_stack([ring, np.full(len(ring), height)])
            found.append(Fence(earth.geodetic(flat)[:, :2], inclusion))
    return found, tuple(remarks)


def _along(path: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 2"]:
    """Places of a way, no farther apart than `_APART`."""
    pieces = [
        np.linspace(a, b, 1 + math.ceil(float(np.linalg.norm(b - a)) / _APART)) for a, b in itertools.pairwise(path)
    ]
    return np.concatenate([path, *pieces])[:, :2]


def _crosses(path: Float64[np.ndarray, "n 2"], rings: Sequence[Ring]) -> bool:
    """Whether a way has a point inside of some rings, where an odd number surround it, or crosses an edge of one."""
    a = np.concatenate(list(rings))
    b = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
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
