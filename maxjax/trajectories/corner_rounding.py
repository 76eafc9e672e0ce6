"""A polyline with its corners rounded, as a curve whose second derivative is continuous.

The polyline x(s) over its arc length s, with a turn Δu_i between unit directions at the corner s_i, is blended over a
width b_i on both sides of each corner,

    x̃(s) = x(s) + Σ_i Δu_i G_i(s),    G_i(s) = b_i/6 (1 − |s − s_i| / b_i)³₊.

It is a cubic between corners and ends of blends, straight where nothing turns, and its second derivative, a sum of hats
Δu_i/b_i (1 − |s − s_i|/b_i)₊, is continuous; for equal widths it is x smoothed by a triangular kernel. The deviation is
bounded by

    |x̃ − x| ≤ Σ_i |Δu_i| G_i ≤ D    if  b_i T_i(b_i) ≤ 6 D,    T_i(b) = sum of |Δu_j| over |s_j − s_i| ≤ 2 b.

(G_i is convex on either side of s_i, so the sum is greatest at a corner s_j. The widest of the corners that reach s_j
has all the others within twice its width; hence the sum is at most b T / 6 of that corner.)

`widths_within` and `blend` take arrays of NumPy (trajectories) and of JAX (flights, `trajectories.online`) alike.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float64

# Widths that are tried [m], the widest for gentle turns at full speed.
_WIDTHS = 16.0 * 2.0 ** (-0.5 * np.arange(16))
# Samples of a blend, from its beginning to its end, and the greatest distance of samples [m].
_BLEND, _SPACING = 17, 0.25
_FEWEST = 8  # intervals of a short curve
# Samples closer than this are one [m].
_SAME = 1e-5


def widths_within(deviation: float, arclength: Any, angle: Any, widths: Any) -> Any:
    """The widest blends [m] that keep the curve within a deviation of its polyline.

    Args:
        deviation: D [m].
        arclength: (n,) of the polyline's points [m].
        angle: (n,) |Δu| of its corners.
        widths: (k,) candidates [m]. Of each, b = min(width, 6 D / T) is valid, as T only falls with b.

    Returns:
        (n,) [m].
    """
    xp = arclength.__array_namespace__()
    turned = xp.concatenate([xp.zeros(1, angle.dtype), xp.cumsum(angle)])
    reach = 2.0 * widths[:, None]
    up_to = xp.searchsorted(arclength, arclength + reach, side="right")
    below = xp.searchsorted(arclength, arclength - reach, side="left")
    around = xp.maximum(turned[up_to] - turned[below], angle)
    widest = xp.where(around > 0.0, 6.0 * deviation / xp.where(around > 0.0, around, 1.0), xp.inf)
    return xp.max(xp.minimum(widths[:, None], widest), axis=0)


def blend(away: Any, width: Any) -> tuple[Any, Any, Any]:
    """G_i(s) and its first two derivatives, at s − s_i `away` from a corner [m]; arrays that broadcast."""
    xp = away.__array_namespace__()
    near = xp.maximum(1.0 - xp.abs(away) / width, 0.0)
    # At the corner itself the edge is the one after it; the sign agrees with that.
    return near**3 * width / 6.0, xp.where(away < 0.0, 0.5, -0.5) * near**2, near / width


@dataclasses.dataclass(frozen=True)
class Curve:
    """A rounded polyline.

    Attributes:
        points: (n, 3) of the polyline [m].
        directions: (n − 1, 3) of its edges, of unit length.
        arclength: (n,) of its points [m].
        widths: (n,) of its blends [m]; 0 at both ends.
    """

    points: Float64[np.ndarray, "n 3"]
    directions: Float64[np.ndarray, "e 3"]
    arclength: Float64[np.ndarray, " n"]
    widths: Float64[np.ndarray, " n"]

    @classmethod
    def of(cls, points: Float64[np.ndarray, "n 3"]) -> Curve:
        """A polyline whose corners are not rounded yet; no two neighbouring points are equal."""
        edges = np.diff(points, axis=0)
        length = np.linalg.norm(edges, axis=1)
        arclength = np.concatenate([[0.0], np.cumsum(length)])
        return cls(points, edges / length[:, None], arclength, np.zeros(len(points)))

    @property
    def turns(self) -> Float64[np.ndarray, "n 3"]:
        """Δu at each point; 0 at both ends."""
        return np.pad(np.diff(self.directions, axis=0), ((1, 1), (0, 0)))

    def rounded(self, deviation: float, shares: Float64[np.ndarray, " n"]) -> Curve:
        """The curve whose blends are as wide as `deviation` [m] allows, times a share of each corner (0 to 1)."""
        s, angle = self.arclength, np.linalg.norm(self.turns, axis=1)
        width = widths_within(deviation, s, angle, _WIDTHS)
        width = np.minimum(np.minimum(width, s), s[-1] - s)
        return dataclasses.replace(self, widths=width * shares)

    def samples(self) -> Float64[np.ndarray, " m"]:
        """Places where the curve is well known: the polyline's points, the blends, and no more than 0.25 m apart."""
        s, total = self.arclength, self.arclength[-1]
        even = np.linspace(0.0, total, max(int(np.ceil(total / _SPACING)), _FEWEST) + 1)
        blends = s[:, None] + self.widths[:, None] * np.linspace(-1.0, 1.0, _BLEND)
        found = np.unique(np.concatenate([even, s, blends.ravel()]))
        apart = np.diff(found) > min(_SAME, 1e-3 * total)
        return np.concatenate([[0.0], found[1:-1][apart[:-1] & apart[1:]], [total]])

    def at(self, s: Float64[np.ndarray, " m"]) -> tuple[Float64[np.ndarray, "m 3"], ...]:
        """The curve and its first two derivatives by s."""
        edge = np.clip(np.searchsorted(self.arclength, s, side="right") - 1, 0, len(self.directions) - 1)
        unit = self.directions[edge]
        point = self.points[edge] + (s - self.arclength[edge])[:, None] * unit
        slope, bend = unit.copy(), np.zeros_like(unit)
        turns = self.turns
        for i in np.flatnonzero(self.widths > 0.0):
            width, turn = self.widths[i], turns[i]
            low, high = np.searchsorted(s, self.arclength[i] + np.array([-width, width]))
            away = s[low:high] - self.arclength[i]
            for curve, part in zip((point, slope, bend), blend(away[:, None], width), strict=True):
                curve[low:high] += part * turn
        return point, slope, bend
