"""OpenStreetMap XML: made-up buildings exactly, the projection against geocentric coordinates, Venice as imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maxjax.core.files import FileError
from maxjax.io.geo.earth import project
from maxjax.io.readers.osm import load_osm

LATITUDE, LONGITUDE = 34.0, -118.45
STEP = 1e-4  # [degrees], some 10 m


def osm(body: str, version: str = "0.6") -> str:
    """A file with the nodes (i, j) of a 4 x 4 lattice, named 1 i j."""
    nodes = "".join(
        f'<node id="1{i}{j}" lat="{LATITUDE + STEP * j:.7f}" lon="{LONGITUDE + STEP * i:.7f}"/>'
        for i in range(4)
        for j in range(4)
    )
    return f'<?xml version="1.0"?><osm version="{version}">{nodes}{body}</osm>'


def way(name: int, nodes: str, **tags: str) -> str:
    inside = "".join(f'<nd ref="1{node}"/>' for node in nodes.split())
    return f'<way id="{name}">{inside}{marks(**tags)}</way>'


def marks(**tags: str) -> str:
    return "".join(f'<tag k="{key.replace("__", ":")}" v="{value}"/>' for key, value in tags.items())


OUTER, SQUARE = "00 30 33 03 00", "00 10 11 01 00"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.osm"


def test_projection_agrees_with_geocentric_coordinates() -> None:
    origin = np.array([LONGITUDE, LATITUDE])
    degrees = origin + np.random.default_rng(0).uniform(-0.005, 0.005, (200, 2))  # some 500 m

    def geocentric(point: np.ndarray) -> np.ndarray:
        lon, lat = np.radians(point).T
        a, b = 6_378_137.0, 6_356_752.314245179  # semi-axes of WGS 84
        normal = a**2 / np.hypot(a * np.cos(lat), b * np.sin(lat))
        across = normal * np.cos(lat)
        return np.stack([across * np.cos(lon), across * np.sin(lon), b**2 / a**2 * normal * np.sin(lat)], -1)

    lon, lat = np.radians(origin)
    east = np.array([-np.sin(lon), np.cos(lon), 0])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    offset = geocentric(degrees) - geocentric(origin[None])
    expected = np.stack([offset @ east, offset @ north], -1)
    assert np.abs(expected).max() > 400
    np.testing.assert_allclose(project(degrees, origin), expected, atol=0.04)


@pytest.mark.parametrize(
    ("tags", "base", "top"),
    [
        ({"height": "8.9"}, 0.0, 8.9),
        ({"height": "12 m", "ele": "4"}, 4.0, 16.0),
        ({"building__levels": "3", "ele": "1.5"}, 1.5, 10.5),
        ({"height": "7", "building__levels": "9"}, 0.0, 7.0),
        ({"height": "tall", "building__levels": "2"}, 0.0, 6.0),
        ({"height": "8.9", "elevation": "14.9"}, 6.0, 14.9),  # of the roof
    ],
)
def test_heights_come_from_tags(path: Path, tags: dict[str, str], base: float, top: float) -> None:
    path.write_text(osm(way(1, SQUARE, building="yes", **tags)))
    (house,) = load_osm(path).buildings
    assert (house.base, house.top) == (pytest.approx(base), pytest.approx(top))
    assert house.name == "way 1"


def test_a_multipolygon_joins_its_ways_and_keeps_its_courtyard(path: Path) -> None:
    ways = way(1, "00 30 33") + way(2, "00 03 33") + way(3, "11 21 22 12 11")
    members = "".join(f'<member type="way" ref="{k}" role="{"inner" if k == 3 else "outer"}"/>' for k in (1, 2, 3))
    relation = f'<relation id="9">{members}{marks(type="multipolygon", building="school", height="9")}</relation>'
    path.write_text(osm(ways + relation))
    found = load_osm(path)
    (school,) = found.buildings
    assert sorted(map(len, school.rings)) == [4, 4]
    np.testing.assert_allclose(found.reference.origin, [LONGITUDE + 1.5 * STEP, LATITUDE + 1.5 * STEP], atol=1e-9)
    # Series of NOAA for a degree at 34° north: 110,922 m along the meridian, 92,385 m along the parallel.
    extent = np.ptp(np.concatenate(school.rings), axis=0)
    np.testing.assert_allclose(extent, [3 * STEP * 92_385, 3 * STEP * 110_922], rtol=1e-4)


def test_what_has_no_height_or_outline_is_counted(path: Path) -> None:
    kept = way(1, SQUARE, building="yes", height="5") + way(2, SQUARE, building__part="roof", height="6")
    left = way(3, SQUARE, building="yes") + way(4, "00 10 11", building="yes", height="5")
    left += way(5, SQUARE, building="yes", height="0") + way(6, "00 10 99 00", building="yes", height="4")
    other = way(7, SQUARE, highway="service", height="4") + way(8, SQUARE, building="no", height="4")
    path.write_text(osm(kept + left + other))
    found = load_osm(path)
    assert [b.name for b in found.buildings] == ["way 1", "way 2"]
    assert found.dropped == {
        "buildings with an open outline": 2,
        "buildings without a height": 2,
        "highway shapes without a height": 1,
        "other shapes without a height": 1,
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<osm", "expected XML"),
        ("<gpx version='1.1'/>", "expected <osm version='0.6'>, found <gpx version='1.1'>"),
        (osm("", "0.5"), "found <osm version='0.5'>"),
        (osm(way(1, SQUARE, building="yes")), r"expected a building .* found none \(1 buildings without a height\)"),
        (osm("<node id='5' lat='here' lon='0'/>"), "malformed OSM: ValueError"),
        (osm("<way/>"), "malformed OSM: KeyError"),
    ],
)
def test_an_error_names_what_is_wrong(path: Path, content: str, message: str) -> None:
    path.write_text(content)
    with pytest.raises(FileError, match=message):
        load_osm(path)


def test_an_error_names_a_missing_file(path: Path) -> None:
    with pytest.raises(FileError, match="cannot be read"):
        load_osm(path)


def test_venice_stands_on_smooth_ground(data: Path) -> None:
    files = sorted((data / "la_venice").glob("*.osm"))
    assert len(files) == 3
    for file, count, addresses in zip(files, (232, 517, 356), (130, 437, 283), strict=True):
        found = load_osm(file)
        assert (len(found.buildings), found.dropped) == (count, {"address shapes without a height": addresses})
        middle = np.array([ring.mean(0) for ring, *_ in (b.rings for b in found.buildings)])
        floor, height = np.array([[b.base, b.top - b.base] for b in found.buildings]).T
        assert height.min() > 1.5
        # Were `elevation` the floor's, floors would rise with the height of the house, one to one.
        assert abs(np.polyfit(height, floor, 1)[0]) < 0.1
        plane = np.column_stack([middle, np.ones(count)])
        rest = floor - plane @ np.linalg.lstsq(plane, floor, rcond=None)[0]
        assert rest.std() < 1.0
