"""Units, datum and axes: what files state becomes metres, as pyproj has them, or is refused in a sentence.

MUTATIONS=100000 python -m pytest tests/io/test_reference.py -k texts      # at length
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.core.files import FileError
from maxjax.io.geo.reference_system import reference_system
from maxjax.io.geo.units_and_axes import Stated, reference
from maxjax.io.kinds.heights import Heights
from maxjax.io.reader import read_map
from maxjax.io.reading import Reading

FOOT, US_FOOT = 0.3048, 1200 / 3937
MUTATIONS = int(os.environ.get("MUTATIONS", "100"))
PLAIN = Reading()


def keys_of(laspy: Any, *keys: tuple[int, int, int, int]) -> list[Any]:
    """A record of GeoTIFF's keys: key, location, count, value."""
    record = laspy.vlrs.known.GeoKeyDirectoryVlr()
    record.parse_record_data(np.array([(1, 1, 0, len(keys)), *keys], "<u2").tobytes())
    return [record]


def wkt_of(laspy: Any, wkt: str) -> list[Any]:
    return [laspy.vlrs.known.WktCoordinateSystemVlr(wkt)]


def las(path: Path, points: np.ndarray, *, keys: tuple[tuple[int, int, int, int], ...] = (), wkt: str = "") -> Path:
    """A survey of ground and a roof at these places, in the file's own units."""
    laspy = pytest.importorskip("laspy", reason="needs the extra las")
    header = laspy.LasHeader(point_format=6 if wkt else 3, version="1.4" if wkt else "1.2")
    header.scales, header.offsets = [1e-7 if np.abs(points[:, 0]).max() < 200 else 0.001] * 2 + [0.001], points[0]
    header.vlrs.extend(wkt_of(laspy, wkt) if wkt else keys_of(laspy, *keys) if keys else [])
    survey = laspy.LasData(header)
    survey.x, survey.y, survey.z = points.T
    survey.classification = np.resize([2, 6], len(points))
    survey.return_number[:] = 1
    survey.number_of_returns[:] = 1
    survey.write(path)
    return path


def around(x: float, y: float, edge: float, z: float = 0.0) -> np.ndarray:
    """Corners of a square and its middle."""
    return np.array([[x, y, z], [x + edge, y, z], [x, y + edge, z], [x + edge, y + edge, z], [x, y, z]])


def degrees(city: maxjax.io.LoadedMap, *point: float) -> np.ndarray:
    earth = city.earth
    assert earth is not None
    found: np.ndarray = earth.geodetic(np.array([point]))[0, :2]
    return found


def wkt1(code: str) -> str:
    return str(pyproj.CRS(code).to_wkt("WKT1_GDAL"))


def test_the_unit_that_a_file_states_counts_more_than_that_of_its_system(tmp_path: Path) -> None:
    points = around(2_047_500.0, 1_270_000.0, 300.0, 100.0)
    keys = ((1024, 0, 1, 1), (3072, 0, 1, 26995), (3076, 0, 1, 9003))
    city = maxjax.load_map(las(tmp_path / "a.las", points, keys=keys))
    x, y = points[0, :2] * US_FOOT
    np.testing.assert_allclose(degrees(city, x, y, 0.0), [32.98886, -91.14565], atol=1e-5)
    assert any("not that of EPSG:26995" in remark for remark in city.file.remarks)
    assert (np.array(city.grid.lower) < [x, y, 100 * US_FOOT]).all()
    assert (np.array(city.grid.upper) > [x, y, 100 * US_FOOT]).all()


