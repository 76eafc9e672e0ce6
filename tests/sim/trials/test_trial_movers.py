"""Real flights among the movers of a population, by the vehicle's own LiDAR: outcomes against the movers by hand."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import AStar
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.trial_movers import movers_of
from maxjax.sim.worlds.movers import solids_at
from maxjax.sim.worlds.populations import Population
from maxjax.sim.worlds.scenes import make_scene
from maxjax.sim.worlds.solid_distance import distance

# A coarse map and few beams; five seconds of flight are enough for the bookkeeping.
SMALL = FlightConfig(planner=AStar(), shape=(51, 51, 17), spacing=4.0, lidar=Lidar(rays=2048, channels=32), plans=5)


@pytest.mark.large
def test_outcomes_are_of_flights_among_the_movers_that_are_shown(tmp_path: Path) -> None:
    campaign = Campaign("suburb", 0, range(2), config=SMALL, movers=Population(6, 5.0, "encounters"))
    outcomes = [one for some in fly_trials(campaign, batch=1, folder=tmp_path) for one in some]
    assert len(outcomes) == 2
    lines = campaign.ledger(tmp_path).positions()
    nearer = 0
    for outcome in outcomes:
        assert outcome.planning_iterations > 0
        assert outcome.hidden_movers == 0
        assert outcome.flagged is not None
        assert outcome.flagged_share is not None
        assert outcome.duration is not None
        assert (
            max(outcome.flagged.values()) <= outcome.flagged_share * outcome.duration + 1e-3 <= outcome.duration + 1e-3
        )
        # The least clearance counts walls and these movers, between the logged places too.
        movers, geoms = movers_of(campaign.configuration(), outcome), make_scene("suburb", outcome.city).geoms
        assert movers is not None
        line = jnp.asarray(lines[outcome.trial])
        times = jnp.minimum(LOG_PERIOD * jnp.arange(len(line)), outcome.duration)
        walls = jax.vmap(distance, (None, 0))(geoms, line)
        moving = jax.vmap(distance)(jax.vmap(solids_at, (None, 0))(movers, times), line)
        least = float(jnp.minimum(walls, moving).min())
        assert least - 1.0 <= outcome.clearance <= least + 2e-3  # type: ignore[operator]
        nearer += int(np.min(moving) < np.min(walls))
    assert nearer > 0 or min(float(one.clearance or 0.0) for one in outcomes) > 0.5
