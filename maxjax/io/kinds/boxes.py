"""Boxes along the axes.

A voxel is filled iff its cube and the box share more than a face.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid, Point3
from maxjax.io.geo.units_and_axes import METRES, UNREFERENCED, Reference, cube_of_metres, on_its_axes, reference
from maxjax.io.reading import Reading

MAX_BOXES = 20_000_000
_TOUCH = 1e-6  # overlaps thinner than that do not count [voxels]


@dataclasses.dataclass(frozen=True)
class Boxes:
    """Boxes of a file, on the host.

    Attributes:
        corners: lowest and highest corner of each obstacle [m].
        source: the file's name.
        free: those of space that is known to be free; None where the file does not tell it from the unknown.
        spacing: edge of the smallest box that the file may hold [m]; None where there is none.
        lattice: a corner of the lattice of those [m].
        reference: of its coordinates.
    """

    corners: Float[np.ndarray, "n 2 3"]
    source: str
    free: Float[np.ndarray, "m 2 3"] | None = None
    spacing: float | None = None
    lattice: Point3 = (0.0, 0.0, 0.0)
    reference: Reference = UNREFERENCED


def boxes_in_metres(boxes: Boxes, path: Path, reading: Reading) -> Boxes:
    """Boxes of a file through the gate; raises as `reference`, and where its axes are none of a plane in metres."""
    known = boxes.corners if boxes.free is None else np.concatenate([boxes.corners, boxes.free])
    around = np.array([known[:, 0, :2].min(axis=0), known[:, 1, :2].max(axis=0)])
    how = on_its_axes(reference(METRES, reading, around, path), path)
    if how.unit == how.vertical_unit == 1.0:
        return dataclasses.replace(boxes, reference=how)
    scale = np.array([how.unit, how.unit, how.vertical_unit])
    free = None if boxes.free is None else boxes.free * scale
    spacing = boxes.spacing
    if spacing is not None:
        cube_of_metres(how, path)
        spacing = spacing * how.unit
    x, y, z = (np.array(boxes.lattice) * scale).tolist()
    return Boxes(boxes.corners * scale, boxes.source, free, spacing, (x, y, z), how)


def fill_boxes(corners: Float[np.ndarray, "n 2 3"], grid: Grid, *, whole: bool = False) -> Bool[np.ndarray, "nx ny nz"]:
    """Voxels that boxes share some volume with.

    Args:
        corners: lowest and highest corner of each [m].
        grid: any.
        whole: only voxels whose centre lies in a box.
    """
    index = (corners - np.array(grid.lower)) / grid.spacing
    if whole:
        first, last = np.ceil(index[:, 0] - 0.5 - _TOUCH), np.floor(index[:, 1] - 0.5 + _TOUCH)
    else:
        first, last = np.floor(index[:, 0] + _TOUCH), np.ceil(index[:, 1] - _TOUCH) - 1
    first, last = (
        np.clip(first, 0, grid.shape).astype(np.int64),
        np.clip(last, -1, np.array(grid.shape) - 1).astype(int),
    )
    held = np.all(first <= last, axis=1)
    first, last = first[held], last[held] + 1
    # Each box is +1 at its first corner and alternates over the other seven; sums along the axes count boxes.
    change = np.zeros([n + 1 for n in grid.shape], np.int32)
    for corner in np.ndindex(2, 2, 2):
        place = tuple(np.where(corner[axis], last[:, axis], first[:, axis]) for axis in range(3))
        np.add.at(change, place, -1 if sum(corner) % 2 else 1)
    for axis in range(3):
        np.cumsum(change, axis=axis, out=change)
    nx, ny, nz = grid.shape
    return np.asarray(change[:nx, :ny, :nz] > 0)
