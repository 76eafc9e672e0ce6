"""Every benchmark runs at a small size, and what it claims holds there."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from pathlib import Path

import pytest

from benchmarks import city_plan, first_hour, lidar, plan, profile, rivals, startup, tables, training, verifier
from maxjax.planning.windows.focus_window import SHAPES


@pytest.mark.nightly
def test_lidar_benchmark_writes_its_rows(tmp_path: Path) -> None:
    rows = lidar.main(dataclasses.replace(lidar.TINY, out=tmp_path))
    document = json.loads((tmp_path / "lidar.json").read_text())
    assert document["rows"] == rows
    assert len({row["method"] for row in rows}) == 5
    assert all(row["rays_off_by_1mm"] in (0, None) for row in rows)
    assert document["config"]["rays"] == 128
    assert {"jax", "mujoco", "python"} <= set(document["provenance"]["versions"])


@pytest.mark.nightly
def test_plan_benchmark_times_plans_alone_and_in_batches(tmp_path: Path) -> None:
    rows = {row["what"]: row for row in plan.main(dataclasses.replace(plan.TINY, out=tmp_path))}
    assert rows["plan, solver: total"]["solved"] == rows["plan, astar: total"]["solved"] == 1
    batch = rows["batch of 2: a plan"]
    assert batch["solved"] == 2
    assert batch["plans_per_second"] == pytest.approx(1e3 / batch["median"], rel=0.1)
    stages = [row["median"] for what, row in rows.items() if what.startswith("batch of 2: ") and row is not batch]
    assert 0 < sum(stages) <= batch["median"]


@pytest.mark.nightly
@pytest.mark.usefixtures("compiled_astar")
def test_the_benchmark_of_the_rivals_has_all_of_them(tmp_path: Path) -> None:
    rows = {str(row["what"]): row for row in rivals.main(dataclasses.replace(rivals.TINY, out=tmp_path))}
    solved = {what: row["solved"] for what, row in rows.items() if "solved" in row}
    assert {what: count for what, count in solved.items() if count not in (1, 6)} == {}
    assert solved["fleet of 6 near: plan_fleet"] == solved["fleet of 6 anywhere: plan_fleet"] == 6
    assert all(row["median"] > 0 for row in rows.values() if "note" not in row)
    assert "query, priced: compiled A*" in rows
    assert solved["batch, priced: plans by A*"] == solved["batch, priced: plan_batch"] == 1
    assert solved["fleet of 6 near: compiled A*"] == 6
    document = json.loads((tmp_path / "rivals.json").read_text())
    assert "| one plan, priced |" in tables.rivals(document)


@pytest.mark.nightly
@pytest.mark.usefixtures("compiled_verifier")
def test_the_benchmark_of_the_verifier_has_one_verdict_of_both(tmp_path: Path) -> None:
    rows = {row["what"]: row for row in verifier.main(dataclasses.replace(verifier.TINY, out=tmp_path))}
    assert len(rows) == 5
    assert {row["paths"] for what, row in rows.items() if "batch" in str(what)} == {4}
    *_, last = rows.values()
    assert last["differ"] == 0
    assert all(row["median"] > 0 for row in rows.values())
    document = json.loads((tmp_path / "verifier.json").read_text())
    assert tables.verdicts(document).splitlines()[-1].endswith("| 4 | 0 |")


@pytest.mark.nightly
def test_profile_books_what_runs_on_the_steps_of_the_method(tmp_path: Path) -> None:
    rows = {row["what"]: row for row in profile.main(dataclasses.replace(profile.TINY, out=tmp_path))}
    shares = {what: row["share"] for what, row in rows.items() if what.startswith("solve, 1: ")}
    whole = shares.pop("solve, 1: all")
    assert sum(shares.values()) == pytest.approx(whole, abs=0.01)
    for step in ("geodesic", "assemble", "lump", "relax", "sweep", "certify"):
        assert shares[f"solve, 1: {step}"] > 0
    assert rows["solve, 1: sweep"]["gb_per_s"] > 0
    assert rows["copy, 1: copy"]["gb_per_s"] > 0


@pytest.mark.nightly
def test_training_benchmark_has_a_row_for_each_number_of_devices_that_there_is(tmp_path: Path) -> None:
    rows = training.main(dataclasses.replace(training.TINY, out=tmp_path))
    assert [(row["devices"], row["speed_up"]) for row in rows] == [(1, 1.0)]
    assert rows[0]["seconds_an_epoch"] > 0
    assert json.loads((tmp_path / "training.json").read_text())["rows"] == rows


@pytest.mark.nightly
def test_cities_are_crossed_in_processes_of_their_own(tmp_path: Path) -> None:
    rows = city_plan.main(dataclasses.replace(city_plan.TINY, out=tmp_path))
    assert [row["status"] for row in rows] == ["OK", "OK"]
    assert all(row["certified"] and row["length_m"] >= row["straight_m"] for row in rows)
    assert all(0 < row["seconds"] <= row["first_seconds"] for row in rows)


@pytest.mark.nightly
def test_the_first_hour_runs_the_commands_of_the_readme(tmp_path: Path) -> None:
    rows = first_hour.main(dataclasses.replace(first_hour.TINY, out=tmp_path))
    clone, *commands, last = rows
    assert (clone["what"], last["what"]) == ("git clone", "all")
    assert [str(row["what"]).split()[:2] for row in commands] == [["maxjax", "map"], *[["maxjax", "mission"]] * 2]
    assert last["median"] == pytest.approx(sum(float(row["median"] or 0) for row in rows[:-1]), abs=0.1)
    document = json.loads((tmp_path / "first_hour.json").read_text())
    assert tables.first_hour(document).count("| `maxjax mission docs/samples/round.toml --") == 2


def test_the_round_over_a_city_of_ones_own_is_the_samples_with_other_places() -> None:
    folder = Path(first_hour.__file__).parents[1]
    given = (folder / "docs/samples/round.toml").read_text(encoding="utf-8")
    places = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))
    before, own = (tomllib.loads(text) for text in (given, first_hour.own_round(given, "x.ply", "EPSG:28992", places)))
    assert own.pop("crs") == "EPSG:28992"
    assert (own.pop("map"), before.pop("map")) == ("x.ply", "quarter.geojson")
    assert [waypoint.pop("at") for waypoint in own["waypoint"]] == [list(place) for place in places]
    assert len([waypoint.pop("at") for waypoint in before["waypoint"]]) == 3
    assert own == before
    first, *rest = first_hour.commands((folder / "README.md").read_text(encoding="utf-8"))
    assert first == ["make", "demo"]
    assert [words[:2] for words in rest] == [["maxjax", "map"], ["maxjax", "mission"], ["maxjax", "mission"]]


@pytest.mark.nightly
def test_the_benchmark_of_the_start_times_processes_of_their_own(tmp_path: Path) -> None:
    rows = startup.main(dataclasses.replace(startup.TINY, out=tmp_path))
    assert json.loads((tmp_path / "startup.json").read_text())["rows"] == rows
    *processes, program = rows
    assert [row["what"] for row in processes] == ["import maxjax", "import maxjax, and its names", "maxjax --help"]
    assert program["what"] == "program of a window of " + " x ".join(map(str, SHAPES[0]))
    assert 1000 < program["equations"] < 20_000
    for row in processes:
        assert row["n"] == 2
        assert 0 < row["min"] <= row["median"] <= row["max"]
        assert row["cpu"] > 0
