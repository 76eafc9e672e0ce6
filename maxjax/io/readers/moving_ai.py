"""Voxel maps of the Moving AI benchmark (.3dmap): a line `voxel nx ny nz`, then `x y z` of each obstacle.

Voxels of 1 m, the first about (0, 0, 0), as indices in the file's scenarios are positions.
"""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path

import numpy as np

from maxjax.core.files import FileError, read_text
from maxjax.io.kinds.point_cloud import StoredVoxels, voxels_in_metres
from maxjax.io.reading import PLAIN, Reading

MAX_VOXELS = 2**30


def load_3dmap(path: Path, reading: Reading = PLAIN) -> StoredVoxels:
    """The obstacles of a .3dmap file.

    Raises:
        FileError: if the file cannot be read, its first line is another, or an obstacle lies outside.
    """
    first, _, rest = read_text(path).partition(b"\n")
    words = first.split()
    if len(words) != 4 or words[0] != b"voxel" or not all(word.isdigit() and len(word) < 10 for word in words[1:]):
        raise FileError(f"{path}: expected a first line 'voxel nx ny nz', found {first[:60].decode('latin1')!r}")
    nx, ny, nz = (int(word) for word in words[1:])
    if not 0 < nx * ny * nz <= MAX_VOXELS:
        raise FileError(f"{path}: claims {nx} x {ny} x {nz} voxels, expected 1 to {MAX_VOXELS} in all")
    occupied = np.zeros((nx, ny, nz), bool)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a map without obstacles
            places = np.loadtxt(BytesIO(rest), np.int64, comments=None, ndmin=2).reshape(-1, 3)
    except (ValueError, OverflowError) as error:
        raise FileError(f"{path}: expected lines of three whole numbers: {error}") from error
    if places.size and (places.min() < 0 or (places >= occupied.shape).any()):
        raise FileError(f"{path}: an obstacle lies outside of {nx} x {ny} x {nz} voxels; damaged")
    occupied[tuple(places.T)] = True
    return voxels_in_metres(StoredVoxels(occupied, 1.0, (0.0, 0.0, 0.0), path.name), path, reading)
