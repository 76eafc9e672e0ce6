"""What cannot be flown is refused."""

from __future__ import annotations

from typing import Any

import pytest

from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.lidar_perception import LidarPerception
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.populations import Population
from maxjax.ui.methods import planner_named

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


def test_campaigns_of_versions_without_movers_can_be_resumed() -> None:
    """Names in the configurations of recorded campaigns."""
    found = Campaign("suburb", config=FlightConfig(planner=PLANNER)).configuration()
    assert " ".join(found) == (
        "map seed first trials method disturbances lidar vehicle controller limits sampling gusts shape spacing "
        "distances period plans tolerance radius snapshot reactive stages"
    )
    assert " ".join(found["lidar"]) == "channels rays elevation_min elevation_max max_range range_noise dropout"
    other = Campaign("suburb", config=FlightConfig(planner=PLANNER, lidar=Lidar(width=90.0), exact=True))
    assert other.configuration()["lidar"]["width"] == 90.0
    assert other.configuration()["exact"] is True


def test_who_flies_among_movers_looks_by_the_flights_own_lidar() -> None:
    lidar = Lidar(rays=4096, channels=32)
    campaign = Campaign("suburb", config=FlightConfig(planner=PLANNER, lidar=lidar), movers=Population(5, 4.0, "birds"))
    how = campaign.flight.extension(Avoidance)
    assert isinstance(how.perception, LidarPerception)
    assert how.perception.sight.lidar == lidar
    assert how.perception.sight.bounds == how.bounds
    assert how.bounds.speed >= 1.4 * 4.0  # what birds keep
    assert how.bounds.acceleration >= 2.0
    assert campaign.configuration()["movers"] == {"count": 5, "speed": 4.0, "kind": "birds"}
    assert campaign.configuration()["moving"]["bounds"]["speed"] == how.bounds.speed
    own = Avoidance(TrueTracks())
    told = Campaign("suburb", config=FlightConfig(planner=PLANNER, extensions=(own,)), movers=Population(5))
    assert told.flight.extensions == (own,)
