"""The stated height of a return to launch: clear from everywhere on a mission, and none much lower is."""

from __future__ import annotations

import functools
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import shapely

import maxjax
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.export import export
from maxjax.io.export.return_height import return_height
from maxjax.io.geo.earth import TangentPlane
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from tests.planners import bare_plan

EARTH = TangentPlane(52.0, 4.3, 0.0)
RADIUS = 1.5


def places_of(path: np.ndarray, step: float) -> np.ndarray:
    pieces = []
    for a, b in itertools.pairwise(path):
        pieces.append(np.linspace(a, b, max(1, int(np.linalg.norm(b - a) / step)), endpoint=False))
    return np.concatenate([*pieces, path[-1:]])


def blocked(where: maxjax.VoxelMap, path: np.ndarray, height: float, step: float = 0.43) -> int:
    """From how many places the level part of a return at a height comes nearer to a column than the radius.

    By shapely: straight lines, and columns as boxes up to their highest voxel.
    """
    held = np.asarray(where.occupied) & ~np.asarray(where.ground)
    i, j = np.nonzero(held.any(axis=2))
    top = where.grid.lower[2] + where.grid.spacing * (held.shape[2] - held[i, j, ::-1].argmax(axis=1))
    low = np.array(where.grid.lower[:2]) + where.grid.spacing * np.column_stack([i, j])
    near = height - top < RADIUS
    low, up = low[near], np.maximum(height - top[near], 0.0)
    columns = shapely.box(low[:, 0], low[:, 1], low[:, 0] + where.grid.spacing, low[:, 1] + where.grid.spacing)
    ways = [shapely.LineString([place[:2], path[0, :2]]) for place in places_of(path, step)]
    return sum(bool((np.hypot(shapely.distance(way, columns), up) < RADIUS - 1e-6).any()) for way in ways)


@functools.cache
def round_trip() -> Plan:
    """The way of docs/samples/round.toml, as it was planned, in the places where it turns."""
    places = [[-75.0, 22.0, 5.0], [-2.0, 62.0, 30.0], [24.9, 48.3, 36.5], [55.0, -20.0, 8.0], [-20.0, -45.0, 8.0]]
    path = np.array([*places, [-75.0, 22.0, 5.0]])
    where = maxjax.load_map("docs/samples/quarter.geojson")
    plan: Plan = bare_plan(where, path, maxjax.Distances(RADIUS, RADIUS), clearance_at=np.full(len(path), RADIUS))
    return plan


def test_a_return_is_clear_from_everywhere_and_not_much_lower() -> None:
    plan = round_trip()
    found = return_height(Mission.of_plan(plan))
    assert blocked(plan.map, plan.path, found.height) == 0
    assert blocked(plan.map, plan.path, found.height - 1.0) > 0
    assert blocked(plan.map, plan.path, 15.0, step=5.0) > 0
    assert blocked(plan.map, plan.path, 30.0, step=5.0) > 0
    assert found.top == 41.0
    # It is asked for where it says: on the way from there.
    way = np.array([found.origin, [*plan.path[0, :2], found.origin[2]]])
    middle = np.array(found.over)
    along = (middle - way[0, :2]) @ (way[1] - way[0])[:2] / ((way[1] - way[0])[:2] ** 2).sum()
    assert 0.0 <= along <= 1.0
    assert np.linalg.norm(way[0, :2] + along * (way[1] - way[0])[:2] - middle) < 3.0


