"""Planning in a map: one problem, many, a fleet, a scan or a mission; inputs are checked once, as a `Task`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, Float, Real

from maxjax.compile.forked import refuse_after_fork
from maxjax.compile.stage_timer import recording, sum_reports, time_stage
from maxjax.core.grid import Grid, Point3
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap, check_map, check_single_map
from maxjax.energy.last_place import end_within_battery, ends_there
from maxjax.energy.split_flights import BatteryFlight, Supply, split_mission
from maxjax.fields.occupancy import add_scan
from maxjax.io.airspace.airspace import Airspace
from maxjax.planners import Field
from maxjax.planning import mission as missions
from maxjax.planning.mission import Mission
from maxjax.planning.path.route import Route
from maxjax.planning.plan import Plan, Plans, no_plans
from maxjax.planning.planner import FieldClimber, Planner, check_climber, check_planner
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task, points_of
from maxjax.planning.run.cheapest_goal import cheapest, costs_to
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.plan_route import plan_route as route_in
from maxjax.planning.run.shared_goal import plan_to_goal as plan_starts
from maxjax.planning.waypoint import Waypoint, legs_of
from maxjax.trajectories.clear_curve import ClearCurve
from maxjax.trajectories.limits import PX4, FlightLimits
from maxjax.trajectories.mission_schedule import schedule_mission
from maxjax.trajectories.schedule import schedule_plan
from maxjax.trajectories.trajectory import Trajectory

FIELD, DISTANCES = Field(), Distances()

Position = Real[Array | np.ndarray, " 3"] | Sequence[float]


def plan(
    where: VoxelMap,
    start: Position,
    goal: Position,
    *,
    planner: Planner = FIELD,
    distances: Distances = DISTANCES,
    airspace: Airspace | None = None,
) -> Plan:
    """Plan a path through a map and verify it.

    Args:
        where: the map, as `maxjax.load_map` or `maxjax.VoxelMap.of` make it.
        start, goal: (3,) [m], ENU.
        planner: `maxjax.Field()`, `Network()`, `AStar()`, `RRTStar()`, `APF()`, or any `planning.planner.Planner`.
        distances: radius, margin and price to keep.
        airspace: altitude band and areas that the path has to keep; it keeps off what they close as off the ground.
            None: those of the map.

    Returns:
        A `Plan`. Its status says what happened; only OK comes with a path.

    Raises:
        ValueError: if the map is an array or a batch, positions are not (3,), distances are longer than the map, or the
            planner is none.
        RuntimeError: in a process that was forked after JAX had run.
    """
    ends = points_of("start", start, (3,))[None], points_of("goal", goal, (3,))
    return plan_task(_task(check_single_map(where), *ends, distances, airspace), check_planner(planner))[0]


def plan_route(
    where: VoxelMap,
    start: Float[Any, " 3"],
    goal: Float[Any, " 3"],
    planner: Planner = FIELD,
    distances: Distances = DISTANCES,
) -> Route:
    """Find a route through a map: a pure function, for `jit` and `vmap`; certified, not verified.

    Where `plan` solves windows of the map and tries longer ascents, this solves the whole map, once. Positions that are
    traced are float32: keep the world's origin near the map.

    Args:
        where: one map; under `vmap` a batch.
        start, goal: (3,) [m], ENU.
        planner: as in `plan`; one that is not batched is called back on the host. Static.
        distances: as in `plan`. Static.

    Returns:
        A `Route` with its path in metres, ENU, filled up with its last point. Unless its status is OK, the path means
        nothing.

    Raises:
        ValueError: if the map is none or a batch, positions are not (3,), or the planner is none.
        RuntimeError: in a process that was forked after JAX had run.
    """
    refuse_after_fork()
    return route_in(where, start, goal, planner, distances)


def plan_batch(
    where: VoxelMap,
    starts: Real[Array | np.ndarray, "b 3"],
    goals: Real[Array | np.ndarray, "b 3"],
    *,
    planner: Planner = FIELD,
    distances: Distances = DISTANCES,
    airspace: Airspace | None = None,
) -> Plans:
    """Plan a batch of problems: on an accelerator in chunks under `vmap`, on a CPU on all cores; verified together.

    Args:
        where: one map for all problems, or a batch of as many maps.
        starts, goals: (b, 3) [m].
        planner, distances, airspace: as in `plan`.

    Returns:
        `Plans`: arrays over the batch; `plans[k]` is a `Plan`.

    Raises:
        ValueError: as `plan`, and for an empty batch.
    """
    starts = points_of("starts", starts, ("b", 3))
    task = _task(where, starts, points_of("goals", goals, starts.shape), distances, airspace)
    return plan_task(task, check_planner(planner))


def plan_to_goal(
    where: VoxelMap,
    starts: Real[Array | np.ndarray, "n 3"],
    goal: Position,
    *,
    planner: FieldClimber = FIELD,
    distances: Distances = DISTANCES,
    airspace: Airspace | None = None,
) -> Plans:
    """Plan many starts to one goal on one map: each plan is that of `plan`, the fields are shared.

    There is one solve for all starts that keep the radius, and one for each that stands too near: a start beside a wall
    opens no way for another. Plans are independent of each other: paths may cross, and the UAVs are not kept apart in
    time, which `maxjax.keep_apart` does for their trajectories.

    Args:
        where: one map.
        starts: (n, 3) [m].
        goal: (3,) [m].
        planner: one that climbs a field.
        distances, airspace: as in `plan`.

    Returns:
        `Plans`. A start that is sealed in, outside the map or equal to the goal has a status of its own, and leaves the
        others alone.

    Raises:
        ValueError: as `plan`, for no starts, or a planner that climbs no field.
    """
    climber = check_climber(planner)
    ends = points_of("starts", starts, ("n", 3)), points_of("goal", goal, (3,))
    return plan_starts(_task(check_single_map(where), *ends, distances, airspace), climber)


def plan_to_nearest(
    where: VoxelMap,
    start: Position,
    goals: Real[Array | np.ndarray, "n 3"],
    *,
    planner: FieldClimber = FIELD,
    distances: Distances = DISTANCES,
    airspace: Airspace | None = None,
) -> Plan:
    """Plan to that of several goals which costs least to reach, as one of several places to land.

    A way costs the same in both directions, so that the field of the start (`plan_to_goal`) tells which goal it is.

    Args:
        where: one map.
        start: (3,) [m].
        goals: (n, 3) [m].
        planner: one that climbs a field.
        distances, airspace: as in `plan`.

    Returns:
        The plan, whose path ends at the goal that was chosen; where none can be reached, that to the nearest in a
        straight line, with its status.

    Raises:
        ValueError: as `plan_to_goal`, for no goals.
    """
    places, climber = points_of("goals", goals, ("n", 3)), check_climber(planner)
    first = _place(points_of("start", start, (3,)).tolist())
    task = _task(check_single_map(where), np.broadcast_to(first, places.shape), places, distances, airspace)
    k = cheapest(costs_to(task, first, places, climber), first, places)
    return plan_task(task.some(slice(k, k + 1)), climber)[0]


plan_fleet = plan_to_goal
"""The name that `plan_to_goal` had before; it stays for one release."""


def plan_scan(
    points: Real[Array | np.ndarray, "n 3"],
    start: Position,
    goal: Position,
    where: Grid | VoxelMap = Grid(),  # noqa: B008 (frozen)
    *,
    planner: Planner = FIELD,
    distances: Distances = DISTANCES,
) -> Plan:
    """Plan from LiDAR points: `voxelize`, then `plan`.

    Args:
        points: (n, 3) returns in the world frame [m]; misses (NaN, or exactly (0, 0, 0)) and points outside the grid
            are dropped.
        start, goal, planner, distances: as in `plan`.
        where: a grid, or a map whose obstacles, ground and closed voxels are known before.

    Returns:
        A `Plan`; EMPTY_SCAN where no point fell into the grid.

    Raises:
        ValueError: as `plan`, and for points that are not (n, 3).
    """
    cloud, finder = points_of("points", points, ("n", 3), least=0), check_planner(planner)
    known = VoxelMap.on(where, np.zeros(where.shape, bool)) if isinstance(where, Grid) else check_single_map(where)
    ends = points_of("start", start, (3,))[None], points_of("goal", goal, (3,))
    with recording() as recorder:
        with time_stage("voxelise"):
            seen, scan = add_scan(known, cloud)
        task = _task(seen, *ends, distances)
        empty = int(scan.kept) == 0
        found = (no_plans(task, Status.EMPTY_SCAN, finder.name) if empty else plan_task(task, finder))[0]
    return dataclasses.replace(found, timings=sum_reports(recorder.report(), found.timings))


def plan_mission(
    where: VoxelMap,
    waypoints: Sequence[Waypoint | Sequence[float]],
    *,
    return_to_start: bool = False,
    planner: Planner = FIELD,
    distances: Distances = DISTANCES,
    airspace: Airspace | None = None,
) -> Mission:
    """Plan a path through waypoints in order, leg by leg, and verify it as a whole.

    Legs of one goal and the same distances share a field where the map is solved as a whole (`plan_to_goal`).

    Args:
        where, planner, distances, airspace: as in `plan`.
        waypoints: at least two, the start first: `Waypoint`, or three coordinates [m]. Of one with alternatives that
            which costs least to reach from the waypoint before is taken (`Mission.choices`).
        return_to_start: whether a last leg leads back to the first waypoint.

    Returns:
        A `Mission`. Its status is OK only if every leg is and the whole path was verified; `Mission.failed` numbers the
        legs that are not. Waypoints in obstacles, outside the map, out of reach or equal to the one before have the
        statuses of `plan`.

    Raises:
        ValueError: as `plan`, for fewer than two waypoints, or one that is none.
    """
    places = [given if isinstance(given, Waypoint) else Waypoint(_place(given)) for given in waypoints]
    if return_to_start and places:
        places.append(Waypoint(places[0].position))
    task = _task(check_single_map(where), *legs_of(places), distances, airspace)
    return missions.plan_mission(task, places, check_planner(planner))


def plan_flights(
    where: VoxelMap,
    waypoints: Sequence[Waypoint | Sequence[float]],
    supply: Supply,
    *,
    limits: FlightLimits = PX4,
    planner: Planner = FIELD,
    distances: Distances = DISTANCES,
) -> tuple[BatteryFlight, ...]:
    """Visit places in order, in as many flights as the battery asks for, each from home and back.

    Args:
        where, planner, distances: as in `plan`.
        waypoints: home first, then the places: `Waypoint`, or three coordinates [m].
        supply: airframe, battery and wind.
        limits: of the flights.

    Returns:
        A `BatteryFlight` each. A mission whose last waypoint lands on a roof, or has alternatives, is one flight, to
        that of these which costs least and the battery lasts to. If a place and back is too far for the battery, the
        last one is the flight there, whose status is CANNOT_RETURN; what has no path has the status of its plan.

    Raises:
        ValueError: as `plan_mission`, and if the wind, or a flight in it, is faster than the airframe.
    """
    places = [given if isinstance(given, Waypoint) else Waypoint(_place(given)) for given in waypoints]
    task, finder = _task(check_single_map(where), *legs_of(places), distances), check_planner(planner)
    if ends_there(places):
        return (end_within_battery(missions.plan_mission(task, places, finder), task, finder, limits, supply),)
    return split_mission(task, places, finder, limits, supply)


def trajectory(
    plan: Plan | Mission, limits: FlightLimits = PX4, *, hovers: Mapping[int, float] | None = None
) -> Trajectory:
    """Give a plan or a mission times: a smooth trajectory from rest to rest, near the fastest within some limits.

    Corners are rounded as far as the map allows: what leaves the plan's path is verified against its radius. Where no
    rounding is clear it rests at the corner. The waypoints of a mission are flown through but where they say how long
    to hover, where the path turns back, and where radius or exemption ask for a rest (`trajectories.mission_schedule`).

    Args:
        plan: one that is OK, or a mission that is; its map says what is clear.
        limits: of speed, climb, acceleration, jerk and heading; those of PX4 by default.
        hovers: seconds to rest at points of a plan's path, by their index; a mission's waypoints have theirs.

    Returns:
        A `Trajectory`; `Trajectory.at` tells position, velocity, acceleration and heading at any time.

    Raises:
        ValueError: if the plan has no path or repeated points, or hovers are no times at points between start and goal.
    """
    if isinstance(plan, Mission):
        if hovers:
            raise ValueError("hovers: a mission's waypoints say how long to hover; leave them out")
        return schedule_mission(plan, limits)
    return schedule_plan(plan, limits, hovers or {}, ClearCurve.of(plan))


def _task(where: Any, starts: np.ndarray, goals: np.ndarray, distances: Any, airspace: Any = None) -> Task:
    """The problems of a map under rules of the air; raises a ValueError for what cannot be used."""
    if not isinstance(distances, Distances):
        raise ValueError(f"distances: expected a maxjax.Distances, given {distances!r}")
    if airspace is not None and not isinstance(airspace, Airspace):
        raise ValueError(f"airspace: expected a maxjax.Airspace, given {airspace!r}")
    given = check_map(where)
    return Task.of(given if airspace is None else airspace.closing(given), starts, goals, distances)


def _place(given: Sequence[float]) -> Point3:
    x, y, z = points_of("waypoints", given, (3,)).tolist()
    return x, y, z
