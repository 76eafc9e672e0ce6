"""Heights above sea level: only of maps that say what their heights count from."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.io.geo.earth import Degrees, Projected, TangentPlane
from maxjax.io.geo.reference_system import reference_system
from maxjax.io.geo.vertical_zero import UnknownZeroError, VerticalZero
from maxjax.io.kinds.contents import facts
from maxjax.io.reader import read_map
from maxjax.io.readers.las_reference import read_records
from tests.io.export.test_as_flown import planned
from tests.io.test_looked_past import block, features

UNKNOWN = "heights above sea level are known"
EGM96 = "EGM96 height"
_KML = "{http://www.opengis.net/kml/2.2}"


def town(folder: Path, **properties: Any) -> Path:
    """Four blocks of 30 m around a crossing at 47 N 8 E, on ground that the file says nothing of."""
    blocks = [(block(x, y), {"building": "yes", "height": 30, **properties}) for x in (-40, 40) for y in (-40, 40)]
    return features(folder, *blocks)


def zone(folder: Path, **properties: Any) -> Path:
    """A zone around the whole town."""
    ring = block(0.0, 0.0, 300.0)
    shape = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    feature = {"type": "Feature", "properties": {"type": "PROHIBITED", **properties}, "geometry": shape}
    path = folder / "zone.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def straight(where: maxjax.VoxelMap, height: float) -> maxjax.Plan:
    """A plan along the street."""
    return planned(where, np.array([[-60.0, 0.0, height], [60.0, 0.0, height]]))


def stated(height: float | None) -> maxjax.Reading:
    return maxjax.Reading(height_of_zero=height)


BAND = {"lower": 480, "upper": 1000, "lowerReference": "AMSL", "upperReference": "AMSL", "uom": "m"}


def test_a_zone_above_sea_level_asks_what_a_map_counts_from(tmp_path: Path) -> None:
    """Ground at 450 m, a zone from 480 m above the sea: who flies at 60 m is in it, whoever says so first."""
    path = town(tmp_path)
    city = maxjax.load_map(path, ground=0.0)
    assert city.earth is not None
    with pytest.raises(ValueError, match=UNKNOWN):
        maxjax.load_airspace(zone(tmp_path, **BAND), city.earth, city.grid)
    city = maxjax.load_map(path, ground=0.0, bounds=[-80, -80, -4, 80, 80, 100], reading=stated(450.0))
    assert city.earth is not None
    rules = maxjax.load_airspace(zone(tmp_path, **BAND), city.earth, city.grid)
    assert rules.areas[0].floor == pytest.approx(30.0)
    plan = maxjax.plan(city, (-60.0, 0.0, 60.0), (60.0, 0.0, 60.0), airspace=rules)
    assert plan.status == maxjax.Status.START_IN_CLOSED_AREA
    assert maxjax.plan(city, (-60.0, 0.0, 20.0), (60.0, 0.0, 20.0), airspace=rules).status == maxjax.Status.OK


def test_an_area_to_keep_in_asks_for_it_as_well(tmp_path: Path) -> None:
    path, top = town(tmp_path), {"upper": 480, "upperReference": "AMSL", "inclusion": True}
    city = maxjax.load_map(path, ground=0.0)
    assert city.earth is not None
    with pytest.raises(ValueError, match=UNKNOWN):
        maxjax.load_airspace(zone(tmp_path, **top), city.earth, city.grid)
    city = maxjax.load_map(path, ground=0.0, reading=stated(450.0))
    assert city.earth is not None
    assert maxjax.load_airspace(zone(tmp_path, **top), city.earth, city.grid).areas[0].ceiling == pytest.approx(30.0)


def test_a_zone_above_ground_or_far_away_asks_for_nothing(tmp_path: Path) -> None:
    city = maxjax.load_map(town(tmp_path), ground=0.0)
    assert city.earth is not None
    assert len(maxjax.load_airspace(zone(tmp_path, upper=100), city.earth, city.grid).areas) == 1
    document = json.loads(zone(tmp_path, upper=100).read_text())
    far = json.loads(zone(tmp_path, **BAND).read_text())["features"][0]
    far["geometry"]["coordinates"] = [[[x + 3.0, y] for x, y in far["geometry"]["coordinates"][0]]]
    document["features"].append(far)
    (tmp_path / "both.geojson").write_text(json.dumps(document))
    assert len(maxjax.load_airspace(tmp_path / "both.geojson", city.earth, city.grid).areas) == 1


@pytest.mark.parametrize("name", ["a.plan", "a.waypoints", "a.kml", "way.geojson"])
def test_a_file_with_heights_above_sea_level_is_refused_where_they_are_not_known(tmp_path: Path, name: str) -> None:
    city = maxjax.load_map(town(tmp_path), ground=0.0)
    plan = straight(city, 60.0)
    with pytest.raises(ValueError, match=UNKNOWN):
        maxjax.export(tmp_path / name, plan)
    assert not (tmp_path / name).exists()
    maxjax.export(tmp_path / "a_ned.csv", maxjax.trajectory(plan))  # counts from its own origin


def test_files_hold_the_height_above_sea_level(tmp_path: Path) -> None:
    """A path at 60 m over ground at 450 m: 510 m in KML and GeoJSON, home at 450 m."""
    plan = straight(maxjax.load_map(town(tmp_path), ground=0.0, reading=stated(450.0)), 60.0)
    for name in ("a.kml", "a.geojson", "a.plan", "a.waypoints"):
        maxjax.export(tmp_path / name, plan)
    drawn = ElementTree.parse(tmp_path / "a.kml")
    heights = [float(row.split(",")[2]) for row in (drawn.findtext(f".//{_KML}coordinates") or "").split()]
    assert heights == pytest.approx([510.0] * 2, abs=0.01)
    assert "above sea level" in (drawn.findtext(f".//{_KML}description") or "")
    line = json.loads((tmp_path / "a.geojson").read_text())["features"][0]
    assert line["geometry"]["coordinates"][0][2] == pytest.approx(510.0, abs=0.01)
    assert line["properties"]["coordinates"].startswith("heights above sea level (as stated)")
    assert json.loads((tmp_path / "a.plan").read_text())["mission"]["plannedHomePosition"][2] == pytest.approx(450.0)
    assert float((tmp_path / "a.waypoints").read_text().splitlines()[1].split("\t")[10]) == pytest.approx(450.0)


def test_a_place_above_sea_level_asks_for_it(tmp_path: Path) -> None:
    city = maxjax.load_map(town(tmp_path), ground=0.0)
    with pytest.raises(ValueError, match=UNKNOWN):
        city.point((47.0, 8.0, 5.0), "amsl")
    assert city.point((47.0, 8.0, 5.0), "agl")[2] == pytest.approx(5.0)
    city = maxjax.load_map(town(tmp_path), ground=0.0, reading=stated(450.0))
    assert city.point((47.0, 8.0, 455.0), "amsl")[2] == pytest.approx(5.0)


def test_heights_that_are_not_known_are_no_numbers() -> None:
    for earth in (Projected("EPSG:32632"), Degrees(8.0, 47.0), TangentPlane(47.0, 8.0)):
        point = np.array([[5e5, 5.2e6, 7.0]]) if isinstance(earth, Projected) else np.array([[10.0, 20.0, 7.0]])
        latitude, longitude, height = earth.geodetic(point)[0].tolist()
        assert np.isfinite([latitude, longitude]).all()
        assert np.isnan(height)
        with pytest.raises(UnknownZeroError, match=UNKNOWN):
            earth.local(np.array([[latitude, longitude, 7.0]]))


@pytest.mark.parametrize(
    ("system", "zero"),
    [
        ("EPSG:7415", VerticalZero(0.0, "NAP height")),
        ("EPSG:25832+5783", VerticalZero(0.0, "DHHN92 height")),
        ("EPSG:28992", VerticalZero()),
        ("EPSG:25832", VerticalZero()),
    ],
)
def test_systems_with_heights_say_what_they_count_from(system: str, zero: VerticalZero) -> None:
    if "+" not in system:
        assert Projected(system).zero == zero
    else:
        assert reference_system(system).zero(np.zeros(2)) == zero


@pytest.mark.parametrize("key", ["ele", "elevation"])
def test_ele_counts_from_sea_level(tmp_path: Path, key: str) -> None:
    city = maxjax.load_map(town(tmp_path, **{key: 450}))
    assert city.earth is not None
    assert city.earth.zero.above_sea == 0.0
    other = maxjax.load_map(town(tmp_path, **{key: 450}), reading=stated(10.0))
    assert other.earth is not None
    assert other.earth.zero.above_sea == 10.0
    assert any("z = 0 lies 0 m above sea level; 10 m is taken, as asked" in remark for remark in other.file.remarks)


def test_third_coordinates_count_from_what_nobody_states(tmp_path: Path) -> None:
    city = maxjax.load_map(features(tmp_path, (block(0, 0, 10.0, 400, 400, 400, 400), {"height": 10})))
    assert city.earth is not None
    assert city.earth.zero == VerticalZero()


def surface(path: Path, crs: Any) -> Path:
    """A surface model of 20 x 20 cells around 48.1 N 16.3 E: flat at 60 m, with a block to 90 m."""
    rasterio = pytest.importorskip("rasterio")
    heights = np.full((20, 20), 60.0, np.float32)
    heights[8:12, 8:12] = 90.0
    system = pyproj.CRS.from_user_input(crs)
    x, y = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True).transform(16.3, 48.1)
    cell = 1e-5 if system.is_geographic else 1.0
    place = rasterio.transform.from_origin(x, y, cell, cell)
    kind = {"driver": "GTiff", "width": 20, "height": 20, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs=rasterio.CRS.from_wkt(system.to_wkt()), transform=place, **kind) as file:
        file.write(heights, 1)
    return path


@pytest.mark.parametrize("crs", ["EPSG:4979", "utm"])
def test_heights_above_the_ellipsoid_are_said_to_be_so(tmp_path: Path, crs: str) -> None:
    """PROJ has no geoid here: GeoJSON takes such heights, whatever needs the sea level does not."""
    path = surface(tmp_path / "a.tif", pyproj.CRS("EPSG:32633").to_3d() if crs == "utm" else crs)
    city = maxjax.load_map(path, spacing=1.0)
    assert any("heights count from the ellipsoid WGS 84, not from sea level" in line for line in city.file.remarks)
    x, y, _ = np.mean([city.grid.lower, city.grid.upper], axis=0).tolist()
    plan = planned(city, np.array([[x - 4.0, y, 95.0], [x + 4.0, y, 95.0]]))
    for name in ("a.kml", "a.plan"):
        with pytest.raises(ValueError, match="they count from the ellipsoid WGS 84"):
            maxjax.export(tmp_path / name, plan, ground=60.0)
    maxjax.export(tmp_path / "a.geojson", plan, ground=60.0)
    line = json.loads((tmp_path / "a.geojson").read_text())["features"][0]
    assert line["geometry"]["coordinates"][0][2] == pytest.approx(95.0, abs=1e-3)
    assert line["properties"]["coordinates"].startswith("heights above the ellipsoid WGS 84")


def test_a_survey_in_three_dimensions_counts_from_its_ellipsoid(tmp_path: Path) -> None:
    """By WKT, and by the keys of GeoTIFF, where 5030 stands for heights above WGS84."""
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [0.01] * 3
    header.add_crs(pyproj.CRS("EPSG:32633").to_3d())
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.array([[6e5, 6e5 + 20], [5.3e6, 5.3e6 + 30], [150.0, 160.0]])
    points.write(tmp_path / "a.las")
    known = facts(read_map(tmp_path / "a.las"))
    assert (known.zero.above_sea, known.zero.ellipsoidal) == (None, True)
    keys = [laspy.vlrs.known.GeoKeyEntryStruct(id=k, count=1, value_offset=v) for k, v in ((1024, 1), (3072, 32633))]
    for vertical, zero in ((5030, VerticalZero(None, "the ellipsoid WGS 84", True)), (5773, VerticalZero(0.0, EGM96))):
        record = laspy.vlrs.known.GeoKeyDirectoryVlr()
        record.geo_keys = [*keys, laspy.vlrs.known.GeoKeyEntryStruct(id=4096, count=1, value_offset=vertical)]
        record.geo_keys_header.number_of_keys = 3
        stated = read_records([record], "", maxjax.Reading(), tmp_path)
        assert reference_system(stated.system or "").zero(np.array([6e5, 5.3e6])) == zero


_WITH_A_GEOID = """
import struct, sys
import numpy as np, pyproj
folder, file = sys.argv[1:]
values = np.array([[45.0 + 0.25 * j - 1.0 for j in range(9)]] * 9, ">f4")  # 45 m at 16 E, a metre more a degree
open(folder + "/egm96_15.gtx", "wb").write(struct.pack(">4d2i", 47.0, 15.0, 0.25, 0.25, 9, 9) + values.tobytes())
pyproj.datadir.append_data_dir(folder)
import maxjax
city = maxjax.load_map(file, spacing=1.0)
print(city.earth.zero.above_sea)
print(*city.file.remarks, sep="; ")
"""


def test_where_proj_has_a_geoid_heights_above_the_ellipsoid_are_brought_to_it(tmp_path: Path) -> None:
    """At 16.3 E the geoid lies 45.3 m above the ellipsoid: z = 0 is 45.3 m below the sea."""
    file = surface(tmp_path / "a.tif", "EPSG:4979")
    done = subprocess.run(
        [sys.executable, "-c", _WITH_A_GEOID, str(tmp_path), str(file)], capture_output=True, text=True, check=True
    )
    height, remarks = done.stdout.splitlines()
    assert float(height) == pytest.approx(-45.3, abs=0.01)
    assert "z = 0 lies -45.30 m above sea level" in remarks


def test_a_zero_is_a_height() -> None:
    for height in (np.nan, np.inf, 2e5):
        with pytest.raises(ValueError, match="height: expected metres for z = 0"):
            maxjax.Reading(height_of_zero=height)
