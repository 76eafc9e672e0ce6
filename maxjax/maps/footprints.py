"""Buildings as footprints with heights: what readers of city models return.

inside a footprint: the even-odd rule over all its rings
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from maxjax.maps.model import MapError

Ring = Float[np.ndarray, "_ 2"]
T = TypeVar("T", bound=Hashable)


@dataclasses.dataclass(frozen=True)
class Footprint:
    """One building, or part of one, as an upright prism.

    Attributes:
        rings: outlines and holes, last point not repeated [m]; inside is where an odd number of them surround.
        base: height of the floor [m]; of the lowest one among all parts of a building, because a part may stand on
            the roof of another.
        top: height of the highest point of the roof [m].
        name: the file's.
    """

    rings: tuple[Ring, ...]
    base: float
    top: float
    name: str


@dataclasses.dataclass(frozen=True)
class Footprints:
    """The buildings of a file in a local ENU frame, metres.

    Attributes:
        buildings: at least one.
        terrain: triangles of the terrain [m]; none in OpenStreetMap.
        origin: of the local frame. CityJSON: file coordinates [m], the middle of the buildings to the metre, height
            0. OpenStreetMap: longitude, latitude [degrees] and 0. Heights are not shifted.
        skipped: buildings left out, because they have no height or no closed outline.
        source: the file's name.
    """

    buildings: tuple[Footprint, ...]
    terrain: Float[np.ndarray, "t 3 3"]
    origin: Float[np.ndarray, "3"]
    skipped: int
    source: str


def localised(
    buildings: Sequence[Footprint], terrain: Float[np.ndarray, "t 3 3"], skipped: int, path: Path
) -> Footprints:
    """The same around the middle of the buildings, to the metre.

    Raises:
        MapError: if there is no building.
    """
    if not buildings:
        raise MapError(f"{path}: expected a building with an outline and a height, found none ({skipped} without)")
    corners = np.concatenate([ring for building in buildings for ring in building.rings])
    middle = np.round(0.5 * (corners.min(0) + corners.max(0)))
    moved = [dataclasses.replace(b, rings=tuple(ring - middle for ring in b.rings)) for b in buildings]
    origin = np.array([*middle, 0.0])
    return Footprints(tuple(moved), terrain - origin, origin, skipped, path.name)


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
    around: dict[T, list[T]] = defaultdict(list)
    for a, b in odd.values():
        around[a].append(b)
        around[b].append(a)
    if not around or any(len(ends) % 2 for ends in around.values()):
        return None
    rings = []
    for first in list(around):
        while around[first]:
            ring, at = [first], first
            while (following := around[at].pop()) != first:
                around[following].remove(at)
                ring.append(following)
                at = following
            around[first].remove(at)
            rings.append(ring)
    return rings
