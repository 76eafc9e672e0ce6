"""Where boxes of maps lie open: the lowest layer of each that is not all occupied, of many boxes at a time.

    lowest open layer = min { z : some voxel (x, y, z) of the box is not occupied },  one above the box where all are

It is what tells how high the ground is under a box, and whether a way may cross a layer of voxels. `lowest_open.cpp`
finds the same where there is a compiler (`programs.native`), without the interpreter.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int64

from maxjax.programs import native

SOURCE = Path(__file__).with_name("lowest_open.cpp")

Corners = Int64[np.ndarray, "n 3"]


class _Boxes(ctypes.Structure):
    """`Request` of the source."""

    _fields_ = (
        ("occupied", ctypes.c_void_p),
        ("next", 3 * ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("map_of", "low", "high")),
        ("boxes", ctypes.c_int64),
        ("found", ctypes.c_void_p),
    )


def lowest_open(
    occupied: Bool[np.ndarray, "m nx ny nz"], map_of: Int64[np.ndarray, " n"], low: Corners, high: Corners
) -> Int64[np.ndarray, " n"]:
    """The lowest layer of each box that is not all occupied; one above the highest where all are.

    Args:
        occupied: maps.
        map_of: which of them each box lies in.
        low, high: the first and the last voxel of each box; what lies beyond the map is left out.
    """
    low, high = np.maximum(low, 0), np.minimum(high, np.array(occupied.shape[1:]) - 1)
    map_of, low, high = (np.ascontiguousarray(numbers, np.int64) for numbers in (map_of, low, high))
    library = native.at_hand(SOURCE) if occupied.strides[3] == 1 else None
    if library is None:
        return plain_lowest_open(occupied, map_of, low, high)
    found = np.empty(len(low), np.int64)
    addresses = (numbers.ctypes.data for numbers in (map_of, low, high))
    asked = _Boxes(occupied.ctypes.data, occupied.strides[:3], *addresses, len(low), found.ctypes.data)
    library.lowest_open(ctypes.byref(asked))
    return found


def plain_lowest_open(
    occupied: Bool[np.ndarray, "m nx ny nz"], map_of: Int64[np.ndarray, " n"], low: Corners, high: Corners
) -> Int64[np.ndarray, " n"]:
    """`lowest_open` in NumPy, box by box."""
    found = np.empty(len(low), np.int64)
    boxes = zip(map_of.tolist(), low.tolist(), (high + 1).tolist(), strict=True)
    for k, (m, (x, y, z), (beyond_x, beyond_y, beyond_z)) in enumerate(boxes):
        box = occupied[m, x:beyond_x, y:beyond_y, z:beyond_z]
        # Axis by axis: over two at once NumPy reduces voxel by voxel.
        solid: Bool[np.ndarray, " layers"] = np.logical_and.reduce(np.logical_and.reduce(box, axis=0), axis=0)
        found[k] = z + (len(solid) if solid.all() else int(np.argmin(solid)))
    return found
