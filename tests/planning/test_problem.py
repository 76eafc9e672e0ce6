"""Inputs judged in every way they can be wrong."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import component_of, random_blocks, random_free

from maxjax import Grid, Status
from maxjax.planning.problem import Problem, formulate

GRID = Grid((16, 18, 20), 2.0, (-10.0, 3.0, 1.0))
NO_GROUND = np.zeros(GRID.shape, bool)


_formulate = jax.jit(formulate, static_argnames=("margin", "grid"))


def formulated(occupied: np.ndarray, ground: np.ndarray, start: np.ndarray, goal: np.ndarray, margin: float) -> Problem:
    """The problem of ends in the world [m]."""
    ends = (np.stack([start, goal]).astype(np.float64) - np.array(GRID.origin)) / GRID.spacing
    found: Problem = _formulate(occupied, ground, ends.astype(np.float32), margin=margin, grid=GRID.local)
    return found


def judge(occupied: np.ndarray, start: np.ndarray, goal: np.ndarray, margin: float = 8.0) -> Problem:
    return formulated(occupied, NO_GROUND, start, goal, margin)


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


def test_a_start_on_a_voxel_face_costs_no_margin() -> None:
    """At 3 m above flat ground, a face of 2 m voxels, the margin of the ground is only touched."""
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, 0] = True
    height = GRID.origin[2] + 1.5 * GRID.spacing
    start, goal = world([2, 2, 5]), world([12, 12, 5])
    start[2] = goal[2] = height
    found = formulated(ground, ground, start, goal, 2 * GRID.spacing)
    assert Status(int(found.status)) is Status.OK
    assert float(found.margin) == 2 * GRID.spacing


def test_the_ground_keeps_no_margin_beyond_one_voxel() -> None:
    ground = NO_GROUND.copy()
    ground[:, :, 0] = True
    start, goal = (np.asarray(world(v), np.float32) for v in ([1, 1, 2], [14, 16, 2]))
    flat = formulated(ground, ground, start, goal, 8.0)
    assert (Status(int(flat.status)), float(flat.margin)) == (Status.OK, 8.0)
    assert np.flatnonzero(np.asarray(flat.blocked)[4, 4]).tolist() == [0, 1]
    assert formulated(ground, NO_GROUND, start, goal, 8.0).margin == 2


def test_vmap_equals_a_loop() -> None:
    rng = np.random.default_rng(3)
    occupied = np.stack([random_blocks(rng, GRID.shape, 20, 5) for _ in range(4)])
    index = np.stack([random_free(rng, o, 2) for o in occupied]).astype(np.float32)
    ends = np.stack([world(one) for one in index])
    batch = jax.jit(jax.vmap(lambda o, two: formulate(o, jnp.asarray(NO_GROUND), two, 8.0, GRID)))(occupied, index)
    for k in range(4):
        single = judge(occupied[k], ends[k, 0], ends[k, 1])
        for name, value in vars(single).items():
            np.testing.assert_array_equal(getattr(batch, name)[k], value, err_msg=name)
