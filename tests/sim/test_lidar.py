"""The LiDAR: pattern, frames, noise, dropout, batches."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxjax.sim.sensors.lidar import Lidar, Scan, directions, scan
from maxjax.sim.worlds.scenes import make_scene

CLEAN = Lidar(range_noise=0.0, dropout=0.0)
POSE = (jnp.array([3.0, 4.0, 30.0]), jnp.eye(3))
KEY = jax.random.key(0)

fast_scan = jax.jit(scan)


def test_pattern_covers_its_field() -> None:
    for channels in (32, 64, 128):
        rays = np.asarray(directions(Lidar(channels=channels)))
        assert rays.shape == (32768, 3)
        np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-6)
        elevation = np.rad2deg(np.arcsin(rays[:, 2])).reshape(channels, -1)
        assert np.ptp(elevation, axis=1).max() < 1e-3
        np.testing.assert_allclose(elevation[:, 0], np.linspace(-45.0, 45.0, channels), atol=1e-3)
        assert np.allclose(rays.reshape(channels, -1, 3)[:, 0, 1], 0.0)
        assert len(np.unique(np.round(rays, 5), axis=0)) == 32768


def test_points_lie_on_their_rays_and_misses_are_marked() -> None:
    geoms = make_scene("downtown", 0).geoms
    rotation = jnp.asarray(Rotation.from_euler("zy", [40.0, 15.0], degrees=True).as_matrix(), jnp.float32)
    result = fast_scan(geoms, CLEAN, POSE[0], rotation, KEY)
    hit = np.asarray(result.hit)
    assert 0.2 < hit.mean() < 1.0
    assert np.all(np.isinf(result.distance[~hit]))
    assert np.all(np.isnan(result.points[~hit]))
    assert np.all(result.distance[hit] <= CLEAN.max_range)
    world = np.asarray(directions(CLEAN)) @ np.asarray(rotation).T
    expected = np.asarray(POSE[0]) + world * np.asarray(result.distance)[:, None]
    np.testing.assert_allclose(result.points[hit], expected[hit], atol=1e-4)
    # The ground is z = 0 and nothing is measured below it.
    assert np.nanmin(result.points[:, 2]) > -1e-3


def test_turning_the_sensor_about_its_axis_by_one_step_shifts_the_scan() -> None:
    geoms = make_scene("suburb", 0).geoms
    steps = CLEAN.rays // CLEAN.channels
    turn = jnp.asarray(Rotation.from_euler("z", 2 * np.pi / steps).as_matrix(), jnp.float32)
    level = np.asarray(fast_scan(geoms, CLEAN, *POSE, KEY).distance).reshape(CLEAN.channels, -1)
    turned = np.asarray(fast_scan(geoms, CLEAN, POSE[0], turn, KEY).distance).reshape(CLEAN.channels, -1)
    same = np.isclose(np.roll(level, -1, axis=1), turned, atol=1e-2) | (
        np.isinf(np.roll(level, -1, axis=1)) & np.isinf(turned)
    )
    assert same.mean() > 0.999


def test_noise_and_dropout_have_their_statistics() -> None:
    geoms = make_scene("midtown", 0).geoms
    clean = fast_scan(geoms, CLEAN, *POSE, KEY)
    noisy = fast_scan(geoms, Lidar(range_noise=0.05, dropout=0.1), *POSE, KEY)
    kept = np.asarray(noisy.hit)
    candidates = np.asarray(clean.hit)
    assert not np.any(kept & ~candidates)
    assert abs(1.0 - kept.sum() / candidates.sum() - 0.1) < 0.01
    # Away from the range limit, where the measured distance is clipped.
    kept = kept & (np.asarray(clean.distance) < 99.0)
    error = np.asarray(noisy.distance - clean.distance)[kept]
    assert abs(error.mean()) < 0.002
    assert abs(error.std() - 0.05) < 0.002
    other = fast_scan(geoms, Lidar(range_noise=0.05, dropout=0.1), *POSE, jax.random.key(1))
    assert not np.array_equal(other.hit, noisy.hit)
    everything_lost = fast_scan(geoms, Lidar(dropout=1.0), *POSE, KEY)
    assert not np.any(everything_lost.hit)


def test_batches_over_scenes_poses_and_keys_equal_the_loop() -> None:
    lidar = Lidar(channels=32, rays=2048)
    keys = jax.random.split(KEY, 3)
    cities = jax.tree.map(lambda *a: jnp.stack(a), *[make_scene("suburb", seed).geoms for seed in range(3)])
    positions = jnp.array([[0.0, 0.0, 12.0], [20.0, -30.0, 15.0], [-40.0, 5.0, 20.0]])
    rotations = jnp.asarray(Rotation.random(3, np.random.default_rng(0)).as_matrix(), jnp.float32)
    batched_scan = jax.jit(jax.vmap(scan, (0, None, 0, 0, 0)))
    batch = batched_scan(cities, lidar, positions, rotations, keys)
    for i in range(3):
        one: Scan = fast_scan(jax.tree.map(lambda a, i=i: a[i], cities), lidar, positions[i], rotations[i], keys[i])
        same = np.asarray(batch.hit[i]) == np.asarray(one.hit)
        assert same.mean() > 0.999
        both = np.asarray(batch.hit[i]) & np.asarray(one.hit)
        assert np.mean(np.isclose(batch.distance[i][both], one.distance[both], atol=1e-3)) > 0.999


def test_bad_settings_and_shapes_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for setting, match in (
        ({"channels": 1}, "2 to 128"),
        ({"channels": 48}, "multiple of 48"),
        ({"elevation_min": 50.0}, "elevation_min < elevation_max"),
        ({"max_range": 0.0}, "max_range"),
        ({"range_noise": -1.0}, "range_noise"),
        ({"dropout": float("nan")}, "dropout"),
    ):
        with pytest.raises(ValueError, match=match):
            Lidar(**setting)
    geoms = make_scene("suburb", 0).geoms
    # In tests the run-time type checks would speak first.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match=r"position \(3,\) and rotation \(3, 3\)"):
        scan(geoms, CLEAN, jnp.zeros((1, 3)), jnp.eye(3), KEY)
