"""Many starts, one goal, one map: starts whose exemptions open no voxel share one field.

    inflated obstacles, the goal's exemption, price and a flood from the goal → one solve for all that it joins
    → ascents in batches → string pulling → verifier

An exemption depends on its own end alone: that of the goal is the same for all. A start whose exemption opens voxels is
formulated by itself and has a field of its own, which does not depend on any other start. So a start's plan is the one
that it would get by itself.
"""

from __future__ import annotations

import dataclasses
import os
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Int64

from maxjax.compile.lowering import target
from maxjax.compile.program import Program
from maxjax.compile.stage_timer import recording, time_stage
from maxjax.compile.threads import concurrently
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.connectivity import flood
from maxjax.planning.path.ascent import Ascent, ascend
from maxjax.planning.path.line_of_sight import Sight, sight_of
from maxjax.planning.path.route import Route, Routes, complete_path, equal_shares, trim_padding
from maxjax.planning.path.string_pulling import tighten
from maxjax.planning.plan import Plans
from maxjax.planning.planner import FieldClimber
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.exemptions import Radius, exemptions
from maxjax.planning.problem.problem import Problem, fault_of_ends, inner_places, locate_all, problem_in
from maxjax.planning.problem.surroundings import Surroundings, surroundings
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plans_of
from maxjax.planning.run.longer_ascents import with_longer_ascents
from maxjax.planning.run.stages import potential_field, status_of_climb

# Starts that climb at a time; fewer are filled up to the lesser number, so that fleets of all sizes share two programs.
# On an accelerator a climb takes its number of steps, however many climb. On a CPU paths are pulled taut one by one:
# together they would leave its cache.
_ON_CPU, _ON_ACCELERATOR = (8, 64), (64, 512)


class Places(NamedTuple):
    """Where starts and their goal are, as in `Problem`; a row a start."""

    inner: Float[Array | np.ndarray, "n 2 3"]
    exact: Float[Array | np.ndarray, "n 2 3"]
    exemptions: Float[Array | np.ndarray, "n 2"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SharedGoal:
    """The starts of a fleet, formulated.

    Attributes:
        around: what they share.
        blocked: voxels that paths keep out of whose starts open none.
        status: OK, or why there is nothing to plan; of starts that open voxels only what is wrong with the ends.
        opens: whether a start's own exemption opens voxels.
        places: of the ends, but for starts that open voxels.
        goal_index: voxel of the goal.
    """

    around: Surroundings
    blocked: Bool[Array, "nx ny nz"]
    status: Int32[Array, " n"]
    opens: Bool[Array, " n"]
    places: Places
    goal_index: Int32[Array, " 3"]


class Group(NamedTuple):
    """Starts that share a field.

    Attributes:
        members: of the fleet.
        blocked: voxels that their paths keep out of.
        places: of the ends of each.
    """

    members: Int64[np.ndarray, " m"]
    blocked: Bool[Array, "nx ny nz"]
    places: Places


def formulate_shared_goal(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "n 2 3"],
    distances: Distances,
    grid: Grid,
) -> SharedGoal:
    """`problem.formulate` for every start whose exemption opens no voxel; the goal is the same for all."""
    around = surroundings(occupied, ground, distances, grid)
    radius = Radius.of(distances.radius / grid.spacing)
    goals = exemptions(around, locate_all(ends[:1, 1], grid.shape), radius)
    starts = exemptions(around, locate_all(ends[:, 0], grid.shape), radius)
    goal = jax.tree.map(lambda x: x[0], goals)
    blocked = goal.open_in(around.inflated)
    inner, radii = inner_places(blocked, starts, distances, grid)
    last_inner, last_radius = inner_places(blocked, goals, distances, grid)

    def beside(rows: Array, last: Array) -> Array:
        """Of each start, and of the goal."""
        return jnp.stack([rows, jnp.broadcast_to(last, rows.shape)], axis=1)

    x, y, z = jnp.clip(starts.first, 0, np.array(grid.shape) - 1).T
    kept, met = (flood(free, goal.first)[x, y, z] for free in (~blocked, ~around.occupied))
    joined = jnp.where(
        met, jnp.where(kept & starts.leaves & goal.leaves, Status.OK, Status.NO_SAFE_PATH), Status.NO_VALID_PATH
    )
    opens = starts.leaves & (starts.level > 0)
    faults = jax.vmap(lambda pair: fault_of_ends(around.occupied, pair, grid))(ends)
    return SharedGoal(
        around=around,
        blocked=blocked,
        status=jnp.where((faults == Status.OK) & ~opens, joined, faults).astype(jnp.int32),
        opens=opens,
        places=Places(beside(inner, last_inner), beside(starts.place, goals.place), beside(radii, last_radius)),
        goal_index=goal.first,
    )


def _ascend_all(
    log_phi: Float[Array, "nx ny nz"],
    sight: Sight,
    blocked: Bool[Array, "nx ny nz"],
    ends: Float[Array, "n 2 3"],
    settings: Ascent,
) -> tuple[Float[Array, "n t 3"], Bool[Array, " n"]]:
    """Ascend one field from many starts: the paths, and which arrived."""
    free = ~blocked
    return jax.vmap(lambda pair: ascend(log_phi, sight, free, pair[0], pair[1], settings))(ends)


