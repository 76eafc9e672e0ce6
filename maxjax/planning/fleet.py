"""Many starts, one goal, one map: starts that need no ball share one field.

    hard set, price and one flood from the goal → one solve for all that it joins → ascents in batches → string pulling
    → judge

A start that the hard set alone does not join is formulated by itself: the field of its problem does not depend on the
ball of any other start. Those that need no ball of their own, only one around the goal, share a field for each size of
that ball; one with a ball of its own has a field of its own. So a start's plan is the one that it would get by itself.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Int64, UInt

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.connectivity import flood
from maxjax.planning.ascent import Ascent, ascend
from maxjax.planning.distances import Distances
from maxjax.planning.ends import locate
from maxjax.planning.execution import plans_of, with_longer_ascents
from maxjax.planning.exemptions import Opened
from maxjax.planning.field_planner import FieldPlanner, potential_field
from maxjax.planning.line_of_sight import Sight, sight_of
from maxjax.planning.plan import Plans
from maxjax.planning.problem import Placement, Problem, Surroundings, faults_of, placement, problem_in, surroundings
from maxjax.planning.route import Route, Routes, whole
from maxjax.planning.string_pulling import tighten
from maxjax.planning.task import Task
from maxjax.programs.lowering import target
from maxjax.programs.program import Program
from maxjax.programs.stage_timer import recording, timed
from maxjax.programs.threads import concurrently

# Starts that climb at a time. Fewer of them are filled up to one of two sizes, so that fleets of all sizes share two
# programs. On a CPU paths are pulled taut one by one: together they would leave its cache.
_BATCH, _SMALL_BATCH = 64, 8


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Fleet:
    """The starts of a fleet, formulated.

    Attributes:
        around: what they share.
        status: OK, or what is wrong with a start or the goal by itself.
        joined: whether the hard set alone joins a start to the goal.
        place: of the ends, without balls.
        goal_index: voxel of the goal.
    """

    around: Surroundings
    status: Int32[Array, " n"]
    joined: Bool[Array, " n"]
    place: Placement
    goal_index: Int32[Array, " 3"]


@dataclasses.dataclass(frozen=True)
class Group:
    """Starts that share a field.

    Attributes:
        members: of the fleet.
        blocked: voxels that their paths keep out of.
        place: of the ends of each.
    """

    members: Int64[np.ndarray, " m"]
    blocked: Bool[Array, "nx ny nz"]
    place: Placement


def formulate_fleet(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "n 2 3"],
    distances: Distances,
    grid: Grid,
) -> Fleet:
    """`problem.formulate` for every start, as far as it goes without balls; the goal is the same for all."""
    around = surroundings(occupied, ground, distances, grid)
    goal = locate(ends[0, 1], grid.shape)
    x, y, z = jnp.clip(jax.vmap(lambda pair: locate(pair[0], grid.shape).index)(ends), 0, jnp.asarray(grid.shape) - 1).T
    way = Opened(around.hard, jnp.zeros(2, jnp.int32), jnp.array(True), jnp.int32(Status.OK))
    return Fleet(
        around=around,
        status=jax.vmap(lambda pair: faults_of(around.occupied, pair, grid).status)(ends),
        joined=flood(~around.hard, goal.index)[x, y, z],
        place=jax.vmap(lambda pair: placement(around, way, pair, distances, grid))(ends),
        goal_index=goal.index,
    )


def _ascents(
    log_phi: Float[Array, "nx ny nz"],
    codes: UInt[Array, "nx ny nz"],
    blocked: Bool[Array, "nx ny nz"],
    ends: Float[Array, "n 2 3"],
    settings: Ascent,
    room: float,
) -> tuple[Float[Array, "n t 3"], Bool[Array, " n"]]:
    """Ascend one field from many starts: the paths, and which arrived; `codes` are those of `Sight`."""
    free = ~blocked
    return jax.vmap(lambda pair: ascend(log_phi, Sight(codes, room), free, pair[0], pair[1], settings))(ends)


def _tightened(
    codes: UInt[Array, "nx ny nz"],
    price: Float[Array, "nx ny nz"] | None,
    paths: Float[Array, "n t 3"],
    ends: Float[Array, "n 2 3"],
    room: float,
) -> tuple[Float[Array, "n s 3"], Float[Array, " n"]]:
    """The paths pulled taut, between their exact ends, and what they cost."""
    return jax.vmap(lambda path, exact: whole(exact, price, tighten(Sight(codes, room), path, price)))(paths, ends)


def _codes(blocked: Bool[Array, "nx ny nz"], room: float) -> UInt[Array, "nx ny nz"]:
    return sight_of(blocked, room).codes


_FORMULATE = Program("formulate", formulate_fleet, static=("distances", "grid"))
_OPEN = Program("formulate", problem_in, static=("distances", "grid"))
_CODES = Program("ascend", _codes, static=("room",))
_ASCENTS = Program("ascend", _ascents, static=("settings", "room"))
_TIGHTENED = Program("tighten", _tightened, static=("room",))


def plan_fleet(task: Task, planner: FieldPlanner) -> Plans:
    """`execution.plan_task` for a task of one map and one goal, with as few solves as balls allow."""
    with recording() as recorder:
        ends = jnp.asarray(task.ends)
        maps = jnp.asarray(task.barred), jnp.asarray(task.kept_off)
        fleet = _FORMULATE(*maps, ends, distances=task.distances, grid=task.grid.local)
        if task.price is not None:
            fleet = dataclasses.replace(fleet, around=fleet.around._replace(price=jnp.asarray(task.price)))
        status, joined = np.array(fleet.status), np.asarray(fleet.joined)
        alone: dict[int, Problem] = {}
        for k in np.flatnonzero((status == Status.OK) & ~joined).tolist():
            alone[k] = _OPEN(fleet.around, ends[k], distances=task.distances, grid=task.grid.local)
            status[k] = int(alone[k].status)
        routes = Routes.blank(len(task))
        routes = Routes(dataclasses.replace(routes.route, status=status))
        for group in _groups(fleet, status, alone):
            routes = routes.put(group.members, _routes(group, fleet, planner, task))
    share = np.arange(len(task))
    spent = {name: np.full(len(task), s) for name, s in recorder.report(len(task)).items()}
    return plans_of(routes.spending(share, spent), task, planner.name)


def _groups(fleet: Fleet, status: Int32[np.ndarray, " n"], alone: dict[int, Problem]) -> Iterator[Group]:
    """Starts by the field that they climb."""
    members = np.flatnonzero((status == Status.OK) & np.asarray(fleet.joined))
    if members.size:
        yield Group(members, fleet.around.hard, jax.tree.map(lambda x: x[members], fleet.place))
    shared: dict[tuple[int, int], list[int]] = {}
    for k, problem in alone.items():
        own, goals = problem.levels.tolist()
        if status[k] == Status.OK:
            shared.setdefault((goals, -1 if own == 0 else k), []).append(k)
    for together in shared.values():
        places = [Placement(p.start, p.goal, p.ends, p.balls) for p in (alone[k] for k in together)]
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *places)
        yield Group(np.array(together), alone[together[0]].blocked, stacked)


def _routes(group: Group, fleet: Fleet, planner: FieldPlanner, task: Task) -> Routes:
    """Routes of the starts of a group, by one field."""
    price, room, count = fleet.around.price, task.distances.room, len(group.members)
    field = potential_field(group.blocked, price, fleet.goal_index, task.grid, planner.potential)
    certified, geodesic = np.full(count, bool(field.certified)), np.full(count, bool(field.geodesic))
    if field.status != Status.OK:
        nothing = Routes.blank(count, int(field.status))
        return Routes(dataclasses.replace(nothing.route, certified=certified))
    codes, place = _CODES(group.blocked, room=room), jax.tree.map(np.asarray, group.place)
    inner, at_a_time = np.stack([place.start, place.goal], axis=1), 1 if target() == "cpu" else _BATCH

    def attempt(which: Int64[np.ndarray, " m"], settings: Ascent) -> Routes:
        batches = _filled(which, _SMALL_BATCH if len(which) <= _SMALL_BATCH else _BATCH)
        climbs = [(field.log_phi, codes, group.blocked, inner[some]) for some in batches]
        paths, arrived = _together(_ASCENTS, climbs, len(which), settings=settings, room=room)
        rows = _filled(np.arange(len(which)), at_a_time)
        pulls = [(codes, price, paths[some], place.ends[which[some]]) for some in rows]
        paths, costs = _together(_TIGHTENED, pulls, len(which), room=room)
        status = np.where(arrived, Status.OK, Status.PATH_STALLED).astype(np.int32)
        costs = (task.grid.spacing * costs).astype(np.float32)
        return Routes(Route(paths, status, certified[which], place.balls[which], geodesic[which], costs))

    return with_longer_ascents(attempt, count, planner.ascent)


def _filled(which: Int64[np.ndarray, " m"], size: int) -> list[Int64[np.ndarray, " size"]]:
    """Parts of one size, the last one filled up."""
    return [np.resize(which[k : k + size], size) for k in range(0, len(which), size)]


def _together(program: Program, calls: list[tuple[Any, ...]], count: int, **static: Any) -> tuple[np.ndarray, ...]:
    """The first `count` results of calls of a program, which run on all cores."""

    def result(call: tuple[Any, ...]) -> tuple[np.ndarray, ...]:
        return tuple(map(np.asarray, program.start(*call, **static)))

    # The first by itself: it may compile.
    results = [tuple(map(np.asarray, program(*calls[0], **static)))]
    with timed(program.name):
        results += concurrently(result, calls[1:], os.cpu_count() or 1)
    return tuple(np.concatenate(rows)[:count] for rows in zip(*results, strict=True))
