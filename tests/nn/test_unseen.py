"""The price of what nobody saw: only unseen voxels cost more, and plans are held to what was seen."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import maxjax
from maxjax.fields.sighting import Sighting, sight
from maxjax.nn.completion import GRID, CompletionNet, complete, init_completion, load_completion
from maxjax.nn.unseen import predict_unseen, price_unseen, raise_price
from maxjax.planning.problem.distances import PriceVolume
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.scenes import make_scene, occupancy

TOWN = maxjax.Grid.centered((0.0, 0.0, 30.0), (81, 81, 38), 2.0)
START, GOAL = np.array([-40.0, 3.0, 8.0]), np.array([45.0, 10.0, 12.0])


@functools.cache
def seen() -> tuple[maxjax.VoxelMap, np.ndarray, maxjax.VoxelMap]:
    """Of a town its ground, the returns of one scan from the start, and all that there is."""
    geoms = make_scene("downtown", 2).geoms
    occupied, ground = occupancy(geoms, TOWN)
    assert not occupied[tuple(np.asarray(TOWN.index_of(jnp.asarray(START))))]
    points = scan(geoms, Lidar(), jnp.asarray(START, jnp.float32), jnp.eye(3), jax.random.key(0)).points
    return maxjax.VoxelMap.on(TOWN, ground, ground), np.asarray(points), maxjax.VoxelMap.on(TOWN, occupied, ground)


def test_the_network_never_changes_what_was_seen() -> None:
    """Whatever its weights."""
    rng = np.random.default_rng(0)
    network = CompletionNet((8, 8), layers=12)
    params = jax.tree.map(lambda w: w + 0.1, init_completion(network, jax.random.key(0)))
    occupied, free, ground = (jnp.asarray(rng.random((13, 22, 12)) < share) for share in (0.2, 0.3, 0.1))
    chance = np.asarray(complete(params, Sighting(occupied, free & ~occupied), ground, network))
    known = np.asarray(occupied | ground)
    assert (chance[known] == 1).all()
    assert (chance[np.asarray(free) & ~known] == 0).all()
    rest = chance[~known & ~np.asarray(free)]
    assert ((rest > 0) & (rest < 1)).all()


def test_only_what_nobody_saw_may_be_occupied() -> None:
    where, points, _ = seen()
    chance = predict_unseen(points, START, where)
    shown = sight(jnp.asarray(START, jnp.float32), jnp.asarray(points), TOWN)
    known = np.asarray(shown.occupied | shown.free) | np.asarray(where.ground)
    assert (chance[known] == 0).all()
    assert ((chance >= 0) & (chance <= 1)).all()
    assert (chance > 0.5).any()


def test_buildings_behind_their_fronts_are_likelier_than_the_air() -> None:
    """On a map that the network never saw: the mean over what is occupied, beside that over what is not."""
    where, points, town = seen()
    chance = predict_unseen(points, START, where)
    there = np.asarray(town.occupied) & ~np.asarray(town.ground)
    assert chance[there & (chance > 0)].mean() > 3.0 * chance[~there & (chance > 0)].mean()


def test_other_voxels_and_places_show_the_same() -> None:
    """At national coordinates the probabilities are the same, in voxels of half the size nearly, which shift them."""
    where, points, _ = seen()
    chance = predict_unseen(points, START, where)
    away = np.array([155_000.0, 463_000.0, 40.0])
    moved = dataclasses.replace(
        where, grid=maxjax.Grid(TOWN.shape, 2.0, tuple((np.array(TOWN.origin) + away).tolist()))
    )
    np.testing.assert_allclose(predict_unseen(points + away, START + away, moved), chance, atol=1e-3)
    fine = maxjax.Grid.centered((0.0, 0.0, 30.0), (162, 162, 76), 1.0)
    ground = np.repeat(np.repeat(np.repeat(np.asarray(where.ground), 2, 0), 2, 1), 2, 2)
    finer = predict_unseen(points, START, maxjax.VoxelMap.on(fine, ground, ground))
    assert np.corrcoef(finer[::2, ::2, ::2].ravel(), chance.ravel())[0, 1] > 0.9


def price_of(distances: maxjax.Distances) -> np.ndarray:
    """n of each voxel."""
    assert isinstance(distances.price, PriceVolume)
    return np.asarray(distances.price.n)


def test_prices_are_raised_where_nobody_saw_and_nowhere_lowered() -> None:
    town = seen()[2]
    chance = np.random.default_rng(0).random(TOWN.shape).astype(np.float32)
    plain, raised = (price_of(raise_price(town, maxjax.Distances(), p, 4.0)) for p in (0.0 * chance, chance))
    assert plain.min() >= 1.0
    np.testing.assert_allclose(raised - plain, 4.0 * chance, atol=1e-5)
    given = price_of(raise_price(town, maxjax.Distances(price=2.0 + chance), chance, 4.0))
    np.testing.assert_allclose(given, 2.0 + 5.0 * chance, atol=1e-5)


def test_a_price_of_nothing_is_that_of_the_default() -> None:
    town = seen()[2]
    plain = raise_price(town, maxjax.Distances(), np.zeros(TOWN.shape, np.float32), 4.0)
    same = maxjax.plan(town, START, GOAL, distances=plain)
    usual = maxjax.plan(town, START, GOAL)
    assert same.status == usual.status == maxjax.Status.OK
    assert same.cost == pytest.approx(usual.cost, rel=2e-3)


def test_plans_with_it_pass_the_same_verifier() -> None:
    where, points, _ = seen()
    distances = price_unseen(points, START, where)
    plan = maxjax.plan_scan(points, START, GOAL, where, distances=distances)
    assert plan.status == maxjax.Status.OK
    assert plan.certified
    shown = sight(jnp.asarray(START, jnp.float32), jnp.asarray(points), TOWN).occupied
    judged = maxjax.VoxelMap.on(TOWN, np.asarray(where.occupied) | np.asarray(shown), where.ground)
    assert maxjax.verify(plan.path, judged, radius=1.0, exemptions=plan.exemptions).ok
    chance = predict_unseen(points, START, where)
    np.testing.assert_array_equal(price_of(distances), price_of(raise_price(judged, maxjax.Distances(), chance, 4.0)))


def test_bad_input_is_told() -> None:
    where, points, _ = seen()
    for height in (-1.0, np.inf):
        with pytest.raises(ValueError, match="height: expected a finite price of at least 0"):
            price_unseen(points, START, where, height=height)
    with pytest.raises(ValueError, match=r"sensor: expected numbers of shape \(3,\)"):
        predict_unseen(points, (1.0, 2.0), where)
    bare = maxjax.VoxelMap.on(TOWN, np.zeros(TOWN.shape, bool))
    with pytest.raises(ValueError, match=r"known: expected a map with its ground, given none at \(-40, 3\)"):
        predict_unseen(points, START, bare)


def test_its_weights_come_with_it() -> None:
    assert sum(weights.size for weights in jax.tree.leaves(load_completion())) == 1_875_808
    assert GRID.shape[2] == 40
