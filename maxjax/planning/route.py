"""What every path finder takes and returns.

    PathFinder = (Problem, Grid) -> Route        completed = (Problem, Route, Grid) -> Route

A route is a claim: only the judge makes a `Plan` of it. It leads from start to goal of its problem; `completed` adds
the ways to the exact ends, and what all of it costs. The grid says nothing but shape and spacing; its origin lies at
zero wherever the map is, so that a path finder is compiled once for all places.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.line_of_sight import paid
from maxjax.planning.problem import Problem


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Route:
    """A path, or why there is none; on a device or, with NumPy's arrays, on the host. Batch axes lead.

    Attributes:
        path: index coordinates, start first, goal last, which may be repeated to the end of the array.
        status: `Status` as int32; unless it is OK, the path means nothing.
        certified: whether the field that was climbed had no local maximum but the goal.
        balls: radii [m] of the exemptions around start and goal; 0 where none is needed.
        geodesic: whether the potential was the flood's own distance.
        cost: the price paid, ∫ n ds [m]; 0: nothing was priced.
    """

    path: Float[Array | np.ndarray, "*batch t 3"]
    status: Int32[Array | np.ndarray, "*batch"]
    certified: Bool[Array | np.ndarray, "*batch"]
    balls: Float[Array | np.ndarray, "*batch 2"] = dataclasses.field(default_factory=lambda: np.zeros(2, np.float32))
    geodesic: Bool[Array | np.ndarray, "*batch"] = dataclasses.field(default_factory=lambda: np.zeros((), bool))
    cost: Float[Array | np.ndarray, "*batch"] = dataclasses.field(default_factory=lambda: np.zeros((), np.float32))


PathFinder = Callable[[Problem, Grid], Route]

NO_PATH = np.zeros((0, 3), np.float32)


def found(path: Float[np.ndarray, "t 3"], certified: bool, geodesic: bool = False) -> Route:
    """A route on the host, to be completed."""
    status = np.asarray(Status.OK, np.int32)
    return Route(path.astype(np.float32), status, np.asarray(certified), geodesic=np.asarray(geodesic))


def failed(status: int | Array | np.ndarray, certified: bool = False) -> Route:
    """A route without a path, on the host."""
    return Route(NO_PATH, np.asarray(status, np.int32), np.asarray(certified))


def completed(problem: Problem, route: Route, grid: Grid) -> Route:
    """A route from exact start to exact goal, with its cost and the problem's exemptions; `jit`- and `vmap`-safe."""
    path, cost = whole(problem.ends, problem.price, jnp.asarray(route.path))
    return dataclasses.replace(route, path=path, balls=problem.balls, cost=grid.spacing * cost)


def whole(
    ends: Float[Array, "2 3"], price: Float[Array, "nx ny nz"] | None, path: Float[Array, "t 3"]
) -> tuple[Float[Array, "s 3"], Float[Array, ""]]:
    """A path between its exact ends, and what it costs: ∫ n ds [voxels], 0 without a price."""
    path = jnp.concatenate([ends[:1], path, ends[1:]])
    return path, jnp.zeros(()) if price is None else jnp.sum(paid(price, path[:-1], path[1:]))
