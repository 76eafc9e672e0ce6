"""Where to land on a roof: its flattest, freest spot, from the city's faces and from its voxels.

    h(x, y)   height of what is topmost there;  the spot is of the roof where that is a face of the building
    bad       not of the roof; or steeper to a neighbour than the slope; or under voxels more than one above h
    clear     distance in plan to the nearest bad place            edge      to the nearest from which h falls

h is taken at places a few to the clear radius: what is thinner than that, as a wire, may be missed. Spots that are as
clear as asked and as far from the edge go by the steepest place around them, then by how clear they are.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.grid import Point3
from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap, check_single_map
from maxjax.inspection.target_surface import city_faces
from maxjax.inspection.targets import Chosen, Target, choose
from maxjax.inspection.upright_lines import find_topmost
from maxjax.io.kinds.faces import Faces
from maxjax.planning.touchdown import Touchdown
from maxjax.planning.waypoint import Waypoint

_FINEST, _PARTS = 0.25, 5  # between places where h is taken [m], and how many are on a clear radius at least
_MOST = 250_000  # places of a roof; a larger one has them wider apart
_ALIKE = 0.5  # slopes that differ by less are alike [degrees]
_ROUND = 1e-6  # of heights [m]

Rows = Float64[np.ndarray, "nx ny"]
Mask = Bool[np.ndarray, "nx ny"]


@dataclasses.dataclass(frozen=True)
class Landing:
    """What a place to land on a roof has to have.

    Attributes:
        radius: of clear roof around it, in plan [m]; at least the radius that the vehicle keeps.
        slope: greatest within that [degrees].
        edge: least distance to where the roof falls [m].
        height: of the end of the path above it [m].

    Raises:
        ValueError: if radius or height is not positive, the edge negative, or the slope not from 0 to 45 degrees.
    """

    radius: float = 1.5
    slope: float = 5.0
    edge: float = 2.0
    height: float = 5.0

    def __post_init__(self) -> None:
        limits = (("radius", 0.0, math.inf), ("height", 0.0, math.inf), ("edge", -1e-9, math.inf))
        for name, least, most in limits:
            if not least < getattr(self, name) < most:
                raise ValueError(f"Landing.{name}: expected a positive number of metres, given {getattr(self, name)}")
        if not 0.0 <= self.slope <= 45.0:
            raise ValueError(f"Landing.slope: expected 0 to 45 degrees, given {self.slope}")


@dataclasses.dataclass(frozen=True)
class LandingPlace:
    """A place on a roof.

    Attributes:
        name: of the building.
        position: on the roof [m], ENU.
        clear: distance in plan to the nearest thing that is not flat roof [m].
        edge: to where the roof falls [m].
        slope: greatest within the clear radius that was asked for [degrees].
        rise: by which the roof is higher within the clear distance, at most [m].
        asked: what it was to have.
    """

    name: str
    position: Point3
    clear: float
    edge: float
    slope: float
    rise: float
    asked: Landing

    @property
    def waypoint(self) -> Waypoint:
        """The end of a mission, above the place, where the vehicle lands upright."""
        x, y, z = self.position
        return Waypoint((x, y, z + self.asked.height), touchdown=Touchdown(z, self.clear, self.rise))

    def __str__(self) -> str:
        x, y, z = self.position
        return (
            f"it lands on the roof of {self.name} at x {x:.1f}, y {y:.1f}, z {z:.1f}: {self.clear:.1f} m clear, "
            f"{self.edge:.1f} m from the edge, slope {self.slope:.1f} degrees"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class _Roof:
    """A roof at places in rows: heights, where it is, what is in the way.

    Attributes:
        corner: first place in plan [m].
        apart: between places [m].
        height: of what is topmost [m]; NaN: nothing.
        own: which places are of the roof.
        slope: to the steepest neighbour [degrees].
        falls: from which places of the roof it falls to a neighbour.
        under: which places have voxels above them beyond the one that holds the roof.
    """

    corner: Float64[np.ndarray, "2"]
    apart: float
    height: Rows
    own: Mask
    slope: Rows
    falls: Mask
    under: Mask


def find_landing(where: VoxelMap, target: Target, landing: Landing | None = None) -> LandingPlace:
    """The flattest, freest spot of a roof.

    Args:
        where: one map. Of a file with faces the roof is that of its faces; else it is that of the voxels.
        target: the building's name, a place (x, y) on its roof, or what else `inspect` takes.
        landing: what the spot has to have; None: the default.

    Raises:
        ValueError: if there is no such building, it has no roof in the map, or no spot of the roof is as flat, as clear
            and as far from its edge as asked, with what was found.
    """
    from scipy import ndimage  # a quarter of a second that most commands can do without

    asked, single = Landing() if landing is None else landing, check_single_map(where).on_host()
    faces = city_faces(single)
    chosen = choose(faces, target)
    roof = _roof_of(single, faces, chosen, min(_FINEST, asked.radius / _PARTS), asked.slope)
    if not roof.own.any():
        raise ValueError(f"{chosen.name}: expected a roof in the map to land on, found none")
    steep = roof.slope > asked.slope + 1e-6
    flat = roof.own & ~steep & ~roof.under
    if not flat.any():
        least = roof.slope[roof.own].min()
        why = (
            f"no place flatter than {least:.1f} degrees" if least > asked.slope else "none that the map's voxels clear"
        )
        raise ValueError(f"{chosen.name}: expected a roof no steeper than {asked.slope:g} degrees, found {why}")
    clear, edge = (roof.apart * np.asarray(ndimage.distance_transform_edt(free)) for free in (flat, ~roof.falls))
    _check(clear, edge, roof, asked, chosen.name)
    reach = math.floor(asked.radius / roof.apart)
    around = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    steepest = ndimage.maximum_filter(np.where(roof.own, roof.slope, 0.0), footprint=around)
    fits = (clear >= asked.radius) & (edge >= asked.edge)
    ranked = np.where(fits, -np.round(steepest / _ALIKE) * 1e3 + np.minimum(clear, 900.0), -np.inf)
    i, j = np.unravel_index(int(ranked.argmax()), ranked.shape)
    x, y = (roof.corner + roof.apart * np.array([i, j])).tolist()
    free, apart, slope, z = (float(rows[i, j]) for rows in (clear, edge, steepest, roof.height))
    rows, columns = np.indices(clear.shape)
    rise = float(roof.height[roof.apart * np.hypot(rows - i, columns - j) < free].max()) - z
    return LandingPlace(chosen.name, (x, y, z), free, apart, slope, rise, asked)


def _check(clear: Rows, edge: Rows, roof: _Roof, asked: Landing, name: str) -> None:
    """Raises a ValueError where no spot has what is asked."""
    wide = clear >= asked.radius
    if wide.any() and (edge[wide] >= asked.edge).any():
        return
    found = np.where(wide, edge, -1.0) if wide.any() else clear
    i, j = np.unravel_index(int(found.argmax()), found.shape)
    x, y = (roof.corner + roof.apart * np.array([i, j])).tolist()
    most = f"found {found[i, j]:.1f} m at most, at x {x:.1f}, y {y:.1f}"
    if wide.any():
        raise ValueError(
            f"{name}: expected a place to land {asked.edge:g} m from the edge of its roof, {most}; ask for less edge"
        )
    raise ValueError(
        f"{name}: expected {asked.radius:g} m of clear roof no steeper than {asked.slope:g} degrees around a place to "
        f"land, {most}; ask for a smaller radius, or take another roof"
    )


def _roof_of(where: VoxelMap, faces: Faces, chosen: Chosen, apart: float, slope: float) -> _Roof:
    """Heights over a building and one place around it, with what is in the way of a landing."""
    corners = faces.triangles[chosen.faces][:, :, :2].reshape(-1, 2)
    if chosen.outline is not None or chosen.box is not None:
        limits = chosen.outline if chosen.outline is not None else chosen.box
        corners = np.asarray(limits, np.float64)[:, :2]
    low = np.maximum(corners.min(axis=0), where.grid.lower[:2])
    high = np.minimum(corners.max(axis=0), where.grid.upper[:2])
    apart = max(apart, math.sqrt(float(np.prod(np.maximum(high - low, apart))) / _MOST))
    counts = np.maximum(np.floor((high - low) / apart), 0).astype(int) + 3
    # Half a place off the corners, so that no line runs along a wall.
    corner = low - 0.5 * apart
    sides = [first + apart * np.arange(n) for first, n in zip(corner.tolist(), counts.tolist(), strict=True)]
    rows = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    flat = rows.reshape(-1, 2)
    top, number = find_topmost(flat, np.asarray(faces.triangles, np.float64))
    own = (number >= 0) & chosen.faces[number] & chosen.holds(np.column_stack([flat, top]))
    inside = ((flat >= where.grid.lower[:2]) & (flat <= where.grid.upper[:2])).all(axis=1)
    height, own = top.reshape(rows.shape[:2]), (own & inside).reshape(rows.shape[:2])
    step = _steps(height)
    fall = apart * math.tan(math.radians(max(slope, 1.0)))
    tilt = np.degrees(np.arctan2(np.abs(step).max(axis=0), apart))
    under = _top_of_voxels(where, flat).reshape(own.shape) - height > where.grid.spacing + _ROUND
    falls = own & (step.min(axis=0) < -fall - _ROUND)
    return _Roof(corner, apart, height, own, np.where(own, tilt, 90.0), falls, under)


def _steps(height: Rows) -> Float64[np.ndarray, "8 nx ny"]:
    """Rise to each of eight neighbours, over the distance of two in a row [m]; beyond the rows it falls for ever."""
    level = np.pad(np.where(np.isnan(height), -np.inf, height), 1, constant_values=-np.inf)
    nx, ny = height.shape
    found = []
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            if (i, j) != (0, 0):
                beside = level[1 + i : 1 + i + nx, 1 + j : 1 + j + ny]
                rise = np.where(np.isfinite(height), beside - np.nan_to_num(height), 0.0)
                found.append(rise / math.hypot(i, j))
    return np.array(found)


def _top_of_voxels(where: VoxelMap, places: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, " n"]:
    """Upper face of the highest occupied voxel at places in plan [m]; NaN where there is none."""
    grid = where.grid
    top = Terrain.of(np.asarray(where.occupied), grid).heights
    index = np.floor((places - np.array(grid.lower[:2])) / grid.spacing).astype(np.int64)
    i, j = np.clip(index, 0, np.array(grid.shape[:2]) - 1).T
    return np.asarray(top[i, j], np.float64)
