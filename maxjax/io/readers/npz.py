"""Maps in NumPy archives: voxels (`occupied` or `occupancy`) or points (`points`).

    voxels: occupied (nx, ny, nz) bool or 0/1; optional spacing [m] (1 if absent) and origin (3,) [m] (0 if
        absent)
    points: points (n, 3) [m]; optional ground (n,) bool or 0/1

Arrays index [x, y, z]; the frame is ENU. Other arrays are ignored; pickled ones are refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from maxjax.core.files import MAX_FILE_BYTES, FileError
from maxjax.core.serialization import read_npz
from maxjax.io.kinds.point_cloud import MAX_POINTS, Labels, PointCloud, StoredVoxels, local_cloud, voxels_in_metres
from maxjax.io.reading import PLAIN, Reading


def load_npz(path: Path, reading: Reading = PLAIN) -> PointCloud | StoredVoxels:
    """Voxels if the archive has them, else points.

    Raises:
        FileError: if the archive is unreadable or too large, or its arrays have other shapes or values.
    """
    try:
        arrays = read_npz(path, max_bytes=MAX_FILE_BYTES)
    except ValueError as error:
        raise FileError(str(error)) from error
    for key in ("occupied", "occupancy"):
        if key in arrays:
            return voxels_in_metres(_voxels(path, key, arrays), path, reading)
    if "points" in arrays:
        return _points(path, arrays, reading)
    held = ", ".join(sorted(arrays)[:8]) or "nothing"
    raise FileError(f"{path}: expected an array occupied, occupancy or points, found {held}")


def _voxels(path: Path, key: str, arrays: Mapping[str, np.ndarray]) -> StoredVoxels:
    volume = arrays[key]
    if volume.ndim != 3 or volume.size == 0:
        raise FileError(f"{path}: {key}: expected shape (nx, ny, nz) without a zero, found {volume.shape}")
    spacing, origin = arrays.get("spacing", np.float64(1.0)), arrays.get("origin", np.zeros(3))
    if np.shape(spacing) != () or spacing.dtype.kind not in "iuf" or not 0 < spacing < np.inf:
        raise FileError(f"{path}: spacing: expected one positive number of metres, found {spacing}")
    if origin.shape != (3,) or origin.dtype.kind not in "iuf" or not np.all(np.isfinite(origin)):
        raise FileError(f"{path}: origin: expected three finite coordinates [m], found {origin}")
    x, y, z = map(float, origin)
    return StoredVoxels(_flags(path, key, volume), float(spacing), (x, y, z), path.name)


def _points(path: Path, arrays: Mapping[str, np.ndarray], reading: Reading) -> PointCloud:
    points, ground = arrays["points"], arrays.get("ground")
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        raise FileError(f"{path}: points: expected numbers of shape (n, 3), found {points.dtype} {points.shape}")
    if len(points) > MAX_POINTS:
        raise FileError(f"{path}: holds {len(points)} points, expected at most {MAX_POINTS}; crop or thin it")
    if ground is not None:
        if ground.shape != (len(points),):
            raise FileError(f"{path}: ground: expected shape ({len(points)},) like points, found {ground.shape}")
        ground = _flags(path, "ground", ground)
    return local_cloud(points, path, reading, labels=Labels(ground))


def _flags(path: Path, key: str, array: np.ndarray) -> Bool[np.ndarray, "..."]:
    """An array of flags as bool; probabilities or labels are refused rather than guessed at."""
    whole = array.dtype.kind in "iu" and (not array.size or (array.min() >= 0 and array.max() <= 1))
    if array.dtype.kind != "b" and not whole:
        raise FileError(f"{path}: {key}: expected bool, or integers that are 0 or 1, found {array.dtype}")
    return array.astype(bool)
