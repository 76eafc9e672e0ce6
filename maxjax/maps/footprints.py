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

from maxjax.core.files import FileError
from maxjax.core.geometry.columns import Ring
from maxjax.maps.model import FARTHEST

T = TypeVar("T", bound=Hashable)

_HIGHEST, _TALLEST = 10_000.0, 2_000.0  # [m]


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
        crs: of the file, as EPSG:28992; None where it names none.
        geographic: whether the file's coordinates are degrees; the map's are then metres from `origin`.
    """

    buildings: tuple[Footprint, ...]
    terrain: Float[np.ndarray, "t 3 3"]
    origin: Float[np.ndarray, "3"]
    skipped: int
    source: str
    crs: str | None = None
    geographic: bool = False

    @property
    def shift(self) -> Float[np.ndarray, "3"]:
        """What takes the local frame to the map's coordinates [m]."""
        return np.zeros(3) if self.geographic else self.origin


def checked_heights(buildings: Sequence[Footprint], skipped: int, path: Path) -> None:
    """Raise a `FileError` if there is no building, or one is not of finite coordinates and of this world."""
    if not buildings:
        raise FileError(f"{path}: expected a building with an outline and a height, found none ({skipped} without)")
    for building in buildings:
        if not all(np.isfinite(ring).all() for ring in building.rings):
            raise FileError(f"{path}: {building.name}: expected finite coordinates; damaged")
        if not (abs(building.base) <= _HIGHEST and 0 < building.top - building.base <= _TALLEST):
            raise FileError(
                f"{path}: {building.name}: expected a floor within {_HIGHEST:g} m of 0 and a height of up to "
                f"{_TALLEST:g} m, found {building.base:g} to {building.top:g}; other units?"
            )


def localised(
    buildings: Sequence[Footprint],
    terrain: Float[np.ndarray, "t 3 3"],
    skipped: int,
    path: Path,
    crs: str | None = None,
) -> Footprints:
    """The same around the middle of the buildings, to the metre.

    Raises:
        FileError: if there is no building; if coordinates are not finite, or are no metres.
    """
    checked_heights(buildings, skipped, path)
    corners = np.concatenate([ring for building in buildings for ring in building.rings])
    if max(np.abs(corners).max(), np.abs(terrain).max(initial=0.0)) > FARTHEST or np.ptp(corners, axis=0).max() < 1.0:
        low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        raise FileError(f"{path}: expected metres, found buildings from {low} to {high}; degrees or other units?")
    middle = np.round(0.5 * (corners.min(0) + corners.max(0)))
    moved = [dataclasses.replace(b, rings=tuple(ring - middle for ring in b.rings)) for b in buildings]
    origin = np.array([*middle, 0.0])
    return Footprints(tuple(moved), terrain - origin, origin, skipped, path.name, crs)


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
