"""Where a map lies on Earth: from its coordinates to latitude and longitude of WGS84, and height above sea level.

`TangentPlane`: the map is ENU about a known place, in closed formulas. With the place's latitude φ and longitude λ,

    (X, Y, Z) = (X₀, Y₀, Z₀) + R(φ, λ) (x, y, z),    X₀ = (N + h) cos φ cos λ, …,    N = a / √(1 − e² sin² φ),

and back by Bowring's formula, tan φ = (Z + e′² b sin³ u) / (p − e² a cos³ u), repeated until it stands still.
`Projected`: the map's coordinates are those of a coordinate reference system. `Degrees`: the map was read
from a file in degrees. Each has `geodetic`, from the map to latitude, longitude and height above sea level, and
`local`, which undoes it. Heights are NaN where the map's `zero` is not known (`io.geo.vertical_zero`).
"""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from maxjax.core.files import FileError
from maxjax.io.geo.reference_system import reference_system
from maxjax.io.geo.vertical_zero import UNSTATED, VerticalZero

_A = 6378137.0  # half axis of the ellipsoid [m]
_F = 1.0 / 298.257223563
_B = _A * (1.0 - _F)
_E2 = _F * (2.0 - _F)
_ROUNDS = 6
# As files of GeoJSON name longitudes and latitudes.
_DEGREES = ("CRS84", "EPSG::4326", "EPSG:4326")
_ASKS = "a height above sea level"
_FARTHEST = 1e5  # from the place [m]; beyond, coordinates are hardly those of a plane there


@dataclasses.dataclass(frozen=True)
class TangentPlane:
    """A map in metres east, north and up of a place.

    Attributes:
        latitude, longitude: of the map's (0, 0, 0) [degrees], WGS84.
        height: of the map's z = 0 above sea level [m]; None where it is not known.

    Raises:
        ValueError: for values outside these meanings.
    """

    latitude: float
    longitude: float
    height: float | None = None

    def __post_init__(self) -> None:
        for name, value, most in (("latitude", self.latitude, 90.0), ("longitude", self.longitude, 180.0)):
            if not -most <= value <= most:
                raise ValueError(f"{name}: expected degrees from {-most:g} to {most:g}, given {value}")
        self.zero  # noqa: B018 (raises)

    @property
    def zero(self) -> VerticalZero:
        """What its heights count from."""
        return VerticalZero(self.height)

    def geodetic(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Latitude, longitude [degrees] and height above sea level [m] of points of the map [m].

        Raises:
            ValueError: for points more than 100 km away.
        """
        if points.size and not np.abs(points).max() <= _FARTHEST:
            raise ValueError(
                f"points: expected a map within {_FARTHEST:g} m of its place on Earth, given coordinates up to "
                f"{np.abs(points).max():g}; are they national ones? Then name their reference system"
            )
        earth = self._centre() + points @ self._axes().T
        p = np.hypot(earth[:, 0], earth[:, 1])
        u = np.arctan2(earth[:, 2] * _A, p * _B)
        for _ in range(_ROUNDS):
            rise = earth[:, 2] + _E2 / (1.0 - _E2) * _B * np.sin(u) ** 3
            latitude = np.arctan2(rise, p - _E2 * _A * np.cos(u) ** 3)
            u = np.arctan2((1.0 - _F) * np.sin(latitude), np.cos(latitude))
        normal = _A / np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
        # Of two forms of the height, one is good at the poles and one at the equator.
        height = p * np.cos(latitude) + earth[:, 2] * np.sin(latitude) - _A**2 / normal
        height = height if self.height is not None else np.full_like(height, np.nan)
        longitude = np.arctan2(earth[:, 1], earth[:, 0])
        return np.column_stack([np.degrees(latitude), np.degrees(longitude), height])

    def local(self, places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Points of the map [m] at some latitudes, longitudes [degrees] and heights above sea level [m].

        Raises:
            ValueError: if a place is not on Earth, or more than 100 km away; where the map's zero is not known.
        """
        self.zero.height(_ASKS)
        found: Float64[np.ndarray, "n 3"] = (_geocentric(_on_earth(places)) - self._centre()) @ self._axes()
        return _near(found, places)

    def _centre(self) -> Float64[np.ndarray, " 3"]:
        centre: Float64[np.ndarray, " 3"] = _geocentric(
            np.array([[self.latitude, self.longitude, self.height or 0.0]])
        )[0]
        return centre

    def _axes(self) -> Float64[np.ndarray, "3 3"]:
        """East, north and up as columns."""
        phi, lam = math.radians(self.latitude), math.radians(self.longitude)
        east = [-math.sin(lam), math.cos(lam), 0.0]
        north = [-math.sin(phi) * math.cos(lam), -math.sin(phi) * math.sin(lam), math.cos(phi)]
        up = [math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)]
        return np.array([east, north, up]).T


