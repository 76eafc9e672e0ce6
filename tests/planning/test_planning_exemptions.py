"""The balls that join two ends are the smallest, by labels of SciPy; and what they open stays within them."""

from __future__ import annotations

import functools
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import component_of, random_blocks, random_free

from maxjax import Status
from maxjax.fields.distance import cube_distance
from maxjax.fields.occupancy import squared_distance
from maxjax.planning.ends import locate
from maxjax.planning.exemptions import Opened, ball_radius, largest_radius, last_level, opened
from maxjax.planning.inflation import hard_set, least_quarters

SHAPE = (16, 14, 12)

distance_on = jax.jit(cube_distance, static_argnums=1)


@functools.partial(jax.jit, static_argnums=4)
def opened_on(
    occupied: jax.Array, ground: jax.Array, start: jax.Array, goal: jax.Array, radius: float
) -> tuple[jax.Array, Opened]:
    quarters = cube_distance(occupied & ~ground, radius)
    hard = hard_set(quarters, squared_distance(ground, 1), least_quarters(radius))
    return hard, opened(hard, occupied, start, goal, radius)


@functools.partial(jax.jit, static_argnums=4)
def largest_on(occupied: jax.Array, ground: jax.Array, start: jax.Array, goal: jax.Array, radius: float) -> jax.Array:
    quarters = cube_distance(occupied & ~ground, radius)
    return largest_radius(quarters, squared_distance(ground, 1), occupied, start, goal, radius)


def with_balls(hard: np.ndarray, occupied: np.ndarray, ends: np.ndarray, levels: tuple[int, int]) -> np.ndarray:
    """Free voxels of the hard set and of a ball around either end."""
    free = ~hard
    centres = np.moveaxis(np.indices(SHAPE), 0, -1)
    for end, level in zip(ends, levels, strict=True):
        free |= ~occupied & (((centres - end) ** 2).sum(axis=-1) < level**2)
    return free


def joined_by(hard: np.ndarray, occupied: np.ndarray, ends: np.ndarray, *levels: int) -> bool:
    free = with_balls(hard, occupied, ends, (levels[0], levels[1]))
    return bool(component_of(free, tuple(ends[0]))[tuple(ends[1])])


