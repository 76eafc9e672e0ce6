"""Faces of a map that is known by its voxels alone: where what stands meets air.

faces = sides of occupied voxels, ground left out, whose neighbour is free
parts = what is joined by faces, edges or corners
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64

from maxjax.core.voxel_map import VoxelMap
from maxjax.io.geo.triangles import Triangles
from maxjax.io.kinds.faces import Faces

# The four corners of a voxel's high side along each axis, counter-clockwise seen from beyond it.
_SIDES = (
    np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]]),
    np.array([[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]]),
    np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]),
)


def voxel_faces(where: VoxelMap) -> Faces:
    """What stands in a map of voxels, and its ground, as squares of two triangles each."""
    from scipy import ndimage  # a quarter of a second that most commands can do without

    occupied, ground = np.asarray(where.occupied), np.asarray(where.ground)
    label, count = ndimage.label(occupied & ~ground, np.ones((3, 3, 3)))
    triangles, voxels = _sides(occupied & ~ground, occupied, where)
    names = tuple(f"part {k + 1}" for k in range(count))
    below = _upper(ground, occupied, where)
    return Faces(triangles, label[tuple(voxels.T)].astype(np.int64) - 1, np.ones(count, bool), names, names, below)


def _sides(
    of: Bool[np.ndarray, "nx ny nz"], occupied: Bool[np.ndarray, "nx ny nz"], where: VoxelMap
) -> tuple[Triangles, Int64[np.ndarray, "t 3"]]:
    """Sides of some voxels towards free ones, and the voxels that they are of."""
    found, voxels = list[np.ndarray](), list[np.ndarray]()
    for axis in range(3):
        for way in (1, -1):
            there = np.argwhere(of & ~_beyond(occupied, axis, way))
            side = _SIDES[axis].copy()
            if way < 0:
                side[:, axis] = 0
                side = side[::-1]
            square = np.array(where.grid.lower) + where.grid.spacing * (there[:, None] + side)
            found += [square[:, [0, 1, 2]], square[:, [0, 2, 3]]]
            voxels += [there, there]
    return np.concatenate(found), np.concatenate(voxels)


def _upper(ground: Bool[np.ndarray, "nx ny nz"], occupied: Bool[np.ndarray, "nx ny nz"], where: VoxelMap) -> Triangles:
    """Upper sides of ground voxels towards free ones."""
    there = np.argwhere(ground & ~_beyond(occupied, 2, 1))
    square = np.array(where.grid.lower) + where.grid.spacing * (there[:, None] + _SIDES[2])
    return np.concatenate([square[:, [0, 1, 2]], square[:, [0, 2, 3]]])


def _beyond(occupied: Bool[np.ndarray, "nx ny nz"], axis: int, way: int) -> Bool[np.ndarray, "nx ny nz"]:
    """Whether the neighbour along an axis is occupied; beyond the map it is, since nothing is known there."""
    pad = [(0, 0)] * 3
    pad[axis] = (0, 1) if way > 0 else (1, 0)
    wide = np.pad(occupied, pad, constant_values=True)
    shift = [slice(None)] * 3
    shift[axis] = slice(1, None) if way > 0 else slice(None, -1)
    return wide[tuple(shift)]
