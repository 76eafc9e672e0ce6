"""The reactive layer: range, bound, independence of sampling, no opposition to travel, finite derivatives."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from maxjax.sim.loop.reactive import RANGE, push

WALL = np.stack(np.meshgrid([0.0], np.linspace(-6, 6, 61), np.linspace(-6, 6, 61), indexing="ij"), -1).reshape(-1, 3)
WALL_POINTS = jnp.asarray(WALL, jnp.float32)
AT_REST = jnp.zeros(3)
fast_push = jax.jit(push)


def test_push_is_zero_beyond_its_range_bounded_and_grows_towards_a_wall() -> None:
    distances = jnp.linspace(0.0, 4.0, 401)
    many = jax.jit(jax.vmap(lambda d: push(WALL_POINTS, -d * jnp.array([1.0, 0.0, 0.0]), AT_REST, 2.0)))
    pushes = np.asarray(many(distances))
    size = np.linalg.norm(pushes, axis=1)
    assert np.all(pushes[distances >= RANGE] == 0.0)
    assert size.max() <= 2.0 + 1e-5
    assert np.all(pushes[1:, 0] <= 0.0)
    np.testing.assert_allclose(pushes[:, 1:], 0.0, atol=1e-4)
    # Nearer than the vehicle's radius there is nothing left to avoid.
    assert size[50] > 1.2
    assert np.all(np.diff(size[50:]) < 1e-5)
    # Smooth: no jump between neighbours a centimetre apart.
    assert np.abs(np.diff(size[20:])).max() < 0.05


def test_push_does_not_depend_on_how_densely_a_wall_is_seen_nor_on_misses() -> None:
    at, along, missed = jnp.array([-1.2, 0.0, 0.0]), jnp.array([0.0, 3.0, 0.0]), jnp.full_like(WALL_POINTS, jnp.nan)
    once = fast_push(jnp.concatenate([missed, WALL_POINTS, missed]), at, along)
    assert np.linalg.norm(once) > 0.3
    np.testing.assert_allclose(fast_push(jnp.tile(WALL_POINTS, (3, 1)), at, along), once, atol=1e-5)
    assert np.all(np.asarray(fast_push(jnp.tile(missed, (3, 1)), at, along)) == 0.0)


def test_push_never_opposes_travel_unless_very_near_and_corridors_cancel() -> None:
    velocity = jnp.array([4.0, 0.5, 0.0])
    for distance in (2.5, 2.0, 1.6):
        given = fast_push(WALL_POINTS, jnp.array([-distance, 0.0, 0.0]), velocity)
        # Not quite 0: the direction of travel is smoothed over 0.3 m/s.
        assert float(given @ velocity) / 4.03 > -0.02
    assert float(fast_push(WALL_POINTS, jnp.array([-0.7, 0.0, 0.0]), velocity) @ velocity) / 4.03 < -0.5
    corridor = jnp.concatenate([WALL_POINTS - jnp.array([1.5, 0, 0]), WALL_POINTS + jnp.array([1.5, 0, 0])])
    np.testing.assert_allclose(fast_push(corridor, jnp.zeros(3), jnp.array([0.0, 4.0, 0.0])), 0.0, atol=1e-4)
    # Beside a wall it pushes away from it, whichever way the flight goes.
    for way in (1.0, -1.0):
        beside = fast_push(WALL_POINTS, jnp.array([-1.0, 0.0, 0.0]), jnp.array([0.0, way * 4.0, 0.0]))
        assert float(beside[0]) < -0.3


def test_push_has_finite_derivatives_everywhere() -> None:
    slope = jax.jit(jax.jacrev(push, (0, 1, 2)))
    points = jnp.concatenate([WALL_POINTS[:50], jnp.zeros((1, 3)), jnp.full((2, 3), jnp.nan)])
    for at in ([0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-9.0, 0.0, 0.0]):
        for velocity in ([0.0, 0.0, 0.0], [2.0, 0.0, 0.0]):
            for leaf in slope(points, jnp.array(at), jnp.array(velocity)):
                assert np.all(np.isfinite(leaf))
