"""`maxjax mission` and `maxjax plan --via`: a file of waypoints to plans, pictures and files, or one sentence."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import maxjax
from maxjax.ui.cli import main
from maxjax.ui.cli.options import PlanOptions
from maxjax.ui.request_files import KEYS, read_plan
from tests.scenes import SHAPE, gap_file

SAMPLE = Path(__file__).parents[3] / "docs" / "samples" / "quarter.geojson"
START, VIA, GOAL = "[6, 16, 10]", "[40, 8, 12]", "[40, 20, 12]"


@pytest.fixture
def town(tmp_path: Path) -> Path:
    return gap_file(tmp_path)


def written(town: Path, *waypoints: str, head: str = "") -> str:
    tables = "".join(f"[[waypoint]]\n{'' if '=' in one else 'at = '}{one}\n" for one in waypoints)
    file = town.parent / "round.toml"
    file.write_text(f'map = "town.npz"\nmethod = "astar"\n{head}\n{tables}')
    return str(file)


def around(town: Path) -> str:
    middle = f"at = {VIA}\nhover = 2.5\nspeed = 3.0"
    return written(town, START, middle, GOAL, head="return_to_start = true\nspeed = 6.0\nground = 2")


def told(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_a_way_beyond_the_data_of_its_map_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As long as shapely finds it outside of the hull of the footprints, but for the columns on its border."""
    city = maxjax.load_map(SAMPLE)
    assert city.earth is not None
    features = json.loads(SAMPLE.read_text())["features"]
    corners = [(y, x, 0.0) for one in features for x, y in np.reshape(one["geometry"]["coordinates"], (-1, 2))]
    hull = shapely.MultiPoint(city.earth.local(np.array(corners))[:, :2]).convex_hull
    file, out = tmp_path / "beyond.toml", tmp_path / "out"
    ends = ("[-150.0, 0.0, 30.0]", "[-75.0, 22.0, 35.0]", "[-70.0, 150.0, 30.0]")
    waypoints = "".join(f"[[waypoint]]\nat = {end}\n" for end in ends)
    file.write_text(f'map = "{SAMPLE}"\nmethod = "astar"\n{waypoints}')
    assert main(["mission", str(file), "--json"]) == 0
    captured = capsys.readouterr()
    told = re.search(r"Warning: ([\d.]+) m of the path lie outside of what the map's file covers", captured.err)
    assert told is not None
    path = shapely.LineString(np.array(json.loads(captured.out)["path"])[:, :2])
    flat = path.difference(hull).length  # the path climbs 5 m on its 75 m, and falls again
    assert flat - 4 * 3.0 < float(told[1]) < 1.01 * flat
    plan = ["plan", str(SAMPLE), "--method", "astar", "--start", "-75", "22", "5", "--goal"]
    assert main([*plan, "55", "-20", "8", "--out", str(out)]) == 0
    assert "outside of what" not in capsys.readouterr().err
    assert main([*plan, "-130", "0", "30"]) == 0
    assert "outside of what the map's file covers" in capsys.readouterr().err


