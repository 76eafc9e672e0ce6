"""A fleet's plans are those of its starts one by one: same exemptions, same status, verified, whatever others do."""

from __future__ import annotations

import dataclasses
import math
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import AStar, Grid, Plans, Potential, Status, VoxelMap, dilate, plan, plan_to_goal, solve_potential, verify
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run import shared_goal as fleet_module
from maxjax.planning.run.field_planner import FieldPlanner
from tests.references import random_blocks, random_free, serpentine

GRID = Grid((16, 18, 20), 2.0, (-10.0, 3.0, 1.0))
RADIUS, MARGIN = 2.0, 4.0
GOAL_INDEX = (13, 14, 15)
# Starts that have nothing to plan, by what is wrong with them.
SEALED, OUTSIDE, AT_GOAL, INSIDE, BROKEN = range(5)
WRONG = [
    Status.NO_VALID_PATH,
    Status.START_OUTSIDE_MAP,
    Status.START_EQUALS_GOAL,
    Status.START_OCCUPIED,
    Status.NONFINITE_INPUT,
]


def world(index: object) -> np.ndarray:
    return np.array(GRID.origin) + GRID.spacing * np.asarray(index, float)


@pytest.fixture(scope="module")
def occupied() -> np.ndarray:
    """Blocks, a closed box around voxel (2, 2, 2), free surroundings of the goal and ground."""
    occupied = random_blocks(np.random.default_rng(5), GRID.shape, 25, 4)
    occupied[1:4, 1:4, 1:4] = True
    occupied[2, 2, 2] = False
    occupied[10:16, 11:18, 12:19] = False
    return occupied


@pytest.fixture(scope="module")
def starts(occupied: np.ndarray) -> np.ndarray:
    """The wrong ones first, then some in any free voxel, off its centre: many stand nearer than the radius."""
    rng = np.random.default_rng(6)
    free = random_free(rng, occupied, 16) + rng.uniform(-0.4, 0.4, (16, 3))
    inside = np.argwhere(occupied)[40]
    wrong = [(2, 2, 2), (-3, 5, 5), GOAL_INDEX, inside, (math.nan, 1, 1)]
    return np.concatenate([world(wrong), world(free)])


@pytest.fixture(scope="module")
def fleet(occupied: np.ndarray, starts: np.ndarray) -> Plans:
    return plan_to_goal(
        VoxelMap.on(GRID, occupied), starts, world(GOAL_INDEX), distances=Distances(radius=RADIUS, margin=MARGIN)
    )


def test_a_fleet_equals_its_starts_one_by_one(occupied: np.ndarray, starts: np.ndarray, fleet: Plans) -> None:
    assert len(fleet) == len(starts)
    for found, start in zip(fleet, starts, strict=True):
        single = plan(
            VoxelMap.on(GRID, occupied), start, world(GOAL_INDEX), distances=Distances(radius=RADIUS, margin=MARGIN)
        )
        assert found.status is single.status
        assert found.exemptions == pytest.approx(single.exemptions, abs=1e-4)
        assert found.certified is single.certified
        np.testing.assert_allclose(found.length, single.length, rtol=1e-2)
    exemptions = np.array([p.exemptions[0] for p in fleet if p.status is Status.OK])
    assert 3 <= (exemptions > 0.0).sum() < len(exemptions)
    assert (exemptions > 4.0).any()  # some open voxels, and have a field each


def test_every_path_keeps_the_radius_outside_its_balls(occupied: np.ndarray, starts: np.ndarray, fleet: Plans) -> None:
    assert (fleet.status == Status.OK).sum() >= 10
    for found, start in zip(fleet, starts, strict=True):
        if found.status is not Status.OK:
            assert found.path.shape == (0, 3)
            assert math.isnan(found.length)
            continue
        verdict = verify(found.path, VoxelMap.on(GRID, occupied), radius=RADIUS, exemptions=found.exemptions)
        assert verdict.ok
        np.testing.assert_allclose([verdict.length, verdict.clearance], [found.length, found.clearance], rtol=1e-9)
        np.testing.assert_array_equal(found.path[[0, -1]], [start, world(GOAL_INDEX)])


def test_wrong_starts_have_their_own_status_and_none_is_truthy(fleet: Plans) -> None:
    assert fleet.status[: len(WRONG)].tolist() == WRONG
    assert not any(p.status for p in fleet)
    assert not fleet.certified[: len(WRONG)].any()


