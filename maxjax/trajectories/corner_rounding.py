"""A polyline with its corners rounded, as a curve whose second derivative is continuous.

The polyline x(s) over its arc length s, with a turn Δu_i between unit directions at the corner s_i, is blended over a
width b_i on both sides of each corner,

    x̃(s) = x(s) + Σ_i Δu_i G_i(s),    G_i(s) = b_i/6 (1 − |s − s_i| / b_i)³₊.

It is a cubic between corners and ends of blends, straight where nothing turns, and blends may overlap. It deviates
from the polyline by at most D if b_i T_i(b_i) ≤ 6 D, T_i(b) = sum of |Δu_j| over |s_j − s_i| ≤ 2 b
(`trajectories.online` derives this). No blend reaches an end of the polyline.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

# Widths that are tried [m], the widest for gentle turns at full speed.
_WIDTHS = 16.0 * 2.0 ** (-0.5 * np.arange(16))
# Samples of a blend, from its beginning to its end, and the greatest distance of samples [m].
_BLEND, _SPACING = 17, 0.25
_FEWEST = 8  # intervals of a short curve
# Samples closer than this are one [m].
_SAME = 1e-5


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
        turned = np.concatenate([[0.0], np.cumsum(angle)])
        reach = 2.0 * _WIDTHS[:, None]
        around = turned[np.searchsorted(s, s + reach, "right")] - turned[np.searchsorted(s, s - reach, "left")]
        widest = 6.0 * deviation / np.maximum(around, 1e-12)
        width = np.max(np.minimum(_WIDTHS[:, None], widest), axis=0)
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
            near = (1.0 - np.abs(away) / width)[:, None]
            point[low:high] += near**3 * (width / 6.0) * turn
            # At the corner itself `edge` is the edge after it; the sign agrees with that.
            slope[low:high] += np.where(away < 0.0, 0.5, -0.5)[:, None] * near**2 * turn
            bend[low:high] += near / width * turn
        return point, slope, bend
