"""What every path finder takes and returns.

    PathFinder = (Problem, Grid) -> Route

A route is a claim: only the judge makes a `Plan` of it. The grid says nothing but shape and spacing; its origin lies at
zero wherever the map is, so that a path finder is compiled once for all places.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.problem import Problem


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Route:
    """A path, or why there is none; on a device or, with NumPy's arrays, on the host. Batch axes lead.

    Attributes:
        path: index coordinates, start first, goal last, which may be repeated to the end of the array.
        status: `Status` as int32; unless it is OK, the path means nothing.
        certified: whether the field that was climbed had no local maximum but the goal.
        balls: radii [m] of the balls around start and goal that were opened; 0 where none was needed.
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


def found(
    path: Float[np.ndarray, "t 3"],
    certified: bool,
    *,
    balls: tuple[float, float] = (0.0, 0.0),
    geodesic: bool = False,
    cost: float = 0.0,
) -> Route:
    """A route on the host."""
    status, numbers = np.asarray(Status.OK, np.int32), (np.asarray(balls, np.float32), np.asarray(geodesic))
    return Route(path.astype(np.float32), status, np.asarray(certified), *numbers, np.asarray(cost, np.float32))


def failed(status: int | Array | np.ndarray, certified: bool = False) -> Route:
    """A route without a path, on the host."""
    return Route(NO_PATH, np.asarray(status, np.int32), np.asarray(certified))
