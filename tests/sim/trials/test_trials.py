"""Trials: the protocol's conditions by independent means, and the same bits in any company."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from maxjax.sim.trials import trials
from maxjax.sim.trials.trials import TRUTH, Trial, draw, draw_many
from maxjax.sim.worlds.geoms import PLANE
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.sim.worlds.solid_distance import distances

# All of them: what one compiled, the next ones run.
pytestmark = pytest.mark.full_speed


def same_bits(a: Trial, b: Trial) -> bool:
    return all(
        np.array_equal(x, y, equal_nan=True) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


def test_trials_obey_the_protocol() -> None:
    """Two cities: distances in NumPy, clearance by sampling verticals, reachability by SciPy's labels."""
    name = "suburb"
    drawn = draw_many(name, 5, range(100))
    assert np.all(drawn.valid)
    assert np.array_equal(drawn.city, np.repeat([5, 6], 50))
    ends = np.asarray(jnp.stack([drawn.start, drawn.goal]), float)
    apart = np.linalg.norm(ends[0] - ends[1], axis=1)
    assert np.all((apart >= 50.0) & (apart <= 80.0))
    # Spread over what is allowed, not piled up at one end.
    assert np.ptp(apart) > 25.0
    assert np.all(np.abs(ends[..., :2]) <= 100.0)
    assert np.all((ends[..., 2] >= 3.0) & (ends[..., 2] <= 15.0))
    assert ends[..., 2].min() < 4.5
    assert ends[..., 2].max() > 13.5
    assert np.array_equal(ends, np.round(ends * 64) / 64)
    along = jax.jit(jax.vmap(distances, (None, 0)))
    heights = np.arange(0.0, 125.0, 1.0)
    for city in (5, 6):
        geoms = make_scene(name, city).geoms
        solid = np.array([kind != PLANE for kind in geoms.type])
        mine = np.asarray(drawn.city) == city
        for x, y, _ in ends[:, mine][:, ::10].reshape(-1, 3):
            points = jnp.asarray(np.stack([np.full_like(heights, x), np.full_like(heights, y), heights], -1))
            assert np.asarray(along(geoms, points.astype(jnp.float32)))[:, solid].min() >= 10.0 - 1e-3

        occupied, ground = occupancy(geoms, TRUTH)
        near = ndimage.distance_transform_edt(~(occupied & ~ground)) * TRUTH.spacing
        blocked = (near <= 2.0) | ndimage.binary_dilation(ground)
        labels, _ = ndimage.label(~blocked)
        index = np.floor((ends[:, mine] - TRUTH.origin) / TRUTH.spacing + 0.5).astype(int)
        a, b = (labels[tuple(i.T)] for i in index)
        assert np.all((a == b) & (a > 0))


def test_a_trial_alone_is_the_same_bits_in_company() -> None:
    company = draw_many("suburb", 0, range(60))
    for index in (37, 59):
        alone = draw("suburb", 0, index)
        assert same_bits(alone, jax.tree.map(lambda a, i=index: a[i], company))
    shuffled = [58, 3, 55, 3]
    picked = draw_many("suburb", 0, shuffled)
    assert same_bits(picked, jax.tree.map(lambda a: a[np.array(shuffled)], company))
    # Other seeds share cities, not flights; no two flights of a set are alike.
    assert not same_bits(draw("suburb", 1, 0), draw("suburb", 0, 50))
    assert int(draw("suburb", 1, 0).city) == int(draw("suburb", 0, 50).city) == 1
    assert len(np.unique(np.asarray(company.start), axis=0)) == 60


def test_sealed_pairs_are_passed_over_and_counted() -> None:
    """Ground truth altered by hand: without the half x > 0, pairs that need it are excluded, the next one is taken."""
    geoms = make_scene("suburb", 0).geoms
    key = jax.random.key(3)
    everywhere = jnp.ones(TRUTH.shape, bool)
    start, goal, valid, excluded = trials.draw_in(geoms, everywhere, key, jnp.int32(0))
    assert np.all(valid)
    assert not np.any(excluded)
    west = everywhere & (jnp.arange(TRUTH.shape[0]) < TRUTH.shape[0] // 2)[:, None, None]
    west_start, west_goal, west_valid, west_excluded = trials.draw_in(geoms, west, key, jnp.int32(0))
    west_valid = np.asarray(west_valid)
    assert np.all(np.asarray(west_start)[west_valid, 0] < 1.0)
    assert np.all(np.asarray(west_goal)[west_valid, 0] < 1.0)
    kept = (np.asarray(start)[:, 0] < -2.0) & (np.asarray(goal)[:, 0] < -2.0)
    assert np.array_equal(np.asarray(start)[kept], np.asarray(west_start)[kept])
    assert np.all(np.asarray(west_excluded)[kept] == 0)
    moved = ~kept & (np.asarray(start)[:, 0] > 2.0)
    assert moved.any()
    assert np.all(np.asarray(west_excluded)[moved] > 0)
    nowhere = trials.draw_in(geoms, ~everywhere, key, jnp.int32(0))
    assert not np.any(nowhere[2])
    assert np.all(np.isnan(nowhere[0]))
    assert np.all(np.asarray(nowhere[3]) > 0)


def test_the_open_air_ends_at_sealed_rooms() -> None:
    """A closed shell of voxels is dilated by one voxel; inside it nothing is joined to the sky."""
    occupied = np.zeros(TRUTH.shape, bool)
    occupied[60:72, 60:72, 5:17] = True
    occupied[61:71, 61:71, 6:16] = False
    ground = np.zeros(TRUTH.shape, bool)
    ground[:, :, :2] = True
    air = np.asarray(trials.open_air(jnp.asarray(occupied | ground), jnp.asarray(ground)))
    assert not air[62:70, 62:70, 7:15].any()
    assert not air[59, 65, 10]
    assert air[58, 65, 10]
    assert not air[:, :, :3].any()
    assert air[:50, :, 3:].all()


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ValueError, match="midtown, downtown, suburb"):
        draw("atlantis", 0, 0)
    with pytest.raises(ValueError, match="from 0 to"):
        draw("suburb", -1, 0)
    with pytest.raises(ValueError, match="from 0 to"):
        draw("suburb", 0, -1)
    with pytest.raises(ValueError, match="at least one"):
        draw_many("suburb", 0, [])
