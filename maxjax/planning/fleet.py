"""Many starts, one goal, one map: one field for each margin that some start needs.

    the margin of every start (one flood fill a rung, from the goal) → one solve a margin → ascents in batches → judge

A start's plan is the one that it would get by itself: its margin is its own, and fields do not depend on the start.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Int64, Integer

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.occupancy import blocked_within
from maxjax.planning.ascent import Ascent, ascend
from maxjax.planning.climb import Climb, potential_field
from maxjax.planning.ends import locate, placed
from maxjax.planning.execute import with_longer_ascents
from maxjax.planning.margin import Ladder, all_stand_free, ladder, largest_joined_each
from maxjax.planning.plan import Plan, judged
from maxjax.planning.problem import Dilated, Faults
from maxjax.planning.program import Program
from maxjax.planning.recorder import recording
from maxjax.planning.route import Route, failed, found
from maxjax.planning.sight import sight_of, stands_free
from maxjax.planning.string_pulling import tighten
from maxjax.planning.task import Task

# Starts that climb at a time: what bounds memory, whatever the size of the fleet. Fewer of them are filled up to one of
# two sizes, so that fleets of all sizes share two programs.
_BATCH, _SMALL_BATCH = 64, 8


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Fleet:
    """The starts of a fleet, formulated.

    Attributes:
        margins: of the map.
        status: OK, or why there is nothing to plan from a start.
        rung: which of `margins` a start keeps.
        goal_index: voxel of the goal.
    """

    margins: Ladder
    status: Int32[Array, " n"]
    rung: Int32[Array, " n"]
    goal_index: Int32[Array, " 3"]


def formulate_fleet(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    starts: Float[Array, "n 3"],
    goal: Float[Array, " 3"],
    margin: float,
    grid: Grid,
) -> Fleet:
    """`problem.formulate` for every start; ends in index coordinates, `margin` and `grid` static."""
    occupied = occupied | ground
    margins = ladder(occupied, ground, margin, grid)
    a, b = jax.vmap(lambda x: locate(x, grid.shape))(starts), locate(goal, grid.shape)
    nowhere, nobody = jnp.zeros(grid.shape, bool), jnp.zeros(len(starts), bool)
    inside_a, inside_b = all_stand_free(nowhere, a), nobody | stands_free(nowhere, b.off)
    outside_a, outside_b = all_stand_free(occupied, a), nobody | stands_free(occupied, b.off)
    finite = a.finite & b.finite
    rung, joined = largest_joined_each(margins, a, b, finite & inside_a & inside_b & outside_a & outside_b)
    faults = Faults(
        nonfinite=~finite,
        start_outside=~inside_a,
        goal_outside=~inside_b,
        same=jnp.all(starts == goal, axis=1),
        start_inside=~outside_a,
        goal_inside=~outside_b,
        apart=~joined,
    )
    return Fleet(margins, faults.status, rung, b.index)


def _dilated(
    squared: Integer[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ground_squared: Integer[Array, "nx ny nz"],
    margin: Float[Array, ""],
    grid: Grid,
) -> Dilated:
    return Dilated(blocked_within(squared, ground, ground_squared, margin, grid), margin)


def _ascents(
    log_phi: Float[Array, "nx ny nz"],
    blocked: Bool[Array, "nx ny nz"],
    starts: Float[Array, "n 3"],
    goal: Float[Array, " 3"],
    settings: Ascent,
) -> tuple[Float[Array, "n t 3"], Bool[Array, " n"]]:
    """Ascend one field from many starts and tighten; returns the paths, and which arrived."""
    sight = sight_of(blocked)

    def one(start: Float[Array, " 3"]) -> tuple[Array, Array]:
        path, arrived = ascend(log_phi, sight, ~blocked, placed(blocked, start), placed(blocked, goal), settings)
        return tighten(sight, path), arrived

    return jax.vmap(one)(starts)


_FORMULATE = Program("margins", formulate_fleet, static=("margin", "grid"))
_DILATE = Program("dilate", _dilated, static=("grid",))
_ASCENTS = Program("ascend", _ascents, static=("settings",))


def plan_fleet(task: Task, climb: Climb, method: str) -> list[Plan]:
    """`execute.plan_task` for a task of one map and one goal: one solve for each margin that is used."""
    with recording() as recorder:
        goal, starts = jnp.asarray(task.ends[0, 1]), jnp.asarray(task.ends[:, 0])
        maps = jnp.asarray(task.occupied), jnp.asarray(task.ground)
        fleet = _FORMULATE(*maps, starts, goal, margin=task.margin, grid=task.grid.local)
        status, rung = np.asarray(fleet.status), np.asarray(fleet.rung)
        routes = [failed(one) for one in status.tolist()]
        used = np.unique(rung)
        dilated: list[Dilated] = []
        for level in used:
            margins = fleet.margins
            distances = margins.squared, margins.ground, margins.ground_squared
            here: Dilated = _DILATE(*distances, margins.margins[level], grid=task.grid.local)
            members = np.flatnonzero((status == Status.OK) & (rung == level))
            if members.size:
                climbed = _routes(starts[members], goal, fleet.goal_index, here, climb, task.grid)
                for k, route in zip(members.tolist(), climbed, strict=True):
                    routes[k] = route
            dilated.append(jax.device_get(here))
        maps_used = jax.tree.map(lambda *parts: np.stack(parts), *dilated)
        plans = judged(routes, task, maps_used, method, np.searchsorted(used, rung))
    timings = recorder.report(len(task))
    return [dataclasses.replace(plan, timings=timings) for plan in plans]


def _routes(
    starts: Float[Array, "n 3"],
    goal: Float[Array, " 3"],
    goal_index: Int32[Array, " 3"],
    dilated: Dilated,
    climb: Climb,
    grid: Grid,
) -> list[Route]:
    """Routes of the starts that share a margin, by one field."""
    field = potential_field(jnp.asarray(dilated.blocked), goal_index, grid, climb.potential)
    certified = bool(field.certified)
    if field.status != Status.OK:
        return [failed(field.status, certified)] * len(starts)

    def attempt(which: Int64[np.ndarray, " m"], settings: Ascent) -> list[Route]:
        routes: list[Route] = []
        for some in np.array_split(which, range(_BATCH, len(which), _BATCH)):
            filled = starts[np.resize(some, _SMALL_BATCH if len(some) <= _SMALL_BATCH else _BATCH)]
            paths, arrived = map(np.asarray, _ASCENTS(field.log_phi, dilated.blocked, filled, goal, settings=settings))
            stalled = failed(Status.PATH_STALLED, certified)
            routes += [found(paths[k], certified) if arrived[k] else stalled for k in range(len(some))]
        return routes

    return with_longer_ascents(attempt, len(starts), climb.settings)
