"""Boxes of maps, many at a time: their voxels, and where they lie open.

    lowest open layer = min { z : some voxel (x, y, z) of the box is not occupied },  one above the box where all are

It tells how high the ground is under a box, and whether a way may cross a layer of voxels. `subvolumes.cpp` finds the
same where there is a compiler (`compile.native`), without the interpreter.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int64, Shaped

from maxjax.compile import native

SOURCE = Path(__file__).with_name("subvolumes.cpp")


class Boxes(NamedTuple):
    """Boxes of maps.

    Attributes:
        maps: volumes of voxels.
        map_of: which of them each box lies in.
        low, high: the first and the last voxel of each.
    """

    maps: Shaped[np.ndarray, "m nx ny nz"]
    map_of: Int64[np.ndarray, " n"]
    low: Int64[np.ndarray, "n 3"]
    high: Int64[np.ndarray, "n 3"]

    @property
    def within(self) -> Boxes:
        """Without what lies beyond the maps; the last voxel lies before the first where that is all."""
        limits = np.array(self.maps.shape[1:])
        low = np.clip(self.low, 0, limits)
        return self._replace(low=low, high=np.maximum(np.minimum(self.high, limits - 1), low - 1))


def voxels_in(boxes: Boxes, beyond: float) -> Shaped[np.ndarray, "n bx by bz"]:
    """Voxels of boxes of one size, and `beyond` where a map ends."""
    low, inside = boxes.low, boxes.within
    shown = np.empty((len(low), *(boxes.high[0] + 1 - low[0]).tolist()), boxes.maps.dtype)
    shown[((inside.low > low) | (inside.high < boxes.high)).any(axis=1)] = beyond
    corners = inside.low.tolist(), (inside.high + 1).tolist(), (inside.low - low).tolist()
    for part, m, (x, y, z), (end_x, end_y, end_z), (i, j, k) in zip(
        shown, boxes.map_of.tolist(), *corners, strict=True
    ):
        part[i : i + end_x - x, j : j + end_y - y, k : k + end_z - z] = boxes.maps[m, x:end_x, y:end_y, z:end_z]
    return shown


def lowest_open(boxes: Boxes) -> Int64[np.ndarray, " n"]:
    """The lowest layer of each box that is not all occupied; one above the highest in the map where all are."""
    boxes, found = boxes.within, np.empty(len(boxes.low), np.int64)
    library = native.at_hand(SOURCE) if boxes.maps.strides[3] == 1 else None
    if library is not None:
        numbers = [np.ascontiguousarray(rows, np.int64) for rows in boxes[1:]]
        addresses = (rows.ctypes.data for rows in numbers)
        maps = boxes.maps.ctypes.data, boxes.maps.strides[:3]
        library.lowest_open(ctypes.byref(_Request(*maps, *addresses, len(found), found.ctypes.data)))
        return found
    corners = boxes.low.tolist(), (boxes.high + 1).tolist()
    for k, (m, (x, y, z), (end_x, end_y, end_z)) in enumerate(zip(boxes.map_of.tolist(), *corners, strict=True)):
        box = boxes.maps[m, x:end_x, y:end_y, z:end_z]
        # Axis by axis: over two at once NumPy reduces voxel by voxel.
        solid: Bool[np.ndarray, " layers"] = np.logical_and.reduce(np.logical_and.reduce(box, axis=0), axis=0)
        found[k] = z + (len(solid) if solid.all() else int(np.argmin(solid)))
    return found


class _Request(ctypes.Structure):
    """`Request` of the source."""

    _fields_ = (
        ("maps", ctypes.c_void_p),
        ("next", 3 * ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("map_of", "low", "high")),
        ("boxes", ctypes.c_int64),
        ("found", ctypes.c_void_p),
    )
