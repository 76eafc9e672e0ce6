"""Inputs judged in every way they can be wrong."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, Price, Status
from maxjax.planning.path.line_of_sight import stands_free
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate
from tests.references import component_of, distances_to_cubes, random_blocks, random_free

GRID = Grid((16, 18, 20), 2.0, (-10.0, 3.0, 1.0))
NO_GROUND = np.zeros(GRID.shape, bool)


_formulate = jax.jit(formulate, static_argnames=("distances", "grid"))


def formulated(
    occupied: np.ndarray, ground: np.ndarray, start: np.ndarray, goal: np.ndarray, radius: float = 1.0
) -> Problem:
    """The problem of ends in the world [m]."""
    ends = (np.stack([start, goal]).astype(np.float64) - np.array(GRID.origin)) / GRID.spacing
    found: Problem = _formulate(occupied, ground, ends.astype(np.float32), distances=Distances(radius), grid=GRID.local)
    return found


def judge(occupied: np.ndarray, start: np.ndarray, goal: np.ndarray) -> Problem:
    return formulated(occupied, NO_GROUND, start, goal)


def world(index: np.ndarray) -> np.ndarray:
    return np.array(GRID.origin) + GRID.spacing * np.asarray(index, float)


@pytest.mark.parametrize("end", ["start", "goal"])
def test_twenty_sealed_ends_have_no_valid_path(end: str) -> None:
    """Inside |x| + |y| + |z| = 2, whose voxels share edges and no faces: only a cut corner could lead through."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        center = rng.integers(3, np.array(GRID.shape) - 3)
        occupied = np.abs(np.indices(GRID.shape).T - center).sum(axis=-1).T == 2
        far = np.array([0, 0, 0])
        ends = (center, far) if end == "start" else (far, center)
        assert not component_of(~occupied, tuple(center))[0, 0, 0]
        assert judge(occupied, world(ends[0]), world(ends[1])).status == Status.NO_VALID_PATH
        x, y, z = center
        occupied[x + 2, y, z] = False
        assert judge(occupied, world(ends[0]), world(ends[1])).status == Status.OK


def test_every_fault_has_its_status() -> None:
    occupied = NO_GROUND.copy()
    occupied[5, 6, 7] = True
    good, other, inside, beyond = world([1, 2, 3]), world([12, 12, 12]), world([5, 6, 7]), np.array([999.0, 10.0, 10.0])
    cases = [
        (good, other, Status.OK),
        (good, good, Status.START_EQUALS_GOAL),
        (beyond, other, Status.START_OUTSIDE_MAP),
        (good, beyond, Status.GOAL_OUTSIDE_MAP),
        (beyond, beyond, Status.START_OUTSIDE_MAP),
        (inside, other, Status.START_OCCUPIED),
        (good, inside, Status.GOAL_OCCUPIED),
        (np.array([math.nan, 5, 5]), other, Status.NONFINITE_INPUT),
        (good, np.array([5, math.inf, 5]), Status.NONFINITE_INPUT),
        (np.array([5, -math.inf, 5]), np.array([5, 5, math.nan]), Status.NONFINITE_INPUT),
        (np.array([1e38, 5, 5]), other, Status.START_OUTSIDE_MAP),
        # A face belongs to the voxel above it, and to no other.
        (np.array([GRID.lower[0], 10.0, 10.0]), other, Status.OK),
        (np.array([GRID.upper[0], 10.0, 10.0]), other, Status.START_OUTSIDE_MAP),
        (world([4.5, 6, 7]), other, Status.START_OCCUPIED),
        (world([5.5, 6, 7]), other, Status.OK),
    ]
    for start, goal, status in cases:
        assert Status(int(judge(occupied, start, goal).status)) is status, (start, goal)


def test_an_end_on_a_face_above_the_ground_needs_no_level() -> None:
    """At 3 m above flat ground, a face of 2 m voxels, what lies beside the ground is only touched."""
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, 0] = True
    start, goal = world([2, 2, 5]), world([12, 12, 5])
    start[2] = goal[2] = GRID.origin[2] + 1.5 * GRID.spacing
    found = formulated(ground, ground, start, goal)
    assert Status(int(found.status)) is Status.OK
    assert found.levels.tolist() == [0, 0]
    assert np.flatnonzero(np.asarray(found.blocked)[4, 4]).tolist() == [0, 1]
    # From there to the centres of their voxels: half a voxel.
    np.testing.assert_allclose(found.exemptions, 0.5 * GRID.spacing, rtol=1e-3)
    # As an obstacle it would be priced, and blocked itself alone.
    assert np.asarray(found.price).max() == 1
    other = formulated(ground, NO_GROUND, start, goal)
    assert np.flatnonzero(np.asarray(other.blocked)[4, 4]).tolist() == [0]
    assert np.asarray(other.price).max() > 4


