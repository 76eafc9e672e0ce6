"""`maxjax fly` with ends: a trajectory flown with the map given; what it prints, writes and ends with."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from maxjax.ui.cli import main
from tests.scenes import gap_file

pytest.importorskip("matplotlib")

ENDS = ["--start", "6", "16", "10", "--goal", "40", "14", "12"]


@pytest.fixture
def town(tmp_path: Path) -> str:
    return str(gap_file(tmp_path))


def fly(*arguments: object) -> int:
    return main(["fly", *map(str, arguments)])


@pytest.mark.large
def test_a_flight_is_told_and_written(town: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert fly(town, *ENDS, "--method", "astar", "--wind", 4, "--json", "--out", out) == 0
    printed = capsys.readouterr().out
    found = json.loads(printed)
    assert (out / "flight.json").read_text() == printed
    assert found["status"] == "OK"
    assert found["first_contact"] is None
    assert 0.0 < found["error_95"] <= found["error_greatest"] < 0.5
    assert found["clearance"] >= 1.0 - found["error_greatest"]
    with (out / "flight.csv").open() as file:
        rows = list(csv.DictReader(file))
    table = np.array([[float(value) for value in row.values()] for row in rows])
    assert table[:, 10].max() == pytest.approx(found["error_greatest"], abs=1e-6)
    assert table[:, 11].min() == pytest.approx(found["clearance"], abs=1e-6)
    np.testing.assert_allclose(table[-1, 7:10], [40.0, 14.0, 12.0])
    np.testing.assert_allclose(np.diff(table[:, 0]), 0.01, atol=1e-6)
    assert (out / "flight.png").read_bytes().startswith(b"\x89PNG")
    assert fly(town, *ENDS, "--method", "astar") == 0
    table_text = capsys.readouterr().out
    assert "tracking error, 95 %" in table_text
    assert "least clearance" in table_text


def test_without_a_plan_nothing_is_flown_and_no_file_of_before_stays(
    town: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "flight.csv").write_text("")
    blocked = ["--start", "24", "1", "1", "--goal", "40", "14", "12"]
    assert fly(town, *blocked, "--method", "astar", "--out", out, "--json") == 1
    streams = capsys.readouterr()
    assert json.loads(streams.out)["status"] == "START_OCCUPIED"
    assert "START_OCCUPIED" in streams.err
    assert [file.name for file in out.iterdir()] == ["flight.json"]


def test_a_missions_file_is_flown(town: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "round.toml"
    lines = ['map = "town.npz"', 'method = "astar"']
    for place in ("[6.0, 16.0, 10.0]", "[16.0, 14.0, 11.0]", "[40.0, 14.0, 12.0]"):
        lines += ["[[waypoint]]", f"at = {place}"]
    file.write_text("\n".join(lines))
    assert fly(file, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["status"] == "OK"
    assert found["flown_length"] > 30.0
    assert fly(file, *ENDS) == 2
    assert "--start: stands in a mission's file" in capsys.readouterr().err


def test_a_wind_that_carries_it_away_ends_with_1(town: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert fly(town, *ENDS, "--method", "astar", "--wind", 40) == 1
    assert any(name in capsys.readouterr().err for name in ("OFF_TRAJECTORY", "IN_CONTACT", "NONFINITE_STATE"))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([*ENDS[:4]], "--start and --goal: expected both or none"),
        ([*ENDS, "--trials", 3], "--trials: goes with trials"),
        ([*ENDS, "--dead-sector", 30], "--dead-sector: goes with trials"),
        ([*ENDS, "--speed", 0], "FlightLimits.speed: expected a positive"),
        ([*ENDS, "--wind", -1, "--method", "astar"], "wind: expected a speed"),
        (["--radius", 2], "--radius: needs --start and --goal"),
    ],
)
def test_unusable_arguments_end_with_2(
    town: str, arguments: list[object], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fly(town, *arguments) == 2
    assert sentence in capsys.readouterr().err
