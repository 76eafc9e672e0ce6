"""Plane polygons in space as triangles: fans for what they bound, trapezoids for what they cover.

    fan:     corner 1, corner k, corner k + 1 of every ring, whatever lies outside counted with the other sign
    covered: the even-odd rule over all rings, between one corner and the next along an axis of the face's plane

A fan of a concave ring reaches beyond it, but a line crosses it as often, in the sum of directions and in parity, as it
crosses the ring's face; it needs no corner but those that the neighbours have, so that closed bodies stay closed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from maxjax.io.geo.triangles import Triangles

_FLAT = 1e-9  # of a face's size; turns smaller than that are none

Corners = Float[np.ndarray, "_ 3"]


def convex(faces: Float[np.ndarray, "m n 3"]) -> Bool[np.ndarray, " m"]:
    """Whether a fan covers no more than the polygon, for polygons of as many corners each."""
    if faces.shape[1] <= 3:
        return np.ones(len(faces), bool)
    local = faces - faces[:, :1]
    edges = np.roll(local, -1, axis=1) - local
    normal = np.cross(local, np.roll(local, -1, axis=1)).sum(axis=1)
    turns = np.einsum("mnk,mk->mn", np.cross(edges, np.roll(edges, -1, axis=1)), normal)
    size = np.einsum("mk,mk->m", normal, normal)
    return np.asarray((turns >= -_FLAT * size[:, None]).all(axis=1))


def fan_of(count: int) -> Int[np.ndarray, "t 3"]:
    """Triangles around the first of so many corners."""
    k = np.arange(1, max(count - 1, 1))
    return np.column_stack([np.zeros_like(k), k, k + 1])[: max(count - 2, 0)]


def newell(ring: Corners) -> Float[np.ndarray, " 3"]:
    """Twice the area of a ring as a vector along its normal."""
    local = ring - ring[0]
    total: Float[np.ndarray, " 3"] = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
    return total


def covering(rings: Sequence[Corners]) -> Triangles:
    """Triangles that cover a plane polygon with holes, and nothing else; they go around as its outline does.

    Args:
        rings: outline and holes [m], last point not repeated.
    """
    normal = newell(rings[0])
    depth = int(np.abs(normal).argmax())
    if normal[depth] == 0.0:  # no area: what is left is a line
        ring = np.asarray(rings[0])
        following = np.roll(ring, -1, axis=0)
        return np.stack([ring, following, following], axis=1)
    u, v = (axis for axis in range(3) if axis != depth)
    ends = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    a, b = ends[:, 0], ends[:, 1]
    turned = a[:, u] > b[:, u]
    a, b = np.where(turned[:, None], b, a), np.where(turned[:, None], a, b)
    cuts = np.unique(ends[:, :, u])
    found = []
    for west, east in itertools.pairwise(cuts):
        crossing = np.flatnonzero((a[:, u] <= west) & (b[:, u] >= east))
        p, q = a[crossing], b[crossing]
        run = (q[:, u] - p[:, u])[:, None]
        left, right = p + (west - p[:, u])[:, None] / run * (q - p), p + (east - p[:, u])[:, None] / run * (q - p)
        order = np.lexsort((right[:, v], left[:, v] + right[:, v]))
        left, right = left[order], right[order]
        for k in range(0, len(order) - 1, 2):
            found += [[left[k], right[k], right[k + 1]], [left[k], right[k + 1], left[k + 1]]]
    triangles = np.array(found).reshape(-1, 3, 3)
    # Trapezoids run along u, then along v: around the axis that is left, by the right hand where u is the one after it.
    along = 1.0 if (u + 1) % 3 == v else -1.0
    return triangles if along * normal[depth] > 0 else triangles[:, ::-1]
