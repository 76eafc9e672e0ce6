"""A map file as a `LoadedMap`: read, cut to a window, made voxels.

occupied[i, j, k]  iff  something of the file lies in the voxel, or it is ground, or unknown and taken as occupied
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool

from maxjax.core.grid import Grid, Point3
from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.geo.accuracy import accuracy_of
from maxjax.io.geo.earth import Earth, earth_of
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.io.kinds.bare_ground import terrain_of
from maxjax.io.kinds.contents import Contents, Facts, facts, voxels
from maxjax.io.kinds.coverage import closing_unknown, within_data
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.kinds.mesh import Mesh
from maxjax.io.kinds.point_cloud import StoredVoxels
from maxjax.io.places import Frame, check_in_map, point_at, points_at
from maxjax.io.reader import read_map
from maxjax.io.reading import PLAIN, Reading
from maxjax.io.window import Window
from maxjax.planning.problem.distances import Distances

_TOUCH = 1e-9  # [m]
_SAME = 0.5  # [m]; what systems of heights differ by


@dataclasses.dataclass(frozen=True, eq=False)
class MapFile:
    """Statements of a map's file about itself.

    Attributes:
        source: its name.
        crs: coordinate reference system, as EPSG:28992; None where neither the file nor the caller names one.
        origin: longitude and latitude of (0, 0) [degrees], where the file is in degrees.
        earth: where it lies on Earth, and what its heights count from; None where neither says where.
        read: what it holds, by kind.
        dropped: what of it is not used, by reason.
        remarks: sentences on what a user should know.
        counts: points `inside`, `outside` and `missing`; empty but for points.
        within: columns that lie within the data; beyond, nothing is known.
        terrain: heights of the ground, as numbers; None where the file tells it by voxels, or not at all.
        contents: what was read, where it has faces (`io.kinds.faces`); else None.
    """

    source: str
    crs: str | None
    origin: tuple[float, float] | None
    earth: Earth | None
    read: Mapping[str, int]
    dropped: Mapping[str, int]
    remarks: tuple[str, ...]
    counts: Mapping[str, int]
    within: Bool[np.ndarray, "nx ny"]
    terrain: Terrain | None = None
    contents: Footprints | Mesh | None = dataclasses.field(default=None, repr=False)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class LoadedMap(VoxelMap):
    """The map of a file: a `VoxelMap` in the file's coordinates [m], and what the file says of itself.

    Of a file in degrees, coordinates are metres east and north of its origin.

    Attributes:
        file: see there. Static.
    """

    file: MapFile = dataclasses.field(metadata={"static": True})

    @property
    def earth(self) -> Earth | None:
        """Where the map lies on Earth, and what its heights count from; None where it is unknown."""
        return self.file.earth

    @property
    def terrain(self) -> Terrain:
        """How high the ground is, as the file says it, else as its voxels tell."""
        return super().terrain if self.file.terrain is None else self.file.terrain

    def point(self, place: Sequence[float], frame: Frame = "agl") -> Point3:
        """The point [m] at a latitude, a longitude [degrees] and a height [m].

        Args:
            place: the three.
            frame: `agl`, above ground, or `amsl`, above sea level.

        Raises:
            ValueError: if the place is none, the map has no ground there, or lies nowhere on Earth; for a height above
                sea level where the map's zero is not known.
            ImportError: if pyproj is missing, where the map has a reference system.
        """
        earth = self.earth
        if earth is None:
            raise ValueError(f"{self.file.source}: expected a map that says where it lies on Earth; name its crs")
        latitude, longitude, height = (float(number) for number in place)
        return point_at((latitude, longitude, height), frame, earth, self.terrain)


def load_map(
    path: str | os.PathLike[str],
    *,
    spacing: float | None = None,
    bounds: Sequence[Any] | np.ndarray | None = None,
    ground: float | None = None,
    crs: str | None = None,
    reading: Reading = PLAIN,
) -> LoadedMap:
    """Read a map file of any known format as voxels: a `VoxelMap` with its place on Earth and what the file says.

    Args:
        path: of a format of docs/maps.md: points, meshes, voxels, buildings, surface models; also packed by gzip.
        spacing: edge of a voxel [m]; None: the file's own, else 2 m.
        bounds: lowest and highest corner of the window, (2, 3) or six numbers [m]; None: map and ends, with room.
        ground: height of flat ground [m], in place of the map's own.
        crs: coordinate reference system, in place of the file's; that of `reading` too.
        reading: a window by its centre or its ends, what is taken of what the file leaves open, and units.

    Raises:
        FileError: if the file cannot be used (a ValueError: it says what was found and expected).
        ValueError: if the window is none, or takes more than 134 million voxels.
    """
    corners = None if bounds is None else tuple(np.asarray(bounds, np.float64).ravel().tolist())
    if corners is not None and len(corners) != 6:
        raise ValueError(f"bounds: expected six numbers of metres, given {bounds!r}")
    window = Window(spacing, corners, reading.center, list(reading.ends), ground)
    reading = reading if crs is None else dataclasses.replace(reading, crs=crs)
    return map_of(read_map(path, reading), window, reading)


def map_of(
    contents: Contents,
    window: Window,
    reading: Reading = PLAIN,
) -> LoadedMap:
    """A file as voxels in a window; arguments and errors as those of `load_map`."""
    known = facts(contents)
    grid, sentence = _grid(contents, known, window)
    found, counts = voxels(contents, grid, reading)
    if window.ground is not None:
        # The terrain stays occupied where the file has it; below flat ground all is.
        bottom = grid.lower[2] + grid.spacing * np.arange(grid.shape[2])
        flat = np.broadcast_to(bottom < window.ground - _TOUCH, grid.shape).copy()
        found = VoxelMap.on(grid, found.occupied, flat)
    within = within_data(contents, grid)
    found, unknown = closing_unknown(found, within, contents, reading.unknown)
    earth, place = locate(known, reading)
    dropped = dict(known.dropped)
    if counts.get("outside"):
        dropped["outside of the window"] = counts["outside"]
    file = MapFile(
        source=contents.source,
        crs=known.crs,
        origin=known.origin,
        earth=earth,
        read=known.read,
        dropped=dropped,
        remarks=(*known.remarks, *place, *unknown, *([sentence] if sentence else [])),
        counts=counts,
        within=within,
        terrain=terrain_of(contents, grid) if window.ground is None else Terrain.flat(window.ground, grid),
        contents=contents if isinstance(contents, Footprints | Mesh) else None,
    )
    return LoadedMap(found.occupied, found.ground, None, grid, file)


def locate(known: Facts, reading: Reading) -> tuple[Earth | None, list[str]]:
    """Where a file's map lies, a user's word before the file's, and remarks on what is not plain."""
    zero, remarks = known.zero, list[str]()
    if reading.height_of_zero is not None:
        zero, stated = VerticalZero(reading.height_of_zero), known.zero.above_sea
        if stated is not None and abs(stated - reading.height_of_zero) >= _SAME:
            taken = f"{reading.height_of_zero:g} m is taken, as asked"
            remarks.append(f"by the file z = 0 lies {stated:g} m above sea level; {taken}")
    elif zero.above_sea is None and zero.datum is not None:
        remarks.append(
            f"heights count from {zero.datum}, not from sea level; --height-of-zero H states where z = 0 lies"
        )
    elif zero.ellipsoidal:
        remarks.append(f"heights count from {zero.datum}: z = 0 lies {zero.above_sea:.2f} m above sea level")
    earth = earth_of(known.crs, known.origin, zero, reading.accuracy)
    if earth is not None:
        true = accuracy_of(earth, known.extent.mean(axis=0))
        remarks += [] if true.metres <= Distances().radius else [f"on Earth, {true}"]
    return earth, remarks


def map_with(
    contents: Contents,
    window: Window,
    places: Sequence[Point3],
    frame: Frame,
    earth: Earth | None,
    reading: Reading = PLAIN,
) -> tuple[LoadedMap, list[Point3]]:
    """A map around some places of a file, and where these are in it, as `map_of` makes it.

    Args:
        contents, window, reading: as in `map_of`; the window's own ends are ignored.
        places: latitudes, longitudes [degrees] and heights [m], or x, y and heights [m].
        frame: what they are, `agl`, `home`, `amsl` or `local-agl`.
        earth: where the map lies; None for `local-agl`.

    Raises:
        ValueError: if a place lies outside of the map; as `places.point_at` and `map_of`.
    """
    known = facts(contents)
    around = [check_in_map(place, frame, earth, known.extent) for place in places]
    points = [(x, y, z + place[2]) for (x, y, z), place in zip(around, places, strict=True)]
    if frame == "amsl":
        points = points_at(places, frame, earth)
    while True:
        window = dataclasses.replace(window, ends=points)
        found = map_of(contents, window, reading)
        points = points_at(places, frame, earth, found.terrain)
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
