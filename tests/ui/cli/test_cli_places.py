"""`maxjax plan` with ends on Earth and rules of the air."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from maxjax.io.geo.earth import project
from maxjax.ui.cli import main

SAMPLE = Path(__file__).parents[3] / "docs" / "samples" / "quarter.geojson"
ORIGIN = np.array([8.0, 47.0])
START, GOAL = (-75.0, 22.0, 5.0), (55.0, -20.0, 8.0)
ENDS = ("--start", *map(str, START), "--goal", *map(str, GOAL))


def degrees(x: float, y: float) -> tuple[float, float]:
    """Latitude and longitude of a point of the sample."""
    east, north = project(ORIGIN[None] + 1e-3, ORIGIN)[0]
    return 47.0 + 1e-3 * y / north, 8.0 + 1e-3 * x / east


def on_earth(point: tuple[float, float, float], height: float) -> list[str]:
    return [repr(float(number)) for number in (*degrees(*point[:2]), height)]


def areas(folder: Path, *rings: list[tuple[float, float]], **properties: object) -> Path:
    file = folder / "areas.geojson"
    features = [
        {
            "type": "Feature",
            "properties": {"name": "school", **properties},
            "geometry": {"type": "Polygon", "coordinates": [[degrees(*p)[::-1] for p in [*ring, ring[0]]]]},
        }
        for ring in rings
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


class Plans:
    """Plans the sample by A*: code, document or None, and the last line on stderr."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *options: object, map: Path = SAMPLE) -> tuple[int, dict[str, object], str]:
        code = main(["plan", str(map), "--method", "astar", "--json", *(str(option) for option in options)])
        out, err = self._capsys.readouterr()
        assert "Traceback" not in err
        return code, json.loads(out) if out else {}, err.splitlines()[-1]


@pytest.fixture
def plans(capsys: pytest.CaptureFixture[str]) -> Plans:
    return Plans(capsys)


def test_ends_on_earth_give_the_path_of_the_map_s_own_coordinates(plans: Plans) -> None:
    code, here, _ = plans(*ENDS, "--ground", 0)
    assert code == 0
    path = np.array(here["path"])
    for frame in ("agl", "amsl"):
        ends = ["--start", *on_earth(START, 5.0), "--goal", *on_earth(GOAL, 8.0)]
        code, again, _ = plans(*ends, "--frame", frame, "--ground", 0)
        assert code == 0
        np.testing.assert_allclose(again["path"], path, atol=1e-5)
    code, again, _ = plans(*ENDS, "--frame", "local-agl", "--ground", 0)
    assert code == 0
    np.testing.assert_allclose(again["path"], path, atol=1e-9)
    places = np.array(here["path_geodetic"])
    np.testing.assert_allclose(places, [(*degrees(x, y), z) for x, y, z in path], rtol=0, atol=1e-8)


def test_the_path_is_written_in_both(tmp_path: Path, plans: Plans) -> None:
    pytest.importorskip("matplotlib")
    assert (
        plans(*ENDS, "--out", tmp_path, "--airspace", areas(tmp_path, [(-9, -9), (9, -9), (9, 50), (-9, 50)]))[0] == 0
    )
    with (tmp_path / "path.csv").open() as file:
        rows = [[float(row[name]) for name in row] for row in csv.DictReader(file)]
    content = json.loads((tmp_path / "plan.json").read_text())
    np.testing.assert_array_equal(rows, np.hstack([content["path"], content["path_geodetic"]]))
    assert content["configuration"]["airspace"].endswith("areas.geojson")
    assert (tmp_path / "plan.png").stat().st_size > 10_000


