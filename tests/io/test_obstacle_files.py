"""The FAA's Digital Obstacle File as prisms, beside arithmetic and geodesics of pyproj."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax import Status
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.reader import read_map
from maxjax.io.readers.obstacle_file import load_obstacles
from maxjax.io.reading import Reading

shapely = pytest.importorskip("shapely", reason="needs shapely (extra dev)")

FOOT = 0.3048
HEAD = [
    "  CURRENCY DATE = 08/02/26",
    f"{'':36} LATITUDE     LONGITUDE     OBSTACLE",
    "OAS#      V CO ST CITY",
    "-" * 127,
]


def line(latitude: str, longitude: str, kind: str = "TOWER", agl: int = 256, amsl: int = 456, **more: str) -> str:
    """One line in fixed columns, as public ones are."""
    given = {"name": "27-000127", "quantity": "1", "accuracy": "1A", "action": "C"} | more
    horizontal, vertical = given["accuracy"]
    text = f"{given['name']:9} O US MN {'MINNEAPOLIS':16} {latitude} {longitude} {kind:18} {given['quantity']} "
    text += f"{agl:05d} {amsl:05d} D {horizontal} {vertical} N {'2015AGL00210OE':14} {given['action']} 2017153 "
    assert len(text) == 128
    return text


def csv_of(*rows: tuple[float, float, str, int, int, str, str]) -> str:
    head = (
        "OAS,VERIFIED STATUS,COUNTRY,STATE,CITY,LATDEC,LONDEC,DMSLAT,DMSLON,TYPE,QUANTITY,AGL,AMSL,LIGHTING,ACCURACY,"
    )
    found = [f"{head}MARKING,FAA STUDY,ACTION,JDATE"]
    for latitude, longitude, kind, agl, amsl, accuracy, action in rows:
        found.append(
            f"27-1,O,US,MN,MINNEAPOLIS,{latitude},{longitude},,,{kind},1,{agl},{amsl},D,{accuracy},N,,{action},2017"
        )
    return "\n".join(found) + "\n"


FIRST, SECOND = ("44 58 30.00N", "093 15 36.00W"), ("44 58 33.60N", "093 15 32.40W")


def written(folder: Path, *lines: str, name: str = "27-MN.Dat") -> Path:
    (folder / name).write_text("\n".join([*HEAD, *lines]) + "\n")
    return folder / name


def test_an_obstacle_is_a_prism_about_its_place_with_all_that_is_not_certain(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj", reason="needs the extra geo")
    file = written(
        tmp_path,
        line(*FIRST, accuracy="3C"),
        line(*SECOND, "WINDMILL", 400, 650, accuracy="1A"),
        line(*SECOND, "CATENARY", 100, 300, accuracy="9I"),
    )
    found = read_map(file)
    assert isinstance(found, Footprints)
    places = [(44 + 58.5 / 60, -(93 + 15.6 / 60)), (44 + 58.56 / 60, -(93 + 15.54 / 60))]
    expected = [
        (places[0], 5.0 + 100 * FOOT, 200 * FOOT, (456 + 20) * FOOT),
        (places[1], 200 * FOOT + 20 * FOOT, 250 * FOOT, (650 + 3) * FOOT),
        (places[1], 5.0 + 1852.0, 200 * FOOT, (300 + 1000) * FOOT),
    ]
    assert found.reference.origin is not None
    longitude, latitude = found.reference.origin
    middle = pyproj.Transformer.from_crs(
        "EPSG:4326", f"+proj=aeqd +lat_0={latitude} +lon_0={longitude} +ellps=WGS84", always_xy=False
    )
    for prism, ((lat, lon), reach, base, top) in zip(found.buildings, expected, strict=True):
        centre = np.array(middle.transform(lat, lon))
        distance = np.hypot(*(prism.rings[0] - centre).T)
        assert shapely.Polygon(prism.rings[0]).covers(shapely.Point(*centre).buffer(reach * 0.999))
        assert distance.max() <= 1.021 * reach + 0.1
        assert (prism.base, prism.top) == pytest.approx((base, top))
    assert found.read == {"TOWER": 1, "WINDMILL": 1, "CATENARY": 1}
    assert found.remarks[1] == "1 obstacles have no known accuracy: 1852 m around, or 305 m above, is taken"
    assert found.remarks[2].startswith("1 obstacles carry wires whose course is not stated")


def test_lines_and_csv_say_the_same(tmp_path: Path) -> None:
    lines = read_map(written(tmp_path, line(*FIRST, accuracy="2B"), line(*SECOND, agl=99, amsl=320, accuracy="4D")))
    rows = csv_of((44.975, -93.26, "TOWER", 256, 456, "2B", "C"), (44.976, -93.259, "TOWER", 99, 320, "4D", "A"))
    (tmp_path / "DOF.CSV").write_text(rows)
    table = read_map(tmp_path / "DOF.CSV")
    assert isinstance(lines, Footprints)
    assert isinstance(table, Footprints)
    for one, other in zip(lines.buildings, table.buildings, strict=True):
        assert (one.base, one.top) == (other.base, other.top)
        np.testing.assert_allclose(one.rings[0], other.rings[0], atol=1e-3)


def test_what_is_not_understood_or_gone_is_counted(tmp_path: Path) -> None:
    bad = line(*FIRST)
    file = written(
        tmp_path, line(*FIRST), line(*SECOND, action="D"), bad[:60], bad.replace("00256", "0O256"),
        bad.replace("44 58", "94 58"),
        bad.replace("44 58", "44 61"), bad.replace("00W", "00X"), line(*FIRST, agl=0), "free text",
    )  # fmt: skip
    found = load_obstacles(file)
    assert len(found.buildings) == 1
    assert found.dropped == {"dismantled obstacles": 1, "lines that are no obstacle": 7}
    rows = csv_of((44.975, -93.26, "TOWER", 256, 456, "2B", "C"), (99.0, -93.26, "TOWER", 99, 320, "4D", "A"))
    (tmp_path / "a.csv").write_text(rows + "27-2,O,US\n")
    assert load_obstacles(tmp_path / "a.csv").dropped == {"lines that are no obstacle": 2}


def test_files_that_cannot_be_used_get_one_sentence(tmp_path: Path) -> None:
    far = line("46 58 30.00N", "093 15 36.00W")
    cases = {
        "no obstacle": (written(tmp_path, "nothing", name="a.dat"), r"found none \(1 lines that are no obstacle\)"),
        "none left": (written(tmp_path, line(*FIRST, action="D"), name="b.dat"), r"found none \(1 dismantled"),
        "a state": (written(tmp_path, line(*FIRST), far, name="c.dat"), "crop it: keep the lines of obstacles around"),
        "a pole": (written(tmp_path, line("90 00 00.00N", "093 15 36.00W"), name="d.dat"), "within 85 degrees"),
        "tall": (written(tmp_path, line(*FIRST, agl=9999, amsl=9999), name="e.dat"), "height of up to 2000 m"),
    }
    for file, sentence in cases.values():
        with pytest.raises(ValueError, match=sentence) as caught:
            read_map(file)
        assert file.name in str(caught.value)
        assert "\n" not in str(caught.value)
    good = written(tmp_path, line(*FIRST))
    for reading in (Reading(crs="EPSG:4326"), Reading(vertical_unit="ft")):
        with pytest.raises(ValueError, match="leave --crs and units out"):
            read_map(good, reading)


def test_no_plan_leads_through_an_obstacle_wherever_it_may_stand(tmp_path: Path) -> None:
    """At 9 m above ground, 20 m beside the stated place of a tower that is true to 50 ft."""
    where = "44 58 30.00N", "093 15 36.00W"
    city = maxjax.load_map(
        written(tmp_path, line(*where, accuracy="2A")), bounds=[-40, -40, 59, 40, 40, 87], spacing=2.0
    )
    ground = 200 * FOOT
    blocked = maxjax.plan(city, (-36.0, 0.0, ground + 9), (14.0, 14.0, ground + 9), planner=maxjax.AStar(),
                          distances=maxjax.Distances(margin=4.0))  # fmt: skip
    assert blocked.status == Status.GOAL_OCCUPIED
    around = maxjax.plan(city, (-36.0, 0.0, ground + 9), (36.0, 0.0, ground + 9), planner=maxjax.AStar(),
                         distances=maxjax.Distances(margin=4.0))  # fmt: skip
    assert around.status == Status.OK
    assert np.hypot(around.path[:, 0], around.path[:, 1]).min() >= 5.0 + 50 * FOOT


def test_heights_of_obstacles_count_from_sea_level(tmp_path: Path) -> None:
    """A ground at 200 ft above the sea is z = 61 m of a map whose zero is the sea."""
    city = maxjax.load_map(written(tmp_path, line(*FIRST)), bounds=(-50.0, -50.0, 50.0, 50.0, 50.0, 200.0))
    assert city.earth is not None
    assert city.earth.zero.above_sea == 0.0
    found = read_map(written(tmp_path, line(*FIRST)))
    assert isinstance(found, Footprints)
    assert found.buildings[0].base == pytest.approx(200 * FOOT)