@pytest.mark.parametrize("seed", range(6))
def test_the_least_height_is_the_least(seed: int) -> None:
    """Random columns around a random way: brute force finds the same to a centimetre or two."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((30, 30, 20), bool)
    for i, j in rng.integers(0, 30, (25, 2)):
        occupied[i, j, : rng.integers(2, 18)] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(1.0, 1.0, 1.0))
    path = np.column_stack([rng.uniform(5.0, 55.0, (4, 2)), np.full(4, 38.0)])
    plan = bare_plan(where, path, maxjax.Distances(RADIUS, RADIUS), clearance_at=np.full(len(path), RADIUS))
    found = return_height(Mission.of_plan(plan)).height
    assert blocked(where, path, found + 1e-3, step=0.1) == 0
    assert blocked(where, path, found - 0.05, step=0.05) > 0


@pytest.mark.parametrize("apart", [0.0, 0.5, 1.0, 1.4, 1.5, 2.0])
def test_a_column_beside_the_way_is_passed_at_the_radius(apart: float) -> None:
    occupied = np.zeros((30, 10, 20), bool)
    occupied[14, 6, :9] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    y = 6.0 - apart if apart else 6.5
    path = np.array([[3.0, y, 15.0], [27.0, y, 15.0]])
    plan = bare_plan(where, path, maxjax.Distances(RADIUS, RADIUS), clearance_at=np.full(2, 6.0))
    wanted = 9.0 + np.sqrt(RADIUS**2 - apart**2) if apart < RADIUS else -np.inf
    assert return_height(Mission.of_plan(plan)).height == pytest.approx(wanted, abs=1e-9)


def test_a_place_below_something_has_no_height() -> None:
    occupied = np.zeros((30, 10, 20), bool)
    occupied[12:16, :, 10:12] = True  # a bridge
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path = np.array([[3.0, 5.0, 4.0], [27.0, 5.0, 4.0]])
    plan = bare_plan(where, path, maxjax.Distances(RADIUS, RADIUS), clearance_at=np.full(2, 6.0))
    found = return_height(Mission.of_plan(plan))
    assert found.height == pytest.approx(12.0 + RADIUS)
    xs = np.array(found.covered)[:, 0]
    assert 12.0 - RADIUS < xs.min() < 12.0 - RADIUS + 0.3
    assert 16.0 + RADIUS - 0.3 < xs.max() < 16.0 + RADIUS
    assert found.places == pytest.approx(97, abs=2)


def test_it_keeps_a_voxel_above_ground_that_rises() -> None:
    ground = np.zeros((30, 10, 20), bool)
    ground[:, :, 0] = True
    ground[12:16, :, :9] = True
    where = maxjax.VoxelMap.of(ground, spacing=1.0, origin=(0.5, 0.5, 0.5), ground=ground)
    path = np.array([[3.0, 5.0, 4.0], [3.0, 6.0, 15.0], [27.0, 5.0, 15.0]])
    plan = bare_plan(where, path, maxjax.Distances(RADIUS, RADIUS), clearance_at=np.full(3, 6.0))
    assert return_height(Mission.of_plan(plan)).height == pytest.approx(10.0)


def exported(folder: Path, autopilot: Autopilot | None) -> tuple[tuple[str, ...], float | None, list[list[float]]]:
    occupied = np.zeros((30, 10, 40), bool)
    occupied[12:16, 2:8, :22] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path = np.array([[3.0, 5.0, 30.0], [27.0, 5.0, 30.0]])
    plan = bare_plan(where, path, maxjax.Distances(RADIUS, RADIUS), length=24.0, clearance_at=np.full(2, 9.0))
    found = export(folder / "a.plan", plan, earth=EARTH, ground=0.0, autopilot=autopilot)
    return found.remarks, found.return_height, json.loads((folder / "a.plan").read_text())["rallyPoints"]["points"]


def test_a_file_states_it_and_warns_of_a_default_that_is_lower(tmp_path: Path) -> None:
    remarks, height, rally = exported(tmp_path, Autopilot.arducopter())
    assert height == 23.5
    assert any(
        one.startswith("a return to launch is clear 23.5 m above home and higher: on the way") and "22.0 m" in one
        for one in remarks
    )
    assert "ArduCopter returns at 15 m and may touch something on its way: set RTL_ALT to 2400" in remarks
    ((north, east, up),) = rally
    assert up == 23.5
    np.testing.assert_allclose(EARTH.local(np.array([[north, east, 0.0]]))[0, :2], [3.0, 5.0], atol=0.01)
    remarks, _, rally = exported(tmp_path, Autopilot.arducopter(RTL_ALT=2400.0))
    assert not any("may touch" in one for one in remarks)
    remarks, _, rally = exported(tmp_path, Autopilot.px4())
    assert not any("may touch" in one for one in remarks)
    assert [point[2] for point in rally] == [0.0]
    remarks, _, rally = exported(tmp_path, None)
    assert any("ArduCopter returns at 15 m" in one for one in remarks)
    assert rally == []
