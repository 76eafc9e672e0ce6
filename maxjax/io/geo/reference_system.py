"""Coordinate reference systems: what the numbers of a file are, as pyproj reads the name that the file gives.

Read are WKT 1 and 2, codes as EPSG:28992, names and addresses of the OGC, and compound systems as EPSG:25832+5783.
Eastings and longitudes come first, as files have them, whatever the order of the system's own axes.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64

from maxjax.io.geo.vertical_zero import VerticalZero

Kind = Literal["projected", "geographic", "local"]

_LONGEST = 100_000  # characters of a name: WKT
_ONE_CODE = re.compile(r"(?:[^,+?]*[:/])?EPSG[:/]+(?:[\d.]*[:/]+)?(\d{3,6})", re.IGNORECASE)
_CLOSE = 0.5  # units; two systems are one where they agree to this
_AROUND = np.array([[-1, 0], [1, 0], [0, -1], [0, 1], [-0.6, -0.8], [0.6, 0.8], [-0.6, 0.8], [0.6, -0.8]])
_STEP = 50.0  # [m]; half the length that the scale of a projection is taken over
# Systems of heights above sea level that PROJ knows the grids of, the finer first.
_GEOIDS = (("EPSG:9518", "EGM2008"), ("EPSG:9707", "EGM96"))
# Parts of names of heights that count from a water level which is not the mean of the sea.
_NO_SEA_LEVEL = ("tide", "low water", "high water", "chart")
# Metres of the units that people name.
UNITS: Mapping[str, float] = {
    "m": 1.0,
    "km": 1000.0,
    "cm": 0.01,
    "mm": 0.001,
    "ft": 0.3048,
    "us-ft": 1200.0 / 3937.0,
    "in": 0.0254,
    "yd": 0.9144,
}


@dataclasses.dataclass(frozen=True)
class ReferenceSystem:
    """A reference system that a file or a user names.

    Attributes:
        name: as EPSG:28992 where it has a code, else its WKT; of a system composed of two, the horizontal one's.
        title: its own words for itself.
        kind: projected, geographic, or local: metres or feet of no place on Earth.
        unit: metres of a unit along the plane; of a geographic system 1.
        vertical_unit: metres of a unit of height; None where it has no heights.
        area: west, south, east and north of where it is used [degrees]; None where it is not known.
        vertical: what its heights count from, in words; None where it has none.
        solid: WKT of the system with heights above its ellipsoid, where its heights are so; else None.
    """

    name: str
    title: str
    kind: Kind
    unit: float
    vertical_unit: float | None
    area: tuple[float, float, float, float] | None
    vertical: str | None = None
    solid: str | None = None

    def geodetic(self, places: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Longitudes and latitudes [degrees], WGS84, of coordinates in the system's own units; infinite where none."""
        longitude, latitude = _to_degrees(self.name).transform(places[:, 0], places[:, 1])
        return np.column_stack([longitude, latitude])

    def coordinates(self, degrees: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """The inverse of `geodetic`."""
        x, y = _to_degrees(self.name).transform(degrees[:, 0], degrees[:, 1], direction="INVERSE")
        return np.column_stack([x, y])

    def zero(self, place: Float64[np.ndarray, " 2"]) -> VerticalZero:
        """What its heights count from at a place in the system's own units; heights above an ellipsoid by a geoid."""
        if self.vertical is None:
            return VerticalZero()
        if self.solid is None:
            sea = not any(word in self.vertical.lower() for word in _NO_SEA_LEVEL)
            return VerticalZero(0.0 if sea else None, self.vertical)
        for geoid, name in _GEOIDS:
            try:
                _, _, height = _to_geoid(self.solid, geoid).transform(*place.tolist(), 0.0)
            except RuntimeError:  # of PROJ, which lacks the grid
                continue
            if np.isfinite(height):
                return VerticalZero(float(height), f"{self.vertical}, brought to {name}", ellipsoidal=True)
        return VerticalZero(None, self.vertical, ellipsoidal=True)

    def scale(self, place: Float64[np.ndarray, " 2"]) -> float:
        """Metres on the map for a metre on Earth at a place in the system's own units: the farthest from 1 of four.

        Measured along both axes and both diagonals, from point to point on the ellipsoid; NaN where the place lies
        nowhere.
        """
        ends = self.geodetic(place + _STEP / self.unit * _AROUND)
        if not np.isfinite(ends).all():
            return float("nan")
        _, _, length = _geod().inv(ends[::2, 0], ends[::2, 1], ends[1::2, 0], ends[1::2, 1])
        scales = 2.0 * _STEP / np.maximum(length, 1e-9)
        return float(max(scales, key=lambda k: abs(k - 1.0)))


@functools.lru_cache(maxsize=64)
def reference_system(text: str) -> ReferenceSystem:
    """The system that a text names.

    Raises:
        ValueError: if pyproj does not know it, or it is none of a plane or of longitudes and latitudes, east and north.
    """
    import pyproj

    if len(text) > _LONGEST:
        raise ValueError(f"crs: expected at most {_LONGEST} characters, given {len(text)}")
    try:
        whole = pyproj.CRS.from_user_input(text.strip())
    except (pyproj.exceptions.CRSError, ValueError) as error:
        raise ValueError(f"crs: expected the name of a reference system, given {_short(text)}") from error
    flat, heights = _parts(whole)
    vertical = None if heights is None else heights.unit
    kind = _kind(flat, text)
    directions = [axis.direction.lower() for axis in flat.axis_info[:2]]
    if sorted(directions) != ["east", "north"]:
        raise ValueError(
            f"crs: expected axes that point east and north, given {' and '.join(directions) or 'none'} "
            f"({whole.name}); bring the file into another system"
        )
    unit = 1.0 if kind == "geographic" else float(flat.axis_info[0].unit_conversion_factor or 1.0)
    name = _name(text, whole, flat)
    if kind == "local":
        return ReferenceSystem(name, whole.name, kind, unit, vertical, None)
    try:
        _to_degrees(name)  # what pyproj reads with faults it may not convert
        known = pyproj.CRS.from_user_input(name)
    except pyproj.exceptions.ProjError as error:
        raise ValueError(f"crs: expected a reference system that leads to degrees, given {_short(text)}") from error
    area = known.area_of_use
    bounds = None if area is None else (area.west, area.south, area.east, area.north)
    if heights is None:
        return ReferenceSystem(name, whole.name, kind, unit, None, bounds)
    solid = flat.to_3d().to_wkt() if heights.ellipsoidal else None
    return ReferenceSystem(name, whole.name, kind, unit, vertical, bounds, heights.name, solid)


def unit_of(text: str) -> float:
    """Metres of a unit by its name (`UNITS`), or the number itself.

    Raises:
        ValueError: if it is neither, or no length from 0.1 mm to 100 km.
    """
    name = text.strip().lower()
    try:
        metres = UNITS[name] if name in UNITS else float(name)
    except ValueError:
        metres = float("nan")
    if not 1e-4 <= metres <= 1e5:
        raise ValueError(f"unit: expected one of {', '.join(UNITS)}, or a number of metres, given {_short(text)}")
    return metres


def unit_of_code(code: int) -> float | None:
    """Metres of the unit of length with this code of EPSG; None where there is none."""
    from pyproj.database import get_units_map

    factors = {int(u.code): u.conv_factor for u in get_units_map(auth_name="EPSG", category="linear").values()}
    return factors.get(code)


def unit_in_words(metres: float) -> str:
    """How a sentence names a unit of length."""
    names = {1.0: "metres", 0.3048: "feet", round(1200.0 / 3937.0, 9): "US survey feet"}
    return names.get(round(metres, 9), f"units of {metres:.9g} m")


@dataclasses.dataclass(frozen=True)
class _Heights:
    """The heights of a system: what they count from, metres of their unit, whether that is an ellipsoid."""

    name: str
    unit: float
    ellipsoidal: bool


def _parts(whole: Any) -> tuple[Any, _Heights | None]:
    """The horizontal system of a system, and its heights; None where it has none."""
    if whole.is_bound:
        return _parts(whole.source_crs)
    if whole.sub_crs_list:
        flat, _ = _parts(whole.sub_crs_list[0])
        parts = [(part.name, axis) for part in whole.sub_crs_list[1:] for axis in part.axis_info]
    else:
        flat, parts = whole, [(None, axis) for axis in whole.axis_info[2:]]
    if not parts:
        return flat, None
    name, axis = parts[0]
    if axis.direction.lower() != "up":
        raise ValueError(f"crs: expected heights that count upwards, given {axis.direction} ({whole.name})")
    ellipsoidal = name is None or "ellipsoid" in name.lower()
    said = f"the ellipsoid {flat.ellipsoid.name}" if ellipsoidal and flat.ellipsoid else str(name)
    return flat, _Heights(said, float(axis.unit_conversion_factor or 1.0), ellipsoidal)


def _kind(flat: Any, text: str) -> Kind:
    if flat.is_projected:
        return "projected"
    if flat.is_geographic:
        return "geographic"
    if flat.is_engineering:
        return "local"
    raise ValueError(f"crs: expected a projected or a geographic system, given {_short(text)} ({flat.type_name})")


def _name(text: str, whole: Any, flat: Any) -> str:
    """As `ReferenceSystem.name`."""
    if one := _ONE_CODE.fullmatch(text.strip()):
        return f"EPSG:{one[1]}"
    code = flat.to_epsg()
    if code and _same(flat, code):
        return f"EPSG:{code}"
    # The text itself, where it is of this system alone: what pyproj writes of a faulty one may be another.
    return str(flat.to_wkt()) if whole.sub_crs_list or whole.is_bound else text.strip()


def _same(flat: Any, code: int) -> bool:
    """Whether a system is that of a code that it claims: its unit, and the middle of its area to half a metre."""
    import pyproj

    claimed = pyproj.CRS.from_epsg(code)
    if claimed.axis_info[0].unit_conversion_factor != flat.axis_info[0].unit_conversion_factor:
        return False
    if claimed.equals(flat, ignore_axis_order=True):
        return True
    area = claimed.area_of_use
    if area is None or flat.is_geographic:
        return False
    middle = 0.5 * (area.west + area.east), 0.5 * (area.south + area.north)
    x, y = (pyproj.Transformer.from_crs("EPSG:4326", c, always_xy=True).transform(*middle) for c in (flat, claimed))
    return bool(np.abs(np.subtract(x, y)).max() <= _CLOSE)


def _short(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:60] + " …")


@functools.lru_cache(maxsize=64)
def _to_degrees(name: str) -> Any:
    """Coordinates of a system to longitudes and latitudes."""
    import pyproj

    return pyproj.Transformer.from_crs(name, "EPSG:4326", always_xy=True)


@functools.lru_cache(maxsize=64)
def _to_geoid(solid: str, geoid: str) -> Any:
    """Coordinates with heights above an ellipsoid to heights above a geoid; raises where PROJ lacks its grid."""
    import pyproj

    return pyproj.Transformer.from_crs(solid, geoid, always_xy=True, allow_ballpark=False)


@functools.cache
def _geod() -> Any:
    import pyproj

    return pyproj.Geod(ellps="WGS84")
