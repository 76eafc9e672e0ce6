"""Zones of a path: its segments cut exactly where they enter or leave spheres around its ends, in float64 NumPy.

A segment a + t d crosses the sphere of radius r around c where

    |a + t d − c|² = r²:    (d·d) t² + 2 (d·(a − c)) t + (a − c)·(a − c) − r² = 0.

Between two neighbouring roots in [0, 1] it lies inside or outside as a whole, as its midpoint does.

Zones are nested: zone k is outside the spheres of k levels, each level's no smaller than those of the level before.
The first level's are the exemptions of the ends.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

# Of a path that is verified: exempt, near its ends, and cruising.
ZONES = 3


def dot(a: Float64[np.ndarray, "*#k 3"], b: Float64[np.ndarray, "*#k 3"]) -> Float64[np.ndarray, "*k"]:
    """Scalar products, summed along x, y and z in this order on every machine: `np.einsum` adds as it is fastest."""
    product = a * b
    total: Float64[np.ndarray, "*k"] = product[..., 0] + product[..., 1] + product[..., 2]
    return total


class Parts(NamedTuple):
    """Parts start + t step, t ∈ [0, 1], of segments, in their order.

    Attributes:
        segment: that each is a part of.
        start, step: as the segments'.
        zone: outside the spheres of how many levels; on a sphere is outside.
        exempt: inside which of the first level's spheres.
    """

    segment: Int64[np.ndarray, " k"]
    start: Float64[np.ndarray, "k 3"]
    step: Float64[np.ndarray, "k 3"]
    zone: Int64[np.ndarray, " k"]
    exempt: Bool[np.ndarray, "k n"]


def cut(
    a: Float64[np.ndarray, "s 3"],
    d: Float64[np.ndarray, "s 3"],
    centres: Float64[np.ndarray, "s n 3"],
    radii: Float64[np.ndarray, "s l n"],
) -> Parts:
    """Cut segments a + t d, t ∈ [0, 1], by l levels of n spheres; one that crosses none stays whole, to the bit."""
    offset = a[:, None] - centres
    square = dot(d, d)[:, None, None]
    half = dot(d[:, None], offset)[:, None]
    rest = dot(offset, offset)[:, None] - radii * radii
    depth = half * half - square * rest
    crosses = (depth > 0) & (square > 0)
    # Of the two forms of each root, the one that subtracts no numbers of nearly one size.
    far = -half - np.copysign(np.sqrt(np.where(crosses, depth, 0.0)), half)
    first = np.where(crosses, far, 0.0) / np.where(crosses, square, 1.0)
    second = np.where(crosses, rest, 0.0) / np.where(crosses, far, 1.0)

    count = math.prod(radii.shape[1:])
    times = np.zeros((len(a), 2 + 2 * count))
    times[:, 1] = 1.0
    times[:, 2 : 2 + count], times[:, 2 + count :] = (t.reshape(len(a), count) for t in (first, second))
    times = np.sort(np.clip(times, 0.0, 1.0), axis=1)
    segment, at = np.nonzero(times[:, 1:] > times[:, :-1])
    t_0, t_1 = times[segment, at], times[segment, at + 1]
    start, step = a[segment] + t_0[:, None] * d[segment], (t_1 - t_0)[:, None] * d[segment]
    gap = (start + 0.5 * step)[:, None] - centres[segment]
    outside = dot(gap, gap)[:, None] >= radii[segment] ** 2
    zone = np.add.reduce(outside.all(axis=2), axis=1, dtype=np.int64)
    return Parts(segment, start, step, zone, ~outside[:, 0])
