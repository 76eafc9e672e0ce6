"""Planning by name (`maxjax.methods`): one problem, many, a fleet, or a scan; inputs are checked once, as a `Task`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, overload

import jax
import numpy as np
from jaxtyping import Array, Bool, Real

from maxjax.airspace.airspace import Airspace
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.occupancy import voxelize
from maxjax.fields.price import Price
from maxjax.methods import METHODS, method_named
from maxjax.planning.execution import plan_task
from maxjax.planning.field_planner import Climb
from maxjax.planning.fleet import plan_fleet as plan_starts
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan, no_plan
from maxjax.planning.task import Distances, Task, checked_grid, points_of
from maxjax.programs.stage_timer import added, recording, timed
from maxjax.solvers.potential import solve_potential
from maxjax.trajectories.clear_curve import Surroundings
from maxjax.trajectories.limits import PX4, FlightLimits
from maxjax.trajectories.mission_schedule import scheduled_mission
from maxjax.trajectories.schedule import scheduled
from maxjax.trajectories.trajectory import Trajectory

DISTANCES = Distances()

# Public names take many arguments, most of them with defaults; they make a `Task` of them at once.


def on_one_map(task: Task) -> Task:
    """The task itself.

    Raises:
        ValueError: unless its problems share one map.
    """
    for name, volume in (("occupied", task.occupied), ("ground", task.ground)):
        if volume.ndim != 3:
            raise ValueError(f"{name}: expected shape {task.grid.shape}, given {volume.shape}")
    return task


def in_airspace(task: Task, airspace: Airspace | None) -> Task:
    """The task under some rules of the air.

    Raises:
        ValueError: for what is no `Airspace`, or for heights above ground in a map without ground.
    """
    if airspace is None:
        return task
    if not isinstance(airspace, Airspace):
        raise ValueError(f"airspace: expected a maxjax.Airspace, given {airspace!r}")
    if task.ground.ndim == 3:
        return task.closing(airspace.closed(task.ground, task.grid))
    return task.closing(np.stack([airspace.closed(ground, task.grid) for ground in task.ground]))


def _planned(task: Task, method: Any, focus: bool) -> list[Plan]:
    chosen = method_named(method)
    find = chosen.finder()
    if isinstance(find, Climb) and not focus:
        find = dataclasses.replace(find, focused=False)
    return plan_task(task, find, chosen.name)


# arguments: a public name; all that has a default is given by keyword
def plan(
    occupied: Bool[Array | np.ndarray, "nx ny nz"],
    start: Real[Array | np.ndarray, " 3"] | Sequence[float],
    goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    method: str = "solver",
    radius: float = DISTANCES.radius,
    margin: float = DISTANCES.margin,
    price: Price = DISTANCES.price,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
    airspace: Airspace | None = None,
    focus: bool = True,
) -> Plan:
    """Plan a path through a voxel map and verify it.

    Args:
        occupied: occupied voxels, ground included, not dilated.
        start, goal: [m], ENU.
        grid: the grid of `occupied`.
        method: `solver`, `network`, `astar`, `rrtstar` (extra `bench`) or `apf`.
        radius: nothing on the path is nearer than this to the cube of an occupied voxel [m], but
            around an end that itself stands nearer, where its own distance is kept, until it is left (`Plan.balls`). At
            0 the path may graze.
        margin: from where on a metre costs no more than its length [m].
        price: what a metre costs below the margin.
        ground: the voxels of `occupied` that are ground; with a radius, paths keep off voxels beside them. None: no
            voxel is.
        airspace: altitude band and areas that the path has to keep; it keeps off what they close as off the ground.
            None: none.
        focus: whether the method `solver` solves a window of the map, where that proves to hold the cheapest way;
            `Plan.certified` is then about the field in this window. False: always the whole map.

    Returns:
        A `Plan`. Its status says what happened; only OK comes with a path.

    Raises:
        ValueError: for a wrong shape or dtype, an unknown method, a radius or a margin that is no number, negative or
            longer than the map, a margin below the radius, or a network without weights.
        ImportError: where a package that the method needs is missing, before anything is computed.
    """
    method_named(method)
    ends = points_of("start", start, (3,))[None], points_of("goal", goal, (3,))[None]
    task = Task.of(occupied, *ends, grid, Distances.of(radius, margin, price), ground)
    return _planned(in_airspace(on_one_map(task), airspace), method, focus)[0]


@dataclasses.dataclass(frozen=True)
class PlanBatch(Sequence[Plan]):
    """Plans of a batch: a sequence of `Plan`, and their numbers as arrays.

    Attributes:
        plans: one plan a problem.
    """

    plans: tuple[Plan, ...]

    @overload
    def __getitem__(self, index: int) -> Plan: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Plan, ...]: ...
    def __getitem__(self, index: int | slice) -> Plan | tuple[Plan, ...]:
        return self.plans[index]

    def __len__(self) -> int:
        return len(self.plans)

    def __iter__(self) -> Iterator[Plan]:
        return iter(self.plans)

    @property
    def status(self) -> np.ndarray:
        """(b,) int32, `Status`."""
        return np.array([int(plan.status) for plan in self.plans], np.int32)

    @property
    def certified(self) -> np.ndarray:
        """(b,) bool."""
        return np.array([plan.certified for plan in self.plans], bool)

    @property
    def length(self) -> np.ndarray:
        """(b,) float64 [m], NaN where there is no path."""
        return np.array([plan.length for plan in self.plans])

    @property
    def clearance(self) -> np.ndarray:
        """(b,) float64 [m], NaN where there is no path."""
        return np.array([plan.clearance for plan in self.plans])

    @property
    def cruise_clearance(self) -> np.ndarray:
        """(b,) float64 [m], NaN where there is no path."""
        return np.array([plan.cruise_clearance for plan in self.plans])

    @property
    def cost(self) -> np.ndarray:
        """(b,) float64 [m], NaN where there is no path."""
        return np.array([plan.cost for plan in self.plans])

    @property
    def radius(self) -> np.ndarray:
        """(b,) float64 [m]."""
        return np.array([plan.radius for plan in self.plans])

    @property
    def margin(self) -> np.ndarray:
        """(b,) float64 [m]."""
        return np.array([plan.margin for plan in self.plans])


# arguments: a public name; all that has a default is given by keyword
def plan_batch(
    occupied: Bool[Array | np.ndarray, "*m nx ny nz"],
    start: Real[Array | np.ndarray, "b 3"],
    goal: Real[Array | np.ndarray, "b 3"],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    method: str = "solver",
    radius: float = DISTANCES.radius,
    margin: float = DISTANCES.margin,
    price: Price = DISTANCES.price,
    ground: Bool[Array | np.ndarray, "*g nx ny nz"] | None = None,
    airspace: Airspace | None = None,
    focus: bool = True,
) -> PlanBatch:
    """Plan a batch of problems; with a field method on an accelerator, in chunks under `vmap` (`planning.batch`).

    Args:
        occupied: (b, nx, ny, nz), or (nx, ny, nz) for one map that all problems share.
        start, goal: (b, 3) [m].
        grid, method, radius, margin, price, ground, airspace, focus: as in `plan`; ground may be shared as well.

    Raises:
        ValueError: as `plan`, and for an empty batch.
    """
    method_named(method)
    starts = points_of("start", start, ("b", 3))
    goals = points_of("goal", goal, starts.shape)
    task = Task.of(occupied, starts, goals, grid, Distances.of(radius, margin, price), ground)
    return PlanBatch(tuple(_planned(in_airspace(task, airspace), method, focus)))


# arguments: a public name; all that has a default is given by keyword
def plan_fleet(
    occupied: Bool[Array | np.ndarray, "nx ny nz"],
    starts: Real[Array | np.ndarray, "n 3"],
    goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    radius: float = DISTANCES.radius,
    margin: float = DISTANCES.margin,
    price: Price = DISTANCES.price,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
    airspace: Airspace | None = None,
) -> PlanBatch:
    """Plan many starts to one goal on one map: each plan is that of `plan`, the fields are shared.

    There is one solve for all starts that keep the radius, and one for each that stands too near: a start beside a wall
    opens no way for another. Plans are independent of each other: paths may cross, and the UAVs are not kept apart in
    time.

    Args:
        occupied: occupied voxels, ground included, not dilated.
        starts: (n, 3) [m].
        goal: [m].
        grid, radius, margin, price, ground, airspace: as in `plan`.

    Returns:
        One `Plan` a start. A start that is sealed in, outside the map or equal to the goal has a status of its own, and
        leaves the others alone.

    Raises:
        ValueError: as `plan`, and for an empty fleet.
    """
    ends = points_of("starts", starts, ("n", 3)), points_of("goal", goal, (3,))
    task = on_one_map(Task.of(occupied, *ends, grid, Distances.of(radius, margin, price), ground))
    task = in_airspace(task, airspace)
    return PlanBatch(tuple(plan_starts(task, Climb(solve_potential), METHODS["solver"].name)))


# arguments: a public name; all that has a default is given by keyword
def plan_scan(
    points: Real[Array | np.ndarray, "n 3"],
    start: Real[Array | np.ndarray, " 3"] | Sequence[float],
    goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    method: str = "solver",
    radius: float = DISTANCES.radius,
    margin: float = DISTANCES.margin,
    price: Price = DISTANCES.price,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
    airspace: Airspace | None = None,
    focus: bool = True,
) -> Plan:
    """Plan from LiDAR points: `voxelize`, then `plan`.

    Args:
        points: returns in the world frame [m]; misses (NaN, or exactly (0, 0, 0)) and points outside the grid are
            dropped.
        start, goal, grid, method, radius, margin, price, airspace, focus: as in `plan`.
        ground: ground voxels, added to those that hold points.

    Returns:
        A `Plan`; EMPTY_SCAN where no point fell into the grid.

    Raises:
        ValueError: as `plan`, and for points that are not (n, 3).
    """
    method_named(method)
    cloud = points_of("points", points, ("n", 3), least=0)
    distances = Distances.of(radius, margin, price).within(checked_grid(grid))
    ends = points_of("start", start, (3,)), points_of("goal", goal, (3,))
    with recording() as recorder:
        with timed("voxelise"):
            scan = jax.block_until_ready(voxelize(cloud, grid))
        if int(scan.kept) == 0:
            found = no_plan(Status.EMPTY_SCAN, method, distances)
        else:
            occupied = np.asarray(scan.occupied)
            task = Task.of(occupied, ends[0][None], ends[1][None], grid, distances, ground)
            (found,) = _planned(in_airspace(on_one_map(task), airspace), method, focus)
    return dataclasses.replace(found, timings=added(recorder.report(), found.timings))


# arguments: a public name; all that has a default may be left out
def trajectory(
    plan: Plan | Mission,
    limits: FlightLimits = PX4,
    occupied: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
    airspace: Airspace | None = None,
    hovers: Mapping[int, float] | None = None,
) -> Trajectory:
    """Give a plan or a mission times: a smooth trajectory from rest to rest, near the fastest within some limits.

    Corners are rounded as far as the map allows: what leaves the plan's path is judged against its radius. Where no
    rounding is clear it rests at the corner. The waypoints of a mission are flown through but where they say how long
    to hover, where the path turns back, and where radius or exemption ask for a rest (`trajectories.mission_schedule`).

    Args:
        plan: one that is OK, or a mission that is.
        limits: of speed, climb, acceleration, jerk and heading; those of PX4 by default.
        occupied: the map that was planned on. None: nothing off the plan's path is known to be free, and every corner
            is passed at rest.
        grid: of the map.
        ground, airspace: as in `plan`.
        hovers: seconds to rest at points of a plan's path, by their index; a mission's waypoints have theirs.

    Returns:
        A `Trajectory`; `Trajectory.at` tells position, velocity, acceleration and heading at any time.

    Raises:
        ValueError: for a plan without a path or with repeated points, a map of another shape, or hovers that are no
            times at points between start and goal.
    """
    volumes = {"occupied": occupied, "ground": ground}
    maps = {name: None if given is None else np.asarray(given) for name, given in volumes.items()}
    for name, volume in maps.items():
        if volume is not None and (volume.shape != grid.shape or volume.dtype != np.bool_):
            raise ValueError(f"{name}: expected bool of shape {grid.shape}, given {volume.dtype} {volume.shape}")
    if airspace is not None and occupied is not None:
        nowhere = np.zeros((1, 3))
        task = in_airspace(Task.of(occupied, nowhere, nowhere, grid, Distances(0.0, 0.0), ground), airspace)
        maps = {"occupied": task.occupied, "ground": task.ground}
    if isinstance(plan, Mission):
        if hovers:
            raise ValueError("hovers: a mission's waypoints say how long to hover; leave them out")
        return scheduled_mission(plan, limits, maps["occupied"], maps["ground"], grid)
    around = None
    if maps["occupied"] is not None:
        path = np.asarray(plan.path, np.float64)
        around = Surroundings(maps["occupied"], maps["ground"], grid, path, plan.radius, plan.balls)
    return scheduled(plan, limits, hovers or {}, around)
