"""One problem from a map to a route, as a pure function: for `jit`, `vmap` and flights.

    (map, start, goal) → formulate → planner.route → completed → Route [m]

    routes = jax.vmap(maxjax.plan_route, (None, 0, 0))(map, starts, goals)

A route is certified, not verified: only `maxjax.plan` and its like hand out paths that the verifier has passed.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap, check_map
from maxjax.planning.path.route import Route, complete_route
from maxjax.planning.planner import Planner, check_planner, pure_route
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate


def find_route(
    where: VoxelMap, ends: Float[Array, "2 3"], distances: Distances, planner: Planner
) -> tuple[Problem, Route]:
    """The problem of two ends in a map, and its route between the exact ends; both in index coordinates.

    Args:
        where: one map.
        ends: start and goal, index coordinates.
        distances: to keep. Static.
        planner: how. Static.
    """
    law, price = distances.split(where.grid)
    occupied, ground = jnp.asarray(where.barred), jnp.asarray(where.kept_off)
    problem = formulate(occupied, ground, ends, law, where.grid)
    if price is not None:
        problem = dataclasses.replace(problem, price=jnp.asarray(price))
    return problem, complete_route(problem, pure_route(planner)(problem))


def plan_route(
    where: VoxelMap, start: Float[Any, " 3"], goal: Float[Any, " 3"], planner: Planner, distances: Distances
) -> Route:
    """A route through a map, its path in metres; arguments and errors as those of `maxjax.plan_route`."""
    single = check_map(where)
    if single.batch is not None:
        raise ValueError(f"map: expected one map, given a batch of {single.batch}; use jax.vmap")
    kept, finder = distances.within(single.grid), check_planner(planner)
    ends = jnp.stack([_index("start", start, single.grid), _index("goal", goal, single.grid)])
    ends = _without_derivative(ends)
    local = VoxelMap(single.occupied, single.ground, single.closed, single.grid.local)
    _, route = find_route(local, ends, kept, finder)
    return dataclasses.replace(
        route, path=single.grid.to_world(jnp.asarray(route.path)), geodesic=jnp.asarray(route.geodesic)
    )


@jax.custom_jvp
def _without_derivative(ends: Float[Array, "2 3"]) -> Float[Array, "2 3"]:
    """The ends themselves; a TypeError where a derivative by them is asked for."""
    return ends


@_without_derivative.defjvp
def _refuse_derivative(primals: Any, tangents: Any) -> Any:
    raise TypeError(
        "plan_route has no derivative: a path jumps from one side of a building to the other. Differentiate the cost "
        "of the way instead: -screening_length * maxjax.solve_potential(sigma, goal_index, price).log_phi at the start"
    )


def _index(name: str, given: Any, grid: Grid) -> Float[Array, " 3"]:
    """Index coordinates of a position [m]: in float64 on the host, unless it is traced."""
    if jnp.shape(given) != (3,):
        raise ValueError(f"{name}: expected shape (3,) [m], given {jnp.shape(given)}; use jax.vmap for batches")
    if isinstance(given, jax.core.Tracer):
        return grid.fractional_index(given.astype(jnp.float32))
    index = (np.asarray(given, np.float64) - np.array(grid.origin)) / grid.spacing
    return jnp.asarray(index, jnp.float32)
