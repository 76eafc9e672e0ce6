"""The gate of units, datum and axes, which every reader passes before a voxel is made: metres, or a sentence.

    x, y = unit · (x, y) of the file              a plane that is true to scale
    x, y = east, north of the middle              longitudes and latitudes, and planes whose metre is none (`degrees`)
    z    = vertical unit · z of the file

A user's word counts more than the file's, and what a file states apart (a key of its unit) more than what its system
implies; whatever is not the plain case is said in a remark. A projection is taken for a plane in metres where it is
true to scale within half a percent: national grids and UTM are, Web Mercator at 60° north shows a metre as two.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64

from maxjax.core.files import FileError
from maxjax.io.geo.earth import project
from maxjax.io.geo.reference_system import ReferenceSystem, reference_system, unit_in_words, unit_of
from maxjax.io.geo.vertical_zero import UNSTATED, VerticalZero
from maxjax.io.reading import Reading

_TRUE = 0.005  # a plane's scale may be so far from 1
_WIDEST = 1.001  # [degrees], a tile of SRTM; some 100 km, where a plane is off by hundreds of metres already
_NORTHERNMOST = 85.0  # [degrees]; farther on, a degree of longitude is hardly a length
_BESIDE = 1.0  # [degrees] outside of the area of a system

Places = Float64[np.ndarray, "n 2"]


@dataclasses.dataclass(frozen=True)
class Stated:
    """Statements of a file about its coordinates.

    Attributes:
        system: name of a reference system, as `reference_system` reads it; None or empty: none.
        unit: metres of a unit along the plane, stated apart from the system; None: the system's.
        vertical_unit: likewise of heights.
        heights: what heights are where no unit of them is stated: like the `plane`, always `metres`, or `asked` for
            where the plane is in other units.
    """

    system: str | None = None
    unit: float | None = None
    vertical_unit: float | None = None
    heights: Literal["plane", "metres", "asked"] = "plane"


METRES = Stated(unit=1.0)  # of formats that are so by definition


@dataclasses.dataclass(frozen=True)
class Reference:
    """How a file's coordinates become those of the map.

    Attributes:
        crs: name of the reference system, as EPSG:28992; None where none is known, or it lies nowhere on Earth.
        origin: longitude and latitude [degrees] of the map's (0, 0); None where coordinates are the system's own.
        unit, vertical_unit: metres of a unit of the file.
        remarks: sentences on what a user should know.
        system: None where none is known.
        zero: what heights count from.
    """

    crs: str | None = None
    origin: tuple[float, float] | None = None
    unit: float = 1.0
    vertical_unit: float = 1.0
    remarks: tuple[str, ...] = ()
    system: ReferenceSystem | None = None
    zero: VerticalZero = UNSTATED

    def plane(self, places: Places) -> Places:
        """Places of the file as metres east and north."""
        if self.origin is None or self.system is None:
            return np.asarray(places * self.unit if self.unit != 1.0 else places, np.float64)
        degrees = self.system.geodetic(places * (self.unit / self.system.unit))
        degrees[:, 0] -= 360.0 * np.round((degrees[:, 0] - self.origin[0]) / 360.0)
        return project(degrees, np.array(self.origin))

    def metres(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Points of the file in metres."""
        if self.origin is None and self.unit == self.vertical_unit == 1.0:
            return points
        return np.column_stack([self.plane(points[:, :2]), points[:, 2] * self.vertical_unit])


UNREFERENCED = Reference()


def reference(stated: Stated, reading: Reading, extent: Float64[np.ndarray, "2 2"], path: Path) -> Reference:
    """How the coordinates of a file become metres.

    Args:
        stated: by the file.
        reading: what the user says in its place.
        extent: lowest and highest x and y in the file.
        path: for messages.

    Raises:
        FileError: if the file names a system that is none, or coordinates that do not lie in it; if heights are in
            units that nothing states; if it is wider than a degree where it is no plane in metres.
        ValueError: if the user names a system that is none.
    """
    system, remarks = _system(stated, reading, path)
    own = 1.0 if system is None else system.unit
    unit = unit_of(reading.unit) if reading.unit else stated.unit or own
    if system is not None and system.kind == "geographic":
        if reading.unit:
            raise FileError(f"{path}: --unit: its coordinates are degrees ({system.title}); leave it out")
        unit = 1.0
    vertical = _vertical(stated, reading, system, unit, path)
    if unit != 1.0:
        remarks.append(f"coordinates are in {unit_in_words(unit)}, and are read as metres")
    if system is not None and system.kind != "geographic" and abs(unit / own - 1.0) > 1e-9:
        remarks.append(
            f"the unit that is stated, {unit_in_words(unit)}, is not that of {_title(system)}, {unit_in_words(own)}; "
            "what is stated is taken"
        )
    if vertical != 1.0:
        known = reading.vertical_unit or stated.vertical_unit or (system is not None and system.vertical_unit)
        guess = "" if known else ", as no unit of them is named; --vertical-unit names another"
        remarks.append(f"heights are in {unit_in_words(vertical)}{guess}, and are read as metres")
    elif stated.heights == "metres" and unit != 1.0 and not reading.vertical_unit:
        remarks.append(
            f"heights are read as metres, although its plane is in {unit_in_words(unit)}; --vertical-unit names another"
        )
    if system is None or system.kind == "local":
        return Reference(None, None, unit, vertical, tuple(remarks), system)
    middle = extent.mean(axis=0) * (unit / system.unit)
    remarks += _located(system, middle, path)
    zero = system.zero(middle)
    places = [middle, *(extent * (unit / system.unit))]
    scales = [np.inf] if system.kind == "geographic" else [system.scale(place) for place in places]
    scale = max(scales, key=lambda k: abs(k - 1.0))
    if all(abs(k - 1.0) <= _TRUE for k in scales):
        return Reference(system.name, None, unit, vertical, tuple(remarks), system, zero)
    origin = _origin(system, extent * (unit / system.unit), path)
    if system.kind == "projected":
        remarks.append(
            f"a metre of {_title(system)} is {1.0 / scale:.3g} m here; the map is in true metres about longitude "
            f"{origin[0]:.6f}, latitude {origin[1]:.6f}"
        )
    return Reference(system.name, origin, unit, vertical, tuple(remarks), system, zero)


