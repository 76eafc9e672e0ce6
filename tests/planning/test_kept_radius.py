"""The radius is never lowered: full plans, measured by brute force over all cubes at dense samples of their paths."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

import maxjax
from maxjax import Grid, Plan, Status, VoxelMap
from maxjax.ui.methods import planner_named
from tests.references import component_of, distances_to_cubes, inflated

SAMPLES = 0.02  # apart [voxels]
SLACK = 1.3e-3  # what the verifier allows [voxels]

FINE = Grid((25, 21, 17), 1.0, (0.0, 0.0, 0.0))
COARSE = Grid((18, 14, 10), 2.0, (-7.0, 5.0, 1.0))


def world(index: object, grid: Grid) -> np.ndarray:
    return np.array(grid.origin) + grid.spacing * np.asarray(index, float)


def wall(grid: Grid, at: int, door: tuple[slice, slice]) -> np.ndarray:
    occupied = np.zeros(grid.shape, bool)
    occupied[at] = True
    occupied[(at, *door)] = False
    return occupied


def planned(occupied: np.ndarray, start: Any, goal: Any, grid: Grid, *, method: str = "field", **kept: Any) -> Plan:
    where = VoxelMap.on(grid, occupied, kept.pop("ground", None))
    return maxjax.plan(where, start, goal, planner=planner_named(method), distances=maxjax.Distances(**kept))


def check_kept(plan: Plan, occupied: np.ndarray, ground: np.ndarray, grid: Grid, radius: float) -> None:
    """The radius outside the exemptions, and the own distance of an end inside; beside the ground only near its end."""
    assert plan.status is Status.OK
    path = (plan.path - np.array(grid.origin)) / grid.spacing
    ends = [(a, b, int(np.linalg.norm(b - a) / SAMPLES) + 2) for a, b in itertools.pairwise(path)]
    points = np.concatenate([np.linspace(a, b, count) for a, b, count in ends])
    r, obstacles = radius / grid.spacing, occupied & ~ground
    beside = ndimage.binary_dilation(ground, ndimage.generate_binary_structure(3, 1)) & ~occupied
    own = np.minimum(distances_to_cubes(path[[0, -1]], obstacles), r)
    touches = distances_to_cubes(path[[0, -1]], beside) <= SLACK
    inside = np.linalg.norm(points[:, None] - path[[0, -1]], axis=2) <= np.array(plan.exemptions) / grid.spacing
    required = np.where(inside, own, r).min(axis=1)
    assert (distances_to_cubes(points, obstacles) >= required - SLACK).all()
    assert (distances_to_cubes(points, occupied) > 0).all()
    apart = ~(inside & touches).any(axis=1)
    assert (distances_to_cubes(points[apart], beside) > 0).all() or radius == 0
    for ball, distance, touch in zip(plan.exemptions, own, touches, strict=True):
        assert ball == 0 or distance < r or touch


def test_a_start_that_keeps_the_radius_does_not_lead_through_a_door_that_does_not() -> None:
    """It was OK, by a ball of 5.4 m around a start 1.5 m clear, with a clearance of 0.5 m."""
    occupied = wall(FINE, 12, (slice(10, 11), slice(8, 9)))
    ends = (10.0, 10.0, 8.0), (22.0, 10.0, 8.0)
    found = planned(occupied, *ends, FINE)
    assert found.status is Status.NO_SAFE_PATH
    assert found.radius == 0.5
    assert found.exemptions == (0.0, 0.0)
    again = planned(occupied, *ends, FINE, radius=found.radius)
    assert again.exemptions == (0.0, 0.0)
    check_kept(again, occupied, np.zeros_like(occupied), FINE, 0.5)
    wider = wall(FINE, 12, (slice(9, 12), slice(7, 10)))
    check_kept(planned(wider, *ends, FINE), wider, np.zeros_like(wider), FINE, 1.0)


@pytest.mark.parametrize("radius", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("width", [1, 2, 3])
def test_doors_of_2_m_voxels(width: int, radius: float) -> None:
    """From beside a door and from in front of it, at the centre of a voxel and off it."""
    occupied = wall(COARSE, 8, (slice(6, 6 + width), slice(4, 4 + width)))
    nothing, goal = np.zeros_like(occupied), world([15, 6.3, 4.2], COARSE)
    labels, _ = ndimage.label(~inflated(occupied, nothing, radius / COARSE.spacing))
    passes = labels[3, 6, 4] == labels[15, 6, 4]
    # Of two voxels, the centres are half a voxel off the sides of the door, whatever is between them.
    assert passes == (width == 3)
    for start in ((3, 6, 4), (7, 6, 4), (7.3, 6.2, 4.4), (7.0, 3.0, 2.0), (6.4, 6.4, 4.0)):
        found = planned(occupied, world(start, COARSE), goal, COARSE, radius=radius, method="astar")
        assert found.status is (Status.OK if passes else Status.NO_SAFE_PATH), start
        if passes:
            check_kept(found, occupied, nothing, COARSE, radius)
        else:
            assert 0 < found.radius < radius
            again = planned(occupied, world(start, COARSE), goal, COARSE, radius=found.radius, method="astar")
            check_kept(again, occupied, nothing, COARSE, found.radius)


def test_an_end_in_a_door_leaves_it_and_keeps_its_distance() -> None:
    """In the middle of a door of one voxel, 1 m off both sides: out on either side, but never nearer than that."""
    occupied, nothing = wall(COARSE, 8, (slice(6, 7), slice(4, 5))), np.zeros(COARSE.shape, bool)
    for goal in ((2, 6, 4), (15, 6, 4)):
        found = planned(occupied, world([8, 6, 4], COARSE), world(goal, COARSE), COARSE, radius=2.0, method="astar")
        check_kept(found, occupied, nothing, COARSE, 2.0)
        assert found.exemptions[0] > 0
        assert found.exemptions[1] == 0
        assert found.clearance == pytest.approx(1.0, abs=2e-3)
    both = planned(occupied, world([2, 6, 4], COARSE), world([15, 6, 4], COARSE), COARSE, radius=2.0)
    assert both.status is Status.NO_SAFE_PATH


def test_ends_beside_ground_and_at_faces_and_corners_of_the_map() -> None:
    ground = np.zeros(COARSE.shape, bool)
    ground[:, :, 0] = True
    occupied = ground.copy()
    occupied[8:10, 3:9, 1:6] = True
    rng, last = np.random.default_rng(1), np.array(COARSE.shape) - 1
    starts = [(0, 0, 1), (0, 0, last[2]), (last[0], 0, 1), (-0.5, -0.5, 0.5), (0, last[1] + 0.49, last[2] + 0.49)]
    starts += [(7.4, 5, 0.6), (7, 5, 1), (7.49, 5.2, 1.5), (7.2, 2.7, 3.0), (3, 3, 1.5), (10.0, 9.0, 1.2)]
    for radius, start in itertools.product((1.0, 2.5), starts):
        goal = world(rng.choice(starts), COARSE) if radius == 1.0 else world([16, 12, 3], COARSE)
        if np.array_equal(world(start, COARSE), goal):
            continue
        given = {"ground": ground, "radius": radius, "method": "astar"}
        found = planned(occupied, world(start, COARSE), goal, COARSE, **given)
        check_kept(found, occupied, ground, COARSE, radius)


def test_random_maps_planned_with_the_radius_or_with_the_one_that_is_named() -> None:
    """Ends anywhere off their centres; a status is that of SciPy's labels where both ends keep the radius."""
    rng, grid, seen = np.random.default_rng(4), Grid((12, 10, 8), 2.0, (0.0, 0.0, 0.0)), []
    nothing = np.zeros(grid.shape, bool)
    for k in range(40):
        occupied = wall(grid, 5 + k % 2, (slice(a := int(rng.integers(0, 7)), a + 1 + k % 3), slice(2, 4 + k % 2)))
        occupied |= rng.random(grid.shape) < 0.01
        ends = np.stack(
            [rng.uniform([-0.4, -0.4, -0.4], [4.4, 9.4, 7.4]), rng.uniform([7, -0.4, -0.4], [11, 9.4, 7.4])]
        )
        voxels = np.floor(ends + 0.5).astype(int)
        if occupied[tuple(voxels.T)].any():
            continue
        for method in ("astar", "field")[: 1 + (k % 8 == 0)]:
            given = {"method": method, "margin": 4.0}
            found = planned(occupied, *world(ends, grid), grid, radius=2.0, **given)
            seen.append((found.status, method))
            free = ~inflated(occupied, nothing, 1.0)
            a, b = (tuple(v) for v in voxels.tolist())
            if free[a] and free[b] and found.status is not Status.OK:
                assert not component_of(free, a)[b] or distances_to_cubes(ends, occupied).min() < 1.0
            if found.status is Status.OK:
                check_kept(found, occupied, nothing, grid, 2.0)
            else:
                assert found.status is Status.NO_SAFE_PATH
                if found.radius > 0:
                    again = planned(
                        occupied, *world(ends, grid), grid, radius=found.radius, **given | {"method": "astar"}
                    )
                    check_kept(again, occupied, nothing, grid, found.radius)
    assert {(Status.OK, "astar"), (Status.NO_SAFE_PATH, "astar")} <= set(seen)
