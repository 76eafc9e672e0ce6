"""Where upright lines meet triangles: how many of them lie above a point, and how high the topmost one is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float64, Int64

_PAIRS = 2**22  # of places and triangles at a time
_UPRIGHT = 1e-9  # of twice the area in plan, up to which a triangle is upright [m²]

Flat = Float64[np.ndarray, "n 2"]
Triangles = Float64[np.ndarray, "m 3 3"]


def count_above(points: Float64[np.ndarray, "n 3"], triangles: Triangles) -> Int64[np.ndarray, " n"]:
    """How many triangles lie above each point [m]."""
    counts = np.zeros(len(points), np.int64)
    if not len(triangles):
        return counts
    under = np.flatnonzero(points[:, 2] <= triangles[:, :, 2].max())
    for rows, _, met, height in _crossings(points[under, :2], triangles):
        counts[under[rows]] = (met & (height > points[under[rows], None, 2])).sum(axis=1)
    return counts


def find_topmost(places: Flat, triangles: Triangles) -> tuple[Float64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """Height of the topmost triangle at each place in plan [m], and its number; NaN and -1 where there is none."""
    top, number = np.full(len(places), np.nan), np.full(len(places), -1)
    for rows, which, met, height in _crossings(places, triangles):
        heights = np.where(met, height, -np.inf)
        best = heights.argmax(axis=1)
        found = heights[np.arange(len(rows)), best]
        some = np.isfinite(found)
        top[rows[some]], number[rows[some]] = found[some], which[best[some]]
    return top, number


def _crossings(
    places: Flat, triangles: Triangles
) -> Iterator[
    tuple[
        Int64[np.ndarray, " r"],
        Int64[np.ndarray, " k"],
        Bool[np.ndarray, "r k"],
        Float64[np.ndarray, "r k"],
    ]
]:
    """Some places and triangles at a time: their numbers, which lines meet which, and the heights there [m]."""
    if not len(triangles) or not len(places):
        return
    low, high = triangles[:, :, :2].min(axis=1), triangles[:, :, :2].max(axis=1)
    a, b, c = np.moveaxis(triangles, 1, 0)
    turn = _turn(b - a, c - a)
    sloping = np.abs(turn) > _UPRIGHT
    reached = ((high >= places.min(axis=0)) & (low <= places.max(axis=0))).all(axis=1)
    which = np.flatnonzero(sloping & reached)
    if not len(which):
        return
    a, b, c, turn = a[which], b[which], c[which], turn[which]
    near = np.flatnonzero(((places >= low[which].min(axis=0)) & (places <= high[which].max(axis=0))).all(axis=1))
    for rows in np.array_split(near, max(1, -(-len(near) * len(which) // _PAIRS))):
        to = places[rows, None] - a[:, :2]
        s, t = _turn(to, c - a) / turn, _turn(b - a, to) / turn
        height = a[:, 2] + s * (b - a)[:, 2] + t * (c - a)[:, 2]
        yield rows, which, np.asarray((s >= 0) & (t >= 0) & (s + t <= 1)), height


def _turn(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Twice the area between two directions in plan."""
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
