"""Disturbances: calm changes nothing, and each strength has the effect and the size that it states."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.sensors.lidar import Lidar, Scan, directions, scan
from maxjax.sim.vehicle.disturbances import SETS, Disturbances, degrade, mean_wind, outage, position_error
from tests.scenes import wall_and_tower

LIDAR = Lidar(rays=8192, channels=64)
START = np.array([-24.0, 1.0, 6.0], np.float32)
KEY = jax.random.key(5)


def worsened(measured: Scan, disturbances: Disturbances, time: float) -> Scan:
    """A scan from the start, degraded as in a flight."""
    failed = outage(disturbances, LIDAR, KEY, jnp.float32(time))
    return degrade(measured, disturbances, LIDAR, jnp.asarray(START), failed, KEY)


def test_a_scan_whose_beams_are_all_lost_holds_no_points() -> None:
    measured = scan(wall_and_tower(), LIDAR, jnp.asarray(START), jnp.eye(3), KEY)
    found = worsened(measured, Disturbances(blackout=1e3, dropout=1.0), 10.0)
    assert not np.any(found.hit)
    assert np.all(np.isnan(found.points))
    assert np.all(np.isinf(found.distance))


def test_calm_leaves_a_scan_as_it_is_and_each_disturbance_does_what_it_says() -> None:
    origin = jnp.asarray(START)
    measured = scan(wall_and_tower(), LIDAR, origin, jnp.eye(3), KEY)

    def worse(time: float = 0.0, **strengths: float) -> Scan:
        return worsened(measured, Disturbances(**strengths), time)

    calm, hit = worse(), np.asarray(measured.hit)
    np.testing.assert_array_equal(calm.hit, hit)
    np.testing.assert_allclose(np.asarray(calm.points)[hit], np.asarray(measured.points)[hit], atol=1e-4)
    noisy = worse(range_noise=0.2)
    error = np.asarray(noisy.distance)[hit] - np.asarray(measured.distance)[hit]
    assert np.std(error) == pytest.approx(0.2, rel=0.05)
    rays = np.asarray(directions(LIDAR))[hit]
    np.testing.assert_allclose(
        np.asarray(noisy.points)[hit], START + rays * np.asarray(noisy.distance)[hit, None], atol=1e-3
    )
    assert np.sum(worse(dropout=0.5).hit) == pytest.approx(0.5 * hit.sum(), rel=0.05)
    dead = hit & ~np.asarray(worse(dead_sector=90.0).hit)
    assert np.all(np.asarray(worse(dead_sector=360.0).hit) == 0)
    lost = np.sort(np.unique(np.nonzero(dead.reshape(LIDAR.channels, -1).any(axis=0))[0]))
    columns = LIDAR.rays // LIDAR.channels
    gaps = np.diff(np.concatenate([lost, lost[:1] + columns]))
    assert columns - gaps.max() == pytest.approx(columns / 4, abs=1)
    dark = [not np.any(worse(time, blackout=1.0).hit) for time in np.arange(0.0, 10.0, 0.25)]
    assert sum(dark) == pytest.approx(4, abs=1)


def test_wind_and_drift_are_as_strong_as_they_say() -> None:
    assert np.linalg.norm(mean_wind(SETS["wind"], KEY)) == pytest.approx(10.0, rel=1e-5)
    errors = [
        np.linalg.norm(position_error(SETS["drift"], KEY, jnp.float32(time))) for time in np.arange(0.0, 40.0, 0.5)
    ]
    assert errors[0] == 0.0
    assert max(errors) == pytest.approx(1.0, rel=1e-3)
    assert np.all(np.asarray(position_error(SETS["calm"], KEY, jnp.float32(7.0))) == 0.0)
    assert all(value == 0.0 for value in dataclasses.asdict(SETS["calm"]).values())
