"""The protocol of planners: a value with a name that finds a route through a problem.

    Planner.route = (Problem) -> Route

A planner is `batched` if `route` is a pure function of arrays, so that it runs under `jit` and `vmap` and inside
compiled flights. Any other is called on the host, one problem at a time; in flight by a callback. Ten lines make one:

    @dataclasses.dataclass(frozen=True)
    class Straight:
        name = "straight"
        batched = True

        def route(self, problem):
            path = jnp.stack([problem.start, problem.goal])
            return Route(path, problem.status, certified=jnp.array(False))

Whatever it returns is a claim: a path is handed out only if the verifier passes it, and flown only if it is clear.

A planner that climbs a field can do more. It says so by the members of `FieldClimber`: its stages then run one by one,
in windows of the map, with longer ascents where one stalls, and with one field for many starts.
"""

from __future__ import annotations

import functools
from collections.abc import Hashable
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32, Num

from maxjax.core.status import Status
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.line_of_sight import clear, sight_of
from maxjax.planning.path.route import Route, RouteFn, no_route
from maxjax.planning.problem.problem import Problem
from maxjax.planning.run.stages import PotentialFn

# Paths of all planners have one length in flight, so that a flight's arrays do.
POINTS = Ascent().steps + 1


@runtime_checkable
class Planner(Hashable, Protocol):
    """A way to find routes; hashable, and equal to any that finds the same (a frozen dataclass is)."""

    @property
    def name(self) -> str:
        """As tables and files show it."""
        ...

    @property
    def batched(self) -> bool:
        """Whether `route` is a pure function of arrays, for `jit` and `vmap`."""
        ...

    def route(self, problem: Problem) -> Route:
        """A route from start to goal of a problem; its status says why there is none.

        Args:
            problem: in index coordinates, arrays of JAX; one whose status is not OK has no route.
        """
        ...


@runtime_checkable
class FieldClimber(Planner, Protocol):
    """A planner whose route is a climb of a field, by the stages of `planning.run.stages`."""

    @property
    def potential(self) -> PotentialFn:
        """Makes the field."""
        ...

    @property
    def ascent(self) -> Ascent:
        """Settings of the ascent; paths have a point more than it has steps."""
        ...

    @property
    def focus(self) -> bool:
        """Whether plans are made in windows of the map, where these prove the same."""
        ...

    def with_ascent(self, ascent: Ascent) -> FieldClimber:
        """The same planner with another ascent."""
        ...


def field_climber(planner: Planner) -> FieldClimber | None:
    """The planner as one that climbs a field; None if it does not."""
    return planner if isinstance(planner, FieldClimber) else None


def plans_in_windows(planner: Planner) -> bool:
    """Whether a planner may be shown windows of a map in place of the map."""
    climber = field_climber(planner)
    return climber is not None and climber.focus


def check_planner(given: object) -> Planner:
    """The planner itself.

    Raises:
        ValueError: if it is none.
    """
    if isinstance(given, type) or not isinstance(given, Planner):
        raise ValueError(
            "planner: expected a planner, as maxjax.Field(), maxjax.AStar() or a value with name, batched and route, "
            f"given {given!r}"
        )
    return given


def check_climber(given: object) -> FieldClimber:
    """The planner itself.

    Raises:
        ValueError: if it climbs no field.
    """
    if isinstance(given, type) or not isinstance(given, FieldClimber):
        raise ValueError(f"planner: expected one that climbs a field, as maxjax.Field(), given {given!r}")
    return given


@functools.cache
def pure_route(planner: Planner) -> RouteFn:
    """How a planner finds routes inside a compiled flight: by itself if it is batched, else by a callback.

    Of a path from the host, points inside straight runs are left out, which changes no point of the line, and the last
    point is repeated until the array has the length of an ascent. Its first point after the start may lie behind the
    vehicle, as the centre of the voxel that it is in, and the vehicle would have to brake and turn back for it at every
    plan. So from the exact start the path leads to the end of the first straight run where that is clear, else to the
    run's second point where that is, and else to its first.
    """
    return planner.route if planner.batched else functools.partial(_route_on_host, planner)


def _route_on_host(planner: Planner, problem: Problem) -> Route:
    """A route of `POINTS` points by a callback; PATH_STALLED where the path has more corners than the array holds."""
    shapes = (jax.ShapeDtypeStruct((POINTS, 3), jnp.float32), jax.ShapeDtypeStruct((), jnp.int32))
    corners = functools.partial(_corners_on_host, planner)
    path, status = jax.pure_callback(corners, shapes, problem, vmap_method="sequential")
    sight = sight_of(problem.blocked, problem.room)
    to_end, to_second = clear(sight, path[0], path[3]), clear(sight, path[0], path[2])
    first = jnp.where(to_end | to_second, path[0], path[1])
    second = jnp.where(to_end, path[0], path[2])
    return Route(path.at[1].set(first).at[2].set(second), status, jnp.array(False))


def _corners_on_host(planner: Planner, problem: Problem) -> tuple[Float[np.ndarray, "n 3"], Int32[np.ndarray, ""]]:
    """Corners of a path, filled up to `POINTS`; nothing is searched for a problem whose status is not OK."""
    route = planner.route(problem) if problem.status == Status.OK else no_route(problem.status)
    whole = np.asarray(route.path, np.float32)
    between = whole[1:-1] if len(whole) > 2 else whole[:1]
    corners = corners_of(between)
    if route.status == Status.OK and len(corners) + 3 > POINTS:
        route = no_route(Status.PATH_STALLED)
    if route.status != Status.OK:
        return np.broadcast_to(np.asarray(problem.start, np.float32), (POINTS, 3)), np.asarray(route.status, np.int32)
    second = between[min(1, len(between) - 1)]
    path = np.concatenate([whole[:1], between[:1], second[None], corners[1:], whole[-1:]])
    return np.pad(path, ((0, POINTS - len(path)), (0, 0)), mode="edge"), np.asarray(Status.OK, np.int32)


def corners_of(path: Num[np.ndarray, "t 3"]) -> Num[np.ndarray, "c 3"]:
    """The points of a path at which it turns, its ends included."""
    step = np.diff(path, axis=0)
    turns = np.any(step[1:] != step[:-1], axis=1)
    return path[np.concatenate([[True], turns, [True]])] if len(path) > 2 else path
