"""Voxels as few upright boxes, for exact ray casting and distances.

    union of boxes = union of occupied voxels

A box begins at the first voxel that none before it covers, and grows upwards and downwards, then along x and y (or y
and x, whichever covers more that is new) as far as all in it is occupied. Boxes may overlap.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int64

from maxjax.core.grid import Grid

Box = tuple[slice, slice, slice]
_ORDERS = ((2, 0, 1), (2, 1, 0))


def box_rows(occupied: Bool[np.ndarray, "nx ny nz"], grid: Grid) -> Float[np.ndarray, "n 7"]:
    """Boxes of occupied voxels as rows of `solids.upright_boxes` [m]."""
    boxes = cover(occupied)
    low, high = (np.array(grid.lower) + grid.spacing * side for side in (boxes[:, :3], boxes[:, 3:]))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    turn = np.zeros((len(boxes), 1))
    return np.concatenate([middle[:, :2], half[:, :2], low[:, 2:], high[:, 2:], turn], axis=1)


def cover(occupied: Bool[np.ndarray, "nx ny nz"]) -> Int64[np.ndarray, "n 6"]:
    """First and one past the last voxel of boxes whose union is what is occupied."""
    left = occupied.copy()
    rest, boxes = left.reshape(-1), []
    for place in np.flatnonzero(rest):
        if not rest[place]:
            continue
        first = np.unravel_index(place, occupied.shape)
        grown = [_grown(occupied, tuple(slice(int(i), int(i) + 1) for i in first), order) for order in _ORDERS]
        box = max(grown, key=lambda box: np.count_nonzero(left[box]))
        left[box] = False
        boxes.append([*(side.start for side in box), *(side.stop for side in box)])
    return np.array(boxes, np.int64).reshape(-1, 6)


def _grown(occupied: Bool[np.ndarray, "nx ny nz"], box: tuple[slice, ...], order: tuple[int, ...]) -> Box:
    """A box of occupied voxels grown along one axis after the other, each to both sides, as far as all is occupied."""
    sides = list(box)
    for axis in order:
        start, stop = sides[axis].start, sides[axis].stop
        # All slabs across this axis at once: which are full, and how far from the box that goes on.
        across = tuple(slice(None) if k == axis else side for k, side in enumerate(sides))
        others = tuple(k for k in range(3) if k != axis)
        full = np.asarray(occupied[across].all(axis=others))
        open_after, open_before = np.flatnonzero(~full[stop:]), np.flatnonzero(~full[:start])
        sides[axis] = slice(
            int(open_before[-1]) + 1 if len(open_before) else 0,
            stop + int(open_after[0]) if len(open_after) else len(full),
        )
    return sides[0], sides[1], sides[2]
