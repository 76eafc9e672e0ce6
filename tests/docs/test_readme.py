"""README and CONTRIBUTING keep their word: the example runs, commands parse, figures are those of results."""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.common.markdown import trials
from maxjax.ui.cli import commands, main

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def test_the_example_runs_word_for_word() -> None:
    (example,) = blocks("python")
    # As a user runs it: without the run-time type checks of the tests, and optimised.
    as_a_user = {"XLA_FLAGS": "", "JAX_DISABLE_MOST_OPTIMIZATIONS": "0", "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    done = subprocess.run(
        [sys.executable, "-c", example],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | as_a_user,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    first, second, third, fourth = done.stdout.splitlines()
    assert re.fullmatch(r"\(\d+, 3\) 1\.0 True", first)
    printed = re.fullmatch(r"(\d+\.\d) m long, (\d+\.\d) m clear of the tower", second)
    assert printed is not None
    length, clearance = map(float, printed.groups())
    # The tower is 60 m wide and stands across the straight line of 120 m.
    assert 130 < length < 156
    assert clearance >= 4
    timed = re.fullmatch(r"(\d+\.\d) s \((\d+), 3\) \(\2, 3\) \(\2,\)", third)
    assert timed is not None
    assert length / 8.0 < float(timed[1]) < 2.0 * length / 8.0
    assert re.fullmatch(r"\[0 0\] \[1\d\d\.\d+ 1\d\d\.\d+\]", fourth)


def test_every_command_line_parses(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    for command, (_, module, function) in commands._COMMANDS.items():

        def run(*_: object, command: str = command) -> int:
            calls.append(command)
            return 0

        monkeypatch.setattr(importlib.import_module(f"maxjax.ui.cli.{module}"), function, run)
    lines = [shlex.split(line, comments=True) for block in blocks("bash") for line in block.splitlines()]
    for program, *arguments in lines:
        if program == "maxjax":
            assert main(arguments) == 0
        else:
            assert program == "make"
            assert re.search(rf"^{arguments[0]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
    first = ["map", "mission", "mission"]
    assert calls == [*first, "check", "scan", "plan", "plan", "fly", "plan", "plan", "fly", "inspect"]


def test_scans_maps_and_plans_run_as_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All commands but `check` and `fly`, which have tests of their own."""
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    for block in blocks("bash"):
        for line in block.splitlines():
            program, command, *arguments = shlex.split(line, comments=True)
            if program == "maxjax" and command in ("scan", "map", "plan", "mission"):
                assert main([command, *arguments]) == 0, line
    for name in ("scan/scan.png", "plan/plan.png", "quarter/map.png", "quarter/plan.json", "quarter.csv", "way.csv"):
        assert (tmp_path / name).is_file(), name
    found = json.loads((tmp_path / "quarter.plan").read_text())["mission"]
    home, held = (
        found["plannedHomePosition"],
        [item for item in found["items"] if item["params"][0] and item["frame"] == 3],
    )
    # Two seconds at rest above the take-off, then as the mission asks.
    assert [item["params"][0] for item in held] == [2.0, 5.0, 10.0]
    last = held[-1]["params"][4:6]
    # The start and this waypoint lie 130 m and 42 m apart east and north, at 47 degrees: 75.9 km and 111.2 km a degree.
    assert (last[1] - home[1]) * 75_920 == pytest.approx(130.0, abs=0.5)
    assert (last[0] - home[0]) * 111_170 == pytest.approx(-42.0, abs=0.5)


def test_the_figures_of_flights_are_those_of_the_result_files() -> None:
    folder = ROOT / "experiments" / "results"
    documents = [
        json.loads((folder / f"closed_loop_{name}.json").read_text(encoding="utf-8"))
        for name in ("many", "disturbed", "disturbed_suburb")
    ]
    assert all(trials(document).startswith("fresh trials") for document in documents)
    calm, downtown, suburb = (document["rows"] for document in documents)
    windy = downtown + suburb
    assert sum(row["contacts"] for row in calm + windy) == 0
    for rows in (calm, windy):
        assert sum(row["arrived"] for row in rows) == sum(row["trials"] for row in rows)
    nearest = " and ".join(f"{row['clearance_mean_m']:.1f}" for row in calm)
    said = (
        f"All of {sum(row['trials'] for row in calm):,} fresh trials, of a seed drawn from the commit after the code, "
        f"arrived, nearest to a wall {nearest} m in the mean of their maps and "
        f"{min(row['clearance_least_m'] for row in calm):.1f} m at worst; so did all of "
        f"{sum(row['trials'] for row in windy):,} in wind,"
    )
    assert said in " ".join(TEXT.split())


def test_the_figures_of_flights_among_movers_are_those_of_the_result_files() -> None:
    folder = ROOT / "experiments" / "results"
    names = ("cities", "encounters", "suburb")
    documents = [json.loads((folder / f"moving_{name}.json").read_text(encoding="utf-8")) for name in names]
    (seed,) = {document["config"]["seed"] for document in documents}
    rows = [row for document in documents for row in document["rows"] if row["movers"]]
    ours, unaware = ([row for row in rows if row["pilot"] == pilot] for pilot in ("ours", "unaware"))
    assert {(row["movers"], row["speed"]) for row in ours} == {(30, 2.0), (30, 5.0), (30, 8.0)}
    assert sum(row["contacts"] for row in ours) == 0
    flights, arrived = (sum(row[name] for row in ours) for name in ("flights", "arrived"))
    others, touched = (sum(row[name] for row in unaware) for name in ("flights", "contacts"))
    said = (
        f"none of {flights:,} flights among 30 drones (at 2, 5 and 8 m/s) and 30 encounters (at 2 and 5 m/s) touched "
        f"anything; {arrived:,} arrived. Who knows of no movers touched one in {touched} of {others:,} "
        f"([results](results.md)). The trials' seed, {seed}, was drawn from commit `{seed:07x}`"
    )
    assert said in " ".join((ROOT / "docs" / "moving.md").read_text(encoding="utf-8").split())


def test_the_first_hour_is_as_short_as_it_is_said_to_be() -> None:
    *_, whole = json.loads((ROOT / "benchmarks/results/first_hour.json").read_text(encoding="utf-8"))["rows"]
    assert whole["what"] == "all"
    assert 120 < whole["median"] <= 180
    assert "This takes three minutes from a clone" in " ".join(TEXT.split())


def test_every_path_in_the_overview_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (overview,) = re.findall(r"^```text\n(maxjax/.*?)^```$", text, re.MULTILINE | re.DOTALL)
    named = [line.split()[0] for line in overview.splitlines() if not line.startswith(" ")]
    named += re.findall(r"`((?:maxjax|tests|docs)/[\w/.]+)`", text)
    named += re.findall(r"\]\(([^)]+)\)", text)
    assert "maxjax/io/reader.py" in named
    for path in named:
        assert (ROOT / path).exists() or path == "maxjax/baselines/mine.py" or "format.py" in path, path