def test_an_area_across_the_way_is_passed_by(tmp_path: Path, plans: Plans) -> None:
    shapely = pytest.importorskip("shapely", reason="needs shapely (extra dev)")
    ring = [(-15.0, -30.0), (20.0, -30.0), (20.0, 40.0), (-15.0, 40.0)]
    code, found, _ = plans(*ENDS, "--airspace", areas(tmp_path, ring), "--floor", 2, "--ceiling", 40)
    assert code == 0
    path, free = np.array(found["path"]), np.array(plans(*ENDS)[1]["path"])
    assert not shapely.LineString(path[:, :2]).intersects(shapely.Polygon(ring))
    assert shapely.LineString(free[:, :2]).intersects(shapely.Polygon(ring))
    assert path[:, 2].min() >= 2.0
    # Over an area of 20 m one may fly.
    code, over, _ = plans(*ENDS, "--airspace", areas(tmp_path, ring, lower=0, upper=20), "--margin", 2)
    assert code == 0
    points = np.concatenate([np.linspace(a, b, 200) for a, b in zip(over["path"], over["path"][1:], strict=False)])
    inside = shapely.contains_xy(shapely.Polygon(ring), points[:, 0], points[:, 1])
    assert points[inside, 2].min(initial=math.inf) >= 20.0


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        (["--floor", "6"], "START_OUTSIDE_BAND", "the voxel of (-75, 22, 5) is below 6 m above ground"),
        (["--ceiling", "7"], "GOAL_OUTSIDE_BAND", "the voxel of (55, -20, 8) is above 7 m above ground"),
        (["--ceiling-above-start", "2"], "GOAL_OUTSIDE_BAND", "the voxel of (55, -20, 8) is above z = 7 m"),
        (["--airspace", "here"], "START_IN_CLOSED_AREA", "is in the keep-out area 'school'"),
        (["--airspace", "kept"], "START_IN_CLOSED_AREA", "is not in the keep-in area 'school'"),
    ],
)
def test_ends_against_the_rules_have_a_status_and_a_sentence(
    tmp_path: Path, plans: Plans, options: list[str], status: str, words: str
) -> None:
    if options[1] == "here":
        options = ["--airspace", str(areas(tmp_path, [(-80, 18), (-70, 18), (-70, 30), (-80, 30)]))]
    if options[1] == "kept":
        options = ["--airspace", str(areas(tmp_path, [(20, -60), (80, -60), (80, 30), (20, 30)], inclusion=True))]
    code, found, message = plans(*ENDS, "--ground", 0, *options)
    assert (code, found["status"], found["path"], found["path_geodetic"]) == (1, status, [], [])
    assert status in message
    assert words in message


def test_a_way_that_the_rules_close_says_so(tmp_path: Path, plans: Plans) -> None:
    wall = areas(tmp_path, [(-20, -990), (0, -990), (0, 990), (-20, 990)])
    for options, status in ((["--airspace", wall], "NO_VALID_PATH"), (["--floor", 4, "--ceiling", 9], "NO_SAFE_PATH")):
        code, found, message = plans(*ENDS, "--ground", 0, *options)
        assert (code, found["status"]) == (1, status)
        assert "the rules of the air close" in message


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--frame", "agl", *ENDS], "place: expected one within 100 km of the map"),
        (
            ["--frame", "agl", "--start", "8.0", "47.0", "5", "--goal", "47", "8", "9"],
            "place: expected one within 100 km",
        ),
        (["--frame", "agl", "--start", "95", "8", "5", "--goal", "47", "8", "9"], "latitude: expected degrees"),
        (
            ["--frame", "amsl", "--start", "nan", "8", "5", "--goal", "47", "8", "9"],
            "place: expected latitude, longitude",
        ),
        (["--frame", "agl", "--start", "47.1", "8", "5", "--goal", "47", "8", "9"], "place: expected one in the map"),
        ([*ENDS, "--floor", "nan"], "floor: expected a height"),
        ([*ENDS, "--floor", "20", "--ceiling", "10"], "ceiling: expected more than the floor"),
        ([*ENDS, "--crs", "EPSG:28992"], "--crs: EPSG:4326 of the file is in degrees"),
        ([*ENDS, "--airspace", "nowhere.geojson"], "nowhere.geojson: cannot be read"),
    ],
)
def test_what_cannot_be_used_gets_one_sentence(plans: Plans, options: list[str], sentence: str) -> None:
    code, found, message = plans(*options)
    assert (code, found) == (2, {})
    assert sentence in message


def test_a_map_without_a_place_or_ground_says_what_is_missing(tmp_path: Path, plans: Plans) -> None:
    box = tmp_path / "box.npz"
    np.savez(box, occupied=np.zeros((24, 16, 12), bool), spacing=2.0, origin=np.zeros(3))
    ends = ["--start", "6", "16", "10", "--goal", "40", "14", "12"]
    place = ["--place", "47", "8", "0"]
    file = areas(tmp_path, [(20, 8), (30, 8), (30, 20), (20, 20)])
    for options, sentence in (
        (["--frame", "agl"], "--frame agl: the map does not say where it lies on Earth; give --place"),
        (["--airspace", file], "the map does not say where it lies; give --place"),
        (["--floor", "3"], "airspace: expected a map with ground below heights above ground"),
    ):
        code, _, message = plans(*ends, *options, map=box)
        assert code == 2
        assert sentence in message
    code, _, message = plans(
        "--start", "47", "8", "10", "--goal", "47.0001", "8.0002", "10", "--frame", "agl", *place, map=box
    )
    assert code == 2
    assert "where it has none" in message
    code, found, _ = plans(*ends, *place, "--airspace", file, "--floor", 3, "--ground", 2, map=box)
    assert (code, found["status"]) == (0, "OK")
    assert len(found["path_geodetic"]) == len(found["path"])


