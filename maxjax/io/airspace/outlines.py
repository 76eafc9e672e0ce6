"""Outlines of areas: whether they cross themselves, what of them lies in a box, edges of bounded length.

Edges p + t d and q + u e cross where (q − p) × e and (q − p) × d lie, divided by d × e, strictly between 0 and 1.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float

from maxjax.io.airspace.zone import UnclearError
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.rings import surrounds
from maxjax.io.geo.triangles import spread

_MOST_PAIRS = 10**8


def check_outline(rings: list[Ring]) -> None:
    """Raise an `UnclearError` where edges of some rings cross each other, or a hole lies outside the outline.

    Rings may touch: that leaves no doubt what is inside.
    """
    edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    edges = edges[np.argsort(edges[:, :, 0].min(axis=1), kind="stable")]
    west, east = edges[:, :, 0].min(axis=1), edges[:, :, 0].max(axis=1)
    first = np.arange(1, len(edges) + 1)
    last = np.searchsorted(west, east, side="right") - 1
    if np.maximum(last - first + 1, 0).sum() > _MOST_PAIRS:
        raise UnclearError(f"expected a simpler outline, found {len(edges)} edges that overlap; simplify it")
    for one, other in spread(first, last):
        p, q = edges[one, 0], edges[other, 0]
        d, e = edges[one, 1] - p, edges[other, 1] - q
        turn, along, across = _cross(d, e), _cross(q - p, e), _cross(q - p, d)
        sign = np.sign(turn)
        crossing = (turn != 0) & (sign * along > 0) & (sign * along < np.abs(turn))
        crossing &= (sign * across > 0) & (sign * across < np.abs(turn))
        if crossing.any():
            k = int(np.argmax(crossing))
            x, y = (p[k] + along[k] / turn[k] * d[k]).tolist()
            raise UnclearError(
                f"expected an outline that does not cross itself, found one that does at {x:.6f}, {y:.6f}"
            )
    left = _MOST_PAIRS // len(rings[0])
    for hole in rings[1:]:
        for point in (*hole, *(0.5 * (hole + np.roll(hole, -1, axis=0)))):
            if left == 0:
                raise UnclearError(f"expected a simpler outline, found {len(edges)} edges with holes; simplify it")
            left -= 1
            if surrounds(rings[0], point):
                break
        else:
            raise UnclearError("expected holes inside of the outline, found one outside")


def _cross(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    found: Float[np.ndarray, " n"] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return found


def cut_to(ring: Ring, box: Float[np.ndarray, "2 2"]) -> Ring:
    """The part of a ring in a box, side by side (Sutherland and Hodgman); edges along the box join its parts."""
    for axis, (side, sign) in itertools.product((0, 1), ((0, 1.0), (1, -1.0))):
        if len(ring) == 0:
            break
        depth = sign * (ring[:, axis] - box[side, axis])
        following, after = np.roll(ring, -1, axis=0), np.roll(depth, -1)
        leaves = (depth >= 0) != (after >= 0)
        share = depth / np.where(leaves, depth - after, 1.0)
        crossing = ring + share[:, None] * (following - ring)
        crossing[:, axis] = np.where(leaves, box[side, axis], crossing[:, axis])
        both = np.stack([ring, crossing], axis=1).reshape(-1, 2)
        ring = both[np.stack([depth >= 0, leaves], axis=1).ravel()]
    return ring


def insert_points(ring: Ring, longest: float) -> Ring:
    """The same ring with points on its edges, none of which is then longer."""
    edge = np.roll(ring, -1, axis=0) - ring
    count = np.maximum(np.ceil(np.abs(edge).max(axis=1) / longest), 1).astype(np.int64)
    which = np.repeat(np.arange(len(ring)), count)
    part = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    found: Ring = ring[which] + (part / count[which])[:, None] * edge[which]
    return found
