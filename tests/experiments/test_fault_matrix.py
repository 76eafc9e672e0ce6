"""Cells of the experiment with faults fail what their names say, and nothing else."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.markdown import trials
from experiments import faults
from maxjax.planners import Field
from maxjax.sim.faults.modes import MEANINGLESS, Mode, Target

LIARS = {"planner-garbage": "garbage", "planner-wrong": "wrong"}


def cells(config: faults.Config) -> dict[str, tuple[object, np.ndarray]]:
    """Planner and modes of each cell."""
    found = faults._cells(config, Field())
    return {name: (planner, modes[k]) for names, planner, modes in found for k, name in enumerate(names)}


def test_each_cell_is_its_target_in_its_mode_in_all_flights() -> None:
    found = cells(faults.Config(flights=3, random=5))
    assert next(iter(found)) == "none"
    assert {"random", *LIARS} < set(found)
    single = {name: modes for name, (_, modes) in found.items() if name not in ("none", "random")}
    for name, modes in single.items():
        wanted = np.zeros((3, len(Target)), int)
        if name not in LIARS:
            target, _, mode = name.upper().partition("-")
            assert (Target[target], Mode[mode]) not in MEANINGLESS
            wanted[:, Target[target]] = Mode[mode]
        np.testing.assert_array_equal(modes, wanted)
    assert len(single.keys() - LIARS.keys()) == len(Target) * (len(Mode) - 1) - len(MEANINGLESS)
    assert not found["none"][1].any()


def test_only_the_liars_cells_are_flown_by_liars() -> None:
    for name, (planner, _) in cells(faults.Config(flights=1, random=1)).items():
        assert getattr(planner, "lie", None) == LIARS.get(name)


def test_random_modes_belong_to_the_trial_and_mean_something() -> None:
    config = faults.Config(random=40, cells=("random",))
    modes = cells(config)["random"][1]
    np.testing.assert_array_equal(cells(dataclasses.replace(config, first=30, random=10))["random"][1], modes[30:])
    assert modes.any()
    drawn = {(Target(k), Mode(mode)) for row in modes.tolist() for k, mode in enumerate(row) if mode}
    assert not drawn & set(MEANINGLESS)


def test_an_unknown_cell_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="given 'lidar-stucked'"):
        cells(dataclasses.replace(faults.TINY, cells=("lidar-stucked",)))


@pytest.mark.large
@pytest.mark.parametrize("trial", [285, 6970])
def test_a_stuck_planner_with_a_broken_clock_touches_nothing(trial: int, tmp_path: Path) -> None:
    """Of ten thousand flights with faults at random, the two that touched a wall with healthy motors."""
    config = faults.Config(flights=0, random=1, first=trial, cells=("random",), out=tmp_path)
    (modes,) = faults._at_random(config)
    assert modes[Target.PLANNER]
    assert modes[Target.CLOCK] == Mode.GARBAGE
    assert not modes[Target.MOTORS]
    (row,) = faults.main(config)
    assert row["contacts"] == row["unseen"] == row["not_numbers"] == 0


def test_what_the_documentation_says_of_faults_at_random_is_what_was_recorded() -> None:
    document = json.loads((faults.RESULTS / "faults_random.json").read_text(encoding="utf-8"))
    (row,) = document["rows"]
    assert trials(document).startswith("fresh trials")
    assert row["flights"] == 10_000
    assert row["not_numbers"] == 0
    assert all("motors-" in cause for cause in row["blamed"].split("; "))
    text = (Path(__file__).parents[2] / "docs" / "flight.md").read_text(encoding="utf-8")
    assert f"all {row['contacts']} contacts have a motor that fails" in " ".join(text.split())