def test_a_map_that_says_where_it_lies_takes_no_other_place(plans: Plans) -> None:
    for options, sentence in (
        (["--place", "45", "7", "450"], "--place: expected a map that does not say where it lies, and this one does"),
        (["--place", "45", "7", "450", "--height-of-zero", "450"], "--height-of-zero: expected one height of z = 0"),
        (["--height-of-zero", "nan"], "height: expected metres for z = 0"),
        (["--accuracy", "-1"], "accuracy: expected a distance of at least 0 m"),
    ):
        code, _, message = plans(*ENDS, *options)
        assert code == 2
        assert sentence in message


def test_the_height_of_zero_moves_what_counts_from_sea_level(tmp_path: Path, plans: Plans) -> None:
    file = areas(tmp_path, [(-90, -60), (90, -60), (90, 60), (-90, 60)], lower=480, lowerReference="AMSL")
    code, found, _ = plans(*ENDS, "--airspace", file, "--height-of-zero", 450)
    assert (code, found["heights"]) == (0, "above sea level (as stated)")
    assert max(place[2] for place in found["path_geodetic"]) < 480.0
    code, found, _ = plans(*ENDS, "--airspace", file, "--height-of-zero", 478)
    assert (code, found["status"]) == (1, "START_IN_CLOSED_AREA")


def test_the_hague_by_its_own_coordinates_and_by_latitudes(data: Path, plans: Plans) -> None:
    city = data / "the_hague" / "DenHaag_01.city.json"
    crs = ["--crs", "EPSG:7415"]  # with its heights above NAP
    code, here, _ = plans("--start", 78420.3, 457800.4, 30, "--goal", 78800.6, 458080.3, 30, *crs, map=city)
    assert code == 0
    (a, b, _), *_, (c, d, _) = here["path_geodetic"]
    code, again, _ = plans("--start", a, b, 30, "--goal", c, d, 30, "--frame", "amsl", *crs, map=city)
    assert code == 0
    np.testing.assert_allclose(again["path"], here["path"], rtol=0, atol=2e-3)


def test_the_command_of_the_page_runs_on_its_sample(plans: Plans) -> None:
    page = (SAMPLE.parents[1] / "airspace.md").read_text().split("```bash")[1].split("```")[0]
    map, *options = page.replace("\\\n", " ").split()[2:]
    options = [str(SAMPLE.parents[2] / word) if word.endswith(".geojson") else word for word in options]
    code, found, _ = plans(*options[: options.index("--out")], map=SAMPLE.parents[2] / map)
    assert (code, found["status"]) == (0, "OK")
    straight = math.dist(found["path"][0], found["path"][-1])
    assert found["length"] > straight + 5.0


def test_a_mission_by_latitudes_names_the_leg_into_an_area(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    school = areas(tmp_path, [(-15.0, -30.0), (20.0, -30.0), (20.0, 40.0), (-15.0, 40.0)])
    for middle, status in (((0.0, 70.0, 30.0), "OK"), ((0.0, 10.0, 30.0), "GOAL_IN_CLOSED_AREA")):
        rows = [", ".join(on_earth(point, point[2])) for point in (START, middle, GOAL)]
        file = tmp_path / "round.toml"
        file.write_text(
            f'map = "{SAMPLE}"\nmethod = "astar"\nframe = "agl"\nground = 0\nairspace = "{school.name}"\n'
            + "".join(f"[[waypoint]]\nat = [{row}]\n" for row in rows)
        )
        code = main(["mission", str(file), "--json"])
        out, err = capsys.readouterr()
        legs = [leg["status"] for leg in json.loads(out)["legs"]]
        if status == "OK":
            assert (code, legs) == (0, ["OK", "OK"])
            np.testing.assert_allclose(json.loads(out)["path"][0], START, atol=1e-5)
        else:
            assert (code, legs) == (1, [status, status.replace("GOAL", "START")])
            assert "is in the keep-out area 'school'" in err
