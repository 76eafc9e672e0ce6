"""Contents of a map file: points or voxels in a local ENU frame, in metres.

    x_local = x_file − offset

Projected coordinates (EPSG:28992 puts Delft at 85,000 / 447,000 m) lie where neighbouring float32 numbers are
up to 3 cm apart, so they are shifted in float64 by a round offset near the cloud's middle first; small
coordinates stay.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float64, Shaped, UInt8

from maxjax.core.files import FileError
from maxjax.core.grid import Grid, Point3
from maxjax.io.geo.own_axes import bring_upright
from maxjax.io.geo.units_and_axes import METRES, UNREFERENCED, Reference, Stated, cube_of_metres, on_its_axes, reference
from maxjax.io.reading import PLAIN, Reading

MAX_POINTS = 50_000_000

FARTHEST = 1e8  # [m]; beyond, even float64 leaves little of a voxel
# Classes that hide nothing from the air: wires, with their guards and connectors. A bridge's deck hides what is below.
WIRES = (13, 14, 16)

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
        reference: of its coordinates.
        withdrawn: points of the file that are left out, by reason.
    """

    points: Float[np.ndarray, "n 3"]
    offset: Float[np.ndarray, "3"]
    ground: Bool[np.ndarray, " n"]
    solid: Bool[np.ndarray, " n"]
    source: str
    classes: UInt8[np.ndarray, " n"] | None = None
    reference: Reference = UNREFERENCED
    withdrawn: Mapping[str, int] = dataclasses.field(default_factory=dict)

    @property
    def hiding(self) -> Bool[np.ndarray, " n"]:
        """Whether a point hides from the air what is below it: all but ground and wires."""
        return ~self.ground if self.classes is None else ~self.ground & ~np.isin(self.classes, WIRES)


@dataclasses.dataclass(frozen=True)
class StoredVoxels:
    """A map that is already voxels, on the host.

    Attributes:
        occupied: obstacles.
        spacing: edge of a voxel [m].
        origin: position of the centre of voxel (0, 0, 0) [m], ENU.
        source: the file's name.
        ground: the voxels that are ground, occupied as well; None where the file does not say.
        reference: of its coordinates.
    """

    occupied: Bool[np.ndarray, "nx ny nz"]
    spacing: float
    origin: Point3
    source: str
    ground: Bool[np.ndarray, "nx ny nz"] | None = None
    reference: Reference = UNREFERENCED

    @property
    def grid(self) -> Grid:
        """Where the voxels lie."""
        nx, ny, nz = self.occupied.shape
        return Grid((nx, ny, nz), self.spacing, self.origin)


@dataclasses.dataclass(frozen=True)
class Labels:
    """Labels of a file for each of its points; None: none. Attributes as those of `PointCloud`."""

    ground: Bool[np.ndarray, " n"] | None = None
    solid: Bool[np.ndarray, " n"] | None = None
    classes: UInt8[np.ndarray, " n"] | None = None
    withdrawn: Mapping[str, int] = dataclasses.field(default_factory=dict)


def local_cloud(
    points: Shaped[np.ndarray, "n 3"],
    path: Path,
    reading: Reading = PLAIN,
    stated: Stated = Stated(),  # noqa: B008 (frozen)
    labels: Labels = Labels(),
) -> PointCloud:
    """A cloud from coordinates as a file gives them, of any integer or float type.

    Args:
        points: what is not finite, or farther out than anything on Earth, is no position.
        path: for messages.
        reading, stated: of the coordinates.
        labels: of the points.

    Raises:
        FileError: if there is no point; as `reference`.
    """
    count = len(points)
    if count == 0:
        raise FileError(f"{path}: holds no point, expected at least one")
    points, reading = bring_upright(points, reading, path)
    how = reference(stated, reading, _extent(points), path)
    if how.origin is not None:
        place = np.where(np.abs(points) <= FARTHEST, points, np.nan).astype(np.float64)
        points = how.metres(place)
    # Axis by axis, so that a large cloud is never in memory twice in float64.
    units = [1.0] * 3 if how.origin is not None else [how.unit, how.unit, how.vertical_unit]
    offset = np.array([_round_middle(points[:, axis], unit) for axis, unit in enumerate(units)])
    local = np.empty((count, 3), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, unit in enumerate(units):
            along = points[:, axis].astype(np.float64) * unit
            local[:, axis] = np.where(np.abs(along) <= FARTHEST, along - offset[axis], np.nan)
    none = np.zeros(count, bool)
    ground, solid = (none if flags is None else flags for flags in (labels.ground, labels.solid))
    return PointCloud(local, offset, ground, solid, path.name, labels.classes, how, labels.withdrawn)


def voxels_in_metres(stored: StoredVoxels, path: Path, reading: Reading) -> StoredVoxels:
    """Voxels of a file through the gate; raises as `reference`, and where its axes are none of a plane in metres."""
    around = np.array([stored.grid.lower, stored.grid.upper])[:, :2]
    how = on_its_axes(reference(METRES, reading, around, path), path)
    if how.unit == how.vertical_unit == 1.0:
        return dataclasses.replace(stored, reference=how)
    cube_of_metres(how, path)
    x, y, z = (how.unit * number for number in stored.origin)
    return dataclasses.replace(stored, spacing=how.unit * stored.spacing, origin=(x, y, z), reference=how)


def _extent(points: Shaped[np.ndarray, "n 3"]) -> Float64[np.ndarray, "2 2"]:
    """Lowest and highest x and y of what has a position; 0 without any."""
    found = np.zeros((2, 2))
    for axis in range(2):
        along = points[:, axis]
        finite = along[np.isfinite(along) & (np.abs(along) <= FARTHEST)]
        if len(finite):
            found[:, axis] = finite.min(), finite.max()
    return found


def _round_middle(coordinates: Shaped[np.ndarray, " n"], unit: float) -> float:
    """Middle of one axis [m] to the next 100 m if some coordinates lie 10 km or farther from zero, else 0."""
    finite = coordinates[np.isfinite(coordinates) & (np.abs(coordinates) <= FARTHEST)]
    low, high = (unit * float(finite.min()), unit * float(finite.max())) if len(finite) else (0.0, 0.0)
    if max(abs(low), abs(high)) < _FAR:
        return 0.0
    return _ROUND * round((0.5 * low + 0.5 * high) / _ROUND)
