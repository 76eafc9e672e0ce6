"""Rings in the plane: edges chained to closed ones, and what lies inside, by the even-odd rule."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

T = TypeVar("T", bound=Hashable)


def surrounds(ring: Float[np.ndarray, "n 2"], point: Float[np.ndarray, " 2"]) -> bool:
    """Whether a ring surrounds a point.

    Args:
        ring: last point not repeated.
        point: one on the ring may count either way.
    """
    a, b = ring, np.roll(ring, -1, axis=0)
    spans = (a[:, 1] <= point[1]) != (b[:, 1] <= point[1])
    run = np.where(spans, b[:, 1] - a[:, 1], 1.0)
    x = a[:, 0] + (point[1] - a[:, 1]) / run * (b[:, 0] - a[:, 0])
    return bool((spans & (x > point[0])).sum() % 2)


def signed_area(ring: Float[np.ndarray, "n 2"]) -> float:
    """Area of a ring, positive where it goes around counter-clockwise; its last point is not repeated."""
    x, y = (ring - ring[0]).T
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def chain(edges: Iterable[tuple[T, T]]) -> list[list[T]] | None:
    """Edges to closed rings, edges that occur an even number of times left out.

    Where more than two edges meet, the rings may be paired either way: under the even-odd rule they enclose the same.

    Returns:
        The rings, first point not repeated; None if there is none, or some edges do not close.
    """
    odd: dict[frozenset[T], tuple[T, T]] = {}
    for a, b in edges:
        key = frozenset((a, b))
        if len(key) == 2 and odd.pop(key, None) is None:
            odd[key] = (a, b)
    # Neighbours in the order of the edges; a dict, as one corner may have very many.
    around: dict[T, dict[T, None]] = defaultdict(dict)
    for a, b in odd.values():
        around[a][b] = None
        around[b][a] = None
    if not around or any(len(ends) % 2 for ends in around.values()):
        return None
    rings = []
    for first in list(around):
        while around[first]:
            ring, at = [first], first
            while (following := around[at].popitem()[0]) != first:
                del around[following][at]
                ring.append(following)
                at = following
            del around[first][at]
            rings.append(ring)
    return rings
