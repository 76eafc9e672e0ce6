"""Points that stand for faces: each with its share of the area, none farther from its neighbours than a distance.

Triangles are halved at the middle of their longest edge until none is longer than the distance; the halves of a cell of
as many metres whose normals agree are then one point, that of the half nearest to their middle, with the area of all.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.io.geo.triangles import Triangles, area_normals

_NEXT = np.array([1, 2, 0])
_ALIKE = 4.0  # steps of a normal's components that count as one direction, from 0 to 1
_LEAST = 1e-8  # of an area that is none [m²]


def halve(
    triangles: Triangles, owner: Int64[np.ndarray, " n"], longest: float
) -> tuple[Float64[np.ndarray, "m 3 3"], Int64[np.ndarray, " m"]]:
    """Triangles whose edges are no longer than so much [m], which make up the given ones, and what each is of."""
    done, owners = list[np.ndarray](), list[np.ndarray]()
    while len(triangles):
        edges = np.linalg.norm(triangles[:, _NEXT] - triangles, axis=2)
        first = edges.argmax(axis=1)
        short = edges.max(axis=1) <= longest
        done.append(triangles[short])
        owners.append(owner[short])
        rest, owner, first = triangles[~short], owner[~short], first[~short]
        rows = np.arange(len(rest))
        a, b, c = rest[rows, first], rest[rows, _NEXT[first]], rest[rows, _NEXT[_NEXT[first]]]
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        owner = np.concatenate([owner, owner])
    return np.concatenate([np.zeros((0, 3, 3)), *done]), np.concatenate([np.zeros(0, np.int64), *owners])


def points_on(
    triangles: Triangles, owner: Int64[np.ndarray, " n"], apart: float
) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"], Float64[np.ndarray, " p"], Int64[np.ndarray, " p"]]:
    """Points on triangles.

    Args:
        triangles: corners [m], outward.
        owner: what each triangle is of; points of different owners are not one.
        apart: distance between neighbours, about [m].

    Returns:
        Points [m], unit normals, areas [m²], and what each is of.
    """
    pieces, of = halve(np.asarray(triangles, np.float64), owner, apart)
    normal = area_normals(pieces)
    size = np.linalg.norm(normal, axis=1)
    kept = size > 2.0 * _LEAST
    pieces, of, size, normal = pieces[kept], of[kept], size[kept], normal[kept] / size[kept, None]
    middle = pieces.mean(axis=1)
    low = middle.min(axis=0) if len(middle) else 0.0
    # Half a cell on, so that no face along the axes lies between two cells at its end.
    cell = np.concatenate(
        [np.floor((middle - low) / apart + 0.5), np.round(_ALIKE * normal), of[:, None]], axis=1
    ).astype(np.int64)
    _, group = np.unique(cell, axis=0, return_inverse=True)
    group = group.reshape(-1)
    area = np.bincount(group, 0.5 * size).astype(np.float64)
    centre = np.stack([np.bincount(group, 0.5 * size * side) / area for side in middle.T], axis=1)
    order = np.lexsort((np.linalg.norm(middle - centre[group], axis=1), group))
    chosen = order[np.r_[True, group[order][1:] != group[order][:-1]][: len(order)]]
    return middle[chosen], normal[chosen], area, of[chosen]
