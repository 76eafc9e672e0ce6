"""What cannot be flown is refused."""

from __future__ import annotations

from typing import Any

import pytest

from maxjax.campaigns.campaign import Campaign
from maxjax.methods import planner_named
from maxjax.sim.disturbances import Disturbances
from maxjax.sim.flight import FlightConfig

PLANNER = planner_named("field")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"map": "venice"}, "midtown, downtown, suburb, given 'venice'"),
        ({"trials": range(0)}, "at least one"),
        ({"seed": -1}, "seed"),
        ({"config": FlightConfig(Disturbances(dropout=1.5), planner=PLANNER)}, "dropout: expected .* from 0 to 1"),
        ({"config": FlightConfig(Disturbances(wind=-1.0), planner=PLANNER)}, "wind: expected a number from 0"),
        ({"config": FlightConfig(Disturbances(drift=float("nan")), planner=PLANNER)}, "drift"),
        ({"config": FlightConfig(planner=PLANNER, reactive=-0.1)}, "reactive"),
    ],
)
def test_what_cannot_be_flown_is_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Campaign(**{"map": "suburb", "config": FlightConfig(planner=PLANNER), **changes})
