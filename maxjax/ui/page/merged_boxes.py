"""Voxels as few boxes: runs along z, joined along x where they are equal, then along y.

The boxes are disjoint, and their union is the volume.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64

# Columns of a box: its first and its last voxel, the last not included, along x, y, z.
_X0, _X1, _Y0, _Y1, _Z0, _Z1 = range(6)


def merge_voxels(volume: Bool[np.ndarray, "nx ny nz"]) -> Int64[np.ndarray, "n 6"]:
    """The boxes of a volume: x0, x1, y0, y1, z0, z1 in voxels, the upper bounds not included."""
    edge = np.diff(np.pad(volume, ((0, 0), (0, 0), (1, 1))).astype(np.int8), axis=2)
    x, y, low = np.nonzero(edge == 1)
    high = np.nonzero(edge == -1)[2]
    runs = np.stack([x, x + 1, y, y + 1, low, high], axis=1).astype(np.int64)
    return _joined(_joined(runs, _X0), _Y0)


def _joined(boxes: Int64[np.ndarray, "n 6"], low: int) -> Int64[np.ndarray, "m 6"]:
    """Boxes that touch along an axis and are equal across it, as one each.

    Args:
        boxes: to join.
        low: column of the axis' lower bound.
    """
    if len(boxes) == 0:
        return boxes
    across = [column for column in range(6) if column not in (low, low + 1)]
    boxes = boxes[np.lexsort((boxes[:, low], *(boxes[:, column] for column in across)))]
    before, after = boxes[:-1], boxes[1:]
    follows = (before[:, across] == after[:, across]).all(axis=1) & (before[:, low + 1] == after[:, low])
    first = np.flatnonzero(np.concatenate([[True], ~follows]))
    last = np.concatenate([first[1:], [len(boxes)]]) - 1
    whole = boxes[first].copy()
    whole[:, low + 1] = boxes[last, low + 1]
    return whole
