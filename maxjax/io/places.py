"""Points given as latitude and longitude or x and y, and a height, in a map.

map         x, y, z of the map [m]
local-agl   x, y of the map, height above the ground beneath [m]
agl         latitude, longitude [degrees], height above the ground beneath [m]
home        latitude, longitude [degrees], height above the ground beneath the first of several places [m]
amsl        latitude, longitude [degrees], height above sea level [m], of a map whose zero is known
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from maxjax.core.grid import Point3
from maxjax.core.terrain import Terrain
from maxjax.io.geo.earth import Earth, on_own_zero

# What a point's three numbers are.
Frame = Literal["map", "local-agl", "agl", "home", "amsl"]

_FARTHEST = 1000.0  # from what the map holds [m]
_ROUNDS = 2  # the place that lies below a point moves with its height, by 2 cm for 100 m and 1 km


def points_at(
    places: Sequence[Point3], frame: Frame, earth: Earth | None, terrain: Terrain | None = None
) -> list[Point3]:
    """Points of the map [m], the first of them above home; as `point_at`."""
    if frame != "home" or not places or earth is None:
        return [point_at(place, frame, earth, terrain) for place in places]
    first = point_at(places[0], "agl", earth, terrain)
    earth = on_own_zero(earth)
    level = float(earth.geodetic(np.array([first]))[0, 2]) - places[0][2]
    return [first, *(point_at((n, e, level + up), "amsl", earth) for n, e, up in places[1:])]


def point_at(place: Point3, frame: Frame, earth: Earth | None, terrain: Terrain | None = None) -> Point3:
    """A point of the map [m].

    Args:
        place: three numbers, as `frame` says.
        frame: what they are.
        earth: where the map lies, for latitudes.
        terrain: of the map, for heights above ground.

    Raises:
        ValueError: for a place that is none, heights above ground where the map has none beneath, or heights above sea
            level where the map's zero is not known.
    """
    if frame == "map":
        return place
    latitude, longitude, height = place
    if not all(map(math.isfinite, place)):
        named = "x, y" if frame == "local-agl" else "latitude, longitude"
        raise ValueError(f"place: expected {named} and height as finite numbers, given {place}")
    if frame != "amsl" and terrain is None:
        raise ValueError(f"{frame}: expected the ground of the map")
    if frame == "local-agl" and terrain is not None:
        x, y, _z = place
        return x, y, _ground_at(terrain, x, y, f"{frame}: expected a place above the map's ground, given") + height
    if earth is None:
        raise ValueError(f"{frame}: expected a map that lies somewhere on Earth; give x and y, and heights local-agl")
    if frame == "amsl" or terrain is None:
        earth.zero.height("amsl")
        return _local(earth, place)
    earth = on_own_zero(earth)
    level = earth.zero.number
    for _ in range(_ROUNDS):
        x, y, _z = _local(earth, (latitude, longitude, level))
        given = f"agl: expected a place above the map's ground, given latitude {latitude:g}, longitude {longitude:g},"
        z = _ground_at(terrain, x, y, given) + height
        level = float(earth.geodetic(np.array([[x, y, z]]))[0, 2])
    return x, y, z


def numbers_of_point(
    point: Point3, frame: Frame, earth: Earth | None, terrain: Terrain | None = None, start: Point3 | None = None
) -> Point3:
    """The three numbers of a point of the map in a frame: the inverse of `point_at`.

    Args:
        point: of the map [m].
        frame: what the numbers are.
        earth: where the map lies, for latitudes.
        terrain: of the map, for heights above ground.
        start: the first of several points [m], above the ground beneath which those of the frame home are.

    Raises:
        ValueError: where the frame needs a place on Earth, a ground or a zero that the map does not have.
    """
    x, y, z = point
    if frame == "map":
        return point
    if frame == "local-agl":
        if terrain is None:
            raise ValueError(f"{frame}: expected the ground of the map")
        return x, y, z - _ground_at(terrain, x, y, f"{frame}: expected a place above the map's ground, given one")
    if earth is None:
        raise ValueError(f"{frame}: expected a map that lies somewhere on Earth; give x and y, and heights local-agl")
    if frame == "amsl":
        earth.zero.height("amsl")
        north, east, up = earth.geodetic(np.array([point]))[0].tolist()
        return north, east, up
    earth = on_own_zero(earth)
    if terrain is None:
        raise ValueError(f"{frame}: expected the ground of the map")
    north, east, up = earth.geodetic(np.array([point]))[0].tolist()
    below = point if frame == "agl" or start is None else start
    ground = _ground_at(terrain, below[0], below[1], f"{frame}: expected a place above the map's ground, given one")
    if frame == "agl":
        return north, east, z - ground
    home = float(earth.geodetic(np.array([[below[0], below[1], ground]]))[0, 2])
    return north, east, up - home


def _ground_at(terrain: Terrain, x: float, y: float, given: str) -> float:
    """Height of the ground [m]; raises a `ValueError` where there is none."""
    height = terrain.at(x, y)
    if math.isnan(height):
        raise ValueError(
            f"{given} where it has none (x {x:.1f}, y {y:.1f}); give the ground's height (--ground Z), or heights amsl"
        )
    return height


def check_in_map(place: Point3, frame: Frame, earth: Earth | None, extent: Float[np.ndarray, "2 3"]) -> Point3:
    """Where a place lies in a map, at its lowest [m].

    Args:
        place: three numbers, as `frame` says.
        frame: what they are.
        earth: where the map lies, for latitudes.
        extent: lowest and highest corner of what the map holds [m].

    Raises:
        ValueError: for a place that is none, or more than 1 km outside of the map.
    """
    if frame == "local-agl" or earth is None:
        x, y, _ = point_at((place[0], place[1], float(extent[0, 2])), "map" if frame == "local-agl" else frame, earth)
    else:
        near = on_own_zero(earth)
        x, y, _ = point_at((place[0], place[1], near.zero.number), "amsl", near)
    if (np.maximum(extent[0, :2] - (x, y), np.subtract((x, y), extent[1, :2])) <= _FARTHEST).all():
        return x, y, float(extent[0, 2])
    if frame == "local-agl" or earth is None:
        (west, south, _), (east, north, _) = extent.tolist()
        raise ValueError(
            f"place: expected one in the map, x {west:.1f} to {east:.1f} and y {south:.1f} to {north:.1f}, "
            f"given {x:.1f}, {y:.1f}"
        )
    corners = earth.geodetic(np.array([[x, y, extent[0, 2]] for x in extent[:, 0] for y in extent[:, 1]]))
    (south, west), (north, east) = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    swapped = south <= place[1] <= north and west <= place[0] <= east
    raise ValueError(
        f"place: expected one in the map, latitude {south:.4f} to {north:.4f} and longitude {west:.4f} to {east:.4f}, "
        f"given {place[0]:g}, {place[1]:g}" + ("; these are swapped" if swapped else "")
    )


def _local(earth: Earth, place: Point3) -> Point3:
    x, y, z = earth.local(np.array([place], np.float64))[0].tolist()
    return x, y, z
