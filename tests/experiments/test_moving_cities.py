"""Rows of flights among movers, from outcomes written by hand: who knows of movers, and what is compared with what."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from experiments import moving_cities
from experiments.moving_cities import Config, by_pilot, main, section
from experiments.orca import orca
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.worlds.populations import Population
from tests.scenes import outcome


def flights(campaign: Campaign, batch: int | None, folder: Path | None) -> Iterator[list[Outcome]]:
    """Alone 10 and 20 s; among movers 15 s and a contact; unaware 12 and 20 s, the later trial first."""
    assert batch is None
    assert folder is None
    if campaign.movers is None:
        assert not campaign.flight.extensions
        yield [outcome(0, "OK", duration=10.0), outcome(1, "OK", duration=20.0)]
    elif campaign.flight.extensions:
        flagged = {"flagged": {"TRAPPED": 1.5}, "flagged_share": 0.1}
        yield [outcome(0, "OK", duration=15.0, **flagged, hidden_movers=0)]
        hit = {"flagged": {"NEAR": 1.0}, "flagged_share": 0.2, "flagged_before": False, "touched": "mover"}
        yield [outcome(1, "IN_CONTACT", duration=5.0, **hit, flagged_at_contact=False, hidden_movers=0)]
    else:
        yield [outcome(trial, "OK", duration=12.0 + 8.0 * trial) for trial in reversed(campaign.trials)]


def test_rows_compare_the_trials_that_arrive_both_ways(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moving_cities, "fly_trials", flights)
    config = Config(trials=2, counts=(10,), speeds=(5.0,), kinds=("drones",), out=tmp_path)
    alone, ours, unaware = main(config)
    assert (alone["arrived"], alone["ratio"], alone["unflagged"]) == (2, 1.0, None)
    assert (ours["arrived"], ours["contacts"], ours["unflagged"], ours["unflagged_at_contact"]) == (1, 1, 1, 1)
    assert ours["ratio"] == pytest.approx(15.0 / 10.0)
    assert ours["flagged"] == pytest.approx((0.1 * 15.0 + 0.2 * 5.0) / 20.0)
    assert ours["again"] == "fly 1"
    assert unaware["ratio"] == pytest.approx(32.0 / 30.0, abs=1e-3)
    document = json.loads((tmp_path / "moving_cities.json").read_text())
    text = section(document)
    assert text.count("no flag then") == 2
    # Files that were written before that was counted are read as well.
    for row in document["rows"]:
        del row["unflagged_at_contact"]
    assert "| 1 | 1 | – |" in section(document)
    assert "| downtown | 10 drones | 5 | ours | 1 of 2 |" in text
    assert "| downtown | none | – | alone | 2 of 2 |" in text
    assert "- `fly 1`" in text


def test_pilots_are_told_what_they_are_named_for() -> None:
    campaign = Campaign("suburb", config=FlightConfig(planner=Field()), movers=Population(3, 5.0, "encounters"))
    ours = campaign.flight.extension(Avoidance)
    by = {pilot: by_pilot(campaign.flight, pilot) for pilot in ("ours", "true", "oracle", "orca", "unaware")}
    assert by["ours"] == campaign.flight
    assert not by["unaware"].extensions
    orca_way, told, oracle = (by[pilot].extension(Avoidance) for pilot in ("orca", "true", "oracle"))
    assert (orca_way.perception, orca_way.chooser) == (ours.perception, orca)
    assert (told.perception, told.bounds, told.chooser) == (TrueTracks(), ours.bounds, ours.chooser)
    assert oracle.perception == TrueTracks(future=ours.choice.horizon)
    assert oracle.bounds.acceleration < 0.01
