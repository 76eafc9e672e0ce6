"""Returns of one's own sensor: the nearest in each pixel, the vehicle's own left out, and all of them counted."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.movers.lookout import as_scan
from maxjax.sim.sensors.lidar import Lidar, directions
from maxjax.sim.sensors.own_returns import Airframe, ReturnCounts, project_returns
from maxjax.sim.sensors.range_image import clear_range

LIDAR = Lidar(channels=8, rays=8 * 36, elevation_min=-30.0, elevation_max=40.0, max_range=50.0)
BOX = ((-0.2, -0.6, -0.1), (0.6, 0.6, 0.2))
AIRFRAME = Airframe(0.4, BOX)
RAYS = np.asarray(directions(LIDAR), np.float64)


def total(counts: ReturnCounts) -> int:
    return sum(dataclasses.astuple(counts))


def ranges(seed: int) -> np.ndarray:
    """Distances of which some are missing, and some too far."""
    rng = np.random.default_rng(seed)
    far = rng.uniform(1.0, 60.0, LIDAR.rays)
    return np.where(rng.random(LIDAR.rays) < 0.2, np.inf, far)


@pytest.mark.parametrize("seed", range(5))
def test_points_on_rays_in_any_order_are_the_ranges_of_these_rays(seed: int) -> None:
    far = ranges(seed)
    points = np.where(np.isfinite(far), far, np.nan)[:, None] * RAYS
    order = np.random.default_rng(seed).permutation(LIDAR.rays)
    ordered, by_ray = project_returns(far, LIDAR, AIRFRAME)
    unordered, by_point = project_returns(points[order], LIDAR, AIRFRAME)
    expected = np.where(far <= LIDAR.max_range, far, np.inf)
    np.testing.assert_allclose(ordered, expected, rtol=1e-6)
    np.testing.assert_allclose(unordered, expected, rtol=1e-6)
    assert by_ray == by_point
    assert by_ray == ReturnCounts(
        seen=int((far <= 50.0).sum()),
        behind=0,
        own=0,
        outside=0,
        beyond=int((np.isfinite(far) & (far > 50.0)).sum()),
        missing=int(np.isinf(far).sum()),
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_nearest_return_of_a_pixel_counts_and_every_point_is_counted(seed: int) -> None:
    """By a search over all rays for the one at the least angle, for a cloud of ten points a ray and every kind."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(10 * LIDAR.rays, 3)) * rng.choice([0.1, 1.0, 10.0, 40.0], (10 * LIDAR.rays, 1))
    points[rng.random(len(points)) < 0.05] = 0.0
    points[rng.random(len(points)) < 0.05, 1] = np.nan
    points[rng.random(len(points)) < 0.01, 2] = np.inf
    found, counts = project_returns(points, LIDAR, AIRFRAME)
    assert total(counts) == len(points)

    sound = points[np.isfinite(points).all(axis=1) & (np.abs(points).sum(axis=1) > 0.0)]
    assert counts.missing == len(points) - len(sound)
    far = np.linalg.norm(sound, axis=1)
    low, high = map(np.array, BOX)
    own = (far < AIRFRAME.least) | ((sound >= low) & (sound <= high)).all(axis=1)
    assert counts.own == own.sum()
    assert counts.beyond == (~own & (far > 50.0)).sum()
    elevation = np.degrees(np.arcsin(sound[:, 2] / far))
    viewed = (elevation > -35.0) & (elevation < 45.0)  # half a step of ten degrees beyond the outermost channels
    assert counts.outside == (~own & (far <= 50.0) & ~viewed).sum()
    azimuth = np.degrees(np.arctan2(sound[:, 1], sound[:, 0]))
    ray = np.round((elevation + 30.0) / 10.0) * 36 + np.round(azimuth / 10.0) % 36
    expected = np.full(LIDAR.rays, np.inf)
    for number in range(LIDAR.rays):
        here = far[viewed & ~own & (far <= 50.0) & (ray == number)]
        expected[number] = here.min() if len(here) else 0.0 if (viewed & own & (ray == number)).any() else np.inf
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_own_returns_hide_what_is_behind_them_and_only_there() -> None:
    """A rotor in a column of beams: the beam is clear nowhere; where another return came through, up to that."""
    wall = np.full(LIDAR.rays, 20.0)
    rotor = np.array([40, 41, 100])
    points = np.concatenate([np.delete(wall[:, None] * RAYS, rotor, axis=0), 0.3 * RAYS[rotor], 20.0 * RAYS[rotor[2:]]])
    found, counts = project_returns(points, LIDAR, AIRFRAME)
    assert counts.own == 3
    clear = np.asarray(clear_range(as_scan(jnp.asarray(found)), LIDAR)).reshape(-1)
    np.testing.assert_array_equal(np.flatnonzero(clear == 0.0), rotor[:2])
    np.testing.assert_allclose(np.delete(clear, rotor[:2]), 20.0, rtol=1e-6)


def test_a_column_that_only_the_vehicle_fills_says_nothing() -> None:
    found, _ = project_returns(np.repeat(0.3 * RAYS, 2, axis=0), LIDAR, AIRFRAME)
    assert (found == 0.0).all()
    half = np.where(np.arange(LIDAR.rays) // 36 % 2 == 0, 0.3, np.inf)
    found, _ = project_returns(half, LIDAR, AIRFRAME)
    assert (np.asarray(clear_range(as_scan(jnp.asarray(found)), LIDAR)) == 0.0).all()


def test_a_narrow_sensor_sees_nothing_beside_its_width() -> None:
    narrow = dataclasses.replace(LIDAR, width=90.0)
    found, counts = project_returns(10.0 * RAYS, narrow, AIRFRAME)
    azimuth = np.degrees(np.arctan2(RAYS[:, 1], RAYS[:, 0]))
    np.testing.assert_array_equal(np.isfinite(found), np.abs(azimuth) < 45.0 + 1e-6)
    assert counts.outside == np.isinf(found).sum()


@pytest.mark.parametrize("of", [lambda: Airframe(0.0), lambda: Airframe(0.3, ((0.0, 0.0, 0.0), (1.0, 1.0, 0.0)))])
def test_an_airframe_that_is_none_is_refused(of: object) -> None:
    with pytest.raises(ValueError, match=r"Airframe\.(least|box): expected"):
        of()  # type: ignore[operator]


def test_ranges_of_another_sensor_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected points \(n, 3\) or 288 distances, given \(287,\)"):
        project_returns(np.zeros(287), LIDAR, AIRFRAME)