def _tighten_all(
    sight: Sight,
    price: Float[Array, "nx ny nz"] | None,
    paths: Float[Array, "n t 3"],
    ends: Float[Array, "n 2 3"],
) -> tuple[Float[Array, "n s 3"], Float[Array, " n"]]:
    """The paths pulled taut, between their exact ends, and what they cost."""
    return jax.vmap(lambda path, exact: complete_path(exact, price, tighten(sight, path, price)))(paths, ends)


_FORMULATE = Program("formulate", formulate_shared_goal, static=("distances", "grid"))
_OPEN = Program("formulate", problem_in, static=("distances", "grid"))
_SIGHT = Program("ascend", sight_of, static=("room",))
_ASCEND = Program("ascend", _ascend_all, static=("settings",))
_TIGHTEN = Program("tighten", _tighten_all)


def plan_to_goal(task: Task, planner: FieldClimber) -> Plans:
    """`execution.plan_task` for a task of one map and one goal, with as few solves as exemptions allow."""
    with recording() as recorder:
        ends = jnp.asarray(task.ends)
        maps = jnp.asarray(task.barred), jnp.asarray(task.kept_off)
        fleet = _FORMULATE(*maps, ends, distances=task.distances, grid=task.grid.local)
        if task.price is not None:
            fleet = dataclasses.replace(fleet, around=fleet.around._replace(price=jnp.asarray(task.price)))
        status, opens = np.array(fleet.status), np.asarray(fleet.opens)
        shared = np.flatnonzero((status == Status.OK) & ~opens)
        groups = [Group(shared, fleet.blocked, jax.tree.map(lambda x: np.asarray(x)[shared], fleet.places))]
        for k in np.flatnonzero((status == Status.OK) & opens).tolist():
            problem: Problem = _OPEN(fleet.around, ends[k], distances=task.distances, grid=task.grid.local)
            status[k] = int(problem.status)
            if status[k] == Status.OK:
                inner = np.stack([problem.start, problem.goal])
                rows = Places(*(np.asarray(x)[None] for x in (inner, problem.ends, problem.exemptions)))
                groups.append(Group(np.array([k]), problem.blocked, rows))
        routes = Routes(dataclasses.replace(Routes.blank(len(task)).route, status=status))
        for group in groups:
            if group.members.size:
                routes = routes.put(group.members, _routes(group, fleet, planner, task))
    routes = routes.add_seconds(np.arange(len(task)), equal_shares(recorder, len(task)))
    return plans_of(routes, task, planner.name)


def _routes(group: Group, fleet: SharedGoal, planner: FieldClimber, task: Task) -> Routes:
    """Routes of the starts of a group, by one field."""
    price, places, count = fleet.around.price, group.places, len(group.members)
    field = potential_field(group.blocked, price, fleet.goal_index, planner.potential)
    certified, geodesic = np.full(count, bool(field.certified)), np.full(count, bool(field.geodesic))
    if field.status != Status.OK:
        nothing = Routes.blank(count, int(field.status))
        return Routes(dataclasses.replace(nothing.route, certified=certified))
    sight = _SIGHT(group.blocked, room=task.distances.room)
    few, many = _ON_CPU if target() == "cpu" else _ON_ACCELERATOR

    def attempt(which: Int64[np.ndarray, " m"], settings: Ascent) -> Routes:
        size = few if len(which) <= few else many
        climbs = [(field.log_phi, sight, group.blocked, places.inner[some]) for some in _batches(which, size)]
        paths, arrived = _together(_ASCEND, climbs, len(which), settings=settings)
        rows = _batches(np.arange(len(which)), 1 if target() == "cpu" else size)
        pulls = [(sight, price, paths[some], places.exact[which[some]]) for some in rows]
        paths, costs = _together(_TIGHTEN, pulls, len(which))
        status = status_of_climb(np.int32(Status.OK), np.asarray(field.status), arrived, np)
        costs = (task.grid.spacing * costs).astype(np.float32)
        route = Route(paths, status, certified[which], places.exemptions[which], geodesic[which], costs)
        return Routes(trim_padding(route))

    return with_longer_ascents(attempt, count, planner.ascent)


def _batches(which: Int64[np.ndarray, " m"], size: int) -> list[Int64[np.ndarray, " size"]]:
    """Parts of one size, the last one filled up."""
    return [np.resize(which[k : k + size], size) for k in range(0, len(which), size)]


def _together(program: Program, calls: list[tuple[Any, ...]], count: int, **static: Any) -> tuple[np.ndarray, ...]:
    """The first `count` results of calls of a program, which run on all cores."""

    def result(call: tuple[Any, ...]) -> tuple[np.ndarray, ...]:
        return tuple(map(np.asarray, program.start(*call, **static)))

    # The first by itself: it may compile.
    results = [tuple(map(np.asarray, program(*calls[0], **static)))]
    with time_stage(program.name):
        results += concurrently(result, calls[1:], os.cpu_count() or 1)
    return tuple(np.concatenate(rows)[:count] for rows in zip(*results, strict=True))
