"""Routes: the result of every planner.

    RouteFn = (Problem) -> Route        complete_route = (Problem, Route) -> Route

A route is a claim: only the verifier makes a `Plan` of it. It leads from start to goal of its problem;
`complete_route` adds the ways to the exact ends, and what all of it costs. The grid says nothing but shape and spacing;
its origin lies at zero wherever the map is, so that a planner is compiled once for all places.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int32, Int64

from maxjax.compile.stage_timer import Recorder
from maxjax.core.status import Status
from maxjax.planning.path.line_of_sight import segment_costs
from maxjax.planning.problem.problem import Problem


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Route:
    """A path, or why there is none; on a device or, with NumPy's arrays, on the host. Batch axes lead.

    Attributes:
        path: index coordinates, start first, goal last, which may be repeated to the end of the array.
        status: `Status` as int32; unless it is OK, the path means nothing.
        certified: whether the field that was climbed had no local maximum but the goal.
        exemptions: radii [m] of the exemptions around start and goal; 0 where none is needed.
        geodesic: whether the potential was the flood's own distance.
        cost: the price paid, ∫ n ds [m]; 0: nothing was priced.
    """

    path: Float[Array | np.ndarray, "*batch t 3"]
    status: Int32[Array | np.ndarray, "*batch"]
    certified: Bool[Array | np.ndarray, "*batch"]
    exemptions: Float[Array | np.ndarray, "*batch 2"] = dataclasses.field(
        default_factory=lambda: np.zeros(2, np.float32)
    )
    geodesic: Bool[Array | np.ndarray, "*batch"] = dataclasses.field(default_factory=lambda: np.zeros((), bool))
    cost: Float[Array | np.ndarray, "*batch"] = dataclasses.field(default_factory=lambda: np.zeros((), np.float32))


RouteFn = Callable[[Problem], Route]

NO_PATH = np.zeros((0, 3), np.float32)


def route_of(path: Float[np.ndarray, "t 3"], certified: bool, geodesic: bool = False) -> Route:
    """A route on the host, to be completed."""
    status = np.asarray(Status.OK, np.int32)
    return Route(path.astype(np.float32), status, np.asarray(certified), geodesic=np.asarray(geodesic))


def no_route(status: int | Array | np.ndarray, certified: bool = False) -> Route:
    """A route without a path, on the host."""
    return Route(NO_PATH, np.asarray(status, np.int32), np.asarray(certified))


def complete_route(problem: Problem, route: Route) -> Route:
    """A route from exact start to exact goal, with its cost and the problem's exemptions; `jit`- and `vmap`-safe."""
    path, cost = complete_path(problem.ends, problem.price, jnp.asarray(route.path))
    return dataclasses.replace(route, path=path, exemptions=problem.exemptions, cost=problem.spacing * cost)


def complete_path(
    ends: Float[Array, "2 3"], price: Float[Array, "nx ny nz"] | None, path: Float[Array, "t 3"]
) -> tuple[Float[Array, "s 3"], Float[Array, ""]]:
    """A path between its exact ends, and what it costs: ∫ n ds [voxels], 0 without a price."""
    path = jnp.concatenate([ends[:1], path, ends[1:]])
    return path, jnp.zeros(()) if price is None else jnp.sum(segment_costs(price, path[:-1], path[1:]))