def scene(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Occupied voxels, the ground among them, and two ends in others; one map in two has a wall across it."""
    occupied = random_blocks(rng, SHAPE, int(rng.integers(10, 30)), 4)
    if rng.random() < 0.5:
        occupied[8, :, :] = rng.random(SHAPE[1:]) < 0.93
    ground = np.zeros(SHAPE, bool)
    ground[:, :, 0] = True
    occupied |= ground
    return occupied, ground, random_free(rng, occupied, 2)


@pytest.mark.parametrize("radius", [0.5, 1.5])
def test_the_smallest_balls_that_join_are_opened(radius: float) -> None:
    rng = np.random.default_rng(3)
    top, seen = last_level(radius), []
    for _ in range(50):
        occupied, ground, ends = scene(rng)
        hard, found = opened_on(occupied, ground, *ends.astype(np.int32), radius)
        joins = functools.partial(joined_by, np.asarray(hard), occupied, ends)
        common = next((k for k in range(top + 1) if joins(k, k)), None)
        seen.append(int(found.status))
        if common is None:
            bare = component_of(~occupied, tuple(ends[0]))[tuple(ends[1])]
            assert found.status == (Status.NO_SAFE_PATH if bare else Status.NO_VALID_PATH)
            continue
        own = next(k for k in range(common + 1) if joins(k, common))
        other = next(k for k in range(common + 1) if joins(own, k))
        assert found.status == Status.OK
        assert found.levels.tolist() == [own, other]
        np.testing.assert_array_equal(~np.asarray(found.blocked), with_balls(hard, occupied, ends, (own, other)))
        seen.append(10 + min(own, 2) + min(other, 2))
    assert {int(Status.OK), 10, 11, 12} <= set(seen)
    if radius > 1:
        assert {Status.NO_SAFE_PATH, Status.NO_VALID_PATH} & set(seen)


def test_many_problems_at_a_time_are_each_by_itself() -> None:
    rng = np.random.default_rng(4)
    scenes = [scene(rng) for _ in range(6)]
    maps, grounds, ends = (np.stack(part) for part in zip(*scenes, strict=True))
    ends = ends.astype(np.int32)
    batch = jax.vmap(functools.partial(opened_on, radius=1.5))(maps, grounds, ends[:, 0], ends[:, 1])
    for k in range(6):
        alone = opened_on(maps[k], grounds[k], *ends[k], 1.5)
        for one, many in zip(jax.tree.leaves(alone), jax.tree.leaves(batch), strict=True):
            np.testing.assert_array_equal(one, many[k])


def test_at_radius_0_no_ball_is_opened() -> None:
    occupied, ground, _ = scene(np.random.default_rng(5))
    ends = random_free(np.random.default_rng(6), occupied, 2).astype(np.int32)
    hard, found = opened_on(occupied, ground, *ends, 0.0)
    np.testing.assert_array_equal(hard, occupied)
    np.testing.assert_array_equal(found.blocked, occupied)
    assert found.levels.tolist() == [0, 0]
    assert found.status in (Status.OK, Status.NO_VALID_PATH)


def test_outside_the_ball_no_cell_is_nearer_than_the_radius() -> None:
    rng = np.random.default_rng(7)
    radius, needed = 1.5, 0
    ball_of = jax.jit(ball_radius, static_argnums=4)
    for _ in range(30):
        occupied, ground, ends = scene(rng)
        hard, found = opened_on(occupied, ground, *ends.astype(np.int32), radius)
        barred = hard & ~jnp.asarray(occupied)
        quarters = distance_on(jnp.asarray(occupied & ~ground), radius)
        exact = (ends + rng.uniform(-0.49, 0.49, (2, 3))).astype(np.float32)
        balls = [
            float(ball_of(barred, quarters, locate(jnp.asarray(x), SHAPE), level, radius))
            for x, level in zip(exact, found.levels, strict=True)
        ]
        free = ~np.asarray(found.blocked)
        lows = np.argwhere(free[:-1, :-1, :-1])
        corners = [np.array(c) for c in itertools.product((0, 1), repeat=3)]
        lows = lows[np.all([free[tuple((lows + c).T)] for c in corners], axis=0)]
        points = np.concatenate([lows + rng.random(lows.shape) for _ in range(3)])
        outside = np.all(
            [np.linalg.norm(points - x, axis=1) > ball for x, ball in zip(exact, balls, strict=True)], axis=0
        )
        gap = np.maximum(np.abs(points[outside][:, None] - np.argwhere(occupied & ~ground)[None]) - 0.5, 0)
        assert (np.sqrt((gap**2).sum(axis=-1)).min(axis=1) >= radius - 1e-6).all()
        needed += sum(ball > 0 for ball in balls)
        assert all(ball <= last_level(radius) + 1.5 * math.sqrt(3) for ball in balls)
    assert needed > 5


def test_the_largest_radius_is_that_of_the_door() -> None:
    """A door of one voxel, one of 2 x 2, and one of 3 x 3 without and with its corners, in a wall."""
    ends, frame = np.array([[1, 6, 6], [14, 6, 6]], np.int32), np.ones((3, 3), bool)
    ground = np.zeros(SHAPE, bool)
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)
    for door, expected in ((frame[:1, :1], 0.5), (frame[:2, :2], 0.5), (cross, math.sqrt(0.5)), (frame, 1.5)):
        occupied = np.zeros(SHAPE, bool)
        occupied[7:9] = True
        occupied[7:9, 5 : 5 + len(door), 5 : 5 + len(door)] = ~door
        joined = expected == 1.5
        assert opened_on(occupied, ground, *ends, 1.5)[1].status == (Status.OK if joined else Status.NO_SAFE_PATH)
        if not joined:
            assert float(largest_on(occupied, ground, *ends, 1.5)) == pytest.approx(expected)
