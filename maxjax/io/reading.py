"""Settings of a user for reading a map file: for what it leaves open, and in place of what it states."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

from maxjax.core.grid import Point3
from maxjax.io.geo.earth import check_accuracy
from maxjax.io.geo.reference_system import reference_system, unit_of
from maxjax.io.geo.vertical_zero import VerticalZero

GEOCENTRIC = "EPSG:4978"  # which only points and meshes may have (`io.geo.own_axes`)

Below = Literal["closed", "open"]
Unknown = Literal["occupied", "free"]
Inside = Literal["solid", "free"]
Up = Literal["z", "y", "-y"]


@dataclasses.dataclass(frozen=True)
class Reading:
    """How a file is read.

    Attributes:
        center: middle of a window of 101 x 101 x 101 voxels [m], in place of bounds. None: the bounds say.
        ends: points that the window has to hold [m], such as start and goal.
        below: `closed`: what points hide from the air is solid down to the ground; `open`: only buildings are. None:
            closed where the file has classes, as .las and .laz.
        unknown: what space is that a file tells nothing of: an OctoMap, a surface model, a survey. None: occupied.
        crs: reference system of the file's coordinates, as EPSG:28992; of points and meshes also EPSG:4978. None: the
            one that the file names.
        unit: of its coordinates, as ft, us-ft or a number of metres. None: that of the file or of its system.
        vertical_unit: of its heights. None: that of the file or of its system.
        band: of a raster, counted from 1. None: the only one.
        drop_classes: ASPRS classes of points that are left out.
        only: what is taken of a city model: keys of OpenStreetMap (building, man_made, power, barrier, natural,
            aerialway, other), or types of CityJSON. None given: all that stands.
        height: property of OpenStreetMap or GeoJSON that holds heights, with their unit as in roof_ht:ft. None: the
            first of `tag_heights.HEIGHTS` that a shape has.
        levels: property that holds numbers of levels. None: the first of `tag_heights.LEVELS`.
        up: axis of meshes and points that is up. None: that of the format: y of .glb, z of all others.
        offset: added to coordinates of meshes and points, in their unit, after they are upright. None: nothing.
        inside: what a closed mesh encloses: solid, as a building, or free, as a room. None: solid.
        accuracy: how true the file's places are on Earth [m]. None: as PROJ knows it of their system.
        height_of_zero: height above sea level of z = 0 in the map [m]. None: as the file states it, if it does.

    Raises:
        ValueError: for points without three coordinates, or a system, a unit, a band or a class that is none.
    """

    center: Point3 | None = None
    ends: tuple[Point3, ...] = ()
    below: Below | None = None
    unknown: Unknown | None = None
    crs: str | None = None
    unit: str | None = None
    vertical_unit: str | None = None
    band: int | None = None
    drop_classes: tuple[int, ...] = ()
    only: tuple[str, ...] = ()
    height: str | None = None
    levels: str | None = None
    up: Up | None = None
    offset: Point3 | None = None
    inside: Inside | None = None
    accuracy: float | None = None
    height_of_zero: float | None = None

    def __post_init__(self) -> None:
        center = None if self.center is None else tuple(float(x) for x in self.center)
        ends = tuple(tuple(float(x) for x in end) for end in self.ends)
        if any(len(point) != 3 for point in (*ends, center or (0, 0, 0))):
            given = f"{self.center!r}, {self.ends!r}"
            raise ValueError(f"center, ends: expected three coordinates each [m], given {given}")
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "ends", ends)
        if self.offset is not None and not all(map(math.isfinite, self.offset)):
            raise ValueError(f"offset: expected three finite numbers, given {self.offset}")
        if self.crs is not None and not self.is_geocentric:
            reference_system(self.crs)
        for unit in (self.unit, self.vertical_unit):
            if unit is not None:
                unit_of(unit)
        _, _, of_height = (self.height or "").partition(":")
        if of_height:
            unit_of(of_height)
        VerticalZero(self.height_of_zero)
        check_accuracy(self.accuracy)
        if self.band is not None and self.band < 1:
            raise ValueError(f"band: expected a number from 1 on, given {self.band}")
        wrong = [number for number in self.drop_classes if not 0 <= number <= 255]
        if wrong:
            raise ValueError(f"drop_classes: expected numbers from 0 to 255, given {wrong[0]}")

    @property
    def is_geocentric(self) -> bool:
        """Whether coordinates are Earth-centred (EPSG:4978)."""
        return self.crs is not None and self.crs.strip().upper() == GEOCENTRIC


PLAIN = Reading()
