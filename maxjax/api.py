"""Planning by name: which planner a method means, inputs checked once.

solver     climbs the exact conduction potential
network    climbs a predicted one, improved until it is certified
astar      searches the dilated grid
rrtstar    samples it (OMPL's, extra `bench`)
apf        descends an artificial potential field
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import overload

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Real

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.occupancy import rungs, voxelize
from maxjax.nn.model import network_potential
from maxjax.planning.baselines.apf import apf
from maxjax.planning.baselines.astar import astar
from maxjax.planning.baselines.rrt_star import rrt_star
from maxjax.planning.batch import one_by_one, plan_paths
from maxjax.planning.fleet import plan_swarm
from maxjax.planning.planner import (
    PathFinder,
    Plan,
    PotentialFn,
    Route,
    Stopwatch,
    field_path,
)
from maxjax.planning.problem import Problem
from maxjax.solvers.potential import solve_potential

DEFAULT_MARGIN = 8.0


def _astar_path(problem: Problem, grid: Grid, watch: Stopwatch) -> Route:
    """A* from the start's voxel to the goal's, joined to the exact ends."""
    with watch.stage("search"):
        ends = [tuple(int(i) for i in np.floor(np.asarray(x) + 0.5)) for x in (problem.start, problem.goal)]
        found = astar(np.asarray(problem.blocked), *ends)  # type: ignore[arg-type]
        centres = found.path.astype(np.float32)
        path = np.concatenate([np.asarray(problem.start)[None], centres, np.asarray(problem.goal)[None]])
    return Route(path, found.status, certified=False)


# Methods that climb a potential, which takes `vmap`, and methods that search.
_POTENTIALS: dict[str, Callable[[], PotentialFn]] = {"solver": lambda: solve_potential, "network": network_potential}
_SEARCHES: dict[str, PathFinder] = {"astar": _astar_path, "rrtstar": rrt_star(), "apf": apf}
METHODS = (*_POTENTIALS, *_SEARCHES)


def path_finder(method: str) -> PathFinder:
    """The path finder that a method means.

    Raises:
        ValueError: for an unknown method, or a network whose weights are missing.
    """
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, given {method!r}")
    return _SEARCHES[method] if method in _SEARCHES else field_path(_POTENTIALS[method]())


def _check(method: str, margin: float, grid: Grid) -> None:
    """Raise a `ValueError` for what `path_finder` does not know, or a margin that `rungs` refuses."""
    path_finder(method)
    rungs(margin, grid)


def _plans(
    method: str,
    occupied: Bool[np.ndarray, "*m nx ny nz"],
    ground: Bool[np.ndarray, "*g nx ny nz"],
    starts: Float[np.ndarray, "b 3"],
    goals: Float[np.ndarray, "b 3"],
    grid: Grid,
    margin: float,
) -> list[Plan]:
    """Plans of problems that were checked: fields in chunks, searches one by one."""
    if method in _SEARCHES:
        find = _SEARCHES[method]
        return one_by_one(find, occupied, starts, goals, grid, margin=float(margin), ground=ground, method=method)
    potential = _POTENTIALS[method]()
    return plan_paths(potential, occupied, starts, goals, grid, margin=float(margin), ground=ground, method=method)


def _volume(name: str, array: object, shape: tuple[int, ...]) -> Bool[np.ndarray, "..."]:
    volume = np.asarray(array)
    if volume.dtype != bool:
        raise ValueError(f"{name}: expected dtype bool, given {volume.dtype}; compare with a threshold first")
    if volume.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, given {volume.shape}")
    return volume


def _points(name: str, array: object, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    points = np.asarray(array)
    if points.shape != shape or not (np.issubdtype(points.dtype, np.number) and np.isrealobj(points)):
        raise ValueError(f"{name}: expected numbers of shape {shape} [m], given {points.dtype} {points.shape}")
    return points.astype(np.float32)


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
        method: `solver`, `network`, `astar`, `rrtstar` (ImportError without the extra `bench`) or `apf`.
        margin: distance to keep from obstacles [m], voxel centre to voxel centre; lowered by one voxel at a time where
            it seals start or goal in. `Plan.margin` tells the one that was used.
        ground: the voxels of `occupied` that are ground; they are dilated by one voxel at most. None: no voxel is.

    Returns:
        A `Plan`. Its status says what happened; only OK comes with a path.

    Raises:
        ValueError: for a wrong shape or dtype, an unknown method or a negative margin.
    """
    _check(method, margin, grid)
    filled = _volume("occupied", occupied, grid.shape)
    below = np.zeros(grid.shape, bool) if ground is None else _volume("ground", ground, grid.shape)
    ends = _points("start", start, (3,)), _points("goal", goal, (3,))
    return _plans(method, filled, below, ends[0][None], ends[1][None], grid, margin)[0]


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
    def margin(self) -> np.ndarray:
        """(b,) float64 [m]."""
        return np.array([plan.margin for plan in self.plans])


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
    _check(method, margin, grid)
    starts = np.asarray(start)
    count = starts.shape[0] if starts.ndim == 2 else 0
    if count == 0:
        raise ValueError(f"start: expected shape (b, 3) with b >= 1, given {starts.shape}")
    starts, goals = _points("start", start, (count, 3)), _points("goal", goal, (count, 3))

    def volumes(name: str, array: Array | np.ndarray) -> Bool[np.ndarray, "*b nx ny nz"]:
        return _volume(name, array, grid.shape if np.ndim(array) == 3 else (count, *grid.shape))

    below = volumes("ground", np.zeros(grid.shape, bool) if ground is None else ground)
    filled = volumes("occupied", occupied)
    return PlanBatch(tuple(_plans(method, filled, below, starts, goals, grid, margin)))


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

    Every start keeps the largest margin at which it, alone, is joined to the goal: one UAV that stands beside a wall
    does not cost the others their distance from it. So there is one solve for each margin that some start uses: one
    where all of them stand clear, never more than margin / spacing + 1. The plans do not mind each other: paths may
    cross, and keeping the UAVs apart in time is not done here.

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
    rungs(margin, grid)
    given = np.asarray(starts)
    if given.ndim != 2 or len(given) == 0:
        raise ValueError(f"starts: expected shape (n, 3) with n >= 1, given {given.shape}")
    occupied = _volume("occupied", occupied, grid.shape)
    ground = np.zeros(grid.shape, bool) if ground is None else _volume("ground", ground, grid.shape)
    plans = plan_swarm(
        solve_potential,
        occupied | ground,
        _points("starts", given, (len(given), 3)),
        _points("goal", goal, (3,)),
        grid,
        margin=float(margin),
        ground=ground,
        method="solver",
    )
    return PlanBatch(tuple(plans))


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
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.number):
        raise ValueError(f"points: expected numbers of shape (n, 3) [m], given {array.dtype} {array.shape}")
    _check(method, margin, grid)
    start, goal = _points("start", start, (3,)), _points("goal", goal, (3,))
    watch = Stopwatch()
    with watch.stage("voxelise"):
        scan = jax.block_until_ready(voxelize(array.astype(np.float32), grid))
    if int(scan.kept) == 0:
        nothing = np.zeros((0, 3), np.float32)
        return Plan(Status.EMPTY_SCAN, nothing, np.nan, np.nan, False, 0.0, watch.report(), method)
    found = plan(np.asarray(scan.occupied), start, goal, grid, method=method, margin=margin, ground=ground)
    voxelise = watch.seconds["voxelise"]
    timings = {**found.timings, "voxelise": voxelise, "total": found.timings["total"] + voxelise}
    return dataclasses.replace(found, timings=timings)