def test_an_error_that_names_options_says_that_the_file_has_them_as_keys(
    town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = around(town)
    assert main(["mission", file, "--export", str(town.parent / "way.plan")]) == 2
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert sentence.endswith(f"give --place LAT LON H, or --crs (place and crs are keys of the file: {file})")
    assert main(["fly", written(town, START, GOAL, head='place = [52.0, 4.3, 0.0]\ncrs = "EPSG:28992"')]) == 2
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert sentence.endswith(f"leave one out (crs and place are keys of the file: {file})")


def test_a_mission_is_planned_drawn_and_written(tmp_path: Path, town: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    out, files = tmp_path / "out", [tmp_path / name for name in ("a.csv", "a.tum")]
    assert main(["mission", around(town), "--json", "--out", str(out), "--export", *map(str, files)]) == 0
    content = told(capsys)
    assert content == json.loads((out / "mission.json").read_text())
    assert sorted(file.name for file in out.iterdir()) == ["mission.json", "mission.png", "path.csv"]
    assert [leg["status"] for leg in content["legs"]] == ["OK", "OK", "OK"]
    assert [(leg["speed"], leg["hover"]) for leg in content["legs"]] == [(3.0, 2.5), (6.0, None), (6.0, None)]
    assert content["waypoints"] == [[6, 16, 10], [40, 8, 12], [40, 20, 12], [6, 16, 10]]
    assert content["length"] == pytest.approx(sum(leg["length"] for leg in content["legs"]))
    path, table = np.array(content["path"]), np.loadtxt(out / "path.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(path, table)
    rows = np.loadtxt(files[0], delimiter=",", skiprows=1)
    assert rows[-1, 0] == pytest.approx(content["duration"], abs=1e-5)
    for time, place in zip(content["times"], content["waypoints"], strict=True):
        assert np.linalg.norm(rows[np.abs(rows[:, 0] - time).argmin(), 1:4] - place) < 1.5
    hovering = (rows[:, 0] > content["times"][1]) & (rows[:, 0] < content["times"][1] + 2.5)
    np.testing.assert_allclose(rows[hovering, 1:4], np.broadcast_to([40, 8, 12], (hovering.sum(), 3)), atol=1e-5)


def test_points_of_interest_are_in_the_frame_of_the_waypoints_and_stand_in_the_mission(
    town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Heights above ground are heights of the map above its ground, of what is looked at as well."""
    file, out = town.parent / "a.csv", town.parent / "out"
    seen, heading = f"at = {VIA}\nhover = 3.0\nlook_at = [30, 30, 5]", f"at = {GOAL}\nheading = -90.0"
    head = 'frame = "local-agl"\nground = 2'
    mission = ["mission", written(town, START, seen, heading, head=head), "--json", "--export", str(file)]
    assert main([*mission, "--out", str(out)]) == 0
    content = told(capsys)
    assert [(leg["look_at"], leg["heading"]) for leg in content["legs"]] == [([30, 30, 7], None), (None, -90.0)]
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    hovering = (rows[:, 0] > content["times"][1]) & (rows[:, 0] < content["times"][1] + 2.9)
    np.testing.assert_allclose(rows[hovering, 10], np.arctan2(30 - 8, 30 - 40), atol=2e-3)
    assert abs(rows[-1, 10]) == pytest.approx(np.pi, abs=2e-3)
    again = read_plan(out / "mission.json")
    assert again is not None
    assert [stop.look_at for stop in again.stops] == [None, (30.0, 30.0, 5.0), None]


def test_plans_and_missions_replace_their_own_files_alone(tmp_path: Path, town: Path) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    ends = ["--start", "6", "16", "10", "--goal", "40", "20", "12", "--method", "astar", "--out", str(out)]
    assert main(["mission", around(town), "--out", str(out)]) == 0
    mission = (out / "mission.json").read_bytes()
    assert main(["plan", str(town), *ends]) == 0
    assert (out / "mission.json").read_bytes() == mission
    assert main(["mission", around(town), "--out", str(out)]) == 0
    assert {"plan.json", "plan.png", "mission.json", "mission.png"} < {file.name for file in out.iterdir()}


def test_tables_fit_80_columns(town: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """No word of a head, a status or a number is cut, with hovers and in national coordinates."""
    monkeypatch.setenv("COLUMNS", "80")
    far = np.array([84000.0, 446000.0, 0.0])
    occupied = np.zeros(SHAPE, bool)
    np.savez(town, occupied=occupied, spacing=2.0, origin=far)
    places = [str((far + np.array(json.loads(one))).tolist()) for one in (START, VIA, GOAL)]
    middle = f"at = {places[1]}\nhover = 2.5"
    assert main(["mission", written(town, places[0], middle, places[2])]) == 0
    shown = capsys.readouterr().out
    assert all(len(line) <= 80 for line in shown.splitlines())
    assert "…" not in shown
    assert "clearance" in shown
    assert "84040" in shown
    assert "446008" in shown


def test_via_is_the_same_mission(town: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mission", written(town, START, VIA, GOAL), "--json"]) == 0
    by_file = told(capsys)
    ends = ["--start", "6", "16", "10", "--goal", "40", "20", "12", "--via", "40", "8", "12"]
    assert main(["plan", str(town), *ends, "--method", "astar", "--json"]) == 0
    by_option = told(capsys)
    assert by_option["path"] == by_file["path"]
    assert len(by_option["legs"]) == 2
    assert main(["plan", str(town), *ends, "--return-to-start", "--method", "astar"]) == 0
    assert capsys.readouterr().out.count(" OK ") == 4  # three legs, and all


def test_a_leg_that_fails_is_named_and_nothing_is_written(
    tmp_path: Path, town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, csv = tmp_path / "out", tmp_path / "a.csv"
    file = written(town, START, VIA, "[24, 1, 1]", GOAL)
    assert main(["mission", file, "--out", str(out), "--export", str(csv)]) == 1
    error = capsys.readouterr().err
    assert "Leg 2 of 3: GOAL_OCCUPIED: The goal lies inside an obstacle" in error
    assert "goal (24, 1, 1)" in error
    assert "Leg 3 of 3: START_OCCUPIED" in error
    assert "Leg 2 failed, and nothing was written; --partial writes the legs before it." in error
    assert not out.exists()
    assert not csv.exists()


def test_partial_writes_the_legs_before(tmp_path: Path, town: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    out, csv = tmp_path / "out", tmp_path / "a.csv"
    file = written(town, START, VIA, "[24, 1, 1]", GOAL)
    assert main(["mission", file, "--partial", "--json", "--out", str(out), "--export", str(csv)]) == 1
    content = told(capsys)
    assert content["status"] == "GOAL_OCCUPIED"
    assert [leg["status"] for leg in content["legs"]] == ["OK", "GOAL_OCCUPIED", "START_OCCUPIED"]
    assert content["path"][0] == [6, 16, 10]
    assert content["path"][-1] == [40, 8, 12]
    assert np.loadtxt(csv, delimiter=",", skiprows=1)[-1, 1:4] == pytest.approx([40, 8, 12])
    assert (out / "mission.png").exists()
    # Later without a leg that can be flown: what was there is gone.
    assert main(["mission", written(town, START, "[24, 1, 1]", GOAL), "--partial", "--out", str(out)]) == 1
    assert not list(out.iterdir())


def test_waypoints_that_are_equal_or_outside_have_statuses(town: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mission", written(town, START, START, "[400, 0, 10]", GOAL), "--json"]) == 1
    statuses = [leg["status"] for leg in told(capsys)["legs"]]
    assert statuses == ["START_EQUALS_GOAL", "GOAL_OUTSIDE_MAP", "START_OUTSIDE_MAP"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "expected a map, as map = 'town.geojson', given none"),
        ('map = "town.npz"', "waypoint: expected at least two tables [[waypoint]], the start first, given None"),
        ('map = "town.npz"\nwaypoint = 3', "waypoint: expected at least two tables [[waypoint]], the start first, giv"),
        ("what is this", "expected a mission as TOML: Expected '=' after a key"),
        ("a = " + "[" * 3000, "expected a mission as TOML: "),
        ("\x00", "expected a mission as TOML: "),
        (
            'speeed = 3\nmap = "town.npz"',
            "speeed: expected one of acceleration, accuracy, airframe, airspace, ascent, autopilot, band, ",
        ),
        ('speed = "fast"\nmap = "town.npz"', "speed: expected a finite number, given 'fast'"),
        ("speed = nan", "speed: expected a finite number, given nan"),
        ("radius = true", "radius: expected a finite number, given True"),
        ("bounds = [1, 2, 3]", "bounds: expected 6 finite numbers in brackets, given [1, 2, 3]"),
        ('method = "magic"', "method: expected one of field, network, astar, rrtstar, apf, solver, given 'magic'"),
        ("method = [[1]]", "method: expected one of field"),
        ("return_to_start = 1", "return_to_start: expected true or false, given 1"),
        ("map = 1979-05-27", "map: expected a text, given datetime.date(1979, 5, 27)"),
        ("drop_class = 7", "drop_class: expected whole numbers in brackets, given 7"),
        ("only = [true]", "only: expected texts in brackets, given [True]"),
        ("band = 1.5", "band: expected a whole number, given 1.5"),
    ],
)
def test_a_file_of_nonsense_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert main(["mission", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"maxjax: error: {tmp_path / 'a.toml'}: {sentence}")
    assert captured.err.count("\n") == 1
    assert not captured.out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("waypoints", "sentence"),
    [
        ((START, "at = [1, 2]"), "waypoint 1: at: expected 3 finite numbers in brackets, given [1, 2]"),
        ((START, "at = [1, 2, inf]"), "waypoint 1: at: expected 3 finite numbers in brackets, given [1, 2, inf]"),
        ((START, f"at = [{'9' * 400}, 0, 0]"), "waypoint 1: at: expected 3 finite numbers"),
        ((START, "hover = 2"), "waypoint 1: expected at = [x, y, z], given none"),
        ((START, f"at = {GOAL}\nwait = 3"), "waypoint 1: expected the keys at, hover, speed, radius, margin, hea"),
        ((START, f"at = {GOAL}\nlook_at = 3"), "waypoint 1: look_at: expected 3 finite numbers in brackets, given 3"),
        ((START, f"at = {GOAL}\nheading = 400"), "waypoint 1: Waypoint.heading: expected degrees from -360 to 360"),
        ((START, f"at = {GOAL}\nhover = -1"), "waypoint 1: Waypoint.hover: expected seconds from 0 to 3600, given -1"),
        ((START, f"at = {GOAL}\nspeed = 0"), "waypoint 1: Waypoint.speed: expected a positive number of m/s, given 0"),
        ((f"at = {START}\nspeed = 3", GOAL), "waypoint 0: expected no speed: no leg leads to the start"),
        ((START,), "waypoint: expected at least two tables"),
    ],
)
def test_what_is_no_waypoint_is_one_sentence(
    town: Path, capsys: pytest.CaptureFixture[str], waypoints: tuple[str, ...], sentence: str
) -> None:
    file = written(town, *waypoints)
    assert main(["mission", file]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"maxjax: error: {file}: {sentence}")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("head", "sentence"),
    [
        ("radius = -1", "radius: expected a finite number of metres, at least 0"),
        ("speed = -2", "FlightLimits.speed: expected a positive finite number, given -2.0"),
        ("place = [4, 190, 0]\ncrs = 'EPSG:28992'", "--crs: expected one of --place and --crs"),
        ("bounds = [0, 0, 0, 0, 0, 0]", "bounds: expected finite minima below the maxima"),
    ],
)
def test_options_are_refused_as_those_of_plan(
    town: Path, capsys: pytest.CaptureFixture[str], head: str, sentence: str
) -> None:
    assert main(["mission", written(town, START, GOAL, head=head)]) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("maxjax: error: ")]
    assert len(error) == 1
    assert error[0].startswith(f"maxjax: error: {sentence}")


def test_a_file_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("nowhere.toml", "."):
        assert main(["mission", str(tmp_path / name)]) == 2
        assert capsys.readouterr().err.startswith("maxjax: error: ")
    (tmp_path / "a.toml").write_text(f'map = "nowhere.npz"\n[[waypoint]]\nat = {START}\n[[waypoint]]\nat = {GOAL}\n')
    assert main(["mission", str(tmp_path / "a.toml")]) == 2
    assert "nowhere.npz" in capsys.readouterr().err


def test_every_option_of_plan_may_stand_in_a_file() -> None:
    options = {field.name for field in dataclasses.fields(PlanOptions)}
    assert KEYS.keys() == options - {"start", "goal", "or_goal", "via", "out", "json", "export"}


@pytest.mark.large
def test_three_waypoints_and_a_keep_out_area_in_venice(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Over city blocks as OpenStreetMap has them, at latitudes and longitudes, around an area in the middle."""
    (source, *_) = sorted((data / "la_venice").glob("*.osm"))
    found = maxjax.load_map(source)
    assert found.earth is not None
    low, high = np.array(found.grid.lower), np.array(found.grid.upper)
    middle, span = 0.5 * (low + high), high - low
    corners = middle + np.array([[-25, -30, 0], [25, -30, 0], [25, 30, 0], [-25, 30, 0], [-25, -30, 0]])
    ring = found.earth.geodetic(corners)[:, 1::-1].tolist()
    area = {"type": "Feature", "properties": {"name": "school"}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (tmp_path / "school.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [area]}))
    # The straight lines between them lead through the area.
    places = middle + span * np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.2, 0.0]])
    tables = "".join(
        f"[[waypoint]]\nat = [{a}, {b}, 25.0]\n" for a, b, _ in found.earth.geodetic(places).round(7).tolist()
    )
    head = f'map = "{source}"\nframe = "agl"\nairspace = "school.geojson"\nceiling = 40.0\nreturn_to_start = true\n'
    (tmp_path / "venice.toml").write_text(head + tables)
    assert main(["mission", str(tmp_path / "venice.toml"), "--json", "--export", str(tmp_path / "v.plan")]) == 0
    content = told(capsys)
    assert [leg["status"] for leg in content["legs"]] == ["OK"] * 3
    path = np.array(content["path"])
    along = [np.linspace(a, b, 200) for a, b in itertools.pairwise(path)]
    aside = np.abs(np.concatenate(along)[:, :2] - middle[:2]) > [25.0, 30.0]
    assert aside.any(axis=1).all()
    items = json.loads((tmp_path / "v.plan").read_text())["mission"]["items"]
    # The take-off, the speed and the way, without points that only cost time.
    assert 4 <= len([item for item in items if item["command"] == 16]) <= len(content["path"])


def beside_the_wall(town: Path, radius: float, head: str = "") -> str:
    """A hover of 30 s 2 m from the wall."""
    middle = "at = [27.0, 16, 10]\nhover = 30.0"
    return written(town, GOAL, middle, VIA, head=f"radius = {radius}\nground = 2\n{head}")


NEAR = (
    "waypoint 1 (27, 16, 10) stands 2.00 m from an obstacle, nearer than the radius of 2.5 m, which is not kept around "
    "it, and the mission hovers there for 30 s"
)


def test_a_waypoint_nearer_than_the_radius_is_told_by_every_command(
    tmp_path: Path, town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = beside_the_wall(town, 2.5, "place = [52.07, 4.3, 10.0]")
    files = [tmp_path / name for name in ("a.plan", "a.waypoints", "a.geojson", "a.kml")]
    assert main(["mission", file, "--json", "--export", *map(str, files)]) == 0
    captured = capsys.readouterr()
    assert f"Warning: {NEAR}; --keep-radius refuses that." in captured.err
    (near,) = json.loads(captured.out)["near_waypoints"]
    assert (near["number"], near["clearance"], near["radius"], near["hover"]) == (1, 2.0, 2.5, 30.0)
    assert NEAR in json.loads(files[0].read_text())["maxjax"]["remarks"]
    features = json.loads(files[2].read_text())["features"]
    assert [one["properties"].get("radius_not_kept") for one in features[:2]] == [NEAR, NEAR]
    ends = ["--start", "27", "16", "10", "--goal", "40", "8", "12", "--radius", "2.5", "--method", "astar"]
    assert main(["plan", str(town), *ends]) == 0
    assert "stands nearer to an obstacle than the radius of 2.5 m" in capsys.readouterr().err
    assert main(["plan", str(town), *ends, "--via", "40", "20", "12"]) == 0
    assert "Warning: the start (27, 16, 10) stands 2.00 m from an obstacle" in capsys.readouterr().err


@pytest.mark.parametrize("how", ["option", "key"])
def test_it_is_refused_where_the_radius_is_to_be_kept(
    tmp_path: Path, town: Path, capsys: pytest.CaptureFixture[str], how: str
) -> None:
    key = "keep_radius = true" if how == "key" else ""
    file = beside_the_wall(town, 2.0, key)
    options = ["--keep-radius"] if how == "option" else []
    out = [*options, "--out", str(tmp_path / "out"), "--export", str(tmp_path / "a.csv")]
    assert main(["mission", file, *out]) == 0
    beside_the_wall(town, 2.5, key)
    capsys.readouterr()
    before = (tmp_path / "a.csv").read_text()
    assert main(["mission", file, *out]) == 1
    assert f"Refused: {NEAR}; move it" in capsys.readouterr().err
    assert (tmp_path / "a.csv").read_text() == before
    assert not list((tmp_path / "out").iterdir())
    if how == "key":
        assert main(["fly", file]) == 2
        assert f"maxjax: error: {NEAR}; move it" in capsys.readouterr().err
    ends = ["--start", "27", "16", "10", "--goal", "40", "8", "12", "--radius", "2.5", "--method", "astar"]
    assert main(["plan", str(town), *ends, "--keep-radius", "--export", str(tmp_path / "b.csv")]) == 1
    assert not (tmp_path / "b.csv").exists()
