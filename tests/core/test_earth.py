"""Places on Earth, beside pyproj."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest

from maxjax.io.geo.earth import Degrees, Projected, TangentPlane, project
from maxjax.io.geo.vertical_zero import VerticalZero

PLACES = [(52.07, 4.3, 10.0), (0.0, 0.0, 0.0), (-33.9, 151.2, 80.0), (89.9, -120.0, 0.0), (45.4, -179.9999, 2000.0)]


def points(count: int = 200) -> np.ndarray:
    """Of a map up to 20 km wide."""
    return np.random.default_rng(0).uniform([-1e4, -1e4, -100.0], [1e4, 1e4, 500.0], (count, 3))


def metres_apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Largest difference of latitudes, longitudes [degrees] and heights, all in metres."""
    gap = one - other
    gap[:, 1] = (gap[:, 1] + 180.0) % 360.0 - 180.0
    scale = np.column_stack([np.full(len(one), 111e3), 111e3 * np.cos(np.radians(one[:, 0])), np.ones(len(one))])
    return np.abs(gap * scale).max(axis=1)


@pytest.mark.parametrize("place", PLACES)
def test_a_tangent_plane_is_that_of_pyproj(place: tuple[float, float, float]) -> None:
    latitude, longitude, height = place
    to_east_north_up = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude} +lon_0={longitude} +h_0={height}"
    )
    given = points()
    longitudes, latitudes, heights = to_east_north_up.transform(*given.T, direction="INVERSE")
    theirs = np.column_stack([latitudes, longitudes, heights])
    assert metres_apart(TangentPlane(*place).geodetic(given), theirs).max() < 1e-5


@pytest.mark.parametrize("place", PLACES)
def test_there_and_back(place: tuple[float, float, float]) -> None:
    plane, given = TangentPlane(*place), points()
    np.testing.assert_allclose(plane.local(plane.geodetic(given)), given, atol=1e-6)
    np.testing.assert_allclose(plane.geodetic(np.zeros((1, 3)))[0], place, atol=1e-9)


def test_a_projected_map_is_that_of_pyproj() -> None:
    given = np.array([[84888.0, 447501.0, 6.0], [155000.0, 463000.0, 0.0]])
    found = Projected("EPSG:28992", VerticalZero(2.0)).geodetic(given)
    to_map = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:28992")
    np.testing.assert_allclose(np.column_stack(to_map.transform(*found[:, :2].T)), given[:, :2], atol=1e-3)
    np.testing.assert_array_equal(found[:, 2], given[:, 2] + 2.0)


def test_a_map_in_degrees_goes_back_to_them() -> None:
    origin, given = np.array([12.33, 45.44]), np.array([[12.3412, 45.4371], [12.3, 45.5]])
    metres = project(given, origin)
    found = Degrees(*origin, VerticalZero(1.0)).geodetic(np.column_stack([metres, [5.0, 6.0]]))
    np.testing.assert_allclose(found, np.column_stack([given[:, ::-1], [6.0, 7.0]]), rtol=0, atol=1e-12)


def test_a_projected_map_is_in_metres_whatever_the_unit_of_its_system() -> None:
    foot = 1200 / 3937
    there = Projected("EPSG:2263", VerticalZero(0.0)).geodetic(np.array([[988_000.0 * foot, 198_000.0 * foot, 5.0]]))
    longitude, latitude = pyproj.Transformer.from_crs("EPSG:2263", "EPSG:4326", always_xy=True).transform(988e3, 198e3)
    np.testing.assert_allclose(there, [[latitude, longitude, 5.0]], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        Projected("EPSG:2263", VerticalZero(0.0)).local(there), [[988e3 * foot, 198e3 * foot, 5.0]], atol=1e-4
    )


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:5703", "EPSG:0", "nonsense"])
def test_systems_that_are_no_plane_are_refused(crs: str) -> None:
    with pytest.raises(ValueError, match="crs: expected"):
        Projected(crs)


@pytest.mark.parametrize("place", [(91.0, 0.0, 0.0), (0.0, 200.0, 0.0), (math.nan, 0.0, 0.0), (0.0, 0.0, math.inf)])
def test_places_that_are_none_are_refused(place: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"(latitude|longitude|height): expected"):
        TangentPlane(*place)


def test_national_coordinates_are_no_metres_about_a_place() -> None:
    with pytest.raises(ValueError, match="are they national ones"):
        TangentPlane(52.0, 4.3).geodetic(np.array([[84888.0, 447501.0, 6.0]]))
