"""What cannot be flown is refused."""

from __future__ import annotations

from typing import Any

import pytest

from maxjax.campaigns.campaign import Campaign
from maxjax.methods import METHODS
from maxjax.sim.disturbances import Disturbances
from maxjax.sim.flight import FlightConfig

SOLVER = METHODS["solver"]
FIND = SOLVER.flying()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"map": "venice"}, "midtown, downtown, suburb, given 'venice'"),
        ({"method": METHODS["apf"]}, "one that can fly, given 'apf'"),
        ({"trials": range(0)}, "at least one"),
        ({"seed": -1}, "seed"),
        ({"config": FlightConfig(Disturbances(dropout=1.5), find=FIND)}, "dropout: expected a number from 0 to 1"),
        ({"config": FlightConfig(Disturbances(wind=-1.0), find=FIND)}, "wind: expected a number from 0"),
        ({"config": FlightConfig(Disturbances(drift=float("nan")), find=FIND)}, "drift"),
        ({"config": FlightConfig(find=FIND, reactive=-0.1)}, "reactive"),
    ],
)
def test_what_cannot_be_flown_is_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Campaign(**{"map": "suburb", "method": SOLVER, **changes})
