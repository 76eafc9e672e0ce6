"""Fleets as they are drawn: ends with room that swap, and movers that begin elsewhere."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.movers.motions import MotionSet
from maxjax.sim.swarm.together import Together
from maxjax.sim.trials.swaps import ALONE, antipodal, city_swaps
from maxjax.sim.trials.swarm_trials import SwarmTrial
from maxjax.sim.trials.trials import APART, HALF_AREA, HEIGHT
from maxjax.sim.worlds.movers import places
from maxjax.sim.worlds.populations import Population, place_movers
from maxjax.sim.worlds.scenes import make_scene
from maxjax.sim.worlds.solid_distance import distance


@pytest.mark.parametrize("count", [12, 33])
def test_swaps_in_a_city_have_room_and_change_places(count: int) -> None:
    swaps = city_swaps("downtown", 1, count)
    pairs = count // 2 * 2
    np.testing.assert_array_equal(swaps.goal[0:pairs:2], swaps.start[1:pairs:2])
    np.testing.assert_array_equal(swaps.goal[1:pairs:2], swaps.start[0:pairs:2])
    length = np.linalg.norm(swaps.goal - swaps.start, axis=1)
    assert ((length >= APART[0]) & (length <= APART[1])).all()
    for ends in (swaps.start, swaps.goal):
        apart = np.linalg.norm(ends[:, None] - ends[None], axis=-1)[np.triu_indices(count, 1)]
        assert apart.min() >= ALONE
        assert (np.abs(ends[:, :2]) <= HALF_AREA).all()
        assert ((ends[:, 2] >= HEIGHT[0]) & (ends[:, 2] <= HEIGHT[1])).all()
    geoms = make_scene("downtown", 1).geoms
    walls = [float(distance(geoms, jnp.asarray(end, jnp.float32))) for end in swaps.start]
    assert min(walls) >= min(ALONE, HEIGHT[0])  # the ground is nearer
    # Fewer vehicles are the first ones.
    np.testing.assert_array_equal(city_swaps("downtown", 1, 4).start, swaps.start[:4])
    assert not np.array_equal(city_swaps("downtown", 2, 4).start, swaps.start[:4])


@pytest.mark.parametrize("sphere", [False, True])
def test_antipodal_swaps_all_lead_through_the_origin(sphere: bool) -> None:
    swaps = antipodal(16, 30.0, sphere=sphere)
    np.testing.assert_allclose(np.linalg.norm(swaps.start, axis=1), 30.0)
    np.testing.assert_allclose(swaps.goal, -swaps.start)
    apart = np.linalg.norm(swaps.start[:, None] - swaps.start[None], axis=-1)[np.triu_indices(16, 1)]
    assert apart.min() > 2.0 * 30.0 * np.sin(np.pi / 16) - 1e-6 if not sphere else apart.min() > 10.0
    assert np.ptp(swaps.start[:, 2]) > 20.0 if sphere else np.ptp(swaps.start[:, 2]) == 0.0


def test_impossible_swaps_are_refused() -> None:
    with pytest.raises(ValueError, match="expected an even number of vehicles, at least 2, given 5"):
        antipodal(5, 30.0, sphere=True)
    with pytest.raises(ValueError, match="map: expected one of"):
        city_swaps("venice", 0, 4)
    with pytest.raises(ValueError, match=r"expected at most \d+ vehicles in downtown:1, given 4000"):
        city_swaps("downtown", 1, 4000)


def test_movers_of_a_fleet_begin_away_from_every_start() -> None:
    config = FlightConfig(planner=Field())
    fleet = SwarmTrial("downtown", 1, 4, Together(0.1), config, Population(16, 5.0, "drones"))
    movers = fleet.worlds().movers
    assert movers is not None
    there = np.asarray(place_movers(movers))
    assert there.shape == (4, 16)
    assert 0 < there[0].sum() < 16
    own = jax.tree.map(lambda x: x[0], movers)
    for time in np.linspace(0.0, 2.0, 9):
        place = np.asarray(places(own, jnp.float32(time))[0])
        apart = np.linalg.norm(place[:, None] - fleet.swaps.start, axis=-1)
        assert apart.min() >= ALONE


def test_motions_wait_for_messages_and_rest_within_their_horizon() -> None:
    for delay, wait in [(0.0, 1), (0.1, 2), (0.25, 4), (0.5, 6)]:
        together = Together(delay)
        assert together.wait == wait
        found = together.motions(MotionSet(speed=6.0, acceleration=8.0))
        assert min(found.brakes) > 0.1 * wait
        assert found.horizon >= max(found.brakes) + 6.0 / 8.0 + 8.0 / 30.0
