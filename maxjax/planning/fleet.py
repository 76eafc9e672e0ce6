"""Many starts, one goal, one map: one field for each margin that some start needs.

    judge every start (one flood fill a margin, from the goal) → one solve a margin → ascents in squadrons → verify

A start's plan is the one that it would get by itself: its margin is its own, and fields do not depend on the start.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.connectivity import flood
from maxjax.fields.occupancy import blocked_within, reach_of, rungs, squared_distance
from maxjax.planning.ascent import Ascent, ascend
from maxjax.planning.planner import NO_PATH, Plan, PotentialFn, Route, Stage, Stopwatch, judge, potential_field
from maxjax.planning.problem import Problem, locate, placed, verdict
from maxjax.planning.sight import span_codes, stands_free
from maxjax.planning.string_pulling import tighten

# Starts that climb at a time: what bounds memory, whatever the size of the fleet. A smaller squadron is filled up to
# one of two sizes, so that fleets of all sizes share two programs.
_SQUADRON, _FLIGHT = 64, 8


def _muster(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    starts: Float[Array, "n 3"],
    goal: Float[Array, " 3"],
    margin: float,
    grid: Grid,
) -> tuple[Int32[Array, " n"], Int32[Array, " n"], Int32[Array, " 3"], tuple[Array, Array]]:
    """Judge every start as `pose` would, with one flood fill per margin, from the goal, for all of them.

    Returns:
        The status of each start, which of `rungs(margin, grid)` it flies with, the voxel of the goal, and
        `squared_distance` of the obstacles and of the ground.
    """
    ladder = jnp.asarray(rungs(margin, grid), jnp.float32)
    squared, below = squared_distance(occupied & ~ground, reach_of(margin, grid)), squared_distance(ground, 1)
    a, b = jax.vmap(lambda x: locate(x, grid))(starts), locate(goal, grid)
    finite = a.finite & b.finite
    x, y, z = jnp.clip(a.index, 0, jnp.asarray(grid.shape) - 1).T
    nowhere, nobody = jnp.zeros(grid.shape, bool), jnp.zeros(len(starts), bool)

    def stand(blocked: Bool[Array, "nx ny nz"]) -> tuple[Bool[Array, " n"], Bool[Array, " n"]]:
        return jax.vmap(lambda start: stands_free(blocked, start))(a.off), nobody | stands_free(blocked, b.off)

    (inside_a, inside_b), (out_a, out_b) = stand(nowhere), stand(occupied)
    sound = finite & inside_a & inside_b & out_a & out_b

    def lower(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        rung, chosen, joined = state
        blocked = blocked_within(squared, ground, below, ladder[rung], grid)
        now_a, now_b = stand(blocked)
        now = flood(~blocked, b.index)[x, y, z] & now_a & now_b
        return rung + 1, jnp.where(now & ~joined, rung, chosen), joined | now

    last = len(ladder) - 1
    _, rung, joined = lax.while_loop(
        lambda state: (state[0] <= last) & jnp.any(sound & ~state[2]),
        lower,
        (jnp.int32(0), jnp.full(len(starts), last, jnp.int32), nobody),
    )
    same = jnp.all(starts == goal, axis=1)
    status = verdict(~finite, ~inside_a, ~inside_b, same, ~out_a, ~out_b, ~joined)
    return status, rung, b.index, (squared, below)


def _share(
    distances: tuple[Integer[Array, "nx ny nz"], Integer[Array, "nx ny nz"]],
    ground: Bool[Array, "nx ny nz"],
    margin: Float[Array, ""],
    goal_index: Int32[Array, " 3"],
    grid: Grid,
) -> Problem:
    """The problem that all starts of one margin share; its own start is no one's, and stands on the goal."""
    at = goal_index.astype(jnp.float32)
    blocked = blocked_within(distances[0], ground, distances[1], margin, grid)
    return Problem(blocked, margin, at, at, goal_index, jnp.int32(Status.OK))


