"""Where a page is first looked at from: the side from which most of a way is seen, as low as that allows.

Towers beside a street hide what flies in it from most sides; from above they hide nothing. What still hides a way, or
comes to hide it when the camera is turned, is drawn see-through: whole buildings, whose columns touch each other. On a
telephone the panel is a sheet over the lower part of the window, and the way is seen above it.
"""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Bool, Float, Int64

from maxjax.core.grid import Point3
from maxjax.ui.page.nodes import point3
from maxjax.ui.page.page_map import City

# Turns from the south-south-west, where the sun is, and heights above the horizon [degrees]; the first are preferred.
_SOUTH_WEST, _TURNS = 237.7, (0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0)
_HEIGHTS = (50.0, 65.0, 80.0)
# What a further turn or height must show more of a way to be taken.
_TURN_WORTH, _HEIGHT_WORTH = 0.01, 0.1
_DISTANCE = 1.1  # of the camera, in widths of what is looked at
_LEAST, _WIDTHS = 60.0, 1.1  # width of what is looked at: at least [m], and in extents of the way
_MOST_POINTS = 64
NARROW = 576  # below this width of the window viser's panel is a sheet [px]
SHEET = 0.36  # the sheet's greatest share of the window's height
_BORDER = 0.15  # of the room above the sheet that stays free on each side, as a share of half the window


def over_map(city: City) -> tuple[Point3, Point3]:
    """Position and point looked at, in the page's frame [m], for a whole map."""
    wide, low = city.grid.spacing * max(city.grid.shape[:2]), city.floor - city.grid.lower[2]
    middle = np.array([0.04 * wide, -0.03 * wide, low])
    return point3(middle + _DISTANCE * wide * _direction(0.0, _HEIGHTS[0])), point3(middle)


def over_way(city: City, points: Float[np.ndarray, "n 3"]) -> tuple[Point3, Point3]:
    """Position and point looked at, in the page's frame [m], for a way.

    Args:
        city: the map.
        points: of the way, in the page's frame [m].
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    wide = city.grid.spacing * max(city.grid.shape[:2])
    away = _DISTANCE * min(wide, max(_LEAST, _WIDTHS * float(np.ptp(points, axis=0).max())))
    some = points[:: max(1, len(points) // _MOST_POINTS)]
    places, costs = [], []
    for higher, height in enumerate(_HEIGHTS):
        for further, turn in enumerate(_TURNS):
            place = middle + away * _direction(turn, height)
            places.append(place)
            costs.append(1.0 - seen(city, place, some) + _HEIGHT_WORTH * higher + _TURN_WORTH * further)
    return point3(places[int(np.argmin(costs))]), point3(middle)


def above_sheet(
    eye: Point3, target: Point3, points: Float[np.ndarray, "n 3"], view: tuple[float, float]
) -> tuple[Point3, Point3]:
    """Position and point looked at in the same direction, as near as lets all of a way be seen above a sheet.

    Args:
        eye: position of the camera, in the page's frame [m].
        target: what it looks at [m].
        points: of the way [m].
        view: height of what the camera sees, at the distance 1; its width.
    """
    back = np.array(eye) - np.array(target)
    near = float(np.linalg.norm(back))
    back /= near
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    x, y, depth = ((points - np.array(target)) @ axis for axis in (right, up, back))
    half_high, half_wide = 0.5 * view[0], 0.5 * view[1]
    low, high, side = 2.0 * SHEET - 1.0 + _BORDER, 1.0 - _BORDER, 1.0 - _BORDER
    # The camera moves aside by (a, b): a point is seen where |x - a| <= side k half_wide, and so on, k its distance.
    for away in np.geomspace(0.1 * near, 20.0 * near, 200):
        k = away - depth
        least_b, most_b = np.max(y - high * k * half_high), np.min(y - low * k * half_high)
        least_a, most_a = np.max(x - side * k * half_wide), np.min(x + side * k * half_wide)
        if k.min() > 0.0 and least_a <= most_a and least_b <= most_b:
            break
    aim = np.array(target) + 0.5 * (least_a + most_a) * right + 0.5 * (least_b + most_b) * up
    return point3(aim + away * back), point3(aim)


def seen(city: City, position: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"]) -> float:
    """Share of the points, in the page's frame [m], that no occupied voxel hides from a position."""
    solid, _ = _crossed(city, position, points)
    return float(1.0 - solid.any(axis=0).mean())


def hiding(city: City, position: Point3, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "nx ny"]:
    """Columns of all buildings that stand between a position and points, in the page's frame [m]."""
    some = points[:: max(1, len(points) // _MOST_POINTS)]
    solid, index = _crossed(city, np.asarray(position, np.float64), some)
    i, j, k = index[solid].T
    number, ground = _buildings(city), city.ground[i, j, k]
    between = np.unique(number[i[~ground], j[~ground]])
    columns: Bool[np.ndarray, "nx ny"] = np.isin(number, between[between > 0])
    return columns


@functools.lru_cache(maxsize=4)
def _buildings(city: City) -> Int64[np.ndarray, "nx ny"]:
    """The number of the building in each column, from 1; 0: none."""
    from scipy.ndimage import label

    number: Int64[np.ndarray, "nx ny"] = np.asarray(label((city.occupied & ~city.ground).any(axis=2))[0], np.int64)
    return number


def _crossed(
    city: City, position: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"]
) -> tuple[Bool[np.ndarray, "s n"], Int64[np.ndarray, "s n 3"]]:
    """Whether steps from a position to points, in the page's frame [m], are in occupied voxels, and in which."""
    grid = city.grid
    steps = int(np.ceil(2.0 * np.linalg.norm(points - position, axis=1).max() / grid.spacing)) + 1
    along = np.linspace(0.0, 1.0, steps)[:, None, None]
    rays = position + along * (points - position) + city.frame.anchor
    index = np.floor((rays - np.array(grid.lower)) / grid.spacing).astype(np.int64)
    inside = ((index >= 0) & (index < np.array(grid.shape))).all(axis=2)
    solid = np.zeros(inside.shape, bool)
    solid[inside] = city.occupied[tuple(index[inside].T)]
    return solid, index


def _direction(turn: float, height: float) -> Float[np.ndarray, "3"]:
    """From what is looked at to the camera."""
    around, above = np.radians([_SOUTH_WEST + turn, height])
    return np.array([np.cos(around) * np.cos(above), np.sin(around) * np.cos(above), np.sin(above)])
