"""City models as read: buildings as footprints with heights, or as shells of faces; and their ground.

inside a footprint: the even-odd rule over its rings; several footprints are a union
a shell            `inside` is solid where it closes; else all `below` its faces; of a `surface` only itself
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Hashable, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from maxjax.core.files import FileError
from maxjax.io.geo.columns import Ring
from maxjax.io.geo.rings import chain
from maxjax.io.geo.units_and_axes import UNREFERENCED, Reference
from maxjax.io.kinds.point_cloud import FARTHEST

T = TypeVar("T", bound=Hashable)

_HIGHEST, _TALLEST = 10_000.0, 2_000.0  # [m]


@dataclasses.dataclass(frozen=True)
class Footprint:
    """One building, part of one, or a piece of a line, as an upright prism.

    Attributes:
        rings: an outline and its holes, last point not repeated [m]; inside is where an odd number of them surround.
        base: height of the ground that it stands on [m].
        top: height of the highest point of the roof [m].
        name: the file's.
    """

    rings: tuple[Ring, ...]
    base: float
    top: float
    name: str


class Fill(IntEnum):
    """The solid part of a shell."""

    INSIDE = 0  # its inside and its faces: a shell that closes
    BELOW = 1  # every column that a face is above, from the lowest point of its building up to the highest face
    SURFACE = 2  # its faces alone: roads, water, lines, points


@dataclasses.dataclass(frozen=True)
class Shells:
    """Faces of solids and surfaces, as triangles.

    Attributes:
        faces: that cover the faces and nothing else [m].
        of_face: shell that each is part of.
        bounds: that bound the same, of the file's own corners: fans, which may reach beyond concave faces [m].
        of_bound: shell that each is part of.
        fill: of each shell.
        base: of each, the lowest point of its building [m].
        grounded: of each, whether it is part of a building, which reaches down to the ground.
        names: of each, the file's.
        buildings: of each, the file's name of the building that it is a part of.
    """

    faces: Float[np.ndarray, "f 3 3"]
    of_face: Int[np.ndarray, " f"]
    bounds: Float[np.ndarray, "b 3 3"]
    of_bound: Int[np.ndarray, " b"]
    fill: Int[np.ndarray, " s"]
    base: Float[np.ndarray, " s"]
    grounded: Bool[np.ndarray, " s"]
    names: tuple[str, ...]
    buildings: tuple[str, ...] = ()


def no_shells() -> Shells:
    """Those of a file of footprints."""
    none, number = np.zeros((0, 3, 3)), np.zeros(0, np.int64)
    return Shells(none, number, none, number, number, np.zeros(0), np.zeros(0, bool), ())


@dataclasses.dataclass(frozen=True)
class Footprints:
    """Contents of a city model, in the map's coordinates: metres, `reference` says where.

    Attributes:
        buildings: upright prisms.
        terrain: triangles of the terrain [m]; none in OpenStreetMap.
        source: the file's name.
        shells: faces of solids.
        read: what the file holds, by kind.
        dropped: what of it is in no voxel, by kind.
        reference: of the file's coordinates.
        remarks: sentences on what a user should know.
    """

    buildings: tuple[Footprint, ...]
    terrain: Float[np.ndarray, "t 3 3"]
    source: str
    shells: Shells = dataclasses.field(default_factory=no_shells)
    read: Mapping[str, int] = dataclasses.field(default_factory=dict)
    dropped: Mapping[str, int] = dataclasses.field(default_factory=dict)
    reference: Reference = UNREFERENCED
    remarks: tuple[str, ...] = ()

    @functools.cached_property
    def solids(self) -> Float64[np.ndarray, "n 3"]:
        """Corners of everything but the terrain [m]."""
        prisms = [np.column_stack([ring, np.full(len(ring), b.top)]) for b in self.buildings for ring in b.rings]
        floors = [np.array([[*b.rings[0][0], b.base]]) for b in self.buildings]
        return np.concatenate([np.zeros((0, 3)), *prisms, *floors, self.shells.faces.reshape(-1, 3)])


def check_footprints(found: Footprints, path: Path) -> Footprints:
    """The same.

    Raises:
        FileError: if nothing in it stands; if coordinates are not finite, are no metres, or not of this world.
    """
    left = ", ".join(f"{count} {kind}" for kind, count in found.dropped.items()) or "0 without"
    if not found.buildings and not found.shells.names:
        raise FileError(f"{path}: expected a building with an outline and a height, found none ({left})")
    for building in found.buildings:
        if not all(np.isfinite(ring).all() for ring in building.rings):
            raise FileError(f"{path}: {building.name}: expected finite coordinates; damaged")
        if not (abs(building.base) <= _HIGHEST and 0 < building.top - building.base <= _TALLEST):
            raise FileError(
                f"{path}: {building.name}: expected a floor within {_HIGHEST:g} m of 0 and a height of up to "
                f"{_TALLEST:g} m, found {building.base:g} to {building.top:g}; other units?"
            )
    corners = found.solids
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (np.abs([low[2], high[2]]) <= _HIGHEST + _TALLEST).all():
        raise FileError(f"{path}: expected heights within {_HIGHEST:g} m of 0, found {low[2]:g} to {high[2]:g}")
    plane = max(np.abs(corners).max(), np.abs(found.terrain).max(initial=0.0))
    if not plane <= FARTHEST or (high - low)[:2].max() < 1.0:
        raise FileError(
            f"{path}: expected metres, found buildings from {low[:2].tolist()} to {high[:2].tolist()}; "
            "degrees or other units?"
        )
    return found


def around(ring: Sequence[T]) -> list[list[T]] | None:
    """A closed sequence of corners as rings; one that goes around twice counts once; None if there is none."""
    edges = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    return chain(edges) or chain({frozenset(edge): edge for edge in edges}.values())


def swept(line: Float64[np.ndarray, "n 2"], width: float) -> list[Ring]:
    """Outlines that together hold everything within half a width of a line or a point [m]."""
    half = 0.5 * width
    found = []
    for a, b in itertools.pairwise(line) if len(line) > 1 else [(line[0], line[0])]:
        length = float(np.hypot(*(b - a)))
        along = (b - a) * (half / length) if length else np.array([half, 0.0])
        aside = np.array([-along[1], along[0]])
        found.append(np.array([a - along - aside, b + along - aside, b + along + aside, a - along + aside]))
    return found
