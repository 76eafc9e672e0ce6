"""Where one may fly: an altitude band, and areas to keep out of or to keep in, as voxels.

    open   = voxels that lie, whole, in the band and in one keep-in area, if there is any, and touch no keep-out area
    closed = all others

So a path through open voxels keeps all of these rules, whatever it does within them. Heights above ground are counted
from the terrain (`core.terrain`). Where only voxels tell it, a floor to stay above is counted from the upper face of
the highest one in a column, a ceiling to stay below from its lower face.

A path keeps off closed voxels as it keeps off the ground, by one voxel, and they have no price: there is nothing to run
into.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float, Int64, UInt8

from maxjax.core.grid import Grid
from maxjax.core.status import Closure
from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.geo.columns import Columns, Ring, columns_of
from maxjax.io.geo.triangles import Volume, fill_columns

# `Closure` of each voxel.
Reasons = UInt8[np.ndarray, "nx ny nz"]

_TOUCH = 1e-6  # [voxels]; overlaps thinner than that do not count, in heights


@dataclasses.dataclass(frozen=True)
class Area:
    """A part of the airspace: an upright prism.

    Attributes:
        name: of the area.
        rings: outline and holes, last point not repeated [m], map coordinates; inside is where an odd number surround.
        keep_in: whether one has to stay inside it, or inside another such area; False: one has to keep out.
        floor, ceiling: where it begins and ends [m].
        floor_above_ground, ceiling_above_ground: whether these are heights above ground; False: z of the map.

    Raises:
        ValueError: for rings that are none or not finite, or a ceiling not above the floor.
    """

    name: str
    rings: tuple[Ring, ...]
    keep_in: bool = False
    floor: float = -math.inf
    ceiling: float = math.inf
    floor_above_ground: bool = True
    ceiling_above_ground: bool = True

    def __post_init__(self) -> None:
        for ring in self.rings:
            if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or not np.isfinite(ring).all():
                raise ValueError(f"{self.name}: expected rings of at least 3 finite points (n, 2), given {ring.shape}")
        if not self.rings or math.isnan(self.floor) or math.isnan(self.ceiling):
            raise ValueError(f"{self.name}: expected a ring, and heights in metres")
        if self.floor_above_ground == self.ceiling_above_ground and not self.floor < self.ceiling:
            raise ValueError(
                f"{self.name}: expected a ceiling above its floor of {self.floor:g} m, given {self.ceiling:g}"
            )

    @property
    def needs_ground(self) -> bool:
        """Whether a height of it is above ground."""
        return (self.floor_above_ground and math.isfinite(self.floor)) or (
            self.ceiling_above_ground and math.isfinite(self.ceiling)
        )


@dataclasses.dataclass(frozen=True)
class Airspace:
    """The rules of the air in a map.

    Attributes:
        floor: least height above ground [m]; None: none.
        ceiling: greatest height above ground [m]; None: none.
        highest: greatest z [m], as start z + 60 for a ceiling of 60 m above the start; None: none.
        areas: to keep out of, or to keep in.
        remarks: sentences on what a user should know of them.

    Raises:
        ValueError: for heights that are no numbers, or a ceiling not above the floor.
    """

    floor: float | None = None
    ceiling: float | None = None
    highest: float | None = None
    areas: tuple[Area, ...] = ()
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("floor", "ceiling", "highest"):
            given = getattr(self, name)
            if given is not None and not math.isfinite(given):
                raise ValueError(f"{name}: expected a height in metres, given {given}")
        if self.floor is not None and self.ceiling is not None and not self.floor < self.ceiling:
            raise ValueError(f"ceiling: expected more than the floor, {self.floor:g} m, given {self.ceiling:g}")

    def closed(self, ground: Volume, grid: Grid) -> Reasons:
        """Why each voxel of a map is closed, if it is; an area counts before the band.

        Args:
            ground: the voxels that are ground.
            grid: where they lie.

        Raises:
            ValueError: where a height above ground is given, and the map has no ground.
        """
        return self.closed_over(Terrain.of(ground, grid))

    def closing(self, where: VoxelMap) -> VoxelMap:
        """A map under these rules, or a batch of maps; raises as `closed`."""
        host = where.on_host()
        if host.batch is None:
            return host.closing(self.closed_over(where.terrain))
        return host.closing(np.stack([self.closed(ground, host.grid) for ground in np.asarray(host.ground)]))

    def closed_over(self, terrain: Terrain) -> Reasons:
        """As `closed`."""
        heights = terrain.everywhere
        if self.needs_ground and np.isnan(heights).any():
            raise ValueError(
                "airspace: expected a map with ground below heights above ground; "
                "give the ground's height (--ground Z), or heights above sea level"
            )
        grid = terrain.grid
        reasons = np.zeros(grid.shape, np.uint8)
        if (self.floor, self.ceiling, self.highest) != (None, None, None):
            reasons[~self._band(terrain, heights)] = Closure.BAND
        reasons[self._kept_out(terrain, heights)] = Closure.AREA
        if any(area.keep_in for area in self.areas):
            reasons[~self._kept_in(terrain, heights)] = Closure.AREA
        return reasons

    @property
    def needs_ground(self) -> bool:
        """Whether a height is above ground."""
        return self.floor is not None or self.ceiling is not None or any(area.needs_ground for area in self.areas)

    def reasons_at(self, index: tuple[int, int, int], terrain: Terrain) -> list[str]:
        """The rule that closes a voxel, in words; empty if it is open."""
        x, y, _ = index
        corner = np.array(terrain.grid.origin) + terrain.grid.spacing * np.array(index)
        one = Grid((1, 1, 1), terrain.grid.spacing, (float(corner[0]), float(corner[1]), float(corner[2])))
        here = Terrain(terrain.everywhere[x : x + 1, y : y + 1], one, terrain.doubt)
        found = [
            f"{words} {value:g} m{'' if name == 'highest' else ' above ground'}"
            for name, words in (("floor", "below"), ("ceiling", "above"), ("highest", "above z ="))
            if (value := getattr(self, name)) is not None and Airspace(**{name: value}).closed_over(here).any()
        ]
        out = [area for area in self.areas if not area.keep_in]
        found += [
            f"in the keep-out area {area.name}" for area in out if Airspace(areas=(area,)).closed_over(here).any()
        ]
        kept = tuple(area for area in self.areas if area.keep_in)
        if kept and Airspace(areas=kept).closed_over(here).any():
            found.append(f"not in the keep-in area {' or '.join(area.name for area in kept)}")
        return found

    def _band(self, terrain: Terrain, heights: Float[np.ndarray, "nx ny"]) -> Bool[np.ndarray, "nx ny nz"]:
        """Voxels that lie, whole, in the altitude band."""
        grid, nowhere = terrain.grid, np.full(heights.shape, math.inf)
        low = -nowhere if self.floor is None else heights + self.floor
        high = nowhere if self.ceiling is None else heights - terrain.doubt + self.ceiling
        first, last = _within(low, np.minimum(high, math.inf if self.highest is None else self.highest), grid)
        level = np.arange(grid.shape[2])
        return (level >= first[:, :, None]) & (level <= last[:, :, None])

    def _kept_out(self, terrain: Terrain, heights: Float[np.ndarray, "nx ny"]) -> Volume:
        """Voxels that a keep-out area touches."""
        grid = terrain.grid
        areas = [area for area in self.areas if not area.keep_in]
        touched, inner = _columns(areas, grid)
        column, owner = (np.concatenate(pair) for pair in zip(touched, inner, strict=True))
        below = heights.ravel()[column]
        low, high = _height(areas, owner, "floor", below - terrain.doubt), _height(areas, owner, "ceiling", below)
        first = _level(np.floor((low - grid.lower[2]) / grid.spacing + _TOUCH), grid)
        last = _level(np.ceil((high - grid.lower[2]) / grid.spacing - _TOUCH) - 1, grid)
        last = np.where(low < high, last, -1)  # hills may reach through a ceiling above sea level
        return fill_columns(column, np.maximum(first, 0), np.minimum(last, grid.shape[2] - 1), grid.shape)

    def _kept_in(self, terrain: Terrain, heights: Float[np.ndarray, "nx ny"]) -> Volume:
        """Voxels that lie, whole, in a keep-in area."""
        grid = terrain.grid
        areas = [area for area in self.areas if area.keep_in]
        touched, inner = (column * len(areas) + owner for column, owner in _columns(areas, grid))
        whole = np.setdiff1d(inner, touched)
        column, owner = whole // len(areas), whole % len(areas)
        below = heights.ravel()[column]
        low, high = _height(areas, owner, "floor", below), _height(areas, owner, "ceiling", below - terrain.doubt)
        first, last = _within(low, high, grid)
        return fill_columns(column, np.maximum(first, 0), np.minimum(last, grid.shape[2] - 1), grid.shape)


def _columns(areas: list[Area], grid: Grid) -> tuple[Columns, Columns]:
    """As `prisms.columns_of`, of areas."""
    owner = np.array([k for k, area in enumerate(areas) for _ in area.rings], np.int64)
    return columns_of([ring for area in areas for ring in area.rings], owner, grid)


def _height(
    areas: list[Area], owner: Int64[np.ndarray, " n"], name: str, ground: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """The `floor` or the `ceiling` of areas over ground of these heights, z [m]."""
    level = np.array([getattr(area, name) for area in areas], np.float64)[owner]
    above_ground = np.array([getattr(area, f"{name}_above_ground") for area in areas], bool)[owner]
    found: Float[np.ndarray, " n"] = np.where(above_ground & np.isfinite(level), ground, 0.0) + level
    return found


def _within(
    low: Float[np.ndarray, "..."], high: Float[np.ndarray, "..."], grid: Grid
) -> tuple[Int64[np.ndarray, "..."], Int64[np.ndarray, "..."]]:
    """First and last layer of voxels that lie, whole, between two heights, z [m]."""
    first = np.ceil((low - grid.lower[2]) / grid.spacing - _TOUCH)
    last = np.floor((high - grid.lower[2]) / grid.spacing + _TOUCH) - 1
    return _level(first, grid), _level(last, grid)


def _level(value: Float[np.ndarray, "..."], grid: Grid) -> Int64[np.ndarray, "..."]:
    """Numbers of layers, infinite ones as one beyond the grid."""
    layers: Int64[np.ndarray, "..."] = np.clip(value, -1, grid.shape[2]).astype(np.int64)
    return layers