@pytest.mark.parametrize("code", ["EPSG:2263", "EPSG:2225", "EPSG:2256"])
def test_feet_become_metres(tmp_path: Path, code: str) -> None:
    foot = pyproj.CRS(code).axis_info[0].unit_conversion_factor
    area = pyproj.CRS(code).area_of_use
    assert area is not None
    x, y = pyproj.Transformer.from_crs("EPSG:4326", code, always_xy=True).transform(area.west + 0.5, area.south + 0.5)
    path = las(tmp_path / "a.las", around(round(x), round(y), 300.0, 90.0), wkt=wkt1(code))
    cloud = read_map(path)
    size = np.ptp(cloud.points, axis=0)
    np.testing.assert_allclose(size[:2], 300 * foot, atol=2e-3)
    np.testing.assert_allclose(cloud.points[0, 2] + cloud.offset[2], 90 * foot, atol=2e-3)
    city = maxjax.load_map(path)
    assert city.file.crs == code
    np.testing.assert_allclose(
        degrees(city, round(x) * foot, round(y) * foot, 0.0), [area.south + 0.5, area.west + 0.5], atol=1e-5
    )
    assert any("feet" in remark and "metres" in remark for remark in city.file.remarks)


DIALECTS = ("WKT1_GDAL", "WKT2_2015", "WKT2_2019")


@pytest.mark.parametrize(
    ("code", "expected", "dialect"),
    [
        *(("EPSG:32632", "EPSG:32632", dialect) for dialect in (*DIALECTS, "WKT1_ESRI")),
        *(("EPSG:28992", "EPSG:28992", dialect) for dialect in (*DIALECTS, "WKT1_ESRI")),
        # ESRI's dialect has no compound systems.
        *((f"EPSG:26910+{heights}", "EPSG:26910", dialect) for heights in (5703, 6360) for dialect in DIALECTS),
    ],
)
def test_systems_are_known_by_their_text(tmp_path: Path, code: str, expected: str, dialect: str) -> None:
    system = pyproj.CRS(code)
    area = (system.sub_crs_list[0] if system.sub_crs_list else system).area_of_use
    assert area is not None
    to_plane = pyproj.Transformer.from_crs("EPSG:4326", expected, always_xy=True)
    x, y = to_plane.transform(0.5 * (area.west + area.east), 0.5 * (area.south + area.north))
    path = las(tmp_path / "a.las", around(round(x), round(y), 60.0, 100.0), wkt=system.to_wkt(dialect))
    city, cloud = maxjax.load_map(path), read_map(path)
    assert city.file.crs == expected
    foot = US_FOOT if "6360" in code else 1.0
    assert cloud.points[0, 2] + cloud.offset[2] == pytest.approx(100 * foot, abs=2e-3)
    assert any("heights are in US survey feet" in remark for remark in city.file.remarks) == (foot != 1.0)


def test_degrees_become_metres(tmp_path: Path) -> None:
    points = np.array([[8.0, 47.0, 400.0], [8.01, 47.01, 400.0], [8.005, 47.005, 430.0]])
    keys = ((1024, 0, 1, 2), (2048, 0, 1, 4326))
    city = maxjax.load_map(las(tmp_path / "a.las", points, keys=keys))
    *_, width = pyproj.Geod(ellps="WGS84").inv(8.0, 47.005, 8.01, 47.005)
    extent = np.array(city.grid.upper) - city.grid.lower
    assert width < extent[0] < width + 2 * 20 + 8 * 2
    assert city.file.origin is not None
    np.testing.assert_allclose(degrees(city, 0.0, 0.0, 0.0), [47.005, 8.005], atol=1e-6)


def test_a_metre_of_web_mercator_is_no_metre(tmp_path: Path) -> None:
    points = around(1_113_195.0, 8_399_738.0, 200.0, 20.0)
    path = las(tmp_path / "a.las", points, wkt=wkt1("EPSG:3857"))
    cloud, city = read_map(path), maxjax.load_map(path)
    to_degrees = pyproj.Transformer.from_crs("EPSG:3857", "EPSG:4326", always_xy=True)
    west, south = to_degrees.transform(*points[0, :2])
    east, north = to_degrees.transform(*points[3, :2])
    *_, across = pyproj.Geod(ellps="WGS84").inv(west, south, east, south)
    *_, along = pyproj.Geod(ellps="WGS84").inv(west, south, west, north)
    np.testing.assert_allclose(np.ptp(cloud.points, axis=0)[:2], [across, along], rtol=1e-4)
    x, y = cloud.points[0, :2] + cloud.offset[:2]
    np.testing.assert_allclose(degrees(city, x, y, 0.0), [south, west], atol=1e-7)
    assert any("EPSG:3857" in remark for remark in city.file.remarks)


