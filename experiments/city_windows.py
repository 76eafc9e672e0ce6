"""Windows of surveyed cities: their buildings as upright boxes, and how well the boxes fit the footprints."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from maxjax.io.geo.rings import chain
from maxjax.io.kinds.footprints import Footprint, Footprints
from maxjax.io.readers.cityjson import load_cityjson
from maxjax.io.readers.osm import load_osm
from maxjax.sim.worlds.real_city import crop, footprint_rows, inside, inside_boxes

# Files of each city, below the folder of public inputs.
CITIES = {
    "The Hague": ("the_hague/DenHaag_01.city.json",),
    "Venice": (
        "la_venice/buildings-addresses-060372733002.osm",
        "la_venice/buildings-addresses-060372741001.osm",
        "la_venice/buildings-addresses-060372742021.osm",
    ),
}
# Vertical share of the normal of a face that counts as level, and how far above the lowest a floor may lie [m].
_LEVEL, _STEP = 0.7, 0.5
# Boxes of a window are padded to a multiple of this.
_SLOTS = 128
# Points a footprint that measure by how much its boxes exceed it.
_SAMPLES = 2000


@dataclasses.dataclass(frozen=True)
class Window:
    """A square of a city.

    Attributes:
        rows: its boxes, around its middle, the ground at 0.
        footprints: their number.
        excess: area of the boxes beyond the footprints, over the area of these.
        missed: area of the footprints that no box covers, over their area.
        relief: 95th less 5th percentile of the floors, which flattening takes away [m].
    """

    rows: Float[np.ndarray, "n 7"]
    footprints: int
    excess: float
    missed: float
    relief: float

    @property
    def built(self) -> float:
        """Area of the boxes [m²]; where boxes overlap it counts twice."""
        return float(4 * np.sum(self.rows[:, 2] * self.rows[:, 3]))


def slots_of(found: Iterable[Window]) -> int:
    """Boxes of the fullest window, up to a multiple, so that windows share a program."""
    return -(-max(len(one.rows) for one in found) // _SLOTS) * _SLOTS


def windows(files: tuple[Path, ...], half: float, tolerance: float) -> list[Window]:
    """The windows of a city that hold anything, the most built-up first.

    Args:
        files: of the city.
        half: half extent of a window [m].
        tolerance: of the boxes [m].
    """
    found = [one for file in files for one in _tiles(_load(file), half, tolerance)]
    return sorted(found, key=lambda one: one.built, reverse=True)


def _load(file: Path) -> tuple[Footprint, ...]:
    """Upright prisms of a city: those of the file, or over the floors of its solids."""
    if file.suffix != ".json":
        return load_osm(file).buildings
    return tuple(_prisms(load_cityjson(file)))


def _prisms(found: Footprints) -> Iterator[Footprint]:
    """A prism over the level faces at the bottom of each solid of a building, up to its highest point."""
    shells = found.shells
    normal = np.cross(*(shells.faces[:, k] - shells.faces[:, 0] for k in (1, 2)))
    level = np.abs(normal[:, 2]) > _LEVEL * np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    order = np.argsort(shells.of_face, kind="stable")
    cuts = np.searchsorted(shells.of_face[order], np.arange(len(shells.names) + 1))
    for k, name in enumerate(shells.names):
        own = order[cuts[k] : cuts[k + 1]]
        faces = shells.faces[own]
        if not shells.grounded[k] or not len(own):
            continue
        low, high = float(faces[:, :, 2].min()), float(faces[:, :, 2].max())
        floor = np.round(faces[level[own] & (faces[:, :, 2].max(axis=1) <= low + _STEP)][:, :, :2], 3)
        corners = [[tuple(corner) for corner in face] for face in floor.tolist()]
        rings = chain((face[i], face[(i + 1) % 3]) for face in corners for i in range(3))
        if rings is not None and high > low:
            yield Footprint(tuple(np.array(ring) for ring in rings), float(shells.base[k]), high, name)


def _tiles(buildings: Sequence[Footprint], half: float, tolerance: float) -> list[Window]:
    """Windows side by side around the middle, as many as fit, those that hold anything."""
    rows = [footprint_rows(b.rings, b.top - b.base, tolerance) for b in buildings]
    corners = np.concatenate([ring for b in buildings for ring in b.rings])
    middle, extent = 0.5 * (corners.min(0) + corners.max(0)), np.ptp(corners, axis=0)
    axes = [
        middle[i] + 2 * half * (np.arange(n := max(1, int(extent[i] // (2 * half)))) - 0.5 * (n - 1)) for i in range(2)
    ]
    tiles = []
    for centre in np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2):
        kept = [crop(boxes, centre, half) for boxes in rows]
        built = [k for k, boxes in enumerate(kept) if len(boxes)]
        if built:
            floors = np.array([buildings[k].base for k in built])
            relief = float(np.ptp(np.percentile(floors, [5, 95])))
            fit = _fit([buildings[k] for k in built], [rows[k] for k in built])
            tiles.append(Window(np.concatenate([kept[k] for k in built]), len(built), *fit, relief))
    return tiles


def _fit(buildings: list[Footprint], rows: list[np.ndarray]) -> tuple[float, float]:
    """Excess and missed area of the boxes over the footprints' area, by uniform points around each footprint."""
    rng = np.random.default_rng(0)
    area = excess = missed = 0.0
    for building, boxes in zip(buildings, rows, strict=True):
        corners = np.concatenate(building.rings)
        low, high = corners.min(0) - 1.0, corners.max(0) + 1.0
        points = rng.uniform(low, high, (_SAMPLES, 2))
        share = float(np.prod(high - low)) / _SAMPLES
        true, covered = inside(building.rings, points), inside_boxes(boxes, points)
        area += share * true.sum()
        excess += share * (covered & ~true).sum()
        missed += share * (true & ~covered).sum()
    return excess / area, missed / area
