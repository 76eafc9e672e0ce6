"""What a map file becomes: points or voxels in a local ENU frame, in metres.

    x_local = x_file − offset

Projected coordinates (EPSG:28992 puts Delft at 85,000 / 447,000 m) lie where neighbouring float32 numbers are
up to 3 cm apart, so they are shifted in float64 by a round offset near the cloud's middle first; small
coordinates stay.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Shaped, UInt8

from maxjax.core.files import FileError
from maxjax.core.grid import Grid, Point3

MAX_POINTS = 50_000_000

FARTHEST = 1e8  # [m]; beyond, even float64 leaves little of a voxel
# Classes that one may fly under: wires with their guards and connectors, bridges (26 in the Dutch AHN), gantries.
OVERHEAD = (13, 14, 16, 17, 19, 26)

_FAR = 10_000.0
_ROUND = 100.0


@dataclasses.dataclass(frozen=True)
class PointCloud:
    """Points of a scan or a survey, on the host.

    Attributes:
        points: positions [m] in a local ENU frame; NaN where the file holds no position.
        offset: what was subtracted from the file's coordinates [m]; zero along axes whose coordinates are
            small.
        ground: whether a point was classified as ground (or water); all False where the file holds no
            classes.
        solid: whether a point is an airborne return from a building, which is solid from there down to the
            ground.
        source: the file's name.
        classes: of each point, as the ASPRS numbers them; None where the file has none.
        crs: the file's coordinate reference system, as EPSG:28992; None where it names none.
        withdrawn: points of the file that are left out, as the survey itself calls them noise or withheld.
    """

    points: Float[np.ndarray, "n 3"]
    offset: Float[np.ndarray, "3"]
    ground: Bool[np.ndarray, " n"]
    solid: Bool[np.ndarray, " n"]
    source: str
    classes: UInt8[np.ndarray, " n"] | None = None
    crs: str | None = None
    withdrawn: int = 0

    @property
    def hiding(self) -> Bool[np.ndarray, " n"]:
        """Whether a point hides from the air what is below it: all but ground, bridges and wires."""
        return ~self.ground if self.classes is None else ~self.ground & ~np.isin(self.classes, OVERHEAD)


@dataclasses.dataclass(frozen=True)
class StoredVoxels:
    """A map that is already voxels, on the host.

    Attributes:
        occupied: obstacles.
        spacing: edge of a voxel [m].
        origin: position of the centre of voxel (0, 0, 0) [m], ENU.
        source: the file's name.
        ground: the voxels that are ground, occupied as well; None where the file does not say.
    """

    occupied: Bool[np.ndarray, "nx ny nz"]
    spacing: float
    origin: Point3
    source: str
    ground: Bool[np.ndarray, "nx ny nz"] | None = None

    @property
    def grid(self) -> Grid:
        """Where the voxels lie."""
        nx, ny, nz = self.occupied.shape
        return Grid((nx, ny, nz), self.spacing, self.origin)


def local_cloud(
    points: Shaped[np.ndarray, "n 3"],
    path: Path,
    *,
    ground: Bool[np.ndarray, " n"] | None = None,
    solid: Bool[np.ndarray, " n"] | None = None,
) -> PointCloud:
    """A cloud from coordinates as a file gives them (any integer or float type) [m]; flags default to False.

    Raises:
        FileError: if there is no point.
    """
    count = len(points)
    if count == 0:
        raise FileError(f"{path}: holds no point, expected at least one")
    offset = np.array([_round_middle(points[:, axis]) for axis in range(3)])
    local = np.empty((count, 3), np.float32)
    # Axis by axis, so that a large cloud is never in memory twice in float64. What is farther out than anything on
    # Earth is no position.
    with np.errstate(over="ignore", invalid="ignore"):
        for axis in range(3):
            along = points[:, axis].astype(np.float64)
            local[:, axis] = np.where(np.abs(along) <= FARTHEST, along - offset[axis], np.nan)
    none = np.zeros(count, bool)
    ground, solid = none if ground is None else ground, none if solid is None else solid
    return PointCloud(local, offset, ground, solid, path.name)


def _round_middle(coordinates: Shaped[np.ndarray, " n"]) -> float:
    """Middle of one axis to the next 100 m if some coordinates lie 10 km or farther from zero, else 0."""
    finite = coordinates[np.isfinite(coordinates) & (np.abs(coordinates) <= FARTHEST)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    if max(abs(low), abs(high)) < _FAR:
        return 0.0
    return _ROUND * round((0.5 * low + 0.5 * high) / _ROUND)