@pytest.mark.parametrize("radius", [0.0, 1.0, 2.5])
def test_ends_go_straight_to_where_there_is_room_and_keep_what_they_have(radius: float) -> None:
    """Outside the exemption the radius, inside it the end's own distance if that is less."""
    rng, moved, exempt = np.random.default_rng(5), 0, 0
    for _ in range(30):
        occupied = random_blocks(rng, GRID.shape, 30, 5)
        index = random_free(rng, occupied, 2)
        exact = index + rng.uniform(-0.49, 0.49, (2, 3))
        found = formulated(occupied, NO_GROUND, *(world(x) for x in exact), radius)
        assert found.room == (0.5 if radius else 0)
        if found.status != Status.OK:
            continue
        np.testing.assert_allclose(found.ends, exact, atol=1e-5)
        for x, inner, voxel, ball in zip(exact, (found.start, found.goal), index, found.exemptions, strict=True):
            assert stands_free(found.blocked, inner, found.room)
            still = np.allclose(inner, x, atol=1e-5)
            assert still or np.array_equal(inner, np.floor(np.asarray(inner) + 0.5))
            assert np.abs(np.asarray(inner) - voxel).max() <= 1
            moved += not still
            way = x + np.linspace(0, 1, 50)[:, None] * (np.asarray(inner) - x)
            kept = GRID.spacing * distances_to_cubes(way, occupied)
            away = GRID.spacing * np.linalg.norm(way - x, axis=1)
            assert (away[kept < radius - 1e-3] <= float(ball) + 1e-4).all()
            assert (kept >= min(radius, kept[0]) - 1e-3).all()
            assert (ball > 0) == (kept[0] < radius - 1e-3)
            exempt += ball > 0
        np.testing.assert_array_equal(found.goal_index, np.floor(np.asarray(found.goal) + 0.5))
    assert (moved > 0) == (radius > 0)
    assert (exempt > 0) == (radius > 0)


@pytest.mark.parametrize("radius", [0.0, 1.0])
def test_ends_on_faces_between_free_voxels_stay_where_they_are(radius: float) -> None:
    start, goal = np.array([1.5, 2.5, 3.0]), np.array([3.0, 4.5, 2.5])
    found = formulated(NO_GROUND, NO_GROUND, world(start), world(goal), radius)
    np.testing.assert_allclose([found.start, found.goal], [start, goal])
    assert not np.asarray(found.exemptions).any()


def test_the_price_is_that_of_the_distance_to_the_nearest_cube() -> None:
    occupied = random_blocks(np.random.default_rng(6), GRID.shape, 3, 4)
    ends = np.zeros((2, 3), np.float32)
    price = _formulate(occupied, NO_GROUND, ends, distances=Distances(1.0, 6.0, Price("speed", 4.0)), grid=GRID).price
    gap = np.maximum(np.abs(np.argwhere(~occupied)[:, None] - np.argwhere(occupied)[None]) - 0.5, 0)
    distance = GRID.spacing * np.sqrt((gap**2).sum(axis=-1)).min(axis=1)
    np.testing.assert_allclose(np.asarray(price)[~occupied], np.clip(6.0 / distance, 1, 5), rtol=1e-5)
    assert formulated(occupied, NO_GROUND, *ends, 0.0).price is not None
    free = _formulate(occupied, NO_GROUND, ends, distances=Distances(0.0, 0.0), grid=GRID)
    assert free.price is None
    np.testing.assert_array_equal(free.blocked, occupied)


def test_vmap_equals_a_loop() -> None:
    rng = np.random.default_rng(3)
    occupied = np.stack([random_blocks(rng, GRID.shape, 20, 5) for _ in range(4)])
    index = np.stack([random_free(rng, o, 2) for o in occupied]).astype(np.float32)
    ends = np.stack([world(one) for one in index])
    batch = jax.jit(jax.vmap(lambda o, two: formulate(o, jnp.asarray(NO_GROUND), two, Distances(), GRID)))(
        occupied, index
    )
    for k in range(4):
        single = judge(occupied[k], ends[k, 0], ends[k, 1])
        for name, value in vars(single).items():
            if name == "room":
                continue
            np.testing.assert_array_equal(getattr(batch, name)[k], value, err_msg=name)
