"""Corners as autopilots cut them: a simulation that leaves waypoints early is the oracle of what the files keep."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage, sparse, spatial

import maxjax
from maxjax.io.export.autopilot import BOTH, Autopilot
from maxjax.io.export.corners import SLACK, Waypoints, _kept, cut_corners
from maxjax.io.export.export import export, write_parameters
from maxjax.io.geo.earth import TangentPlane
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.verification.polylines import Paths
from maxjax.verification.verifier import verify_paths
from tests.planners import bare_plan

EARTH = TangentPlane(52.0, 4.3, 0.0)
RADIUS = 1.0
# Half a step between the segments that are judged, beyond what `SLACK` is for.
UNSEEN = SLACK + 0.06


def town(seed: int) -> maxjax.VoxelMap:
    rng = np.random.default_rng(seed)
    occupied = np.zeros((26, 26, 10), bool)
    for _ in range(18):
        (i, j), (w, d) = rng.integers(2, 23, 2), rng.integers(1, 5, 2)
        occupied[i : i + w, j : j + d, : rng.integers(5, 11)] = True
    occupied[:3, :3] = occupied[-3:, -3:] = False
    return maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))


def pulled(path: np.ndarray, city: maxjax.VoxelMap) -> np.ndarray:
    """The points of a path that its straight lines need to keep the radius: corners as tight as they can be."""
    kept = [0]
    while kept[-1] < len(path) - 1:
        k = kept[-1]
        lines = [path[[k, m]] for m in range(k + 1, len(path))]
        clear = np.flatnonzero(verify_paths(Paths.of(lines), city, radius=RADIUS).ok)
        kept.append(k + 1 + int(clear.max(initial=0)))
    return path[kept]


def rough(city: maxjax.VoxelMap) -> np.ndarray:
    """A shortest way through centres with room around, from one corner of a town to the other; empty where none is."""
    room = ndimage.distance_transform_edt(~np.asarray(city.occupied)) >= RADIUS + 0.9
    number = np.where(room, np.cumsum(room).reshape(room.shape) - 1, -1)
    pairs = [np.stack([np.delete(number, -1, axis), np.delete(number, 0, axis)]).reshape(2, -1) for axis in range(3)]
    one, other = (edges := np.concatenate(pairs, axis=1))[:, (edges >= 0).all(axis=0)]
    graph = sparse.csr_matrix((np.ones(len(one)), (one, other)), shape=(room.sum(), room.sum()))
    _, before = sparse.csgraph.dijkstra(
        graph, directed=False, indices=number[1, 1, 2], unweighted=True, return_predecessors=True
    )
    way = [number[-2, -2, 2]]
    while way[-1] >= 0:
        way.append(before[way[-1]])
    return np.array(city.grid.origin) + np.argwhere(room)[way[-2::-1]]


@functools.cache
def plans() -> tuple[Plan, ...]:
    """25 with corners, at a radius and a margin of 1 m."""
    found: list[Plan] = []
    for seed in range(80):
        city = town(seed)
        path = pulled(rough(city), city)
        if len(path) > 3 and len(found) < 25:
            clear = np.full(len(path), RADIUS)
            found.append(bare_plan(city, path, maxjax.Distances(RADIUS, RADIUS), length=40.0, clearance_at=clear))
    assert len(found) == 25
    return tuple(found)


def distance(points: np.ndarray, where: maxjax.VoxelMap) -> float:
    """Least distance of points to the cubes of occupied voxels of 1 m."""
    middles = np.array(where.grid.origin) + np.argwhere(np.asarray(where.occupied))
    apart, near = map(np.asarray, spatial.cKDTree(middles).query(points, 60))
    gap = np.maximum(np.abs(points[:, None] - middles[near]) - 0.5, 0.0)
    least = np.asarray(np.sqrt((gap**2).sum(axis=2)).min(axis=1))
    # No cube is nearer than half its diagonal less than its middle, so that none of the others is the nearest.
    assert (apart[:, -1] - np.sqrt(0.75) >= least).all()
    return float(least.min())


def flown(places: np.ndarray, stops: np.ndarray, radii: np.ndarray, height: float | None = None) -> np.ndarray:
    """Points, 5 cm apart, of a vehicle that leaves each waypoint within its radius of it, but for its stops."""
    at, line = places[0], [places[:1]]
    for k in range(1, len(places)):
        way = places[k] - at
        points = at + np.linspace(0.0, 1.0, max(2, int(np.linalg.norm(way) / 0.05)))[:, None] * way
        off = points - places[k]
        near = np.linalg.norm(off, axis=1) <= radii[k]
        if height is not None:
            near = (np.hypot(off[:, 0], off[:, 1]) <= radii[k]) & (np.abs(off[:, 2]) <= height)
        leaves = len(points) - 1 if stops[k] or k == len(places) - 1 else int(near.argmax())
        line.append(points[: leaves + 1])
        at = points[leaves]
    return np.concatenate(line)


def waypoints_in(file: Path) -> list[list[float]]:
    items = json.loads(file.read_text())["mission"]["items"]
    return [item["params"] for item in items if item["command"] == 16]


def test_nothing_that_is_written_touches_where_waypoints_are_left_early(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    touched = np.zeros(2, int)
    for plan in plans():
        found = export(
            tmp_path / "a.plan",
            plan,
            earth=EARTH,
            ground=0.0,
            takeoff_and_landing=False,
            autopilot=Autopilot.arducopter(),
        )
        params = waypoints_in(tmp_path / "a.plan")
        stops = np.array([row[0] >= 1.0 for row in params])
        places, many = plan.path, len(params)
        assert set(found.stops) == set(np.flatnonzero(stops).tolist())
        for way, held in enumerate((np.zeros(many, bool), stops)):
            touched[way] += distance(flown(places, held, np.full(many, 2.0)), plan.map) == 0.0
        for radii in (np.full(many, 2.0), rng.uniform(0.0, 2.0, many)):
            assert distance(flown(places, stops, radii), plan.map) >= RADIUS - UNSEEN
    # As they are planned, some touch.
    assert touched[0] >= 1
    assert touched[1] == 0


def test_px4_leaves_a_waypoint_by_height_alone(tmp_path: Path) -> None:
    for plan in plans()[:8]:
        export(tmp_path / "a.plan", plan, earth=EARTH, ground=0.0, autopilot=Autopilot.px4())
        params = waypoints_in(tmp_path / "a.plan")
        stops = np.array([row[0] >= 2.0 for row in params])
        line = flown(plan.path, stops, np.full(len(params), params[0][1]), 0.8)
        assert distance(line, plan.map) >= RADIUS - UNSEEN


def over_a_roof() -> Plan:
    """Upright beside a house, then level 1.2 m over its roof."""
    occupied = np.zeros((30, 8, 16), bool)
    occupied[8:20, :, :8] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path = np.array([[6.5, 4.0, 2.5], [6.5, 4.0, 9.2], [22.0, 4.0, 9.2], [26.0, 4.0, 5.0]])
    clear = np.full(len(path), 1.2)
    plan: Plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), length=30.0, clearance=1.2, clearance_at=clear)
    return plan


def test_a_climb_that_ends_early_meets_the_roof(tmp_path: Path) -> None:
    def stops(autopilot: Autopilot | None) -> tuple[int, ...]:
        found = export(
            tmp_path / "a.plan", over_a_roof(), earth=EARTH, ground=0.0, takeoff_and_landing=False, autopilot=autopilot
        )
        for k, params in enumerate(waypoints_in(tmp_path / "a.plan")):
            assert (params[0] > 0.0) == (k in found.stops)
        return found.stops

    assert stops(Autopilot.px4()) == (1,)
    assert stops(Autopilot.px4(NAV_MC_ALT_RAD=0.05)) == ()
    # Behind the roof the way leads down, and blended legs cut that corner, too.
    assert stops(Autopilot.arducopter()) == (1, 2)
    assert stops(Autopilot.arducopter(WPNAV_RADIUS=10.0)) == ()
    assert stops(None) == (1, 2)


@pytest.mark.parametrize(("autopilot", "hold"), [(Autopilot.px4(), 1.5), (Autopilot.arducopter(), 0.9)])
def test_a_hold_that_is_too_short_is_no_stop(autopilot: Autopilot, hold: float) -> None:
    mission = Mission.of_plan(over_a_roof())
    accepted = np.full(4, 0.5)
    for held, wrong in ((0.0, True), (hold, True), (autopilot.rests_after, False)):
        holds = np.array([0.0, held, 0.0, 0.0])
        corners, _ = cut_corners(Waypoints(mission.path, holds, accepted), mission, autopilot)
        assert (1 in corners) == wrong


def test_a_file_without_its_stops_is_refused(tmp_path: Path) -> None:
    from maxjax.core.terrain import Terrain
    from maxjax.io.export.as_flown import judge_lines
    from maxjax.io.export.read_back import Standing, lines_in

    plan = over_a_roof()
    for name in ("a.plan", "a.waypoints"):
        export(tmp_path / name, plan, earth=EARTH, ground=0.0)
        lines = lines_in(
            tmp_path / name, (tmp_path / name).read_text(), Standing(EARTH, Terrain.flat(0.0, plan.map.grid))
        )
        judge_lines(tmp_path / name, lines, Mission.of_plan(plan), None)
        assert lines.holds is not None
        without = dataclasses.replace(lines, holds=np.zeros_like(lines.holds))
        with pytest.raises(
            ValueError,
            match=r"PX4 cuts the corner at waypoint 2 of 4 \(x 6\.5, y 4\.0, z 9\.2\) and comes within 0\.\d\d m of "
            r"something, where 1 m are to be kept; nothing was written: hold there for 2 s",
        ):
            judge_lines(tmp_path / name, without, Mission.of_plan(plan), None)


def test_a_take_off_and_a_landing_are_left_at_rest(tmp_path: Path) -> None:
    floor = np.zeros((30, 8, 16), bool)
    floor[:, :, 0] = True
    where = maxjax.VoxelMap.of(floor, spacing=1.0, origin=(0.5, 0.5, -0.5), ground=floor)
    path = np.array([[6.5, 4.0, 4.0], [15.0, 6.0, 6.0], [26.0, 4.0, 4.0]])
    plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), length=30.0, clearance_at=np.full(3, np.inf))
    for landing in (False, True):
        export(tmp_path / "a.plan", plan, earth=EARTH, ground=0.0, takeoff_and_landing=landing)
        assert [row[0] for row in waypoints_in(tmp_path / "a.plan")] == [2.0 * landing, 0.0, 2.0 * landing]


def test_the_vehicle_may_leave_within_an_exemption_as_near_as_its_end_stands() -> None:
    """A start 0.3 m off a wall: what leads straight away from it has no corner to stop at."""
    occupied = np.zeros((30, 12, 12), bool)
    occupied[:, 0, :] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path = np.array([[5.0, 1.3, 5.0], [8.0, 3.0, 5.0], [20.0, 3.5, 5.0]])
    plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), exemptions=(3.0, 0.0), clearance_at=np.full(3, 1.0))
    mission = Mission.of_plan(plan)
    for autopilot in BOTH:
        corners, least = cut_corners(Waypoints(path, np.zeros(3), np.full(3, 0.5)), mission, autopilot)
        assert not corners
        assert least > 0.9
    early = Waypoints(path[[0, 1, 2]] - [0.0, 1.2, 0.0], np.zeros(3), np.full(3, 0.5))
    assert set(cut_corners(early, mission, Autopilot.arducopter())[0]) == {1}


def test_an_exemption_keeps_what_its_end_keeps() -> None:
    """Inside that of a start 0.3 m off a wall, segments keep 0.3 m but for the slack; outside of it the radius."""
    occupied = np.zeros((30, 12, 12), bool)
    occupied[:, 0, :] = True
    where = maxjax.VoxelMap.of(occupied, spacing=1.0, origin=(0.5, 0.5, 0.5))
    path = np.array([[5.0, 1.3, 5.0], [20.0, 3.5, 5.0]])
    plan = bare_plan(where, path, maxjax.Distances(1.0, 1.0), exemptions=(3.0, 0.0), clearance_at=np.full(2, 1.0))
    lines = np.array([[[4.0, y, 5.0], [7.0, y, 5.0]] for y in (1.25, 1.15)] + [[[7.0, 1.5, 5.0], [9.0, 1.5, 5.0]]])
    clearance, passes = _kept(lines, path, Mission.of_plan(plan), 0)
    assert passes.tolist() == [True, False, False]
    np.testing.assert_allclose(clearance, [0.25, 0.15, 0.5], atol=1e-9)


def test_autopilots_have_names_and_parameters() -> None:
    assert Autopilot.named("px4") == Autopilot.px4() == BOTH[0]
    assert Autopilot.named("ArduCopter:WPNAV_RADIUS=50, RTL_ALT=3000") == Autopilot.arducopter(
        WPNAV_RADIUS=50.0, RTL_ALT=3000.0
    )
    assert Autopilot.arducopter(WPNAV_RADIUS=50.0).corner_radius == 0.5
    assert Autopilot.px4().radius_of(0.5) == 0.5
    assert Autopilot.px4().radius_of(0.0) == 2.0
    assert Autopilot.arducopter().radius_of(0.5) == 2.0
    assert Autopilot.arducopter().returning(42.5).parameters["RTL_ALT"] == 4300.0
    assert Autopilot.px4().returning(42.5) == Autopilot.px4()
    for wrong in ("", "betaflight", "px4:NAV_ACC_RAD", "px4:NAV_ACC_RAD=near"):
        with pytest.raises(ValueError, match="autopilot: expected px4 or arducopter, with parameters"):
            Autopilot.named(wrong)
    with pytest.raises(ValueError, match=r"expected parameters of px4 .NAV_ACC_RAD, .*given 'WPNAV_RADIUS'"):
        Autopilot.named("px4:WPNAV_RADIUS=50")
    for value in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="expected a positive RTL_ALT"):
            Autopilot.arducopter(RTL_ALT=value)


def test_parameters_are_stated_and_written_beside(tmp_path: Path) -> None:
    found = export(tmp_path / "a.plan", over_a_roof(), earth=EARTH, ground=0.0)
    said = json.loads((tmp_path / "a.plan").read_text())["maxjax"]
    assert said["parameters"] == {one.name: dict(one.parameters) for one in found.autopilots}
    assert said["parameters"]["arducopter"] == {
        "WPNAV_RADIUS": 200.0,
        "RTL_ALT": 1500.0,
        "RTL_CONE_SLOPE": 0.0,
        "FS_THR_ENABLE": 1.0,
        "FS_GCS_ENABLE": 1.0,
    }
    assert any("WPNAV_RADIUS 200" in remark for remark in found.remarks)
    assert said["remarks"]
    assert set(said["remarks"]) <= set(found.remarks)
    files = write_parameters(tmp_path / "a.plan", found)
    assert [file.name for file in files] == ["a_px4.params", "a_arducopter.param"]
    assert "WPNAV_RADIUS,200\n" in files[1].read_text()
    rows = [row.split("\t") for row in files[0].read_text().splitlines() if not row.startswith("#")]
    assert {row[2]: float(row[3]) for row in rows} == dict(BOTH[0].parameters)
    assert {len(row) for row in rows} == {5}


def test_a_file_names_whom_it_is_made_for(tmp_path: Path) -> None:
    for autopilot, firmware in ((Autopilot.px4(), 12), (Autopilot.arducopter(), 3), (None, 12)):
        export(tmp_path / "a.plan", over_a_roof(), earth=EARTH, ground=0.0, autopilot=autopilot)
        assert json.loads((tmp_path / "a.plan").read_text())["mission"]["firmwareType"] == firmware
