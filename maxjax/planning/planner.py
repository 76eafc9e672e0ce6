"""From a map, a start and a goal to a verified path.

    pose (dilate, choose the margin) → find a path (a field climbed, or a graph searched) → verify → Plan

The path finder is an argument, so that every planner answers the same problems, on the same dilated grid, before the
same judge. `field_path` makes one from any potential function (the exact solver, later a network).
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Int64, UInt8, UInt16

from maxjax.core import bits
from maxjax.core.grid import Grid
from maxjax.core.lowering import materialise
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.planning.ascent import Ascent, ascend
from maxjax.planning.judge import Verification, verify_batch
from maxjax.planning.problem import Problem, pose
from maxjax.planning.sight import span_codes
from maxjax.planning.string_pulling import tighten


@runtime_checkable
class PotentialLike(Protocol):
    """What the solver and a network return alike."""

    @property
    def phi(self) -> Array:
        """Potential, 1 at the goal."""
        ...

    @property
    def status(self) -> Array:
        """`Status` as int32."""
        ...

    @property
    def certified(self) -> Array:
        """Whether no voxel but the goal is a local maximum."""
        ...


PotentialFn = Callable[[Array, Array], PotentialLike]


@dataclasses.dataclass(frozen=True)
class Plan:
    """A verified path, or why there is none.

    Attributes:
        status: OK only for a path that passed `verify`.
        path: (t, 3) float32 [m], ENU, start first, goal last; empty unless OK. An end that lies on the face of a
            blocked voxel is moved off it by less than a thousandth of a voxel (1 mm at 2 m).
        length: length of the path [m]; NaN unless OK.
        clearance: least distance from the path to the cube of an occupied voxel [m], ground left out; NaN unless OK.
        certified: whether the field it climbed had no local maximum but the goal (always False for graph searches).
        margin: dilation that was used [m].
        timings: seconds by stage (`dilate`, `solve`, `ascend`, `tighten`, `verify`, …; `transfer` is the way to the
            device and back; `device` is all of that in one program), `compile` apart, and `total` without it.
        method: name of the planner.
    """

    status: Status
    path: Float[np.ndarray, "t 3"]
    length: float
    clearance: float
    certified: bool
    margin: float
    timings: Mapping[str, float]
    method: str


class Stopwatch:
    """Seconds by stage, compilation apart."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {"compile": 0.0}

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Book the time of a block of code."""
        begun = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begun

    def report(self, shares: int = 1) -> dict[str, float]:
        """All stages, and their total without compilation; of each, one of so many equal shares."""
        seconds = {name: spent / shares for name, spent in self.seconds.items()}
        return {**seconds, "total": sum(spent for name, spent in seconds.items() if name != "compile")}


class Stage:
    """A jitted function that is compiled ahead of its first call, so that compilation can be timed apart.

    Arguments are arrays, keywords are static; one executable is kept for each combination of shapes, dtypes and
    keywords.
    """

    def __init__(self, name: str, function: Callable[..., Any], static: tuple[str, ...] = ()) -> None:
        self.name = name
        self._jit = jax.jit(function, static_argnames=static)
        self._compiled: dict[Hashable, Callable[..., Any]] = {}

    def __call__(self, watch: Stopwatch, *arrays: Any, **static: Any) -> Any:
        """Run, blocked until ready."""
        ready = self._executable(watch, arrays, static)
        with watch.stage(self.name):
            return jax.block_until_ready(ready(*arrays))

    def start(self, watch: Stopwatch, *arrays: Any, **static: Any) -> Any:
        """Run without waiting for the result; only compilation is booked."""
        return self._executable(watch, arrays, static)(*arrays)

    def _executable(self, watch: Stopwatch, arrays: tuple[Any, ...], static: Mapping[str, Any]) -> Callable[..., Any]:
        leaves, tree = jax.tree.flatten(arrays)
        key = (tree, tuple((x.shape, x.dtype) for x in leaves), tuple(sorted(static.items())))
        if key not in self._compiled:
            with watch.stage("compile"):
                self._compiled[key] = self._jit.lower(*arrays, **static).compile()
        return self._compiled[key]


@dataclasses.dataclass(frozen=True)
class Route:
    """What a path finder returns: a path in index coordinates, start first, goal last, or why there is none."""

    path: Float[np.ndarray, "t 3"]
    status: Status
    certified: bool


PathFinder = Callable[[Problem, Grid, Stopwatch], Route]


def fetch(watch: Stopwatch, *arrays: Array) -> tuple[np.ndarray, ...]:
    """Arrays on the host, all at once: on an accelerator every fetch costs as much as a short stage."""
    with watch.stage("transfer"):
        there: tuple[np.ndarray, ...] = jax.device_get(arrays)
    return there


def solve(
    blocked: Bool[Array, "nx ny nz"], goal_index: Int32[Array, " 3"], grid: Grid, potential: PotentialFn
) -> PotentialLike:
    """The potential of a dilated map."""
    return potential(materialise(conductivity(blocked, goal_index, grid)), goal_index)


def climb(
    phi: Float[Array, "nx ny nz"],
    blocked: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    settings: Ascent,
) -> tuple[Float[Array, "t 3"], Bool[Array, ""], UInt16[Array, "nx ny nz"]]:
    """Ascend the field; returns the path, whether it arrived, and the line-of-sight span codes."""
    sight = span_codes(blocked)
    path, arrived = ascend(phi, sight, ~blocked, start, goal, settings)
    return path, arrived, sight


def route(
    problem: Problem, grid: Grid, potential: PotentialFn, settings: Ascent
) -> tuple[Float[Array, "t 3"], Int32[Array, ""], Bool[Array, ""]]:
    """Field, ascent and tightening as one pure function, for `jit` and `vmap`: (path, status, certified)."""
    field = solve(problem.blocked, problem.goal_index, grid, potential)
    path, arrived, sight = climb(field.phi, problem.blocked, problem.start, problem.goal, settings)
    path = tighten(sight, path)
    status = jnp.where(arrived, Status.OK, Status.PATH_STALLED)
    status = jnp.where(field.status != Status.OK, field.status, status)
    status = jnp.where(problem.status != Status.OK, problem.status, status)
    return path, status.astype(jnp.int32), field.certified & (problem.status == Status.OK)


def posed(
    occupied: UInt8[Array, " bytes"],
    ground: UInt8[Array, " bytes"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    margin: float,
    grid: Grid,
) -> Problem:
    """`pose` for maps that come as bits."""
    below = bits.volume(ground, grid.shape)
    return pose(bits.volume(occupied, grid.shape) | below, below, start, goal, margin, grid)


_POSE = Stage("dilate", posed, static=("margin", "grid"))
_SOLVE = Stage("solve", solve, static=("grid", "potential"))
_CLIMB = Stage("ascend", climb, static=("settings",))
_TIGHTEN = Stage("tighten", tighten)


def potential_field(
    blocked: Bool[Array, "nx ny nz"],
    goal_index: Int32[Array, " 3"],
    grid: Grid,
    potential: PotentialFn,
    watch: Stopwatch,
) -> PotentialLike:
    """`solve` as a timed stage, compiled once for all callers."""
    field: PotentialLike = _SOLVE(watch, blocked, goal_index, grid=grid, potential=potential)
    return field


def field_path(potential: PotentialFn, settings: Ascent = Ascent()) -> PathFinder:  # noqa: B008 (frozen)
    """The path finder that climbs a potential.

    Args:
        potential: (sigma, goal_index) ↦ `PotentialLike`; pure, hashable: pass the same function each time.
        settings: of the ascent.
    """

    def find(problem: Problem, grid: Grid, watch: Stopwatch) -> Route:
        field = potential_field(problem.blocked, problem.goal_index, grid, potential, watch)
        # A maze can need more steps than a city; each attempt gives the ascent four times as many.
        for factor in (1, 4, 16):
            longer = dataclasses.replace(settings, steps=settings.steps * factor)
            ends = problem.start, problem.goal
            path, arrived, sight = _CLIMB(watch, field.phi, problem.blocked, *ends, settings=longer)
            taut = _TIGHTEN(watch, sight, path)
            status, certified, there, points = fetch(watch, field.status, field.certified, arrived, taut)
            if status != Status.OK:
                return Route(NO_PATH, Status(int(status)), bool(certified))
            if there:
                return Route(points, Status.OK, bool(certified))
        return Route(NO_PATH, Status.PATH_STALLED, bool(certified))

    return find


NO_PATH = np.zeros((0, 3), np.float32)


def judge(
    routes: Sequence[Route],
    starts: Float[np.ndarray, "n 3"],
    goals: Float[np.ndarray, "n 3"],
    which: Int64[np.ndarray, " n"],
    margins: Sequence[float],
    blocked: Bool[np.ndarray, "m nx ny nz"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    grid: Grid,
    watch: Stopwatch,
    method: str,
    ground: Bool[np.ndarray, "m nx ny nz"] | None = None,
) -> list[Plan]:
    """Turn routes into plans: only a path that `verify` passes is handed out.

    Args:
        routes: what was found.
        starts, goals: as given [m].
        which: map of each route, of the m dilated ones that follow.
        margins: of the maps [m].
        blocked: within the margin, of each map.
        occupied: of each map.
        grid: of the maps.
        watch: time spent on all routes so far; each plan gets its share.
        method: name of the planner.
        ground: of each map, from which no clearance is measured. None: there is none.
    """
    metres = {
        k: _metres(route.path, starts[k], goals[k], grid) for k, route in enumerate(routes) if route.status == Status.OK
    }
    with watch.stage("verify") if metres else contextlib.nullcontext():
        verdicts = _verdicts(metres, which, blocked, occupied, ground, grid)
    timings = watch.report(len(routes))
    plans = []
    for k, route in enumerate(routes):
        margin, status = float(margins[which[k]]), route.status
        if k in verdicts and verdicts[k].ok:
            figures = verdicts[k].length, verdicts[k].clearance
            plans.append(Plan(status, metres[k], *figures, route.certified, margin, timings, method))
            continue
        status = Status.PATH_IN_COLLISION if k in verdicts else status
        plans.append(Plan(status, NO_PATH, math.nan, math.nan, route.certified, margin, timings, method))
    return plans


def _metres(
    path: Float[np.ndarray, "t 3"], start: Float[np.ndarray, " 3"], goal: Float[np.ndarray, " 3"], grid: Grid
) -> Float[np.ndarray, "s 3"]:
    """World coordinates of a path, without repeated points."""
    # Before the ends are set: those of a path of fewer points than the array holds are repeated in index coordinates.
    x, y, z = (path[1:] != path[:-1]).T
    world = np.asarray(grid.origin) + grid.spacing * path[np.concatenate([[True], x | y | z])].astype(np.float64)
    # To the bit where given, unless `pose` moved an end off the face of a blocked voxel.
    for end, given in ((0, start), (-1, goal)):
        if np.abs(world[end] - given).max() < 1e-4 * grid.spacing:
            world[end] = given
    return np.asarray(world.astype(np.float32))


# Paths that are verified in one go, and maps that these may span: so few that they stay in a core's cache.
_TOGETHER, _MAPS = 16, 8


def _verdicts(
    metres: Mapping[int, Float[np.ndarray, "_ 3"]],
    which: Int64[np.ndarray, " n"],
    blocked: Bool[np.ndarray, "m nx ny nz"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
    grid: Grid,
) -> dict[int, Verification]:
    def some(keys: list[int]) -> list[tuple[int, Verification]]:
        first, last = which[keys[0]], which[keys[-1]] + 1
        maps = blocked[first:last], occupied[first:last]
        below = None if ground is None else ground[first:last]
        paths = [metres[key] for key in keys]
        return list(zip(keys, verify_batch(paths, which[keys] - first, *maps, grid, ground=below), strict=True))

    parts: list[list[int]] = []
    for key in sorted(metres, key=lambda key: which[key]):
        if not parts or len(parts[-1]) == _TOGETHER or which[key] - which[parts[-1][0]] >= _MAPS:
            parts.append([])
        parts[-1].append(key)
    if len(parts) < 2:
        return dict(verdict for part in parts for verdict in some(part))
    # NumPy lets several threads work at a time.
    with ThreadPoolExecutor() as pool:
        return dict(verdict for part in pool.map(some, parts) for verdict in part)


def plan_path(
    find: PathFinder,
    occupied: Bool[np.ndarray, "nx ny nz"],
    start: Float[np.ndarray, " 3"],
    goal: Float[np.ndarray, " 3"],
    grid: Grid,
    *,
    margin: float,
    ground: Bool[np.ndarray, "nx ny nz"],
    method: str,
) -> Plan:
    """Pose the problem, find a path, verify it. Arguments as in `maxjax.plan`, already checked."""
    watch = Stopwatch()
    with watch.stage("transfer"):
        arrays = jax.block_until_ready(jax.device_put((bits.pack(occupied), bits.pack(ground), start, goal)))
    problem = _POSE(watch, *arrays, margin=margin, grid=grid)
    status, used, blocked = fetch(watch, problem.status, problem.margin, problem.blocked)
    found = Route(NO_PATH, Status(int(status)), certified=False)
    if found.status == Status.OK:
        found = find(problem, grid, watch)
    here = [float(used)], blocked[None], occupied[None], grid, watch, method, ground[None]
    (plan,) = judge([found], start[None], goal[None], np.zeros(1, np.int64), *here)
    return plan
