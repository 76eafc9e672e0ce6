"""A batch answers each problem as if it were alone, in whatever chunks it goes through the device."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax import Grid, Plans, Status, VoxelMap, solve_potential, verify
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.pipeline import run_chunks
from maxjax.planning.windows.focus_window import View
from tests.references import random_blocks, random_free, serpentine

GRID = Grid((14, 15, 16), 2.0, (-10.0, 3.0, 1.0))
COUNT = 7
DISTANCES = Distances(1.0, 4.0)


@pytest.fixture(scope="module")
def problems() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Maps, ground, starts and goals; problem 2 is a maze, problem 5 has no way."""
    rng = np.random.default_rng(7)
    occupied = np.stack([random_blocks(rng, GRID.shape, int(rng.integers(5, 30)), 4) for _ in range(COUNT)])
    ends = np.stack([random_free(rng, one, 2) for one in occupied]).astype(np.float32)
    occupied[2] = np.concatenate([np.repeat(serpentine(13, 15, 1), 16, axis=2), np.ones((1, 15, 16), bool)], dtype=bool)
    ends[2] = [0, 0, 9], [12, 0, 9]
    occupied[5, 7] = True
    ends[5] = [2, 2, 9], [12, 12, 9]
    occupied[5, 2, 2, 9] = occupied[5, 12, 12, 9] = False
    ground = np.zeros_like(occupied)
    ground[:, :, :, 0] = True
    starts, goals = (np.float32(GRID.origin) + 2 * np.maximum(ends[:, k], [0, 0, 1]) for k in (0, 1))
    return occupied, ground, starts.astype(np.float32), goals.astype(np.float32)


# Of the first attempt, in which the maze stalls, and of the second, in which it does not.
STEPS = 48, 192


def _batch(problems: tuple[np.ndarray, ...], chunk: int | None = 3, steps: int = STEPS[0]) -> Plans:
    occupied, ground, starts, goals = problems
    task = Task.of(VoxelMap.on(GRID, occupied, ground), starts, goals, DISTANCES)
    return plan_task(task, FieldPlanner(solve_potential, Ascent(steps=steps)), chunk=chunk)


def test_chunks_do_not_change_the_plans(problems: tuple[np.ndarray, ...]) -> None:
    """One by one, or in chunks of three, the last one filled up; the maze needs more steps than the others."""
    whole, parts = _batch(problems, None), _batch(problems)
    assert len(whole) == len(parts) == COUNT
    for k, (one, other) in enumerate(zip(whole, parts, strict=True)):
        assert one.status is other.status
        assert (one.exemptions, one.certified) == (other.exemptions, other.certified)
        assert one.stats.potential == other.stats.potential
        np.testing.assert_allclose([one.cost, one.length], [other.cost, other.length], rtol=1e-3)
        np.testing.assert_allclose(one.path, other.path, atol=1e-3)
        occupied, ground, starts, goals = (array[k] for array in problems)
        task = Task.of(VoxelMap.on(GRID, occupied | ground, ground), starts[None], goals, DISTANCES)
        alone = plan_task(task, FieldPlanner(solve_potential, Ascent(steps=STEPS[1]), focus=False))[0]
        assert alone.status == one.status
        np.testing.assert_allclose(alone.exemptions, one.exemptions, atol=1e-5)
        if one.status is Status.OK:
            assert one.length == pytest.approx(alone.length, rel=1e-3)
            verdict = verify(one.path, VoxelMap.on(GRID, occupied, ground), radius=1.0, exemptions=one.exemptions)
            assert verdict.ok
            assert verdict.clearance == pytest.approx(one.clearance, rel=1e-9)
    assert whole[5].status is Status.NO_VALID_PATH
    assert whole[2].status is Status.OK
    assert sum(plan.status is Status.OK for plan in whole) == COUNT - 1


def test_chunks_without_a_problem_are_left_out(problems: tuple[np.ndarray, ...]) -> None:
    """Sizes that are enough for more problems than there are."""
    occupied, ground, starts, goals = problems
    task = Task.of(VoxelMap.on(GRID, occupied, ground), starts, goals, DISTANCES)
    planner = FieldPlanner(solve_potential, Ascent(steps=STEPS[0]))
    few, many = (run_chunks(View(task), planner, [3] * count) for count in (3, 5))
    assert np.array_equal(few.status, many.status)
    assert np.array_equal(few.path, many.path)


def test_one_program_answers_one_problem_as_its_stages_do(problems: tuple[np.ndarray, ...]) -> None:
    """What an accelerator does for `plan`, on a map without a batch axis."""
    occupied, ground, starts, goals = problems
    for k in (0, 2, 5):
        (one,) = _batch((occupied[k], ground[k], starts[[k]], goals[[k]]), 1, STEPS[1])
        (other,) = _batch((occupied[k], ground[k], starts[[k]], goals[[k]]), None, STEPS[1])
        assert "device" in one.timings
        assert "solve" in other.timings or k == 5
        assert (one.status, one.certified) == (other.status, other.certified)
        np.testing.assert_allclose(one.path, other.path, atol=1e-3)


def test_a_shared_map_equals_its_copies(problems: tuple[np.ndarray, ...]) -> None:
    occupied, ground, starts, goals = problems
    shared = _batch((occupied[0], ground[0], starts, goals))
    copies = _batch((np.broadcast_to(occupied[0], occupied.shape), ground, starts, goals))
    for one, other in zip(shared, copies, strict=True):
        assert one.status is other.status
        # Two programs: each may round a · b + c once or twice.
        np.testing.assert_allclose(one.path, other.path, atol=1e-4)


def test_times_are_shares_of_the_wall_clock(problems: tuple[np.ndarray, ...]) -> None:
    first, second = _batch(problems), _batch(problems)
    for one, again in zip(first, second, strict=True):
        assert again.timings["compile"] == 0
        for timings in (one.timings, again.timings):
            assert timings["device"] > 0
            assert timings["verify"] >= 0
            assert timings["total"] == pytest.approx(timings["device"] + timings["verify"])