def test_swapped_axes_are_refused(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", around(447_000.0, 85_000.0, 60.0), wkt=wkt1("EPSG:28992"))
    with pytest.raises(FileError, match="swapped"):
        read_map(path)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (((1024, 0, 1, 1), (3072, 0, 1, 32767)), "no code, and no unit"),
        (((1024, 0, 1, 1), (3072, 0, 1, 26910), (3076, 0, 1, 4242)), "code 4242"),
        (((1024, 0, 1, 1), (3072, 0, 1, 2048)), "west and south"),
        (((1024, 0, 1, 3), (3072, 0, 1, 4978)), "expected"),
        (((1024, 0, 1, 1), (3072, 0, 1, 1)), "expected the name of a reference system"),
    ],
)
def test_what_is_no_metres_for_sure_is_refused(
    tmp_path: Path, keys: tuple[tuple[int, int, int, int], ...], message: str
) -> None:
    path = las(tmp_path / "a.las", around(500_000.0, 4_000_000.0, 60.0), keys=keys)
    with pytest.raises(FileError, match=message):
        read_map(path)


def test_a_user_says_what_a_file_does_not(tmp_path: Path) -> None:
    keys = ((1024, 0, 1, 1), (3072, 0, 1, 32767))
    path = las(tmp_path / "a.las", around(1_000.0, 2_000.0, 100.0, 50.0), keys=keys)
    cloud = read_map(path, Reading(unit="ft"))
    np.testing.assert_allclose(np.ptp(cloud.points, axis=0)[:2], 100 * FOOT, atol=1e-3)
    cloud = read_map(path, Reading(unit="ft", vertical_unit="m"))
    assert cloud.points[0, 2] + cloud.offset[2] == pytest.approx(50.0, abs=1e-3)
    named = read_map(path, Reading(crs="EPSG:2263"))
    np.testing.assert_allclose(np.ptp(named.points, axis=0)[:2], 100 * US_FOOT, atol=1e-3)
    assert named.reference.crs == "EPSG:2263"
    with pytest.raises(ValueError, match="crs: expected"):
        Reading(crs="EPSG:0")
    with pytest.raises(ValueError, match="unit: expected"):
        Reading(unit="furlong")


