"""A map file as a `Map`: read, cut to a window, made voxels.

occupied[i, j, k]  iff  something of the file lies in the voxel, or it is ground, or unknown and taken as occupied
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool

from maxjax.core.earth import Degrees, Earth, Projected
from maxjax.core.grid import Grid, Point3
from maxjax.core.terrain import Terrain
from maxjax.maps.contents import Below, Contents, Facts, Unknown, facts, voxels
from maxjax.maps.coverage import within_data
from maxjax.maps.model import StoredVoxels
from maxjax.maps.places import Frame, check_in_map, point_at
from maxjax.maps.reader import read_map
from maxjax.maps.window import Window

_TOUCH = 1e-9  # [m]


@dataclasses.dataclass(frozen=True)
class Map:
    """A map as voxels, on the host.

    Attributes:
        occupied: obstacles, the ground included.
        ground: the voxels that are ground, which a path only keeps off.
        grid: where they lie, in the file's coordinates [m]; of a file in degrees, metres east and north of `origin`.
        crs: coordinate reference system, as EPSG:28992; None where neither the file nor the caller names one.
        origin: longitude and latitude of (0, 0) [degrees], where the file is in degrees.
        source: the file's name.
        read: what the file holds, by kind.
        dropped: what of it is not used, by reason.
        remarks: sentences on what a user should know.
        counts: points `inside`, `outside` and `missing`; empty but for points.
        within: columns that lie within the data; beyond, nothing is known.
    """

    occupied: Bool[np.ndarray, "nx ny nz"]
    ground: Bool[np.ndarray, "nx ny nz"]
    grid: Grid
    crs: str | None
    origin: tuple[float, float] | None
    source: str
    read: Mapping[str, int]
    dropped: Mapping[str, int]
    remarks: tuple[str, ...]
    counts: Mapping[str, int]
    within: Bool[np.ndarray, "nx ny"]

    @property
    def earth(self) -> Earth | None:
        """Where the map lies on Earth, with its heights above sea level as the file has them; None where it is unknown.

        Raises:
            ImportError: without pyproj, where the map has a reference system.
            ValueError: for a system that pyproj does not know, or one without metres.
        """
        if self.origin is not None:
            return Degrees(*self.origin)
        return None if self.crs is None else Projected(self.crs)

    def point(self, place: Sequence[float], frame: Frame = "agl") -> Point3:
        """The point [m] at a latitude, a longitude [degrees] and a height [m].

        Args:
            place: the three.
            frame: `agl`, above ground, or `amsl`, above sea level, which is z where the file does not say otherwise.

        Raises:
            ValueError: for a place that is none or where the map has no ground, or a map that lies nowhere on Earth.
            ImportError: without pyproj, where the map has a reference system.
        """
        earth = self.earth
        if earth is None:
            raise ValueError(f"{self.source}: expected a map that says where it lies on Earth; name its crs")
        latitude, longitude, height = (float(number) for number in place)
        return point_at((latitude, longitude, height), frame, earth, Terrain.of(self.ground, self.grid))


def load_map(  # noqa: PLR0913 (a public name; all but the first is given by keyword and has a default)
    path: str | os.PathLike[str],
    *,
    spacing: float | None = None,
    bounds: Sequence[Any] | np.ndarray | None = None,
    center: Sequence[float] | None = None,
    ends: Sequence[Sequence[float]] = (),
    ground: float | None = None,
    below: Below | None = None,
    unknown: Unknown | None = None,
    crs: str | None = None,
) -> Map:
    """Read a map file of any known format as voxels.

    Args:
        path: .npz, .ply, .pcd, .las, .laz (points or voxels); .ply, .obj, .stl, .glb (meshes); CityJSON, OSM XML,
            GeoJSON (buildings); .bt, .ot (OctoMap), .tif (surface models), .3dmap (Moving AI), .csv (boxes).
        spacing: edge of a voxel [m]; None: the file's own, else 2 m.
        bounds: lowest and highest corner of the window, (2, 3) or six numbers [m]; None: map and ends, with room.
        center: middle of a window of 101 x 101 x 101 voxels [m], in place of bounds.
        ends: points that the window has to hold [m], such as start and goal.
        ground: height of flat ground [m], in place of the map's own.
        below: `closed`: what points hide from the air is solid down to the ground, and the default of .las and .laz;
            `open`: only buildings are. Meshes and other files are as they are.
        unknown: what unknown space is, in OctoMap files and surface models: `occupied`, the default, or `free`.
        crs: coordinate reference system, in place of the file's.

    Raises:
        FileError: if the file cannot be used (a ValueError: it says what was found and expected).
        ValueError: for a window that is none, or takes more than 134 million voxels.
    """
    corners = None if bounds is None else tuple(np.asarray(bounds, np.float64).ravel().tolist())
    if corners is not None and len(corners) != 6:
        raise ValueError(f"bounds: expected six numbers of metres, given {bounds!r}")
    middle = None if center is None else tuple(float(x) for x in center)
    points = [tuple(float(x) for x in end) for end in ends]
    if any(len(point) != 3 for point in [*points, middle or (0, 0, 0)]):
        raise ValueError(f"center, ends: expected three coordinates each [m], given {center!r}, {ends!r}")
    window = Window(spacing, corners, middle, points, ground)  # type: ignore[arg-type]
    return map_of(read_map(path), window, below, unknown, crs)


def map_of(
    contents: Contents,
    window: Window,
    below: Below | None = None,
    unknown: Unknown | None = None,
    crs: str | None = None,
) -> Map:
    """What a file holds as voxels in a window; arguments and errors as those of `load_map`."""
    known = facts(contents)
    grid, sentence = _grid(contents, known, window)
    found = voxels(contents, grid, below, unknown)
    occupied, ground = found.occupied, found.ground
    if window.ground is not None:
        # The terrain stays occupied where the file has it; below flat ground all is.
        bottom = grid.lower[2] + grid.spacing * np.arange(grid.shape[2])
        ground = np.broadcast_to(bottom < window.ground - _TOUCH, grid.shape).copy()
        occupied = occupied | ground
    remarks = (*known.remarks, sentence) if sentence else known.remarks
    dropped = dict(known.dropped)
    if found.counts.get("outside"):
        dropped["outside of the window"] = found.counts["outside"]
    return Map(
        occupied,
        ground,
        grid,
        crs or known.crs,
        known.origin,
        contents.source,
        known.read,
        dropped,
        remarks,
        found.counts,
        within_data(contents, grid),
    )


def map_with(  # noqa: PLR0913 (those of `map_of`, and points with what they are)
    contents: Contents,
    window: Window,
    places: Sequence[Point3],
    frame: Frame,
    earth: Earth,
    below: Below | None = None,
    unknown: Unknown | None = None,
) -> tuple[Map, list[Point3]]:
    """What a file holds around some places, and where these are in it: the map that `map_of` makes around the points.

    Args:
        contents, window, below, unknown: as in `map_of`; the window's own ends are ignored.
        places: latitudes, longitudes [degrees] and heights [m].
        frame: what the heights are, `agl` or `amsl`.
        earth: where the map lies.

    Raises:
        ValueError: for places outside of the map, or as `places.point_at` and `map_of`.
    """
    known = facts(contents)
    around = [check_in_map(place, earth, known.extent) for place in places]
    points = [(x, y, z + place[2]) for (x, y, z), place in zip(around, places, strict=True)]
    if frame == "amsl":
        points = [point_at(place, frame, earth) for place in places]
    while True:
        window = dataclasses.replace(window, ends=points)
        found = map_of(contents, window, below, unknown)
        level = window.ground
        terrain = Terrain.of(found.ground, found.grid) if level is None else Terrain.flat(level, found.grid)
        points = [point_at(place, frame, earth, terrain) for place in places]
        # Heights above ground are known once there is ground; they may ask for another window, of the same voxels.
        if _grid(contents, known, dataclasses.replace(window, ends=points))[0] == found.grid:
            return found, points


def _grid(contents: Contents, known: Facts, window: Window) -> tuple[Grid, str]:
    """The grid of a window; a map of voxels keeps its own, but for bounds."""
    if not isinstance(contents, StoredVoxels):
        return window.grid(known.extent, known.spacing, known.lattice)
    if window.center is not None:
        raise ValueError("center: a voxel map brings its own grid; leave it out, or give bounds")
    if window.spacing is not None and window.spacing != contents.spacing:
        raise ValueError(f"spacing: a voxel map brings its own, {contents.spacing:g} m, given {window.spacing:g}")
    if window.bounds is not None:
        flat = dataclasses.replace(window, ground=None)
        return flat.grid(known.extent, known.spacing, known.lattice)
    if contents.occupied.size > window.most:
        raise ValueError(
            f"{contents.source}: expected at most {window.most} voxels, given {contents.occupied.size} "
            f"{contents.occupied.shape}; crop it around start and goal"
        )
    return contents.grid, ""
