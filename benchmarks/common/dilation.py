"""Which voxels a vehicle cannot be in, and which are joined without them, by SciPy alone.

    closed = { x : distance from the centre of x to an occupied cube < radius }      joined = same 6-neighbour label

Lengths in voxels. Nothing here imports maxjax or JAX, so it runs in worker processes beside a device.
"""

from __future__ import annotations

import functools
import itertools

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


def least_distance(occupied: np.ndarray, path: np.ndarray, radius: float, apart: float = 0.05) -> float:
    """Least distance from samples of a path, (t, 3) index coordinates, to an occupied cube; exact below the radius."""
    edges = [(a, b, int(np.linalg.norm(b - a) / apart) + 2) for a, b in itertools.pairwise(path)]
    points = np.concatenate([np.linspace(a, b, count) for a, b, count in edges])
    reach = int(np.ceil(radius + 0.5))
    around = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    voxels = np.floor(points + 0.5).astype(int)[:, None] + around + reach
    i, j, k = np.moveaxis(np.clip(voxels, 0, np.array(occupied.shape) + 2 * reach - 1), -1, 0)
    there = np.pad(occupied, reach)[i, j, k]
    gap = np.maximum(np.abs(points[:, None] - (voxels - reach)) - 0.5, 0)
    return float(np.sqrt(np.where(there, (gap**2).sum(axis=-1), np.inf).min()))
