"""What stands where an end was asked for, and free places beside it, judged by the distance to every cube."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.core.status import Status
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.occupied_end import find_occupied_end
from maxjax.planning.problem.task import Task
from maxjax.planning.run import execution

SPACING = 2.0


def town() -> maxjax.VoxelMap:
    """Ground up to z = 9, a house of 40 m beside it."""
    occupied, ground = np.zeros((40, 30, 30), bool), np.zeros((40, 30, 30), bool)
    ground[:, :, :5] = True
    occupied[20:30, 10:20, :20] = True
    return maxjax.VoxelMap.of(occupied | ground, spacing=SPACING, origin=(0.0, 0.0, 0.0), ground=ground)


def distance(where: maxjax.VoxelMap, volume: np.ndarray, point: tuple[float, float, float]) -> float:
    """To the nearest cube of a volume [m]."""
    centres = np.argwhere(volume) * SPACING + np.array(where.grid.origin)
    beyond = np.maximum(np.abs(centres - point) - SPACING / 2, 0.0)
    return float(np.linalg.norm(beyond, axis=1).min())


@pytest.mark.parametrize("radius", [0.0, 1.0, 3.5])
@pytest.mark.parametrize("point", [(10.0, 20.0, 5.0), (50.0, 30.0, 31.0), (41.0, 21.5, 20.0), (50.0, 30.0, 2.0)])
def test_the_free_place_keeps_the_radius_and_none_is_nearer(point: tuple[float, float, float], radius: float) -> None:
    where = town()
    found = find_occupied_end(where, point, radius)
    assert found is not None
    walls = np.asarray(where.occupied & ~where.ground)
    assert found.nearest is not None
    assert distance(where, walls, found.nearest) >= radius
    assert distance(where, np.asarray(where.ground), found.nearest) >= (SPACING / 2 if radius else 0.0)
    assert found.free_from is not None
    above = (point[0], point[1], found.free_from)
    assert distance(where, np.asarray(where.occupied), above) >= radius - SPACING  # the column's centre is as near
    assert found.ground == bool(where.ground[tuple(np.round(np.array(point) / SPACING).astype(int))])


def test_heights_are_those_of_the_stack_that_holds_the_end() -> None:
    where = town()
    ground = find_occupied_end(where, (10.0, 20.0, 5.0), 1.0)
    assert ground is not None
    assert (ground.ground, ground.top) == (True, 9.0)
    assert ground.free_from == pytest.approx(12.0)
    assert "4.0 m below its top at z = 9.0; free from z = 12.0" in ground.sentence
    assert "did you mean 5 m above ground, z = 14.0?" in ground.sentence
    house = find_occupied_end(where, (50.0, 30.0, 31.0), 1.0)
    assert house is not None
    assert (house.ground, house.top) == (False, 39.0)
    assert "an obstacle, 8.0 m below its top at z = 39.0" in house.sentence
    assert find_occupied_end(where, (10.0, 20.0, 15.0), 1.0) is None
    assert find_occupied_end(where, (-50.0, 20.0, 15.0), 1.0) is None
    assert find_occupied_end(where, (10.0, 20.0, 9.0), 1.0) is None  # on a face, which is free


@pytest.mark.parametrize(
    ("start", "goal", "expected"),
    [
        ((10.0, 20.0, 5.0), (10.0, 40.0, 20.0), Status.START_OCCUPIED),
        ((10.0, 20.0, 20.0), (50.0, 30.0, 30.0), Status.GOAL_OCCUPIED),
        ((10.0, 20.0, 5.0), (50.0, 30.0, 30.0), Status.START_OCCUPIED),
    ],
)
def test_nothing_is_compiled_for_an_end_that_is_taken(
    start: tuple[float, ...], goal: tuple[float, ...], expected: Status, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = Task.of(town(), np.array([start]), np.array([goal]), Distances(1.0, 8.0))
    planned = execution.plan_task(task, maxjax.Field())[0]
    with monkeypatch.context() as patch:
        patch.setattr(execution, "plans_of_occupied_ends", lambda *_: None)
        on_device = execution.plan_task(task, maxjax.Field())[0]
    assert planned.status == on_device.status == expected
    assert (planned.timings["compile"], planned.timings["total"]) == (0.0, 0.0)