def test_the_text_behind_the_points_is_read(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy", reason="needs the extra las")
    path = las(tmp_path / "a.las", around(500_000.0, 5_500_000.0, 60.0), wkt=wkt1("EPSG:32632"))
    survey = laspy.read(path)
    survey.evlrs = laspy.vlrs.vlrlist.VLRList(wkt_of(laspy, wkt1("EPSG:32631")))
    survey.header.vlrs.clear()
    survey.write(path)
    assert read_map(path).reference.crs == "EPSG:32631"


def test_meshes_boxes_and_voxels_take_the_unit_that_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    (tmp_path / "a.csv").write_text("x_min,y_min,z_min,x_max,y_max,z_max\n0,0,0,10,20,30\n")
    np.savez(tmp_path / "a.npz", occupied=np.ones((4, 4, 4), bool), spacing=10.0, origin=np.array([5.0, 5.0, 5.0]))
    feet = Reading(unit="ft")
    assert read_map(tmp_path / "a.obj", feet).triangles.max() == pytest.approx(100 * FOOT)
    assert read_map(tmp_path / "a.csv", feet).corners.max() == pytest.approx(30 * FOOT)
    voxels = read_map(tmp_path / "a.npz", feet)
    assert (voxels.spacing, voxels.origin[0]) == (pytest.approx(10 * FOOT), pytest.approx(5 * FOOT))
    for name in ("a.csv", "a.npz"):
        with pytest.raises(FileError, match="plane in metres"):
            read_map(tmp_path / name, Reading(crs="EPSG:3857"))


def geotiff(path: Path, values: np.ndarray, *, crs: str = "EPSG:25832", **options: Any) -> Path:
    """A raster, its bands last; values from north to south and west to east."""
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    bands = values[..., None] if values.ndim == 2 else values
    place = options.pop("place", rasterio.Affine(2, 0, 500_000, 0, -2, 5_500_000))
    after = {name: options.pop(name) for name in ("scales", "offsets", "units") if name in options}
    shape = {"height": bands.shape[0], "width": bands.shape[1], "count": bands.shape[2], "dtype": bands.dtype}
    with rasterio.open(path, "w", driver="GTiff", transform=place, crs=crs, **shape, **options) as file:
        for number in range(bands.shape[2]):
            file.write(bands[:, :, number], number + 1)
        for name, value in after.items():
            setattr(file, name, value)
    return path


def heights(path: Path, reading: Reading = PLAIN) -> np.ndarray:
    found = read_map(path, reading)
    assert isinstance(found, Heights)
    return found.height.T[::-1]


@pytest.mark.parametrize(
    ("values", "options", "expected"),
    [
        (np.full((4, 4), 328.08, np.float32), {"units": ["US survey foot"]}, 328.08 * US_FOOT),
        (np.full((4, 4), 328.08, np.float32), {"units": ["ft"]}, 328.08 * FOOT),
        (np.full((4, 4), 328.08, np.float32), {"crs": "EPSG:25832+6360"}, 328.08 * US_FOOT),
        (np.full((4, 4), 25, np.uint8), {"scales": [2.0]}, 50.0),
        (np.full((4, 4), 1000, np.int16), {"scales": [0.01], "offsets": [40.0]}, 50.0),
        (np.full((4, 4), 50, np.float32), {"crs": "EPSG:25832+5783"}, 50.0),
    ],
)
def test_heights_of_a_raster_in_their_unit(
    tmp_path: Path, values: np.ndarray, options: dict[str, Any], expected: float
) -> None:
    found = heights(geotiff(tmp_path / "a.tif", values, **options))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_raster_in_feet_says_its_heights_or_is_asked(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    place = rasterio.Affine(2, 0, 988_000, 0, -2, 198_000)
    path = geotiff(tmp_path / "a.tif", np.full((5, 4), 100, np.float32), crs="EPSG:2263", place=place)
    with pytest.raises(FileError, match="--vertical-unit"):
        read_map(path)
    found = read_map(path, Reading(vertical_unit="us-ft"))
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.height, 100 * US_FOOT, rtol=1e-6)
    assert found.cell == (pytest.approx(2 * US_FOOT), pytest.approx(2 * US_FOOT))
    with pytest.raises(FileError, match="unit of heights"):
        read_map(geotiff(tmp_path / "b.tif", np.full((4, 4), 1, np.float32), units=["fathom"]))


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:4326"])
def test_a_raster_of_degrees_or_of_web_mercator_lies_on_a_plane(tmp_path: Path, crs: str) -> None:
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    corner, cell = ((10.0, 60.0), 1e-5) if crs == "EPSG:4326" else ((1_113_195.0, 8_399_738.0), 2.0)
    place = rasterio.Affine(cell, 0, corner[0], 0, -cell, corner[1])
    path = geotiff(tmp_path / "a.tif", np.full((40, 60), 7, np.float32), crs=crs, place=place)
    found = read_map(path)
    assert isinstance(found, Heights)
    to_degrees = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    (west, north), (east, south) = (
        to_degrees.transform(corner[0] + i * cell, corner[1] - j * cell) for i, j in ((0, 0), (60, 40))
    )
    geod = pyproj.Geod(ellps="WGS84")
    across, along = geod.inv(west, south, east, south)[2], geod.inv(west, south, west, north)[2]
    np.testing.assert_allclose(found.cell, [across / 60, along / 40], rtol=1e-4)


def test_a_turned_grid_is_refused(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    # LAEA far from its centre is neither true to scale nor turned to north.
    place = rasterio.Affine(50, 0, 6_500_000, 0, -50, 2_500_000)
    path = geotiff(tmp_path / "a.tif", np.full((40, 60), 7, np.float32), crs="EPSG:3035", place=place)
    with pytest.raises(FileError, match="turned"):
        read_map(path)


@pytest.mark.parametrize("value", [-9999.0, -32768.0, 9999.0, 0.0, -3.4e38, 12345.0])
def test_what_can_be_no_height_is_unknown(tmp_path: Path, value: float) -> None:
    values = np.full((12, 12), 250.0, np.float32) + np.arange(12, dtype=np.float32)
    values[2:5, 3:7] = value
    path = geotiff(tmp_path / "a.tif", values)
    expected = np.where(values == np.float32(value), np.nan, values)
    np.testing.assert_array_equal(heights(path), expected)
    city = maxjax.load_map(path)
    assert any("no height" in remark for remark in city.file.remarks)
    assert city.file.dropped["cells without a height"] == 12
    x, y = (int(np.floor((a - b) / 2)) for a, b in zip((500_009.0, 5_499_993.0), city.grid.lower[:2], strict=True))
    assert city.occupied[x, y].all()
    assert city.grid.lower[2] > 200.0


def test_real_heights_stay(tmp_path: Path) -> None:
    values = np.zeros((30, 30), np.float32)  # a town at sea level, with a tower of 300 m and a quarry
    values[10:14, 10:14] = 300.0
    values[20:25, 20:25] = -40.0
    np.testing.assert_array_equal(heights(geotiff(tmp_path / "a.tif", values)), values)


def test_bands_that_are_no_heights_are_refused(tmp_path: Path) -> None:
    colours = geotiff(tmp_path / "a.tif", np.full((4, 4, 3), 90, np.uint8), photometric="RGB")
    with pytest.raises(FileError, match="colours"):
        read_map(colours)
    two = np.stack([np.full((4, 4), 1.0), np.full((4, 4), 60.0)], axis=-1).astype(np.float32)
    path = geotiff(tmp_path / "b.tif", two)
    with pytest.raises(FileError, match="--band"):
        read_map(path)
    np.testing.assert_array_equal(heights(path, Reading(band=2)), 60.0)
    with pytest.raises(FileError, match="up to 2"):
        read_map(path, Reading(band=3))


def test_a_voxel_file_says_that_it_is_in_metres(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", occupied=np.ones((4, 4, 4), bool), spacing=1.0, origin=np.array([3e5, 6e4, 0.0]))
    city = maxjax.load_map(tmp_path / "a.npz", crs="EPSG:2263")
    assert (city.grid.spacing, *city.grid.origin[:2]) == (1.0, 3e5, 6e4)
    assert any("what is stated is taken" in remark for remark in city.file.remarks)


def test_texts_of_systems_end_in_metres_or_a_sentence() -> None:
    """Places lie where pyproj puts them by that text, on a plane true to scale; or the text is refused."""
    rng = np.random.default_rng(0)
    texts = [wkt1("EPSG:2263"), wkt1("EPSG:32632"), "EPSG:26910+6360", "urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783"]
    corners, geod, read = np.array([[500_000.0, 200_000.0], [500_060.0, 200_080.0]]), pyproj.Geod(ellps="WGS84"), 0
    for _ in range(MUTATIONS):
        text = bytearray(texts[rng.integers(len(texts))].encode())
        for _ in range(int(rng.integers(1, 4))):
            text[rng.integers(len(text))] = rng.integers(32, 127)
        name = text.decode()
        try:
            how = reference(Stated(name), PLAIN, corners, Path("a.las"))
        except FileError:
            continue
        read += 1
        if how.crs is None:
            continue
        to_degrees = pyproj.Transformer.from_crs(pyproj.CRS(name), "EPSG:4326", always_xy=True)
        (west, south), (east, north) = (to_degrees.transform(*corner) for corner in corners)
        true = geod.inv(west, south, east, north)[2]
        length = float(np.linalg.norm(np.ptp(how.plane(corners), axis=0)))
        assert length == pytest.approx(true, rel=0.006), name
    assert read > MUTATIONS // 20


def test_names_of_systems_in_json_are_those_of_pyproj() -> None:
    assert reference_system("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783").name == "EPSG:25832"
    for text in ("EPSG:7415", "https://www.opengis.net/def/crs/EPSG/0/7415", "urn:ogc:def:crs:EPSG::7415"):
        assert (reference_system(text).name, reference_system(text).kind) == ("EPSG:7415", "projected")
