"""Landing on roofs and alternative goals from files and arguments: `maxjax mission`, `maxjax plan`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax.ui.cli import main
from maxjax.ui.mission_text import mission_text
from maxjax.ui.request_files import read_plan

START = ("--start", "-12", "-12", "4")
FAST = ("--method", "astar", "--margin", "3")


@pytest.fixture
def houses(tmp_path: Path) -> str:
    """Two houses of 10 by 10 m, 6 and 9 m high, the second twice as far from the start as the first."""

    def feature(x: float, height: float, name: str) -> dict[str, Any]:
        east, north = 84_000.0 + x, 446_000.0
        ring = [[east, north], [east + 10.0, north], [east + 10.0, north + 10.0], [east, north + 10.0], [east, north]]
        own = {"height": height, "building": "yes", "id": name}
        return {
            "type": "Feature",
            "id": name,
            "properties": own,
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }

    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    file = tmp_path / "houses.geojson"
    features = [feature(0.0, 6.0, "near"), feature(24.0, 9.0, "far")]
    file.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return str(file)


def start_of(houses: str) -> list[float]:
    """A free place south-west of both houses, 4 m up, in the map's coordinates."""
    city = maxjax.load_map(houses, spacing=1.0)
    x, y, _ = maxjax.find_landing(city, "near").position
    return [x - 15.0, y - 12.0, 4.0]


def test_a_mission_lands_on_the_roof_that_it_names(houses: str, tmp_path: Path, capsys: Any) -> None:
    """The last item of the file is at the roof's height, and mission.json makes the same request again."""
    start, out = start_of(houses), tmp_path / "out"
    file = tmp_path / "roof.toml"
    head = 'map = "houses.geojson"\nspacing = 1.0\nmethod = "astar"\nheight_of_zero = 2.0\n'
    head += 'land_on = "near"\nlanding_height = 4.0\n'
    file.write_text(f"{head}[[waypoint]]\nat = {start}\n")
    export = tmp_path / "roof.plan"
    assert main(["mission", str(file), "--out", str(out), "--export", str(export)]) == 0
    assert "it lands on the roof of near" in " ".join(capsys.readouterr().err.split())
    told = json.loads((out / "mission.json").read_text())
    assert told["landing"]["position"][2] == 6.0
    assert told["path"][-1][2] == pytest.approx(10.0)
    last = json.loads(export.read_text())["mission"]["items"][-1]
    assert last["command"] == 21
    assert last["params"][6] == pytest.approx(6.0, abs=0.01)
    asked, again = maxjax.load_mission(file), read_plan(out / "mission.json")
    assert again is not None
    assert again.roofs == asked.roofs == ("near",)
    (tmp_path / "again.toml").write_text(mission_text(asked))
    assert maxjax.load_mission(tmp_path / "again.toml") == asked


def test_of_several_roofs_the_cheapest_to_reach_is_taken(houses: str, capsys: Any) -> None:
    """Whatever the order in which they are named; and the other one, by a place on it."""
    start = [str(x) for x in start_of(houses)]
    common = ["plan", houses, "--spacing", "1", "--json", *FAST, "--start", *start]
    for order in (("near", "far"), ("far", "near")):
        assert main([*common, *(word for name in order for word in ("--land-on", name))]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["landing"]["name"] == "near"
        (choice,) = told["choices"]
        assert choice["taken"] == order.index("near") == int(np.argmin(choice["costs"]))
    x, y = (float(start[0]) + 15.0 + 24.0, float(start[1]) + 12.0)
    assert main([*common, "--land-at", str(x), str(y)]) == 0
    assert json.loads(capsys.readouterr().out)["landing"]["name"] == "far"


def test_a_roof_without_room_gives_way_to_another_and_else_is_refused(houses: str, capsys: Any) -> None:
    """With the figures that were found; 5 m is half of the roof, but for the samples' spacing."""
    start = [str(x) for x in start_of(houses)]
    common = ["plan", houses, "--spacing", "1", *FAST, "--start", *start]
    assert main([*common, "--land-on", "near", "--landing-radius", "6"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "expected 6 m of clear roof" in said
    assert "found 4." in said
    for more, sentence in (
        (["--land-on", "nowhere"], "expected a building of the map, given 'nowhere'"),
        (["--land-on", "near", "--landing-radius", "0.5"], "expected at least the radius that the vehicle keeps, 1 m"),
        (["--land-on", "near", "--return-to-start"], "leave one out"),
        ([], "expected both or none, given one"),
        (["--land-on", "near", "--or-goal", "1", "2", "3"], "expected with a goal"),
    ):
        assert main([*common, *more]) == 2
        assert sentence in " ".join(capsys.readouterr().err.split())


def test_alternative_goals_of_a_plan_and_of_a_mission(houses: str, tmp_path: Path, capsys: Any) -> None:
    """On the command line and in a file, in latitude and longitude as well."""
    x, y, z = start_of(houses)
    far, near = (x + 40.0, y, z), (x - 5.0, y + 3.0, z)
    words = [str(number) for place in ((x, y, z), far, near) for number in place]
    ends = ["--start", *words[:3], "--goal", *words[3:6], "--or-goal", *words[6:]]
    assert main(["plan", houses, "--spacing", "1", "--json", *FAST, *ends]) == 0
    told = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(told["path"][-1], near, atol=1e-6)
    earth = maxjax.load_map(houses, spacing=1.0).earth
    assert earth is not None
    on_earth = earth.geodetic(np.array([(x, y, z), far, near]))
    a, b, c = ([north, east, 4.0] for north, east, _ in on_earth.tolist())
    file = tmp_path / "agl.toml"
    head = 'map = "houses.geojson"\nspacing = 1.0\nmethod = "astar"\nmargin = 3.0\nframe = "agl"\n'
    file.write_text(f"{head}[[waypoint]]\nat = {a}\n[[waypoint]]\nat = {b}\nalternatives = [{c}]\n")
    assert main(["mission", str(file), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(told["path"][-1], near, atol=0.05)
    assert told["choices"][0]["taken"] == 1
    assert maxjax.load_mission(file).waypoints[1].alternatives == (tuple(c),)
