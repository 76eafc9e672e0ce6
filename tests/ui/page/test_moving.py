"""Movers on the page: those of the trial, where they are, as boxes that Trimesh finds closed."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from maxjax.core.rng_streams import named_key
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.movers.moments import Moment
from maxjax.sim.trials import batches as execution
from maxjax.sim.trials import cities
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.trial_movers import movers_of
from maxjax.sim.worlds.geoms import BOX, CAPSULE, SPHERE, Geoms, concatenate, ground_plane, rotation_z
from maxjax.sim.worlds.movers import Movers, places, straight
from maxjax.sim.worlds.populations import Population, population
from maxjax.sim.worlds.solids import upright_boxes
from maxjax.ui.methods import planner_named
from maxjax.ui.page.mover_playback import KNOWN_NODE, MOVERS_NODE, knowledge_cues, moving_cues
from maxjax.ui.page.nodes import Lines, Surface
from maxjax.ui.page.trial_folder import city_of, film_of
from tests.ui.page.flown import GOAL, START, line, outcome


def bodies() -> Movers:
    """A car's box, a jib's capsule, a ball, at constant velocities."""
    size = jnp.array([[2.25, 0.9, 0.75], [0.4, 7.0, 0.0], [0.6, 0.0, 0.0]])
    rotation = rotation_z(jnp.array([0.3, -1.0, 0.0]))
    solids = Geoms(jnp.zeros((3, 3)), rotation, size, (BOX, CAPSULE, SPHERE))
    return straight(solids, jnp.array([[0.0, 5.0, 0.8], [20.0, 0.0, 20.0], [-9.0, -9.0, 9.0]]), 2.0 * jnp.eye(3))


def test_movers_are_those_that_the_trial_was_flown_among(monkeypatch: pytest.MonkeyPatch) -> None:
    town = concatenate([ground_plane(), upright_boxes(jnp.array([[0.0, 0.0, 9.0, 9.0, 0.0, 30.0, 0.3]]))])
    monkeypatch.setattr(cities, "_city", lambda name, seed: town)
    how = Population(2, 6.0, "cars")
    config = FlightConfig(planner=planner_named("field"))
    campaign = Campaign("suburb", 3, range(4, 6), config=config, movers=how)
    ends = {"start": np.array([START] * 2, np.float32), "goal": np.array([GOAL] * 2, np.float32)}
    flown_among = execution.world_of(campaign, {**ends, "city": np.array([3, 3])}, 1).movers
    shown = movers_of(campaign.configuration(), dataclasses.replace(outcome(5, "OK"), city=3))
    assert shown is not None
    for given, expected in zip(jax.tree.leaves(shown), jax.tree.leaves(flown_among), strict=True):
        np.testing.assert_array_equal(given, expected)
    key = jax.random.fold_in(named_key(jax.random.key(3), "movers suburb"), 5)
    by_hand = population(town, jnp.array(START), jnp.array(GOAL), key, how=how)
    np.testing.assert_array_equal(shown.knots, by_hand.knots)
    assert movers_of({"map": "suburb", "seed": 3}, outcome(5, "OK")) is None


def test_boxes_are_closed_and_move_with_their_movers() -> None:
    city, movers = city_of("suburb", 0), bodies()
    film = film_of(outcome(0, "OK"), line(1.0), city, (), movers)
    for time in (0.0, 3.0):
        node = film.showing(time)[MOVERS_NODE][MOVERS_NODE]
        assert isinstance(node, Surface)
        faces = node.faces.reshape(3, 12, 3)
        place = city.frame.page(np.asarray(places(movers, jnp.float32(time))[0]))
        for k, volume in enumerate((4.5 * 1.8 * 1.5, 0.8 * 0.8 * 14.8, 1.2**3)):
            mesh = trimesh.Trimesh(node.points, faces[k]).process()
            assert mesh.is_watertight
            np.testing.assert_allclose(mesh.volume, volume, rtol=1e-3)  # positive: counter-clockwise from outside
            np.testing.assert_allclose(mesh.center_mass, place[k], atol=1e-3)
    assert [cue.time for cue in film.cues] == sorted(cue.time for cue in film.cues)


def test_who_is_hidden_is_not_shown() -> None:
    frame, movers = city_of("suburb", 0).frame, bodies()
    (cue,) = moving_cues(dataclasses.replace(movers, knots=movers.knots.at[1, :, 2].set(-1000.0)), np.zeros(1), frame)
    node = cue.nodes[MOVERS_NODE]
    assert isinstance(node, Surface)
    assert len(node.faces) == 2 * 12
    assert moving_cues(dataclasses.replace(movers, knots=0.0 * movers.knots - 1000.0), np.zeros(1), frame) == ()


def test_what_is_known_are_frames_veils_and_the_motion() -> None:
    frame = city_of("suburb", 0).frame
    low, high = np.array([[0.0, 0.0, 1.0], [5.0, 5.0, 5.0]]), np.array([[1.0, 2.0, 4.0], [6.0, 7.0, 9.0]])
    boxes = np.stack([np.stack([low - grown, high + grown], axis=1) for grown in (0.0, 1.0, 3.0)])
    moment = Moment(boxes, np.linspace([0.0, 0.0, 5.0], [3.0, 0.0, 5.0], 13), ())
    nothing = Moment(boxes[:, :0], np.zeros((13, 3)), ())
    first, second = knowledge_cues([moment, nothing], np.array([0.0, 0.1]), frame)
    assert (first.time, first.part, second.nodes) == (0.0, KNOWN_NODE, {})
    now, later, motion = (first.nodes[f"{KNOWN_NODE}/{name}"] for name in ("now", "later", "motion"))
    assert isinstance(now, Lines)
    assert isinstance(motion, Lines)
    assert isinstance(later, Surface)
    edges = np.linalg.norm(now.points[:, 1] - now.points[:, 0], axis=1).reshape(2, 12).sum(axis=1)
    np.testing.assert_allclose(edges, 4.0 * (high - low).sum(axis=1), atol=1e-3)
    np.testing.assert_allclose(frame.map(now.points).reshape(2, 24, 3).min(axis=1), low, atol=1e-3)
    assert later.opacity < 0.5
    for k, volume in enumerate(np.prod(high - low + 6.0, axis=1)):
        mesh = trimesh.Trimesh(later.points, later.faces.reshape(2, 12, 3)[k]).process()
        assert mesh.is_watertight
        np.testing.assert_allclose(mesh.volume, volume, rtol=1e-3)
