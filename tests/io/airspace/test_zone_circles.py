"""Circles as polygons: around the circle to keep out, within it to keep in, beside geodesics of pyproj."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax import load_airspace
from maxjax.core.status import Closure
from maxjax.io.airspace.circles import circle_around
from maxjax.io.airspace.zone import UnclearError
from maxjax.io.geo.earth import TangentPlane
from tests.fuzz import zone_samples as samples

pyproj = pytest.importorskip("pyproj", reason="needs the extra geo")
shapely = pytest.importorskip("shapely", reason="needs shapely (extra dev)")

GEOD = pyproj.Geod(ellps="WGS84")
GRID = maxjax.Grid((14, 12, 4), 2.0, (-13.0, -11.0, 1.0))
NOTHING = np.zeros(GRID.shape, bool)


def rim(longitude: float, latitude: float, radius: float, count: int = 720) -> np.ndarray:
    """Points on a circle, longitudes near that of its centre."""
    full = np.ones(count)
    azimuth = np.linspace(0.0, 360.0, count, endpoint=False)
    x, y, _ = GEOD.fwd(longitude * full, latitude * full, azimuth, radius * full)
    x = np.asarray(x) - 360.0 * np.round((np.asarray(x) - longitude) / 360.0)
    return np.column_stack([x, y])


@pytest.mark.parametrize("radius", [0.5, 40.0, 3500.0, 1e5, 9e5])
@pytest.mark.parametrize("latitude", [-70.0, -33.0, 0.0, 0.01, 47.0, 52.0, 64.9, 81.0, 89.0])
@pytest.mark.parametrize("longitude", [4.3, 179.999, -180.0])
def test_a_polygon_holds_the_circle_or_is_held_by_it(longitude: float, latitude: float, radius: float) -> None:
    points = rim(longitude, latitude, radius)
    (around,) = circle_around(np.array([longitude, latitude]), radius)
    outer = shapely.Polygon(around)
    assert outer.is_valid
    near_a_pole = (90.0 - abs(latitude)) * 110e3 < 3.0 * radius
    turned = points - np.array([360.0, 0.0]) * np.round(points[:, :1] / 360.0) if near_a_pole else points
    assert outer.covers(shapely.points(turned)).all()
    if near_a_pole:
        with pytest.raises(UnclearError, match="far from the poles"):
            circle_around(np.array([longitude, latitude]), radius, keep_in=True)
        return
    # No more than 0.3 percent of the radius farther than it has to be.
    _, _, far = GEOD.inv(np.full(len(around), longitude), np.full(len(around), latitude), *around.T)
    assert np.max(far) <= 1.003 * radius
    (within,) = circle_around(np.array([longitude, latitude]), radius, keep_in=True)
    dense = np.array(shapely.Polygon(within).segmentize(max(radius * 1e-7, 1e-9)).exterior.coords)
    _, _, far = GEOD.inv(np.full(len(dense), longitude), np.full(len(dense), latitude), *dense.T)
    assert np.max(far) <= radius
    assert np.max(far) >= 0.998 * radius


@pytest.mark.parametrize("radius", [0.0, -3.0, float("nan"), float("inf"), 1e300, 2e6])
def test_a_radius_that_is_none_is_refused(radius: float) -> None:
    with pytest.raises(UnclearError, match="expected a radius of 0 to 1e"):
        circle_around(np.array([4.3, 52.0]), radius)


@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("place", [(52.0, 4.3), (-17.0, 180.0), (-17.0, -179.99995), (70.0, 179.99995), (84.0, 30.0)])
def test_voxels_of_a_circle_are_those_that_it_touches_or_holds(
    tmp_path: Path, place: tuple[float, float], kept: bool
) -> None:
    earth = TangentPlane(*place, 0.0)
    latitude, longitude = earth.geodetic(np.array([[3.0, -2.0, 0.0]]))[0, :2].tolist()
    (tmp_path / "a.plan").write_bytes(samples.fence(circles=[((longitude, latitude), 8.0, kept)]))
    found = load_airspace(tmp_path / "a.plan", earth, GRID).closed(NOTHING, GRID)[:, :, 2] == Closure.AREA
    for i, j in np.ndindex(14, 12):
        cell = shapely.box(-14 + 2 * i, -12 + 2 * j, -12 + 2 * i, -10 + 2 * j)
        circle = shapely.Point(3.0, -2.0).buffer(8.0, 64)
        if kept:
            assert found[i, j] or circle.contains(cell)
            assert not found[i, j] or not circle.buffer(-0.03).contains(cell)
        else:
            assert found[i, j] or not circle.intersects(cell)
            assert not found[i, j] or circle.buffer(0.03).intersects(cell)


def test_a_circle_about_a_pole_closes_what_is_as_far_north(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    pole = samples.ed318_feature(samples.point((0.0, 90.0), 8e5))
    file.write_bytes(samples.collection(pole, samples.ed318_feature(samples.point((0.0, 0.0), 9.0))))
    for longitude in (0.0, 133.0, 180.0, -179.9999):
        within = load_airspace(file, TangentPlane(83.0, longitude), GRID)
        assert (within.closed(NOTHING, GRID) == Closure.AREA).all()
        with pytest.raises(ValueError, match="expected an area in the map"):
            load_airspace(file, TangentPlane(82.5, longitude), GRID)
    with pytest.raises(ValueError, match=r"within 89\.5 degrees of the equator"):
        load_airspace(file, TangentPlane(90.0, 0.0), GRID)


def test_the_names_of_a_circle_vary(tmp_path: Path) -> None:
    """The collection of EUROCAE's examples says Circles; others give a property."""
    earth = TangentPlane(52.0, 4.3)
    exact = samples.ed318_feature(samples.point((4.3, 52.0), 8.0))
    plural = json.loads(json.dumps(exact).replace('"Circle"', '"Circles"'))
    by_property = {"type": "Feature", "properties": {"radius": 8.0},
                   "geometry": {"type": "Point", "coordinates": [4.3, 52.0]}}  # fmt: skip
    results = []
    for feature in (exact, plural, by_property):
        (tmp_path / "a.json").write_bytes(samples.collection(feature))
        results.append(load_airspace(tmp_path / "a.json", earth, GRID).closed(NOTHING, GRID))
    assert results[0].any()
    assert (results[0] == results[1]).all()
    assert (results[0] == results[2]).all()
