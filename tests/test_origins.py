"""A map has the same plans wherever it lies in the world, and a second one of its shape compiles nothing."""

from __future__ import annotations

import math
from typing import Any

import jax
import numpy as np
import pytest

from maxjax import (
    Distances,
    Grid,
    Plan,
    Price,
    Status,
    VoxelMap,
    dilate,
    plan,
    plan_batch,
    plan_scan,
    plan_to_goal,
    verify,
    voxelize,
)
from maxjax.ui.methods import METHODS, planner_named
from tests.references import random_blocks, random_free

# The least that the network takes.
GRID = Grid((32, 32, 32), 2.0, (-10.0, 3.0, 1.0))
MARGIN = 2.0
# Dutch and invented national coordinates; the last ones are no multiples of anything.
SHIFTS = ((84_888.0, 447_501.0, 0.0), (1e6 + 0.1, -1e6 - 0.7, 250.3))


def world(index: np.ndarray) -> np.ndarray:
    return np.array(GRID.origin) + GRID.spacing * np.asarray(index, float)


def moved(shift: tuple[float, float, float]) -> Grid:
    x, y, z = np.array(GRID.origin) + shift
    return Grid(GRID.shape, GRID.spacing, (float(x), float(y), float(z)))


@pytest.fixture(scope="module")
def problem() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A map, three starts and a goal, off the centres of their voxels."""
    rng = np.random.default_rng(3)
    occupied = random_blocks(rng, GRID.shape, 30, 7)
    points = world(random_free(rng, occupied, 4) + rng.uniform(-0.4, 0.4, (4, 3)))
    return occupied, points[:3], points[3]


def same(here: Plan, away: Plan, shift: tuple[float, float, float]) -> None:
    assert away.status is here.status
    assert (away.radius, away.certified, away.method) == (here.radius, here.certified, here.method)
    np.testing.assert_allclose(away.exemptions, here.exemptions, atol=1e-6)
    assert away.path.dtype == np.float64
    np.testing.assert_allclose(away.path - shift, here.path, rtol=0, atol=1e-6)
    np.testing.assert_allclose([away.length, away.clearance], [here.length, here.clearance], rtol=1e-9)


# The network climbs as the field does.
@pytest.mark.parametrize(
    "method", [pytest.param(name, marks=pytest.mark.nightly if name == "network" else ()) for name in METHODS]
)
def test_paths_differ_by_the_shift_alone(method: str, problem: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    if method == "rrtstar":
        pytest.importorskip("ompl", reason="RRT* is OMPL's: pip install 'maxjax[bench]'")
    occupied, starts, goal = problem
    cloud = world(np.argwhere(occupied)) + np.random.default_rng(4).uniform(-0.9, 0.9, (int(occupied.sum()), 3))
    options: dict[str, Any] = {"planner": planner_named(method), "distances": Distances(margin=MARGIN)}
    many, where = starts, VoxelMap.on(GRID, occupied)
    if method == "rrtstar":  # which takes seconds each, and with prices a minute
        many, options["distances"] = starts[:1], Distances(margin=MARGIN, price=Price(height=0.0))
    here = plan(where, starts[0], goal, **options)
    batch = plan_batch(where, many, np.stack([goal] * len(many)), **options)
    scan = plan_scan(cloud, starts[0], goal, GRID, **options)
    assert here.status is Status.OK or method == "apf"
    same(here, scan, (0.0, 0.0, 0.0))
    for shift in SHIFTS:
        grid, ends = moved(shift), (starts[0] + shift, goal + shift)
        away = plan(VoxelMap.on(grid, occupied), *ends, **options)
        same(here, away, shift)
        if away.status is Status.OK:
            np.testing.assert_array_equal(away.path[[0, -1]], ends)
            assert verify(away.path, VoxelMap.on(grid, occupied), radius=away.radius, exemptions=away.exemptions).ok
        same(scan, plan_scan(cloud + shift, *ends, grid, **options), shift)
        goals = np.stack([goal + shift] * len(many))
        elsewhere = plan_batch(VoxelMap.on(grid, occupied), many + shift, goals, **options)
        for one, other in zip(batch, elsewhere, strict=True):
            same(one, other, shift)


def test_fleets_differ_by_the_shift_alone(problem: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    occupied, starts, goal = problem
    fleet = plan_to_goal(VoxelMap.on(GRID, occupied), starts, goal, distances=Distances(margin=MARGIN))
    assert (fleet.status == Status.OK).any()
    for shift in SHIFTS:
        away = plan_to_goal(
            VoxelMap.on(moved(shift), occupied), starts + shift, goal + shift, distances=Distances(margin=MARGIN)
        )
        for one, other in zip(fleet, away, strict=True):
            same(one, other, shift)


def test_correct_paths_are_handed_out_far_from_the_worlds_origin() -> None:
    """Around a wall, which the path may pass at the radius, to a thousandth of a voxel."""
    occupied = np.zeros((17, 17, 17), bool)
    occupied[8, :12, :] = True
    for origin in ((0.0, 0.0, 0.0), (1000.0, 10_000.0, 0.0), (84_888.0, 447_501.0, 0.0)):
        grid = Grid((17, 17, 17), 1.0, origin)
        for method in ("solver", "astar"):
            found = plan(
                VoxelMap.on(grid, occupied),
                np.add(origin, 3.0),
                np.add(origin, (14, 4, 9)),
                planner=planner_named(method),
                distances=Distances(radius=0.5, margin=1.0),
            )
            assert found.status is Status.OK, (origin, method)


def test_a_tower_at_a_dutch_northing() -> None:
    """The README's, at a third of its size."""
    grid = Grid.centered((84_888.0, 447_501.0, 0.0), (33, 33, 33), 2.0)
    occupied = np.zeros(grid.shape, bool)
    occupied[13:20, 11:21, :30] = True
    start, goal = np.array([84_868.0, 447_501.0, 3.0]), np.array([84_908.0, 447_503.0, 4.0])
    found = plan(VoxelMap.on(grid, occupied), start, goal, distances=Distances(margin=8.0))
    assert found.status is Status.OK
    assert found.certified
    np.testing.assert_array_equal(found.path[[0, -1]], [start, goal])
    assert math.dist(start, goal) < found.length < 80


def test_a_second_map_of_a_shape_compiles_nothing_elsewhere(
    problem: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    occupied, starts, goal = problem
    compilations: list[str] = []
    counting = False

    def count(event: str, _: float, **__: object) -> None:
        if counting and "backend_compile" in event:
            compilations.append(event)

    def run(shift: tuple[float, float, float]) -> list[Plan]:
        grid, cloud = moved(shift), world(np.argwhere(occupied)) + shift
        voxelize(cloud, grid)
        dilate(occupied, MARGIN, grid)
        plans = [plan_scan(cloud, starts[0] + shift, goal + shift, grid, distances=Distances(margin=MARGIN))]
        plans += plan_batch(
            VoxelMap.on(grid, occupied),
            starts + shift,
            np.stack([goal + shift] * 3),
            distances=Distances(margin=MARGIN),
        )
        return [
            *plans,
            *plan_to_goal(
                VoxelMap.on(grid, occupied), starts + shift, goal + shift, distances=Distances(margin=MARGIN)
            ),
        ]

    run((0.0, 0.0, 0.0))
    jax.monitoring.register_event_duration_secs_listener(count)
    counting = True
    plans = run((84_888.0, 447_501.0, 0.0))
    counting = False
    assert not compilations
    assert {found.timings["compile"] for found in plans} == {0.0}
