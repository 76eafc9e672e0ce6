"""Which voxels a vehicle cannot be in, and which are joined without them, by SciPy alone.

    closed = { x : distance from the centre of x to an occupied cube < radius }      joined = same 6-neighbour label

Lengths in voxels. Nothing here imports maxjax or JAX, so it runs in worker processes beside a device.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy import ndimage


@functools.cache
def ball(radius: float) -> np.ndarray:
    """The voxels from whose centres a cube in the middle is nearer than the radius."""
    reach = int(np.ceil(radius + 0.5))
    gap = np.maximum(np.abs(np.arange(-reach, reach + 1)) - 0.5, 0) ** 2
    near = gap[:, None, None] + gap[None, :, None] + gap[None, None, :] < radius**2 - 1e-9
    near[reach, reach, reach] = True
    return np.asarray(near)


def closed(occupied: np.ndarray, radius: float) -> np.ndarray:
    """Voxels that are occupied, or nearer than the radius to one that is."""
    return np.asarray(ndimage.binary_dilation(occupied, ball(radius)))


def joined(occupied: np.ndarray, radius: float, ends: np.ndarray) -> bool:
    """Whether two voxels, (2, 3), are joined without closed ones."""
    labels, _ = ndimage.label(~closed(occupied, radius))
    start, goal = labels[tuple(ends.T)]
    return bool(start == goal != 0)
