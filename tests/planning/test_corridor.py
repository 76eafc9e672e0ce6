"""Routes too long for a window: coarse to fine, judged on the whole map, and about as short as by the whole field."""

import dataclasses

import numpy as np
import pytest

from maxjax import AStar, VoxelMap
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.plan import Plan
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run import execution as execute
from maxjax.planning.search import astar_compiled
from maxjax.planning.windows import corridor
from maxjax.planning.windows import focus_window as focus
from maxjax.ui.methods import planner_named
from maxjax.verification.verifier import verify

GRID = Grid((66, 44, 14), 2.0, (5.0, -3.0, 1.0))
FIND = planner_named("field")


@pytest.fixture(autouse=True)
def small_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows, legs and coarse maps so small that this map is a city to them."""
    monkeypatch.setattr(focus, "SHAPES", ((24, 24, 14),))
    monkeypatch.setattr(execute, "_LARGEST_WHOLE", 0)
    monkeypatch.setattr(corridor, "_COARSE", 2**13)
    monkeypatch.setattr(corridor, "_LEG", 12)


def town() -> tuple[np.ndarray, np.ndarray]:
    """Blocks of houses, streets of six voxels between them, a ground."""
    occupied = np.zeros(GRID.shape, bool)
    rng = np.random.default_rng(3)
    for x in range(4, 60, 14):
        for y in range(4, 40, 14):
            occupied[x : x + 8, y : y + 8, : rng.integers(6, 14)] = True
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, 0] = True
    return occupied | ground, ground


def across(occupied: np.ndarray, ground: np.ndarray) -> Task:
    ends = np.array([[2.0, 2.0, 3.0], [63.0, 41.0, 3.0]]) * GRID.spacing + np.array(GRID.origin)
    return Task.of(VoxelMap.on(GRID, occupied, ground), ends[:1], ends[1:], Distances(1.0, 6.0))


def planned(task: Task) -> Plan:
    (plan,) = execute.plan_task(task, FIND)
    return plan


def whole(task: Task) -> Plan:
    (plan,) = execute.plan_task(task, dataclasses.replace(FIND, focus=False))  # type: ignore[type-var]
    return plan


def test_a_route_in_a_corridor_passes_the_judge_and_is_about_the_shortest() -> None:
    occupied, ground = town()
    task = across(occupied, ground)
    plan, other = planned(task), whole(task)
    assert plan.status == other.status == Status.OK
    assert plan.certified
    assert plan.method == "field"
    assert verify(plan.path, VoxelMap.on(GRID, occupied, ground), radius=1.0, exemptions=plan.exemptions).ok
    assert np.array_equal(plan.path[0], task.starts[0])
    assert np.array_equal(plan.path[-1], task.goals[0])
    assert plan.cost <= 1.02 * other.cost


@pytest.mark.usefixtures("compiled_astar")
def test_a_route_states_what_it_costs_over_its_guide() -> None:
    occupied, ground = town()
    task = across(occupied, ground)
    plan = planned(task)
    (rival,) = execute.plan_task(task, AStar())
    inside = rival.cost - 2 * GRID.spacing  # the ways to the exact ends are not the guide's
    assert 0.9 < plan.stats.ratio <= 1.0 + 1e-3
    assert inside <= plan.cost / plan.stats.ratio <= rival.cost + 1e-3
    assert np.isnan(whole(task).stats.ratio)


def test_without_a_compiled_search_a_coarse_map_guides(monkeypatch: pytest.MonkeyPatch) -> None:
    occupied, ground = town()
    task = across(occupied, ground)
    guided = planned(task)
    monkeypatch.setattr(astar_compiled, "available", lambda: False)
    plan = planned(task)
    assert plan.status == Status.OK
    assert plan.certified
    assert plan.cost <= 1.05 * guided.cost
    assert plan.stats.ratio == pytest.approx(plan.cost / np.linalg.norm(task.goals - task.starts))


def test_what_no_corridor_joins_has_the_status_of_the_whole_map() -> None:
    occupied, ground = town()
    occupied[33] = True
    assert planned(across(occupied, ground)).status == Status.NO_VALID_PATH
    occupied[33, 15, 7] = False  # a door that no coarse map shows
    assert planned(across(occupied, ground)).status == Status.OK


@pytest.mark.parametrize(("factor", "share"), [(2, 0.0), (3, 0.0), (3, 0.5)])
def test_a_coarse_voxel_is_occupied_by_the_share_of_its_voxels(factor: int, share: float) -> None:
    volume = np.random.default_rng(1).random((7, 8, 10)) < 0.4
    found = corridor.coarsen(volume, factor, share)
    for index in np.ndindex(*found.shape):
        block = volume[tuple(slice(i * factor, (i + 1) * factor) for i in index)]
        assert found[index] == (block.sum() > share * factor**3)


@pytest.mark.parametrize("factor", [2, 3, 4])
def test_a_coarse_price_is_the_mean_of_its_voxels_and_one_beyond_the_map(factor: int) -> None:
    price = 1 + np.random.default_rng(2).random((7, 9, 5)).astype(np.float32)
    found = corridor.coarsen_price(price, factor)
    assert found.shape == tuple(-(-n // factor) for n in price.shape)
    for index in np.ndindex(*found.shape):
        block = price[tuple(slice(i * factor, (i + 1) * factor) for i in index)]
        assert found[index] == pytest.approx((block.sum() + factor**3 - block.size) / factor**3, rel=1e-5)


def test_a_guide_is_moved_to_where_there_is_most_room() -> None:
    occupied, ground = town()
    task = across(occupied, ground)
    free = np.argwhere(~task.barred)
    walls = np.argwhere(task.barred)
    for point in free[np.random.default_rng(6).permutation(len(free))[:20]]:
        place = np.array(GRID.origin) + GRID.spacing * point
        found = (corridor._roomy(task, place, 3.0) - np.array(GRID.origin)) / GRID.spacing

        def score(index: np.ndarray, point: np.ndarray = point) -> float:
            """Room, as far as it has a price, less half the way there."""
            room = np.linalg.norm(walls - index, axis=1).min()
            return min(room, task.distances.margin / GRID.spacing + 1) - 0.5 * float(np.linalg.norm(index - point))

        within = free[np.linalg.norm(free - point, axis=1) <= 3.0]
        assert score(found) == pytest.approx(max(map(score, within)), abs=1e-6)