def trim_padding(route: Route) -> Route:
    """Routes of a batch on the host, whose paths repeat a point no more than about as often as others need points.

    A device's paths have the room of the longest that might be: a few points among hundreds, and the exact goal.
    """
    path, ok = np.asarray(route.path), np.asarray(route.status) == Status.OK
    seen, count = path if ok.all() else path[ok], path.shape[1] - 1
    while count > 2 and (seen[:, count // 2 : count] == seen[:, -2:-1]).all():
        count = count // 2 + 1
    return (
        dataclasses.replace(route, path=np.concatenate([path[:, :count], path[:, -1:]], axis=1)) if count > 0 else route
    )


def equal_shares(recorder: Recorder, count: int) -> dict[str, Float64[np.ndarray, " b"]]:
    """Seconds by stage of problems that were planned together: an equal share of what was recorded for each."""
    return {name: np.full(count, seconds) for name, seconds in recorder.report(count).items()}


@dataclasses.dataclass(frozen=True, eq=False)
class Routes:
    """Routes of several problems on the host, and the seconds that each took.

    Attributes:
        route: with one leading axis; paths are filled up with their last points.
        timings: by stage; NaN where a problem had none of that stage.
        ratio: of routes that were guided, their cost over the guide's (`corridor`); NaN of those that were not.
    """

    route: Route
    timings: Mapping[str, Float64[np.ndarray, " b"]] = dataclasses.field(default_factory=dict)
    ratio: Float64[np.ndarray, " b"] = dataclasses.field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if len(self.ratio) != len(self.route.status):
            object.__setattr__(self, "ratio", np.full(len(self.route.status), np.nan))

    @classmethod
    def blank(cls, count: int, status: int = Status.NO_VALID_PATH) -> Routes:
        """No routes, all with one status."""
        none = np.zeros(count, bool)
        return cls(
            Route(
                np.zeros((count, 0, 3)),
                np.full(count, int(status), np.int32),
                none,
                np.zeros((count, 2), np.float32),
                none,
                np.zeros(count, np.float32),
            )
        )

    @classmethod
    def of(cls, routes: Sequence[Route], timings: Sequence[Mapping[str, float]] = ()) -> Routes:
        """Those of single routes, at least one, and what each took."""
        longest = max(len(route.path) for route in routes)
        alike = [_fill_up(jax.tree.map(lambda x: np.asarray(x)[None], route), longest) for route in routes]
        stages = dict.fromkeys(name for spent in timings for name in spent)
        seconds = {name: np.array([spent.get(name, np.nan) for spent in timings]) for name in stages}
        return cls(jax.tree.map(lambda *rows: np.concatenate(rows), *alike), seconds)

    def __len__(self) -> int:
        return len(self.route.status)

    @property
    def ok(self) -> Bool[np.ndarray, " b"]:
        """Which of them have a path."""
        return np.asarray(self.route.status == Status.OK)

    def one(self, k: int) -> Route:
        """One of them."""
        return jax.tree.map(lambda x: x[k, ...], self.route)  # type: ignore[no-any-return]

    def some(self, rows: Bool[np.ndarray, " b"]) -> Routes:
        """Those that are chosen."""
        timings = {name: seconds[rows] for name, seconds in self.timings.items()}
        return Routes(jax.tree.map(lambda x: x[rows], self.route), timings, self.ratio[rows])

    def put(self, rows: Int64[np.ndarray, " r"], others: Routes) -> Routes:
        """Others in place of some of these; the seconds add up."""

        def merge(old: np.ndarray, new: np.ndarray) -> np.ndarray:
            both = np.array(old)
            both[rows] = new
            return both

        count = max(self.route.path.shape[1], others.route.path.shape[1])
        route = jax.tree.map(merge, _fill_up(self.route, count), _fill_up(others.route, count))
        return Routes(route, self.add_seconds(rows, others.timings).timings, merge(self.ratio, others.ratio))

    def add_seconds(self, rows: Int64[np.ndarray, " r"], seconds: Mapping[str, Float64[np.ndarray, " r"]]) -> Routes:
        """The same routes, with seconds added to those of some."""
        timings = {name: np.array(values) for name, values in self.timings.items()}
        for name, values in seconds.items():
            own = timings.setdefault(name, np.full(len(self), np.nan))
            before = own[rows]
            own[rows] = np.where(np.isnan(before), values, before + np.where(np.isnan(values), 0.0, values))
        return Routes(self.route, timings, self.ratio)


def _fill_up(route: Route, count: int) -> Route:
    """Routes whose paths have so many points, in float64, their last ones repeated; zeros where there is no point."""
    given = route.path.shape[1]
    path = np.zeros((len(route.path), count, 3))
    path[:, :given] = route.path
    if given:
        path[:, given:] = route.path[:, -1:]
    return dataclasses.replace(route, path=path)
