"""Completion: what was seen stays, prices are at least 1, and training goes on where it ended."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.completion import judge, train
from experiments.completion import network as net
from experiments.completion.network import TINY_NETWORK
from experiments.completion.scenes import GROUND, OCCUPIED, SEEN_FREE, SEEN_OCCUPIED, draw_scene, look, passed
from maxjax.core.grid import Grid
from maxjax.sim.worlds.solids import upright_boxes


def test_beams_pass_what_lies_before_their_returns() -> None:
    grid = Grid((20, 20, 20), 1.0, (0.0, 0.0, 0.0))
    sensor = np.array([2.2, 3.2, 4.0])
    returns = np.array([[15.3, 3.2, 4.0], [2.2, 12.6, 4.0], [np.nan, 0.0, 0.0]])
    found = np.asarray(passed(jnp.asarray(sensor, jnp.float32), jnp.asarray(returns, jnp.float32), grid))
    expected = np.zeros(grid.shape, bool)
    # The last points, a multiple of half a voxel from the sensor, lie at 14.7 and 11.7.
    expected[2:16, 3, 4], expected[2, 3:13, 4] = True, True
    np.testing.assert_array_equal(found, expected)


def test_a_wall_is_seen_on_its_near_side_and_hides_what_is_behind() -> None:
    grid = Grid((40, 40, 10), 2.0, (-40.0, -40.0, 0.0))
    wall = upright_boxes(jnp.array([[10.0, 0.0, 2.0, 30.0, 0.0, 20.0, 0.0]]))
    seen = look(wall, jnp.array([-10.0, 0.0, 6.0]), jax.random.key(0), grid)
    x = grid.origin[0] + grid.spacing * np.arange(40)
    occupied, free = np.asarray(seen.seen_occupied), np.asarray(seen.seen_free)
    assert occupied[np.abs(x - 8.0) <= 1.0].any()
    assert not (occupied | free)[x > 10.0, 15:25].any()
    assert free[(x > -8.0) & (x < 6.0), 19:21, 2:4].all()
    assert not (occupied & free).any()


def test_a_scan_of_a_city_shows_no_more_than_there_is() -> None:
    bits = draw_scene("midtown", 3, 0, 0)
    np.testing.assert_array_equal(bits, draw_scene("midtown", 3, 0, 0))
    occupied, free = (bits & SEEN_OCCUPIED) > 0, (bits & SEEN_FREE) > 0
    there = (bits & (OCCUPIED | GROUND)) > 0
    assert occupied.any()
    assert free.any()
    # Returns have noise of centimetres, and a beam may pass the empty part of an occupied voxel.
    assert there[occupied].mean() > 0.99
    assert there[free].mean() < 0.1


def test_the_network_never_changes_what_was_seen() -> None:
    bits = draw_scene("midtown", 3, 0, 1)
    params = net.start(TINY_NETWORK, jax.random.key(0))
    chance = np.asarray(net.probability(params, jnp.asarray(bits), TINY_NETWORK))
    assert (chance[(bits & (SEEN_OCCUPIED | GROUND)) > 0] == 1).all()
    assert (chance[((bits & SEEN_FREE) > 0) & ((bits & GROUND) == 0)] == 0).all()
    unseen = np.asarray(net.unseen_in(jnp.asarray(bits)))
    assert ((chance[unseen] > 0) & (chance[unseen] < 1)).all()
    # What is there is not among the inputs.
    np.testing.assert_array_equal(net.inputs_of(jnp.asarray(bits)), net.inputs_of(jnp.asarray(bits ^ OCCUPIED)))


def test_prices_are_at_least_one_and_raised_only_where_nobody_saw() -> None:
    rng = np.random.default_rng(0)
    bits = rng.choice(np.array([0, SEEN_FREE, SEEN_OCCUPIED, GROUND], np.uint8), judge._GRID.shape)
    chance = rng.random(bits.shape).astype(np.float32)
    free, priced = judge.price_of(bits, np.zeros_like(chance), 4.0), judge.price_of(bits, chance, 4.0)
    assert free.min() >= 1
    np.testing.assert_allclose(priced - free, np.where(bits == 0, 4.0 * chance, 0), atol=1e-5)


@pytest.mark.large
def test_training_goes_on_where_it_ended_and_lowers_the_loss(tmp_path: Path) -> None:
    config = train.Config(
        tmp_path / "whole", cities=1, places=2, epochs=4, batch=2, rate=1e-2, tiny=True, out=tmp_path / "results"
    )
    rows = train.main(config)
    whole, _ = train.load(config.folder)
    parts = dataclasses.replace(config, folder=tmp_path / "parts")
    real = train.save_checkpoint

    def once(*given: object) -> None:
        real(*given)  # type: ignore[arg-type]
        raise KeyboardInterrupt

    train.save_checkpoint = once  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        train.main(parts)
    train.save_checkpoint = real
    train.main(parts)
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(train.load(parts.folder)[0]), strict=True):
        np.testing.assert_array_equal(one, other)
    losses = [float(row["loss"]) for row in rows]
    assert len(losses) == 4
    assert losses[-1] < losses[0]
    with pytest.raises(ValueError, match="choose another folder"):
        train.main(dataclasses.replace(config, rate=1e-3))


@pytest.mark.nightly
def test_the_judge_counts_plans_of_every_kind(tmp_path: Path) -> None:
    train.main(train.Config(tmp_path, cities=1, places=2, epochs=1, batch=2, tiny=True, out=tmp_path))
    rows = judge.main(judge.Config(tmp_path, maps=("suburb",), problems=1, out=tmp_path))
    plans = {row["unseen"]: row for row in rows if row["what"] == "plans"}
    assert set(plans) == {"free", "alike", "extruded", "truth", "network"}
    assert all(row["problems"] == 1 for row in plans.values())
    assert sum(int(row["voxels"]) for row in rows if row["what"] == "reliability") > 0
