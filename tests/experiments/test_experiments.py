"""Every experiment and benchmark runs at a small size, and what it claims holds there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import plan as plan_benchmark
from benchmarks import profile
from experiments import warframe_crops

pytestmark = pytest.mark.full_speed


def test_warframe_subset_is_solved_certified_and_short(data: Path, tmp_path: Path) -> None:
    rows = {(row["crop"], row["method"]): row for row in warframe_crops.main(warframe_crops.Config(data, 20, tmp_path))}
    for crop in ("Complex", "Simple"):
        ours, rival = rows[crop, "solver"], rows[crop, "astar"]
        assert ours["ok"] == ours["certified"] == ours["verified"] == ours["scenarios"]
        assert ours["over_optimum_mean"] <= 0.98
        assert ours["over_optimum_worst"] <= 1.05
        assert rival["ok"] == rival["scenarios"]
        assert rival["off_optimum"] == 0


def test_random_problems_hold_before_independent_judges(tmp_path: Path) -> None:
    pytest.importorskip("skfmm", reason="the eikonal oracle needs scikit-fmm: pip install 'maxjax[bench]'")
    from experiments import random_problems

    *maps, sealed = random_problems.main(random_problems.Config(problems=50, sealed=20, measured=3, out=tmp_path))
    assert [row["map"] for row in maps] == ["midtown", "downtown", "suburb"]
    for row in maps:
        assert row["solved"] == row["certified"] == row["largest_margin"] == row["solvable"]
        assert row["proved_unsolvable"] == row["problems"] - row["solvable"]
        assert row["unsafe"] == 0
        assert row["length_over_geodesic_mean"] <= 1.03
    assert sealed["solvable"] == sealed["solved"] == sealed["certified"] == 0
    assert sealed["proved_unsolvable"] == sealed["problems"]


def test_plan_benchmark_times_plans_alone_and_in_batches(tmp_path: Path) -> None:
    config = plan_benchmark.Config(maps=("suburb",), problems=1, batches=(2,), repeats=1, out=tmp_path)
    rows = {row["what"]: row for row in plan_benchmark.main(config)}
    assert rows["plan, solver: total"]["solved"] == rows["plan, astar: total"]["solved"] == 1
    batch = rows["batch of 2: a plan"]
    assert batch["solved"] == 2
    assert batch["plans_per_second"] == pytest.approx(1e3 / batch["median"], rel=0.1)
    stages = [row["median"] for what, row in rows.items() if what.startswith("batch of 2: ") and row is not batch]
    assert 0 < sum(stages) <= batch["median"]


def test_profile_books_what_runs_on_the_steps_of_the_method(tmp_path: Path) -> None:
    config = profile.Config(scenes=(1,), plans=(), shape=(51, 51, 51), maps=("suburb",), repeats=1, out=tmp_path)
    rows = {row["what"]: row for row in profile.main(config)}
    shares = {what: row["share"] for what, row in rows.items() if what.startswith("solve, 1: ")}
    whole = shares.pop("solve, 1: all")
    assert sum(shares.values()) == pytest.approx(whole, abs=0.01)
    for step in ("geodesic", "assemble", "lump", "relax", "sweep", "certify"):
        assert shares[f"solve, 1: {step}"] > 0
    assert rows["solve, 1: sweep"]["gb_per_s"] > 0
    assert rows["copy, 1: copy"]["gb_per_s"] > 0


def test_training_benchmark_has_a_row_for_each_number_of_devices_that_there_is(tmp_path: Path) -> None:
    from benchmarks import training

    rows = training.main(
        training.Config(recipes=("tiny",), devices=(1, 99), scenes=4, shape=(51, 51, 17), repeats=1, out=tmp_path)
    )
    assert [(row["devices"], row["speed_up"]) for row in rows] == [(1, 1.0)]
    assert rows[0]["seconds_an_epoch"] > 0
    assert json.loads((tmp_path / "training.json").read_text())["rows"] == rows
