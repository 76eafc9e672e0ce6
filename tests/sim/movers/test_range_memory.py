"""Range images of the last looks: against a loop over beams in NumPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from maxjax.sim.movers.range_memory import empty_memory, margin, remember_scan, was_empty
from tests.sim.movers.scenes import CITY, LIDAR, SIGHT, fast_scan, pose

jit_remembered, jit_was_empty = jax.jit(remember_scan), jax.jit(was_empty)


def twin(scans: list[np.ndarray], movers: list[np.ndarray], points: np.ndarray, poses: list) -> np.ndarray:
    """What `was_empty` says, point by point; newest image first."""
    verdicts = []
    for point in points:
        empty, taken = [], []
        for image, mover, (where, turned) in zip(scans, movers, poses, strict=True):
            local = np.asarray(turned, float).T @ (point - np.asarray(where, float))
            distance = np.linalg.norm(local)
            row = (np.rad2deg(np.arcsin(local[2] / distance)) + 30.0) / 60.0 * 31.0
            column = round(np.arctan2(local[1], local[0]) / (2.0 * np.pi) * 256.0)
            least = 0.0
            if 0.0 <= row <= 31.0:
                rows = [r for r in range(round(row) - 1, round(row) + 2) if 0 <= r < 32]
                columns = [(column + j) % 256 for j in (-1, 0, 1)]
                if not mover[np.ix_(rows, columns)].any():
                    patch = image[np.ix_(rows, columns)]
                    least = np.where(np.isfinite(patch), patch, LIDAR.max_range).min()
            allowed = float(margin(jnp.float32(distance), SIGHT))
            empty.append(least > 0 and distance + allowed < least)
            taken.append(least > 0 and abs(distance - least) <= allowed)
        verdicts.append((sum(empty) >= 2 and sum(taken) <= 1) or (empty[-1] and empty[-2]))
    return np.array(verdicts)


def test_verdicts_are_those_of_a_loop_over_beams() -> None:
    rng = np.random.default_rng(0)
    memory, scans, movers, poses = empty_memory(SIGHT), [], [], []
    for k in range(SIGHT.images):
        where, turned = pose(2 * k, 5.0)
        result = fast_scan(CITY, LIDAR, (where, turned), jax.random.key(k))
        mover = np.zeros((32, 256), bool)
        mover[rng.integers(0, 32, 20), rng.integers(0, 256, 20)] = True
        memory = jit_remembered(
            memory, result, jnp.asarray(mover.reshape(-1)), (where, turned), jnp.float32(0.2 * k), SIGHT
        )
        scans, movers, poses = (
            [np.asarray(result.distance).reshape(32, 256), *scans],
            [mover, *movers],
            [(where, turned), *poses],
        )
    points = rng.uniform([-20.0, -20.0, -1.0], [20.0, 25.0, 14.0], (700, 3)).astype(np.float32)
    given = np.asarray(jit_was_empty(memory, jnp.asarray(points), SIGHT))
    np.testing.assert_array_equal(was_empty(memory, jnp.asarray(points), SIGHT), given)
    expected = twin(scans, movers, points.astype(float), poses)
    assert 0.05 < expected.mean() < 0.95
    # Directions between two beams are rounded to either.
    assert (given != expected).mean() < 0.01


def test_images_are_taken_some_time_apart_and_never_of_a_pose_that_is_none() -> None:
    memory, where = empty_memory(SIGHT), pose(0, 0.0)
    result, none = fast_scan(CITY, LIDAR, where, jax.random.key(0)), jnp.zeros(LIDAR.rays, bool)
    for k in range(8):
        memory = jit_remembered(memory, result, none, where, jnp.float32(0.1 * k), SIGHT)
    np.testing.assert_allclose(memory.time[:4], [0.6, 0.4, 0.2, 0.0], atol=1e-6)
    assert np.isneginf(np.asarray(memory.time[4:])).all()
    lost = jit_remembered(memory, result, none, (where[0] * jnp.nan, where[1]), jnp.float32(9.0), SIGHT)
    assert lost.time[0] == memory.time[0]