def on_its_axes(how: Reference, path: Path) -> Reference:
    """The same, of a file whose cells lie along its axes: raises a `FileError` where these are none of the map."""
    if how.origin is not None:
        raise FileError(f"{path}: expected a plane in metres for cells, found {how.crs}; bring it into another system")
    return how


def cube_of_metres(how: Reference, path: Path) -> None:
    """Raise a `FileError` where voxels, which are cubes, would become none."""
    if how.unit != how.vertical_unit:
        raise FileError(
            f"{path}: expected one unit for all edges of a voxel, given {unit_in_words(how.unit)} and, upwards, "
            f"{unit_in_words(how.vertical_unit)}; leave --vertical-unit out"
        )


def _system(stated: Stated, reading: Reading, path: Path) -> tuple[ReferenceSystem | None, list[str]]:
    """The system that counts, and a remark where it is not the file's."""
    text = (stated.system or "").strip("\0 \n\t")
    if reading.crs is not None:
        given = reference_system(reading.crs)
        try:
            other = text and reference_system(text).name != given.name
        except ValueError:
            other = True
        return given, [f"the file names another reference system than {given.name}, which is taken"] if other else []
    if not text:
        return None, []
    try:
        return reference_system(text), []
    except ValueError as error:
        raise FileError(f"{path}: {error}; --crs CODE names another") from error


def _vertical(stated: Stated, reading: Reading, system: ReferenceSystem | None, unit: float, path: Path) -> float:
    """Metres of a unit of heights."""
    if reading.vertical_unit:
        return unit_of(reading.vertical_unit)
    known = stated.vertical_unit or (None if system is None else system.vertical_unit)
    if known:
        return known
    if stated.heights == "asked" and unit != 1.0:
        raise FileError(
            f"{path}: its plane is in {unit_in_words(unit)}, and no unit of its heights is stated; "
            "--vertical-unit ft, us-ft or m names it"
        )
    return unit if stated.heights == "plane" else 1.0


def _located(system: ReferenceSystem, middle: Float64[np.ndarray, " 2"], path: Path) -> list[str]:
    """Find out whether a place lies in its system; a remark where it is not meant for it."""
    here, there = system.geodetic(np.stack([middle, middle[::-1]]))
    given = f"{middle[0]:g}, {middle[1]:g}"
    swapped = _within(there, system) and not _within(here, system)
    if swapped or not np.isfinite(here).all():
        why = "its axes are swapped" if swapped else "wrong system, or axes swapped?"
        raise FileError(f"{path}: expected coordinates of {_title(system)}, found {given} in the middle; {why}")
    if not _within(here, system):
        return [f"it lies outside of the area of {_title(system)}, at longitude {here[0]:.3f}, latitude {here[1]:.3f}"]
    return []


def _within(degrees: Float64[np.ndarray, " 2"], system: ReferenceSystem) -> bool:
    """Whether a place lies in the area of a system, or near it."""
    if not np.isfinite(degrees).all() or not (np.abs(degrees) <= (540.0, 90.0)).all():
        return False
    if system.area is None:
        return True
    west, south, east, north = system.area
    around = (degrees[0] - west + _BESIDE) % 360.0
    return bool(around <= (east - west) % 360.0 + 2 * _BESIDE or east - west >= 360.0) and bool(
        south - _BESIDE <= degrees[1] <= north + _BESIDE
    )


def _origin(system: ReferenceSystem, extent: Float64[np.ndarray, "2 2"], path: Path) -> tuple[float, float]:
    """Longitude and latitude of the middle, of what is narrow enough for a plane."""
    corners = system.geodetic(np.array([extent[0], extent[1], extent.mean(axis=0)]))
    corners[:, 0] -= 360.0 * np.round((corners[:, 0] - corners[2, 0]) / 360.0)
    wide = np.ptp(corners, axis=0).max()
    if not (wide <= _WIDEST and np.abs(corners[:, 1]).max() <= _NORTHERNMOST):
        low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        raise FileError(
            f"{path}: expected coordinates within {_WIDEST:.3g} degree of each other and {_NORTHERNMOST:g} degrees of "
            f"the equator ({_title(system)}), found longitudes and latitudes from {low} to {high}; crop it"
        )
    longitude, latitude = corners[2].tolist()
    return longitude, latitude


def _title(system: ReferenceSystem) -> str:
    return f"{system.name} ({system.title})" if system.name.startswith("EPSG:") else system.title
