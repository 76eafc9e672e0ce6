"""Planning by name (`maxjax.methods`): one problem, many, a fleet, or a scan; inputs are checked once, as a `Task`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, overload

import jax
import numpy as np
from jaxtyping import Array, Bool, Real

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.occupancy import voxelize
from maxjax.methods import METHODS, method_named
from maxjax.planning.climb import Climb
from maxjax.planning.execute import plan_task
from maxjax.planning.fleet import plan_fleet as plan_starts
from maxjax.planning.plan import Plan, no_plan
from maxjax.planning.recorder import added, recording, timed
from maxjax.planning.task import Task, checked_grid, checked_margin, points_of
from maxjax.solvers.potential import solve_potential

DEFAULT_MARGIN = 8.0

# `plan`, `plan_batch` and `plan_scan` take seven arguments: they are the public interface, and four have defaults. They
# make a `Task` of them at once.


def _on_one_map(task: Task) -> Task:
    """The task itself.

    Raises:
        ValueError: unless its problems share one map.
    """
    for name, volume in (("occupied", task.occupied), ("ground", task.ground)):
        if volume.ndim != 3:
            raise ValueError(f"{name}: expected shape {task.grid.shape}, given {volume.shape}")
    return task


def _planned(task: Task, method: Any) -> list[Plan]:
    chosen = method_named(method)
    return plan_task(task, chosen.finder(), chosen.name)


# arguments: a public name; all that has a default is given by keyword
def plan(
    occupied: Bool[Array | np.ndarray, "nx ny nz"],
    start: Real[Array | np.ndarray, " 3"] | Sequence[float],
    goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    method: str = "solver",
    margin: float = DEFAULT_MARGIN,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
) -> Plan:
    """Plan a path through a voxel map and verify it.

    Args:
        occupied: occupied voxels, ground included, not dilated.
        start, goal: [m], ENU.
        grid: the grid of `occupied`.
        method: `solver`, `network`, `astar`, `rrtstar` (extra `bench`) or `apf`.
        margin: distance to keep from obstacles [m], voxel centre to voxel centre; lowered by one voxel at a time where
            it seals start or goal in. `Plan.margin` tells the one that was used.
        ground: the voxels of `occupied` that are ground; they are dilated by one voxel at most. None: no voxel is.

    Returns:
        A `Plan`. Its status says what happened; only OK comes with a path.

    Raises:
        ValueError: for a wrong shape or dtype, an unknown method, a margin that is no number, negative or longer than
            the map, or a network without weights.
        ImportError: where a package that the method needs is missing, before anything is computed.
    """
    method_named(method)
    ends = points_of("start", start, (3,))[None], points_of("goal", goal, (3,))[None]
    return _planned(_on_one_map(Task.of(occupied, *ends, grid, margin, ground)), method)[0]


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
    margin: float = DEFAULT_MARGIN,
    ground: Bool[Array | np.ndarray, "*g nx ny nz"] | None = None,
) -> PlanBatch:
    """Plan a batch of problems; with a field method on an accelerator, in chunks under `vmap` (`planning.batch`).

    Args:
        occupied: (b, nx, ny, nz), or (nx, ny, nz) for one map that all problems share.
        start, goal: (b, 3) [m].
        grid, method, margin, ground: as in `plan`; ground may be shared as well.

    Raises:
        ValueError: as `plan`, and for an empty batch.
    """
    method_named(method)
    starts = points_of("start", start, ("b", 3))
    goals = points_of("goal", goal, starts.shape)
    return PlanBatch(tuple(_planned(Task.of(occupied, starts, goals, grid, margin, ground), method)))


def plan_fleet(
    occupied: Bool[Array | np.ndarray, "nx ny nz"],
    starts: Real[Array | np.ndarray, "n 3"],
    goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    margin: float = DEFAULT_MARGIN,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
) -> PlanBatch:
    """Plan many starts to one goal on one map: each plan is that of `plan`, the fields are shared.

    Every start keeps the largest margin at which it, alone, is joined to the goal: a start beside a wall lowers no
    other start's margin. There is one solve for each margin that some start uses: one where all of them stand clear,
    never more than margin / spacing + 1. Plans are independent of each other: paths may cross, and the UAVs are not
    kept apart in time.

    Args:
        occupied: occupied voxels, ground included, not dilated.
        starts: (n, 3) [m].
        goal: [m].
        grid, margin, ground: as in `plan`.

    Returns:
        One `Plan` a start. A start that is sealed in, outside the map or equal to the goal has a status of its own, and
        leaves the others alone.

    Raises:
        ValueError: as `plan`, and for an empty fleet.
    """
    ends = points_of("starts", starts, ("n", 3)), points_of("goal", goal, (3,))
    task = _on_one_map(Task.of(occupied, *ends, grid, margin, ground))
    return PlanBatch(tuple(plan_starts(task, Climb(solve_potential), METHODS["solver"].name)))


# arguments: a public name; all that has a default is given by keyword
def plan_scan(
    points: Real[Array | np.ndarray, "n 3"],
    start: Real[Array | np.ndarray, " 3"] | Sequence[float],
    goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    method: str = "solver",
    margin: float = DEFAULT_MARGIN,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
) -> Plan:
    """Plan from LiDAR points: `voxelize`, then `plan`.

    Args:
        points: returns in the world frame [m]; misses (NaN, or exactly (0, 0, 0)) and points outside the grid are
            dropped.
        start, goal, grid, method, margin: as in `plan`.
        ground: ground voxels, added to those that hold points.

    Returns:
        A `Plan`; EMPTY_SCAN where no point fell into the grid.

    Raises:
        ValueError: as `plan`, and for points that are not (n, 3).
    """
    method_named(method)
    cloud = points_of("points", points, ("n", 3), least=0)
    checked_margin(margin, checked_grid(grid))
    ends = points_of("start", start, (3,)), points_of("goal", goal, (3,))
    with recording() as recorder:
        with timed("voxelise"):
            scan = jax.block_until_ready(voxelize(cloud, grid))
        if int(scan.kept) == 0:
            found = no_plan(Status.EMPTY_SCAN, method)
        else:
            found = plan(np.asarray(scan.occupied), *ends, grid, method=method, margin=margin, ground=ground)
    return dataclasses.replace(found, timings=added(recorder.report(), found.timings))