@dataclasses.dataclass(frozen=True)
class Projected:
    """A map in the coordinates of a projected reference system, easting first, in metres whatever the system's unit.

    Attributes:
        crs: its name, as `EPSG:28992`.
        zero: what its heights count from; by default sea level where the system has heights above it.
        accuracy: how true its places are on Earth [m]; None: as PROJ knows (`io.geo.accuracy`).

    Raises:
        ValueError: for an accuracy that is no distance, or a system that is none (`reference_system`) or not projected.
    """

    crs: str
    zero: VerticalZero = UNSTATED
    accuracy: float | None = None

    def __post_init__(self) -> None:
        check_accuracy(self.accuracy)
        system = reference_system(self.crs)
        if system.kind != "projected":
            raise ValueError(f"crs: expected a projected system, given {self.crs!r} ({system.title})")
        if self.zero == UNSTATED and system.vertical and not system.solid:
            object.__setattr__(self, "zero", system.zero(np.zeros(2)))

    def geodetic(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Latitude, longitude [degrees] and height above sea level [m] of points of the map [m]."""
        system = reference_system(self.crs)
        longitude, latitude = system.geodetic(points[:, :2] / system.unit).T
        return np.column_stack([latitude, longitude, points[:, 2] + self.zero.number])

    def local(self, places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Points of the map [m] at some latitudes, longitudes [degrees] and heights above sea level [m].

        Raises:
            ValueError: if a place is not on Earth, or the system has no coordinates there; where the map's zero is not
                known.
        """
        latitude, longitude, height = _on_earth(places).T
        system = reference_system(self.crs)
        plane = system.coordinates(np.column_stack([longitude, latitude])) * system.unit
        found = np.column_stack([plane, height - self.zero.height(_ASKS)])
        if not np.isfinite(found).all():
            place = places[~np.isfinite(found).all(axis=1)][0, :2].tolist()
            raise ValueError(f"place: expected one where {self.crs} has coordinates, given {place}; swapped?")
        return found


@dataclasses.dataclass(frozen=True)
class Degrees:
    """A map that was read from a file in degrees, on the plane of `io.geo.degrees`.

    Attributes:
        longitude, latitude: of the map's (0, 0) [degrees], `maxjax.Map.origin`.
        zero: what its heights count from.
        crs: the file's system.
        accuracy: how true its places are on Earth [m]; None: as PROJ knows.

    Raises:
        ValueError: for an accuracy that is no distance.
    """

    longitude: float
    latitude: float
    zero: VerticalZero = UNSTATED
    crs: str = "EPSG:4326"
    accuracy: float | None = None

    def __post_init__(self) -> None:
        check_accuracy(self.accuracy)

    def geodetic(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Latitude, longitude [degrees] and height above sea level [m] of points of the map [m]."""
        longitude, latitude = unproject(points[:, :2], np.array([self.longitude, self.latitude])).T
        longitude = longitude - 360.0 * np.round(longitude / 360.0)
        return np.column_stack([latitude, longitude, points[:, 2] + self.zero.number])

    def local(self, places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Points of the map [m] at some latitudes, longitudes [degrees] and heights above sea level [m].

        Raises:
            ValueError: if a place is not on Earth, or more than 100 km away, where the Earth is not flat; where the
                map's zero is not known.
        """
        latitude, longitude, height = _on_earth(places).T
        longitude = longitude - 360.0 * np.round((longitude - self.longitude) / 360.0)
        east_north = project(np.column_stack([longitude, latitude]), np.array([self.longitude, self.latitude]))
        return _near(np.column_stack([east_north, height - self.zero.height(_ASKS)]), places)


# What tells where a map's points lie.
Earth = TangentPlane | Projected | Degrees


def earth_of(
    crs: str | None, origin: tuple[float, float] | None, zero: VerticalZero, accuracy: float | None = None
) -> Earth | None:
    """Where a map lies by its reference system, or the longitude and latitude of its (0, 0); None: unknown."""
    if crs is None:
        return None
    return Projected(crs, zero, accuracy) if origin is None else Degrees(*origin, zero, crs, accuracy)


def check_accuracy(metres: float | None) -> None:
    """Raise a ValueError for an accuracy that is no distance [m]."""
    if metres is not None and not 0.0 <= metres < math.inf:
        raise ValueError(f"accuracy: expected a distance of at least 0 m, given {metres}")


def on_own_zero(earth: Earth) -> Earth:
    """The same, its heights counted from its own z = 0 where sea level is not known: for whoever uses differences."""
    if earth.zero.above_sea is not None:
        return earth
    if isinstance(earth, TangentPlane):
        return dataclasses.replace(earth, height=0.0)
    return dataclasses.replace(earth, zero=dataclasses.replace(earth.zero, above_sea=0.0))


def _on_earth(places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """The places themselves; raises a ValueError for a latitude, a longitude or a height that is none."""
    for column, (name, most) in enumerate((("latitude", 90.0), ("longitude", 180.0))):
        off = ~(np.abs(places[:, column]) <= most)
        if off.any():
            swapped = "; latitude comes first: swapped?" if name == "latitude" else ""
            value = places[off][0, column]
            raise ValueError(f"{name}: expected degrees from {-most:g} to {most:g}, given {value:g}{swapped}")
    if not (np.abs(places[:, 2]) <= _FARTHEST).all():
        raise ValueError(f"height: expected metres, at most {_FARTHEST:g}, given {places[:, 2].tolist()}")
    return places


def _near(found: Float64[np.ndarray, "n 3"], places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Points of a map [m]; raises a ValueError where one is too far away for a plane."""
    far = ~(np.abs(found) <= _FARTHEST).all(axis=1)
    if far.any():
        raise ValueError(
            f"place: expected one within {_FARTHEST / 1000:g} km of the map, given latitude and longitude "
            f"{places[far][0, :2].tolist()}; swapped?"
        )
    return found


def _geocentric(places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """X to longitude 0, Z to the north pole [m], of latitudes, longitudes and heights."""
    phi, lam, height = np.radians(places[:, 0]), np.radians(places[:, 1]), places[:, 2]
    normal = _A / np.sqrt(1.0 - _E2 * np.sin(phi) ** 2)
    across = (normal + height) * np.cos(phi)
    return np.column_stack([across * np.cos(lam), across * np.sin(lam), (normal * (1.0 - _E2) + height) * np.sin(phi)])


def project(degrees: Float[np.ndarray, "n 2"], origin: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
    """Longitude and latitude [degrees] to east and north of the origin [m]."""
    latitude = math.radians(origin[1])
    root = math.sqrt(1.0 - _E2 * math.sin(latitude) ** 2)
    across, along = _A / root, _A * (1.0 - _E2) / root**3
    metres: np.ndarray = np.radians(degrees - origin) * np.array([across * math.cos(latitude), along])
    return metres


def unproject(metres: Float[np.ndarray, "n 2"], origin: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
    """Longitude and latitude [degrees] of points east and north of the origin [m]: what `project` undoes."""
    metres_a_degree = project(origin[None] + 1.0, origin)
    degrees: np.ndarray = origin + metres / metres_a_degree
    return degrees


def geojson_system(document: dict[str, Any]) -> str | None:
    """The name of the reference system of a GeoJSON file's coordinates; None for longitudes and latitudes."""
    named = str(document["crs"]["properties"]["name"]) if document.get("crs") else ""
    return None if not named or named.endswith(_DEGREES) else named


def geojson_crs(document: dict[str, Any], path: Path) -> str | None:
    """The reference system of a GeoJSON file's coordinates, as EPSG:28992; None for longitudes and latitudes.

    Raises:
        FileError: for one that is neither.
    """
    named = geojson_system(document)
    if named is None:
        return None
    code = re.search(r"EPSG:+(\d+)$", named)
    if code is None:
        raise FileError(f"{path}: expected a crs CRS84 or EPSG, found {named!r}")
    return f"EPSG:{code[1]}"