def _swarm(
    phi: Float[Array, "nx ny nz"],
    blocked: Bool[Array, "nx ny nz"],
    starts: Float[Array, "n 3"],
    goal: Float[Array, " 3"],
    grid: Grid,
    settings: Ascent,
) -> tuple[Float[Array, "n t 3"], Bool[Array, " n"]]:
    """Ascend one field from many starts [m] and tighten; returns the paths, and which arrived."""
    bits = span_codes(blocked)

    def end(point: Float[Array, " 3"]) -> Float[Array, " 3"]:
        return placed(blocked, grid.fractional_index(point))

    def one(start: Float[Array, " 3"]) -> tuple[Array, Array]:
        path, arrived = ascend(phi, bits, ~blocked, end(start), end(goal), settings)
        return tighten(bits, path), arrived

    return jax.vmap(one)(starts)


_MUSTER = Stage("muster", _muster, static=("margin", "grid"))
_SHARE = Stage("dilate", _share, static=("grid",))
_SWARM = Stage("ascend", _swarm, static=("grid", "settings"))


def plan_swarm(
    potential: PotentialFn,
    occupied: Bool[np.ndarray, "nx ny nz"],
    starts: Float[np.ndarray, "n 3"],
    goal: Float[np.ndarray, " 3"],
    grid: Grid,
    *,
    margin: float,
    ground: Bool[np.ndarray, "nx ny nz"],
    method: str,
    settings: Ascent = Ascent(),  # noqa: B008 (frozen)
) -> list[Plan]:
    """`plan_path` with a field for many starts of one goal: one solve per margin that is used.

    The starts of one margin climb its field in squadrons; those that need more steps than the others go again, by
    themselves, as in `field_path`.
    """
    watch = Stopwatch()
    filled, below, ends, target = map(jnp.asarray, (occupied, ground, starts, goal))
    status, rung, goal_index, distances = _MUSTER(watch, filled, below, ends, target, margin=margin, grid=grid)
    ladder = rungs(margin, grid)
    rung, statuses = np.asarray(rung), np.array(status)
    feasible = statuses == Status.OK
    paths, certified = [NO_PATH] * len(starts), np.zeros(len(starts), bool)
    problems: dict[int, Problem] = {}
    for level in np.unique(rung).tolist():
        shared = problems[level] = _SHARE(watch, distances, below, jnp.float32(ladder[level]), goal_index, grid=grid)
        members = np.flatnonzero(feasible & (rung == level))
        if members.size == 0:
            continue
        field = potential_field(shared.blocked, goal_index, grid, potential, watch)
        certified[members] = bool(field.certified)
        statuses[members] = int(field.status)
        if int(field.status) != Status.OK:
            continue
        for factor in (1, 4, 16):
            longer = dataclasses.replace(settings, steps=settings.steps * factor)
            statuses[members] = Status.PATH_STALLED
            for squadron in np.array_split(members, range(_SQUADRON, len(members), _SQUADRON)):
                crew = ends[np.resize(squadron, _FLIGHT if len(squadron) <= _FLIGHT else _SQUADRON)]
                found, arrived = _SWARM(watch, field.phi, shared.blocked, crew, target, grid=grid, settings=longer)
                for k, path, there in zip(squadron, np.asarray(found), np.asarray(arrived), strict=False):
                    if there:
                        paths[k], statuses[k] = path, Status.OK
            members = members[statuses[members] == Status.PATH_STALLED]
            if members.size == 0:
                break
    routes = [
        Route(path, Status(status), sure)
        for path, status, sure in zip(paths, statuses.tolist(), certified.tolist(), strict=True)
    ]
    levels = sorted(problems)
    maps = (
        [float(problems[level].margin) for level in levels],
        np.stack([np.asarray(problems[level].blocked) for level in levels]),
        np.broadcast_to(occupied, (len(levels), *grid.shape)),
    )
    bare = np.broadcast_to(ground, (len(levels), *grid.shape))
    goals = np.broadcast_to(goal, starts.shape)
    return judge(routes, starts, goals, np.searchsorted(levels, rung), *maps, grid, watch, method, bare)