def test_a_wrong_goal_fails_all(occupied: np.ndarray, starts: np.ndarray) -> None:
    for goal, status in (
        ((99, 0, 0), Status.GOAL_OUTSIDE_MAP),
        (np.argwhere(occupied)[0], Status.GOAL_OCCUPIED),
        ((2, 2, 2), Status.NO_VALID_PATH),
    ):
        with patch("maxjax.planning.run.shared_goal.potential_field", side_effect=AssertionError):  # nothing is solved
            found = plan_to_goal(
                VoxelMap.on(GRID, occupied),
                starts[len(WRONG) :],
                world(goal),
                distances=Distances(radius=RADIUS, margin=MARGIN),
            )
        assert set(found.status) == {status}
    unknown = plan_to_goal(
        VoxelMap.on(GRID, occupied), starts, [0.0, math.nan, 0.0], distances=Distances(radius=RADIUS, margin=MARGIN)
    )
    assert set(unknown.status) == {Status.NONFINITE_INPUT}


def test_many_starts_in_one_call_cost_one_solve() -> None:
    occupied = np.zeros(GRID.shape, bool)
    occupied[7, :, :12] = True
    rng = np.random.default_rng(7)
    clear = np.asarray(dilate(occupied, MARGIN, GRID))
    starts = world(rng.choice(np.argwhere(~clear), 200) + rng.uniform(-0.4, 0.4, (200, 3)))
    with patch.object(fleet_module, "potential_field", wraps=fleet_module.potential_field) as solves:
        found = plan_to_goal(
            VoxelMap.on(GRID, occupied), starts, world(GOAL_INDEX), distances=Distances(radius=RADIUS, margin=MARGIN)
        )
    assert solves.call_count == 1
    assert found.status.tolist() == [Status.OK] * 200
    assert found.certified.all()
    straight = np.linalg.norm(starts - world(GOAL_INDEX), axis=1)
    assert (found.length >= straight * (1 - 1e-6)).all()
    assert np.median(found.length / straight) < 1.05
    for k in range(0, 200, 20):
        assert verify(found[k].path, VoxelMap.on(GRID, occupied), radius=RADIUS).ok
        np.testing.assert_array_equal(found[k].path[0], starts[k])


def statuses_of(potential: object, maze: np.ndarray, starts: np.ndarray, goal: np.ndarray, steps: int) -> list[Status]:
    task = Task.of(VoxelMap.on(GRID, maze), starts, goal, Distances(0.0, 0.0))
    found = fleet_module.plan_to_goal(task, FieldPlanner(potential, Ascent(steps=steps)))  # type: ignore[arg-type]
    for p in found:
        assert p.status is not Status.OK or verify(p.path, VoxelMap.on(GRID, maze)).ok
    return [p.status for p in found]


def test_those_that_need_more_steps_go_again_and_a_field_that_fails_says_so() -> None:
    maze = np.repeat(serpentine(15, 18, 1), 20, axis=2)
    maze = np.concatenate([maze, np.ones((1, 18, 20), bool)])
    starts, goal = world([[0, 0, 9], [14, 4, 9], [0, 9, 9]]), world([14, 0, 9])

    def doubtful(sigma: jax.Array, goal_index: jax.Array, price: jax.Array) -> Potential:
        """Of a goal in layer 8 it certifies nothing."""
        potential, doubt = solve_potential(sigma, goal_index, price), goal_index[2] == 8
        status = jnp.where(doubt, Status.NOT_CERTIFIED, potential.status)
        return dataclasses.replace(potential, status=status, certified=potential.certified & ~doubt)

    assert statuses_of(doubtful, maze, starts, goal, 128) == [Status.OK] * 3
    goal[2] -= GRID.spacing
    assert statuses_of(doubtful, maze, starts, goal, 128) == [Status.NOT_CERTIFIED] * 3


def test_wrong_arguments_are_told_with_what_was_given(occupied: np.ndarray, starts: np.ndarray) -> None:
    call, where = getattr(plan_to_goal, "__wrapped__", plan_to_goal), VoxelMap.on(GRID, occupied)
    with pytest.raises(ValueError, match=r"starts: .*shape \(n, 3\) with n >= 1 .*given float64 \(0, 3\)"):
        call(where, starts[:0], world(GOAL_INDEX))
    with pytest.raises(ValueError, match=r"starts: .*shape \(n, 3\) with n >= 1 .*given float64 \(3,\)"):
        call(where, starts[0], world(GOAL_INDEX))
    with pytest.raises(ValueError, match="planner: expected one that climbs a field"):
        call(where, starts, world(GOAL_INDEX), planner=AStar())
