"""Points given as latitude, longitude and height, in maps."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.core.terrain import Terrain
from maxjax.io import Window, map_of, read_map
from maxjax.io.geo.earth import Degrees, Earth, Projected, TangentPlane
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.io.load import map_with
from maxjax.io.places import Frame, check_in_map, numbers_of_point, point_at, points_at

SAMPLE = Path(__file__).parents[2] / "docs" / "samples" / "quarter.geojson"
PLANE = TangentPlane(52.0, 4.3, 7.0)
SEVEN = VerticalZero(7.0)


def earths() -> list[Earth]:
    return [
        PLANE,
        Degrees(8.0, 47.0, SEVEN),
        Degrees(179.999, -17.0, VerticalZero(0.0)),
        Projected("EPSG:32632", SEVEN),
    ]


def test_local_undoes_geodetic() -> None:
    rng = np.random.default_rng(0)
    for earth in earths():
        middle = [5e5, 5e6, 0.0] if isinstance(earth, Projected) else [0.0, 0.0, 0.0]
        points = middle + rng.uniform([-3e3, -3e3, -50.0], [3e3, 3e3, 300.0], (50, 3))
        np.testing.assert_allclose(earth.local(earth.geodetic(points)), points, rtol=0, atol=2e-5)


def test_projected_places_are_those_of_pyproj() -> None:
    places = np.array([[52.1044, 4.2726, 20.0], [52.0, 4.4, 0.0]])
    theirs = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:28992").transform(*places[:, :2].T)
    found = Projected("EPSG:28992", VerticalZero(2.0)).local(places)
    np.testing.assert_allclose(found, np.column_stack([*theirs, places[:, 2] - 2.0]), rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ((91.0, 4.3, 5.0), "latitude: expected degrees from -90 to 90, given 91; latitude comes first: swapped"),
        ((52.0, 181.0, 5.0), "longitude: expected degrees from -180 to 180, given 181"),
        ((math.nan, 4.3, 5.0), "latitude"),
        ((52.0, 4.3, math.inf), "height: expected metres"),
    ],
)
def test_places_that_are_not_on_earth_are_refused(place: tuple[float, float, float], sentence: str) -> None:
    for earth in earths():
        with pytest.raises(ValueError, match=sentence):
            earth.local(np.array([place]))


def test_places_far_from_a_plane_are_refused() -> None:
    for earth in earths()[:3]:
        for place in ((4.3, 52.0, 5.0), (53.5, 4.3, 5.0), (-52.0, -175.7, 5.0)):
            with pytest.raises(ValueError, match="within 100 km of the map"):
                earth.local(np.array([place]))


def slope(grid: maxjax.Grid) -> np.ndarray:
    """Ground that rises to the east by a voxel a column; none in the first two columns."""
    top = np.arange(grid.shape[0])[:, None, None]
    ground: np.ndarray = np.broadcast_to(np.arange(grid.shape[2]) < top - 1, grid.shape)
    return ground


GRID = maxjax.Grid((12, 10, 14), 2.0, (-11.0, -9.0, 1.0))


def test_heights_above_ground_are_counted_from_the_column_beneath() -> None:
    terrain = Terrain.of(slope(GRID), GRID)
    for x, ground in ((-7.9, 2.0), (-5.0, 4.0), (0.0, 10.0), (1.9, 10.0), (2.1, 12.0), (11.9, 20.0)):
        latitude, longitude, _ = PLANE.geodetic(np.array([[x, 3.0, 0.0]]))[0].tolist()
        found = point_at((latitude, longitude, 6.0), "agl", PLANE, terrain)
        np.testing.assert_allclose(found, (x, 3.0, ground + 6.0), rtol=0, atol=1e-4)
    for x in (-8.1, -11.0, 12.1, -40.0):
        latitude, longitude, _ = PLANE.geodetic(np.array([[x, 3.0, 0.0]]))[0].tolist()
        with pytest.raises(ValueError, match="where it has none"):
            point_at((latitude, longitude, 6.0), "agl", PLANE, terrain)


def test_far_from_the_place_a_height_is_still_above_the_ground_there() -> None:
    """The vertical of a place 50 km away leans by half a degree: what is above what is asked in the map."""
    grid = maxjax.Grid((10, 10, 4), 2.0, (50_000.0, 0.0, 1.0))
    terrain = Terrain.of(np.ones(grid.shape, bool), grid)
    latitude, longitude, _ = PLANE.geodetic(np.array([[50_009.0, 9.0, 108.0]]))[0].tolist()
    np.testing.assert_allclose(
        point_at((latitude, longitude, 100.0), "agl", PLANE, terrain), (50_009, 9, 108), atol=1e-3
    )


def test_heights_above_sea_level_are_those_of_the_map() -> None:
    for earth in earths():
        middle = [5e5, 5e6, 0.0] if isinstance(earth, Projected) else [0.0, 0.0, 0.0]
        point = np.array(middle) + np.array([30.0, -20.0, 12.0])
        latitude, longitude, height = earth.geodetic(point[None])[0].tolist()
        assert height == pytest.approx(12.0 + earth.zero.number, abs=1e-3)
        np.testing.assert_allclose(point_at((latitude, longitude, height), "amsl", earth), point, atol=1e-4)


def test_places_outside_a_map_are_refused_and_swapped_ones_named() -> None:
    extent = np.array([[-100.0, -100.0, 0.0], [100.0, 100.0, 30.0]])
    earth = Degrees(46.0, 47.0)
    assert check_in_map((47.0, 46.0, 5.0), "amsl", earth, extent) == pytest.approx((0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"expected one in the map, latitude 46\.99\d+ to 47\.00\d+"):
        check_in_map((47.02, 46.0, 5.0), "amsl", earth, extent)
    with pytest.raises(ValueError, match="swapped"):
        check_in_map((46.0, 47.0, 5.0), "amsl", earth, extent)


def test_a_map_around_places_is_that_around_their_points() -> None:
    contents, window, reading = read_map(SAMPLE), Window(ground=0.0), maxjax.Reading(height_of_zero=0.0)
    points = [(-75.0, 22.0, 5.0), (55.0, -20.0, 61.0)]
    elsewhere = map_of(contents, Window(ends=points, ground=0.0), reading)
    assert elsewhere.earth is not None
    places = [tuple(place) for place in elsewhere.earth.geodetic(np.array(points)).tolist()]
    for frame in ("agl", "amsl"):
        found, ends = map_with(contents, window, places, frame, elsewhere.earth, reading)  # type: ignore[arg-type]
        np.testing.assert_allclose(ends, points, atol=1e-6)
        assert found.grid == elsewhere.grid
        np.testing.assert_array_equal(found.occupied, elsewhere.occupied)
    for frame in ("agl", "amsl"):
        np.testing.assert_allclose(elsewhere.point(places[0], frame), points[0], atol=1e-6)  # type: ignore[arg-type]


def test_a_map_that_lies_nowhere_says_so(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", occupied=np.zeros((4, 4, 4), bool), spacing=2.0, origin=np.zeros(3))
    found = maxjax.load_map(tmp_path / "a.npz")
    assert found.earth is None
    with pytest.raises(ValueError, match="says where it lies on Earth"):
        found.point((52.0, 4.3, 5.0))
    assert maxjax.load_map(tmp_path / "a.npz", crs="EPSG:28992").earth == Projected("EPSG:28992")


def test_heights_above_the_ground_beneath_by_x_and_y() -> None:
    terrain = Terrain.of(slope(GRID), GRID)
    x, y = (0.5 * (low + high) for low, high in zip(GRID.lower[:2], GRID.upper[:2], strict=True))
    assert point_at((x, y, 7.5), "local-agl", None, terrain) == (x, y, terrain.at(x, y) + 7.5)
    with pytest.raises(ValueError, match="local-agl: expected a place above the map's ground"):
        point_at((x + 1e5, y, 7.5), "local-agl", None, terrain)
    with pytest.raises(ValueError, match="agl: expected a map that lies somewhere on Earth"):
        point_at((x, y, 7.5), "agl", None, terrain)


def test_a_map_around_x_and_y_above_ground_is_that_around_their_points() -> None:
    contents, window = read_map(SAMPLE), Window()
    points = [(-75.0, 22.0, 5.0), (55.0, -20.0, 61.0)]  # the ground is at 0, to a hair
    found, ends = map_with(contents, window, points, "local-agl", None)
    np.testing.assert_allclose(ends, points, atol=1e-9)
    assert found.grid == map_of(contents, Window(ends=points)).grid
    with pytest.raises(ValueError, match=r"place: expected one in the map, x .* given 9000.0, 0.0"):
        map_with(contents, window, [points[0], (9e3, 0.0, 5.0)], "local-agl", None)


@pytest.mark.parametrize("frame", ["map", "local-agl", "agl", "home", "amsl"])
def test_numbers_of_a_point_are_what_leads_there(frame: Frame) -> None:
    terrain = Terrain.flat(12.0, maxjax.Grid((1, 1, 1), 4e3))
    points = [(10.0, -20.0, 30.0), (-150.0, 80.0, 15.5), (500.0, 700.0, 112.0)]
    for earth in (PLANE, Degrees(8.0, 47.0, SEVEN)):
        numbers = [numbers_of_point(point, frame, earth, terrain, points[0]) for point in points]
        np.testing.assert_allclose(points_at(numbers, frame, earth, terrain), points, rtol=0, atol=2e-5)
    if frame in ("agl", "home", "local-agl"):
        assert numbers_of_point(points[0], frame, PLANE, terrain, points[0])[2] == pytest.approx(18.0, abs=1e-6)


def test_numbers_of_a_point_need_what_they_count_from() -> None:
    for frame, earth, terrain in (("agl", None, Terrain.flat(0.0, maxjax.Grid((1, 1, 1), 4e3))), ("home", PLANE, None)):
        with pytest.raises(ValueError, match=f"{frame}: expected"):
            numbers_of_point((0.0, 0.0, 5.0), frame, earth, terrain)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="local-agl: expected the ground"):
        numbers_of_point((0.0, 0.0, 5.0), "local-agl", None)
