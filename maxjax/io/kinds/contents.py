"""Contents of each kind of map file, as voxels, as an extent and in words; one place for all kinds.

Coordinates are the file's own [m]; of files in degrees, metres east and north of the middle of the buildings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.files import FileError
from maxjax.core.grid import Grid, Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.geo.units_and_axes import Reference
from maxjax.io.geo.vertical_zero import UNSTATED, VerticalZero
from maxjax.io.kinds.airborne import ground_mask, solidify
from maxjax.io.kinds.boxes import Boxes, fill_boxes
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.kinds.heights import Heights
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import PointCloud, StoredVoxels
from maxjax.io.kinds.prisms import prism_voxels
from maxjax.io.reading import PLAIN, Below, Reading, Unknown

Contents = PointCloud | StoredVoxels | Mesh | Footprints | Boxes | Heights
Volume = Bool[np.ndarray, "nx ny nz"]

_ADDRESSES = "address "  # shapes that are counted, and stand nowhere
_CHUNK = 2**20  # points at a time


# Points by what became of them: `inside` and `outside` of the grid, and `missing` (without a return).
Counts = Mapping[str, int]


@dataclasses.dataclass(frozen=True)
class Facts:
    """Facts of a file's contents before they are voxels.

    Attributes:
        extent: lowest and highest corner [m].
        read, dropped: what the file holds, by kind, and what of it is not used.
        remarks: sentences on what a user should know.
        spacing: the file's own [m]; None where it has none.
        lattice: centre of a voxel of that spacing [m].
        crs: coordinate reference system, as EPSG:28992; None where the file names none.
        origin: longitude and latitude [degrees] of (0, 0); None where coordinates are the file's.
        zero: what heights count from.
    """

    extent: Float[np.ndarray, "2 3"]
    read: Mapping[str, int]
    dropped: Mapping[str, int] = dataclasses.field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    spacing: float | None = None
    lattice: Point3 = (0.0, 0.0, 0.0)
    crs: str | None = None
    origin: tuple[float, float] | None = None
    zero: VerticalZero = UNSTATED


def facts(contents: Contents) -> Facts:
    """Facts of a file's contents.

    Raises:
        FileError: if nothing in it has a place.
    """
    match contents:
        case PointCloud():
            return _of_points(contents)
        case StoredVoxels():
            corners = np.array([contents.grid.lower, contents.grid.upper])
            read = {"voxels": contents.occupied.size, "occupied": int(contents.occupied.sum())}
            return _referred(
                Facts(corners, read, spacing=contents.spacing, lattice=contents.origin), contents.reference
            )
        case Mesh():
            corners = np.concatenate([contents.triangles.reshape(-1, 3), contents.points])
            read = {"triangles": len(contents.triangles), "closed bodies": contents.closed_bodies}
            read |= {"open bodies": contents.bodies.open_bodies, "loose vertices": len(contents.points)}
            whole = Facts(_around(corners), read, contents.dropped, contents.remarks)
            return _referred(whole, contents.reference)
        case Footprints():
            return _of_footprints(contents)
        case Boxes():
            known = contents.corners if contents.free is None else np.concatenate([contents.corners, contents.free])
            read = {"boxes": len(contents.corners)}
            read |= {} if contents.free is None else {"free boxes": len(contents.free)}
            half = 0.5 * (contents.spacing or 0.0)
            x, y, z = (float(corner) + half for corner in contents.lattice)
            boxes = Facts(_around(known.reshape(-1, 3)), read, spacing=contents.spacing, lattice=(x, y, z))
            return _referred(boxes, contents.reference)
        case Heights():
            known = np.isfinite(contents.height)
            dropped = {"cells without a height": int((~known).sum())}
            cells = Facts(contents.extent, {"cells": int(known.sum())}, dropped, contents.remarks)
            return _referred(cells, contents.reference)


def _referred(known: Facts, how: Reference) -> Facts:
    """The same with a reference system and what it says."""
    remarks = (*how.remarks, *known.remarks)
    return dataclasses.replace(known, crs=how.crs, origin=how.origin, zero=how.zero, remarks=remarks)


def _of_points(cloud: PointCloud) -> Facts:
    finite = np.isfinite(cloud.points).all(axis=1)
    if not cloud.offset.any():
        finite &= (cloud.points != 0).any(axis=1)  # a missed beam
    read = {"points": len(cloud.points)}
    if cloud.classes is not None:
        numbers, counts = np.unique(cloud.classes, return_counts=True)
        read |= {f"class {number}": count for number, count in zip(numbers.tolist(), counts.tolist(), strict=True)}
    dropped = dict(cloud.withdrawn)
    if not finite.all():
        dropped["without a return"] = int((~finite).sum())
    remarks = () if cloud.classes is None or cloud.ground.any() else ("no point is classified as ground",)
    # Without a return at all, the window is about (0, 0, 0), and the plan says what is wrong.
    corners = cloud.points[finite].astype(np.float64) if finite.any() else np.zeros((1, 3))
    return _referred(Facts(_around(corners) + cloud.offset, read, dropped, remarks), cloud.reference)


def _of_footprints(found: Footprints) -> Facts:
    extent = _around(np.concatenate([found.solids, found.terrain.reshape(-1, 3)]))
    remarks = list(found.remarks)
    if not len(found.terrain):
        remarks.append("the ground is taken from the floors of the buildings")
    standing = {kind: count for kind, count in found.dropped.items() if not kind.startswith(_ADDRESSES)}
    if standing:
        left = ", ".join(f"{count} {kind}" for kind, count in standing.items())
        remarks.append(f"left out, though they may stand: {left}")
    return _referred(Facts(extent, found.read, found.dropped, tuple(remarks)), found.reference)


def _around(corners: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 3"]:
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def voxels(contents: Contents, grid: Grid, reading: Reading = PLAIN) -> tuple[VoxelMap, Counts]:
    """A file's contents on a grid, and of points how many lie where.

    Args:
        contents: of any kind.
        grid: in the map's coordinates.
        reading: of what the file leaves open.
    """
    if isinstance(contents, PointCloud):
        return _points(contents, grid, reading.below)
    if isinstance(contents, Mesh):
        return VoxelMap.on(grid, *contents.voxels(grid, hollow=reading.inside == "free")), {}
    return _solids(contents, grid, reading.unknown), {}


def _solids(contents: Contents, grid: Grid, unknown: Unknown | None) -> VoxelMap:
    """All but points and meshes."""
    match contents:
        case StoredVoxels():
            return _cut(contents, grid)
        case Footprints():
            solid, ground = prism_voxels(contents, grid)
            return VoxelMap.on(grid, solid | ground, ground)
        case Boxes():
            occupied = fill_boxes(contents.corners, grid)
            if contents.free is not None and unknown != "free":
                occupied |= ~fill_boxes(contents.free, grid, whole=True)
            return VoxelMap.on(grid, occupied)
        case Heights():
            occupied, blank = contents.voxels(grid)
            return VoxelMap.on(grid, occupied | blank[:, :, None] if unknown != "free" else occupied)
        case _:
            raise TypeError(f"contents: expected those of a map's file, given {type(contents).__name__}")


def _points(cloud: PointCloud, grid: Grid, below: Below | None) -> tuple[VoxelMap, Counts]:
    x, y, z = (a - b for a, b in zip(grid.origin, cloud.offset.tolist(), strict=True))
    frame = Grid(grid.shape, grid.spacing, (x, y, z))
    occupied = np.zeros(grid.shape, bool)
    inside = missing = 0
    for begin in range(0, len(cloud.points), _CHUNK):
        points = cloud.points[begin : begin + _CHUNK].astype(np.float64)
        valid = np.isfinite(points).all(axis=1)
        if not cloud.offset.any():
            valid &= (points != 0).any(axis=1)
        missing += int((~valid).sum())
        index = np.floor((points[valid] - np.array(frame.origin)) / frame.spacing + 0.5)
        index = index[((index >= 0) & (index < frame.shape)).all(axis=1)].astype(np.int64)
        inside += len(index)
        occupied[tuple(index.T)] = True
    closed = cloud.classes is not None if below is None else below == "closed"
    occupied |= solidify(cloud, frame, closed=closed)
    ground = ground_mask(cloud, frame)
    counts = {"inside": inside, "outside": len(cloud.points) - inside - missing, "missing": missing}
    return VoxelMap.on(grid, occupied | ground, ground), counts


def _cut(source: StoredVoxels, grid: Grid) -> VoxelMap:
    """The voxels of a map on a grid of the same lattice, which may reach beyond it."""
    shift = np.round((np.array(grid.origin) - np.array(source.origin)) / grid.spacing).astype(np.int64)
    low, high = np.maximum(shift, 0), np.minimum(shift + grid.shape, source.occupied.shape)
    if (low >= high).any():
        raise FileError(
            f"{source.source}: expected bounds that meet the map, {source.grid.lower} to {source.grid.upper}"
        )
    found = []
    for volume in (source.occupied, source.ground):
        part = np.zeros(grid.shape, bool)
        if volume is not None:
            place = tuple(slice(a, b) for a, b in zip(low - shift, high - shift, strict=True))
            part[place] = volume[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
        found.append(part)
    return VoxelMap.on(grid, found[0] | found[1], found[1])
