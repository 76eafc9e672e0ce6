"""Flights in windows beside flights in whole maps: what a row says of made-up outcomes."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from experiments import windowed_flights as module
from maxjax.planners import Field
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome


def outcome(trial: int, status: str, flown: float) -> Outcome:
    return Outcome(
        trial=trial,
        city=0,
        status=status,
        start=[0.0, 0.0, 5.0],
        goal=[60.0, 0.0, 5.0],
        distance=60.0,
        excluded=0,
        flown_length=flown,
        duration=20.0,
        clearance=3.0 + trial,
        planning_iterations=15 + trial,
        failed_plans=0,
        margins={},
        certified=1.0,
        command="",
    )


def test_a_row_counts_outcomes_and_compares_those_that_arrive_both_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fake(campaign: Campaign, **_: Any) -> Iterator[list[Outcome]]:
        planner = campaign.config.planner
        assert isinstance(planner, Field)
        longer = 1.01 if planner.focus else 1.0
        third = "OK" if planner.focus else "IN_CONTACT"
        yield [outcome(0, "OK", 60.0 * longer), outcome(1, "OK", 80.0), outcome(2, third, 70.0)]

    monkeypatch.setattr(module, "fly_trials", fake)
    (row,) = module.main(module.Config(trials=3, maps=("suburb",), out=tmp_path))
    assert (row["trials"], row["same_status"], row["arrived"], row["contacts"]) == (3, 2, 2, 1)
    assert row["ratio_mean"] == pytest.approx(1.005)
    assert row["ratio_worst"] == pytest.approx(1.01)
    assert row["clearance_least_m"] == 3.0
    text = module.section(json.loads((tmp_path / "windowed_flights.json").read_text()))
    assert "| suburb | 2 of 3 | 2 | 1 |" in text
