"""`maxjax plan --export`: files for other programs, by their endings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from maxjax.io.geo.earth import TangentPlane
from maxjax.ui.cli import main
from tests.scenes import gap_file

SHAPE = (24, 16, 12)
PLACE = ("52.07", "4.3", "10")


@pytest.fixture
def town(tmp_path: Path) -> str:
    return str(gap_file(tmp_path))


def plan(town: str, *options: object) -> int:
    ends = ["--start", "6", "16", "10", "--goal", "40", "14", "12"]
    return main(["plan", town, *ends, "--method", "astar", *map(str, options)])


def test_every_format_is_written(tmp_path: Path, town: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    files = [out / f"way{ending}" for ending in (".plan", ".waypoints", ".geojson", ".kml", ".csv", "_ned.csv", ".tum")]
    assert plan(town, "--ground", 2, "--place", *PLACE, "--json", "--export", *files) == 0
    path = np.array(json.loads(capsys.readouterr().out)["path"])
    assert sorted(out.iterdir()) == sorted(files)
    items = json.loads(files[0].read_text())["mission"]["items"]
    assert [item["command"] for item in items[:3]] == [22, 178, 16]
    places = np.array([item["params"][4:] for item in items if item["command"] == 16])
    places[:, 2] += 10.0 + 2.0  # the place, and the ground above it
    np.testing.assert_allclose(TangentPlane(52.07, 4.3, 10.0).local(places), path, atol=0.01)


def test_a_failed_plan_writes_nothing(tmp_path: Path, town: str) -> None:
    assert (
        main(["plan", town, "--start", "24", "1", "1", "--goal", "40", "14", "12", "--export", str(tmp_path / "a.csv")])
        == 1
    )
    assert [file.name for file in tmp_path.iterdir()] == ["town.npz"]


def test_a_map_that_lies_nowhere_is_refused_before_the_plan(town: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert plan(town, "--export", "way.plan") == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("maxjax: error: way.plan: expected a place on Earth for .plan, which the map does not name")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--export", "way.txt"], "way.txt: expected a name that ends in one of .plan, "),
        (["--export", "nowhere/way.csv"], "nowhere/way.csv: expected a folder"),
        (["--export", "way.kml", "--place", "4.3", "190", "0"], "longitude: expected degrees from -180 to 180"),
        (["--export", "way.csv", "--speed", "0"], "FlightLimits.speed: expected a positive finite number, given 0"),
        (["--export", "way.csv", "--speed", "nan"], "FlightLimits.speed: expected a positive finite number, given nan"),
        (["--export", "way.csv", "--place", *PLACE, "--crs", "EPSG:28992"], "--crs: expected one of --place and --crs"),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_work(
    town: str, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert plan(town, *options) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"maxjax: error: {sentence}")
    assert captured.err.count("\n") == 1
