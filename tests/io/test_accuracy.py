"""How true a map is on Earth: said, written into files with latitudes, and kept in addition to the radius."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.io.geo.accuracy import accuracy_of
from maxjax.io.geo.earth import Degrees, Projected, TangentPlane
from maxjax.io.geo.vertical_zero import VerticalZero
from tests.io.export.test_as_flown import planned

# Ordnance Survey's own example of OSTN15 on easting 624161, northing 308459.58; PROJ without its grid is 3.17 m off.
OSTN15 = (52.6276036, 1.3107335)
EAST, NORTH = 624161.0, 308459.58
# Lines of files say how true they are; a datum of feet in New York, one of Switzerland, two that are WGS84 itself.
PLACES = {
    "EPSG:27700": (EAST, NORTH),
    "EPSG:31467": (3513000.0, 5404000.0),
    "EPSG:2056": (2600000.0, 1200000.0),
    "EPSG:32632": (6e5, 5.3e6),
    "EPSG:3857": (9e5, 59e5),
}


def british(folder: Path, accuracy: float | None = None) -> maxjax.LoadedMap:
    """Two walls 9 m apart, 4.5 m on either side of a way, in the British National Grid with Newlyn's heights."""
    occupied = np.zeros((40, 15, 12), bool)
    occupied[:, [2, 12], :8] = True
    file = folder / "street.npz"
    np.savez(file, occupied=occupied, spacing=1.0, origin=np.array([EAST, NORTH, 0.5]))
    reading = maxjax.Reading(accuracy=accuracy, height_of_zero=0.0)
    return maxjax.load_map(file, crs="EPSG:27700", ground=1.0, reading=reading)


def along(where: maxjax.VoxelMap, aside: float) -> maxjax.Plan:
    """Along the street, so far from its middle."""
    y = NORTH + 7.0 + aside
    return planned(where, np.array([[EAST + 5.0, y, 4.5], [EAST + 34.0, y, 4.5]]))


@pytest.mark.parametrize("crs", list(PLACES))
def test_the_accuracy_is_that_of_the_transformation_that_is_taken(crs: str) -> None:
    place = np.array([*PLACES[crs], 0.0])
    taken = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    taken.transform(*PLACES[crs])
    with contextlib.suppress(pyproj.exceptions.ProjError):  # where there is only one
        taken = taken.get_last_used_operation()
    earth: Projected | Degrees = Projected(crs)
    if crs == "EPSG:3857":
        earth = Degrees(8.0, 47.0, crs=crs)
        place = np.zeros(3)
    assert accuracy_of(earth, place).metres == taken.accuracy


def test_what_is_wrong_is_within_a_few_metres_and_a_grid_is_named() -> None:
    """PROJ states 2 m as one standard deviation; where the Ordnance Survey gives its example it is 3.17 m."""
    where = np.array([EAST, NORTH, 0.0])
    true = accuracy_of(Projected("EPSG:27700"), where)
    assert true.metres == 2.0
    assert true.missing == ("uk_os_OSTN15_NTv2_OSGBtoETRS.tif",)
    latitude, longitude, _ = Projected("EPSG:27700").geodetic(where[None])[0].tolist()
    _, _, off = pyproj.Geod(ellps="WGS84").inv(longitude, latitude, *OSTN15[::-1])
    assert off == pytest.approx(3.17, abs=0.01)


def test_a_map_says_how_true_it_is(tmp_path: Path) -> None:
    said = [line for line in british(tmp_path).file.remarks if "true to 2 m" in line]
    assert len(said) == 1
    assert "needs the grid uk_os_OSTN15_NTv2_OSGBtoETRS.tif" in said[0]
    assert not any("true to" in line for line in british(tmp_path, accuracy=0.1).file.remarks)


@pytest.mark.parametrize("name", ["a.kml", "a.geojson", "a.plan", "a.waypoints"])
def test_a_file_with_latitudes_keeps_as_much_more_as_the_map_may_be_off(tmp_path: Path, name: str) -> None:
    """The walls are 4.5 m from the middle: a metre aside 3.5 m are left for 1 m and 2 m, two metres aside are not."""
    city = british(tmp_path)
    maxjax.export(tmp_path / f"near_{name}", along(city, 1.0))
    with pytest.raises(ValueError, match=r"1 m are to be kept, and 2 m more: places are true to 2 m, by OSGB36 to WGS"):
        maxjax.export(tmp_path / name, along(city, 2.0))
    assert not (tmp_path / name).exists()
    maxjax.export(tmp_path / "a.csv", maxjax.trajectory(along(city, 2.0)))  # of the map alone
    flown = maxjax.export(tmp_path / name, along(british(tmp_path, accuracy=0.4), 2.0))
    assert flown.clearance == pytest.approx(2.5, abs=0.02)
    assert any(line.startswith("places are true to 0.4 m") for line in flown.remarks)


def test_files_of_lines_say_how_true_they_are(tmp_path: Path) -> None:
    maxjax.export(tmp_path / "a.kml", along(british(tmp_path), 0.0))
    maxjax.export(tmp_path / "a.geojson", along(british(tmp_path), 0.0))
    assert "places are true to 2 m, by OSGB36 to WGS 84" in (tmp_path / "a.kml").read_text()
    said = json.loads((tmp_path / "a.geojson").read_text())["features"][0]["properties"]["coordinates"]
    assert said.startswith("heights above sea level (as stated); places are true to 2 m")


def test_an_end_that_stands_near_keeps_its_own_distance(tmp_path: Path) -> None:
    """Both ends 2 m from a wall, and in between the middle of the street."""
    city = british(tmp_path)
    y = NORTH + 7.0
    line = [[5.0, y + 2.0], [9.0, y], [30.0, y], [34.0, y + 2.0]]
    plan = planned(city, np.array([[EAST + x, north, 4.5] for x, north in line]))
    assert maxjax.export(tmp_path / "a.kml", plan).clearance == pytest.approx(2.5, abs=0.02)


def test_what_nobody_knows_is_asked_for(tmp_path: Path) -> None:
    """A datum without a name has no transformation but a guess."""
    system = "+proj=tmerc +lon_0=9 +k=1 +x_0=500000 +ellps=bessel +units=m +type=crs"
    place = np.array([5e5, 5.3e6, 0.0])
    assert math.isnan(accuracy_of(Projected(system), place).metres)
    assert accuracy_of(Projected(system, accuracy=5.0), place).metres == 5.0
    plan = along(british(tmp_path), 0.0)
    with pytest.raises(ValueError, match=r"how true places are is not known.*state it, as --accuracy 2"):
        maxjax.export(tmp_path / "a.kml", plan, earth=Projected(system, VerticalZero(0.0)))


def test_a_place_that_is_given_is_true() -> None:
    assert accuracy_of(TangentPlane(47.0, 8.0, 0.0), np.zeros(3)).metres == 0.0


@pytest.mark.parametrize("metres", [-1.0, math.nan, math.inf])
def test_an_accuracy_is_a_distance(metres: float) -> None:
    with pytest.raises(ValueError, match="accuracy: expected a distance of at least 0 m"):
        maxjax.Reading(accuracy=metres)
