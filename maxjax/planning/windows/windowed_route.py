"""A route by the smallest window of a map that proves it, as a pure function: for flights.

    cost → window around both ends → route of cost C ≤ bound: the cheapest of the whole map   (`windows.focus_window`)
                                                   C > bound, or none: a larger window, at last the whole map

Under `vmap` each size of window is solved for those members alone that ask for it, a part of the batch at a time.
A route is checked where it is found: every edge of it, as it lies in the world, is clear with the room that it keeps.

Positions are index coordinates of the map (whole numbers at voxel centres), costs and bounds [voxels].
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, Shaped

from maxjax.compile.batching import settle
from maxjax.compile.lowering import materialise
from maxjax.core.grid import Grid, Index3
from maxjax.core.status import Status
from maxjax.planning.path.line_of_sight import clear, sight_of
from maxjax.planning.path.route import Route, complete_route
from maxjax.planning.planner import Planner, field_climber, plans_in_windows, pure_route
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate
from maxjax.planning.problem.surroundings import halo_of
from maxjax.planning.windows.geometry import (
    centre,
    costs_over_faces,
    ellipsoid_box,
    ends_inside,
    guess_costs,
    is_proved,
    next_costs,
    path_costs,
    worthwhile,
)

# Windows that are tried before the whole map [voxels], and how many members of a batch are solved at once: nearly all
# ask for the first, few for the next, hardly any for the whole map.
_SIZES: tuple[Index3, ...] = ((48, 48, 24), (64, 64, 32))
_AT_ONCE = 512, 64, 8
# Voxels of whole maps that are solved at once where all members ask for theirs.
_VOXELS = 2**26
# Of a route that is proved: no number of a size.
_PROVED = 1000
# Voxels around the start that every window holds, so that `WindowedRoute.near` is known.
NEAR = 6


class MapAndEnds(NamedTuple):
    """A map and two ends in it, between which a route is sought.

    Attributes:
        occupied: occupied voxels, ground included.
        ground: voxels of the ground.
        ends: start and goal.
        origin: where the centre of voxel (0, 0, 0) lies in the world [m]; a path is flown by its places there.
        solid: layers that are all occupied, as those below the ground.
        price: what a metre costs in each voxel, where that is not by the distance; else None.
    """

    occupied: Bool[Array, "nx ny nz"]
    ground: Bool[Array, "nx ny nz"]
    ends: Float[Array, "2 3"]
    origin: Float[Array, " 3"]
    solid: Bool[Array, " nz"]
    price: Float[Array, "nx ny nz"] | None

    @classmethod
    def of(
        cls,
        volumes: tuple[Bool[Array, "nx ny nz"], Bool[Array, "nx ny nz"]],
        ends: Float[Array, "2 3"],
        origin: Float[Array, " 3"],
        price: Float[Array, "nx ny nz"] | None = None,
    ) -> MapAndEnds:
        """That of a map: `occupied` and `ground`."""
        return cls(*volumes, ends, origin, jnp.all(volumes[0], axis=(0, 1)), price)


class WindowedRoute(NamedTuple):
    """A route, and how far it is sought.

    Attributes:
        route: the one found so far.
        near: blocked voxels around the start, `NEAR` to each side; beyond the map all are.
        cost: what the cheapest way is taken to cost.
        least: the smallest size of a window that may still show more, by its number; beyond all of them: none does.
    """

    route: Route
    near: Bool[Array, "k k k"]
    cost: Float[Array, ""]
    least: Int32[Array, ""]


def cut_box(
    volume: Shaped[Array, "nx ny nz"], corner: Int32[Array, " 3"], shape: Index3, beyond: float | int = False
) -> Shaped[Array, "bx by bz"]:
    """Values of a volume in a box of this shape (static) from a lowest voxel on, and `beyond` outside the volume."""
    at = [corner[axis] + jnp.arange(n, dtype=jnp.int32) for axis, n in enumerate(shape)]
    inside = [(x >= 0) & (x < n) for x, n in zip(at, volume.shape, strict=True)]
    x, y, z = (jnp.clip(x, 0, n - 1) for x, n in zip(at, volume.shape, strict=True))
    shown = volume[x[:, None, None], y[None, :, None], z[None, None, :]]
    within = inside[0][:, None, None] & inside[1][None, :, None] & inside[2][None, None, :]
    return jnp.where(within, shown, jnp.asarray(beyond, volume.dtype))


def corner_around(place: Float[Array, " 3"], half: int) -> Int32[Array, " 3"]:
    """The lowest voxel of the box that reaches so far around the voxel of a place."""
    return jnp.floor(place + 0.5).astype(jnp.int32) - half


def route_in_windows(
    asked: MapAndEnds, wanted: Bool[Array, ""], distances: Distances, grid: Grid, planner: Planner
) -> WindowedRoute:
    """The route of two ends in a map, in index coordinates of the map.

    Args:
        asked: map and ends.
        wanted: whether there is anything to do; a route that nobody wants costs nothing in a batch, and means nothing.
        distances: to keep, without a price of its own for each voxel. Static.
        grid: of the map, its origin at zero. Static.
        planner: how. Static; without `focus` only the whole map is solved.
    """
    sizes = [size for size in _SIZES if plans_in_windows(planner) and worthwhile(size, grid.shape)]
    finders = [_Finder(distances, grid, planner, k, size) for k, size in enumerate((*sizes, None))]
    zero, no = jnp.zeros((), jnp.float32), jnp.array(False)
    path = jnp.zeros((_points(planner, finders[-1], asked), 3), jnp.float32)
    sought = WindowedRoute(
        Route(path, jnp.int32(Status.NO_VALID_PATH), no, jnp.zeros(2, jnp.float32), no, zero),
        jnp.ones((2 * NEAR + 1,) * 3, bool),
        guess_costs(asked.ends, jnp),
        jnp.where(wanted, 0, len(finders)).astype(jnp.int32),
    )
    whole = _AT_ONCE[-1] if sizes else max(_VOXELS // math.prod(grid.shape), 1)
    for finder, at_once in zip(finders, (*_AT_ONCE[: len(sizes)], whole), strict=True):
        sought = settle(finder.suits, finder.improve, asked, sought, at_once=at_once)
    return sought


def _points(planner: Planner, finder: _Finder, asked: MapAndEnds) -> int:
    """How many points a route has, with its exact ends."""
    if (climber := field_climber(planner)) is not None:
        return climber.ascent.steps + 3
    return int(jax.eval_shape(lambda asked: finder.find(asked, jnp.zeros(())).route.path, asked).shape[0])


@dataclasses.dataclass(frozen=True)
class _Finder:
    """Seeks routes in windows of one size.

    Attributes:
        distances, grid, planner: as of `route_in_windows`.
        number: of the size.
        size: of the window; None: the whole map.
    """

    distances: Distances
    grid: Grid
    planner: Planner
    number: int
    size: Index3 | None

    def suits(self, asked: MapAndEnds, sought: WindowedRoute) -> Bool[Array, ""]:
        """Whether the window may show more, and no way of the cost leaves it."""
        more = sought.least <= self.number
        return more if self.size is None else more & _place(asked, sought.cost, self.size)[0]

    def improve(self, asked: MapAndEnds, sought: WindowedRoute) -> WindowedRoute:
        """The better of a route and the one that the window holds."""
        # Where nobody asks, as in what fills up a batch, all is closed: that is solved in no time.
        closed = sought.least > self.number
        asked = asked._replace(occupied=asked.occupied | closed)
        new = self.find(asked, sought.cost)
        better = (new.route.status == Status.OK) | (sought.route.status != Status.OK)
        route = jax.tree.map(lambda new, old: jnp.where(better, new, old), new.route, sought.route)
        return new._replace(route=route)

    def find(self, asked: MapAndEnds, cost: Float[Array, ""]) -> WindowedRoute:
        """The route that the window holds, and what to look for next."""
        if self.size is None:
            problem = formulate(asked.occupied, asked.ground, asked.ends, self.distances, self.grid)
            corner, grid, bound, price = jnp.zeros(3, jnp.int32), self.grid, jnp.float32(jnp.inf), asked.price
        else:
            grid = Grid(self.size, self.grid.spacing, (0.0, 0.0, 0.0))
            _, corner = _place(asked, cost, self.size)
            bound = _bound(asked, corner, self.size)
            problem = self._problem(asked, corner, grid)
            price = None if asked.price is None else cut_box(asked.price, corner, self.size, beyond=1.0)
        if price is not None:
            problem = dataclasses.replace(problem, price=price)
        route = complete_route(problem, pure_route(self.planner)(problem))
        path = jnp.asarray(route.path) + corner
        passes = _is_clear(problem, path - corner, asked.origin + grid.spacing * corner, grid)
        status = jnp.where((route.status == Status.OK) & ~passes, Status.PATH_IN_COLLISION, route.status)
        status, geodesic = status.astype(jnp.int32), jnp.asarray(route.geodesic)
        route = dataclasses.replace(route, path=path, status=status, geodesic=geodesic)
        paid = path_costs(path, jnp.asarray(route.cost) / grid.spacing, jnp)
        near = corner_around(asked.ends[0], NEAR) - corner
        k = 2 * NEAR + 1
        return WindowedRoute(
            route,
            cut_box(problem.blocked, near, (k, k, k), beyond=True),
            next_costs(status, paid, cost, jnp).astype(jnp.float32),
            jnp.where(is_proved(status, paid, bound), _PROVED, self.number + 1).astype(jnp.int32),
        )

    def _problem(self, asked: MapAndEnds, corner: Int32[Array, " 3"], grid: Grid) -> Problem:
        """The problem in a window of the map, with what lies around it."""
        halo = halo_of(self.distances, grid)
        x, y, z = (n + 2 * halo for n in grid.shape)
        occupied, ground = (cut_box(v, corner - halo, (x, y, z)) for v in (asked.occupied, asked.ground))
        left = jnp.asarray(self.grid.shape, jnp.int32) - corner
        rim = jnp.minimum(left, jnp.asarray(grid.shape, jnp.int32))
        ends = asked.ends - corner
        return formulate(materialise(occupied), materialise(ground), ends, self.distances, grid, rim)


def _place(asked: MapAndEnds, cost: Float[Array, ""], size: Index3) -> tuple[Bool[Array, ""], Int32[Array, " 3"]]:
    """Whether a window of this size holds every way of a cost and what is near the start, and its lowest voxel."""
    limits, sizes = (jnp.asarray(shape, jnp.int32) for shape in (asked.occupied.shape, size))
    sound = ends_inside(asked.ends, limits, jnp)
    ends = jnp.where(sound, asked.ends, 0.0)
    start = corner_around(ends[0], 0)
    low, high = ellipsoid_box(ends, cost, limits, jnp)
    low = jnp.minimum(low, jnp.maximum(start - NEAR, 0))
    high = jnp.maximum(high, jnp.minimum(start + NEAR, limits - 1))
    # Layers that are solid everywhere, as below the ground, need no room.
    layer = jnp.arange(len(asked.solid), dtype=jnp.int32)
    floor = jnp.min(jnp.where(~asked.solid & (layer >= low[2]) & (layer <= high[2]), layer, high[2]))
    low = low.at[2].set(floor)
    corner = centre(low, high, sizes, limits, jnp)
    corner = corner.at[2].set(jnp.minimum(floor, jnp.maximum(limits - sizes, 0)[2]))
    return sound & jnp.all(high - low < sizes), corner


def _bound(asked: MapAndEnds, corner: Int32[Array, " 3"], size: Index3) -> Float[Array, ""]:
    """The least cost of a way that leaves a window, as `focus_window.ways_out`; infinite if none can."""
    costs = costs_over_faces(asked.ends, corner, jnp.asarray(size, jnp.int32), jnp)
    bound = jnp.asarray(jnp.inf, jnp.float32)
    for axis in range(3):
        x, y, z = (1 if k == axis else n for k, n in enumerate(size))
        for side, layer in enumerate((corner[axis] - 1, corner[axis] + size[axis])):
            beyond = cut_box(asked.occupied, corner.at[axis].set(layer), (x, y, z), beyond=True)
            bound = jnp.where(jnp.all(beyond), bound, jnp.minimum(bound, costs[side, axis]))
    return bound


def _is_clear(problem: Problem, path: Float[Array, "t 3"], origin: Float[Array, " 3"], grid: Grid) -> Bool[Array, ""]:
    """Whether a path, brought to the world and back, is clear; the ways to its exact ends were checked before."""
    sight = sight_of(problem.blocked, problem.room)
    sight = dataclasses.replace(sight, codes=materialise(sight.codes))
    back = ((origin + grid.spacing * path) - origin) / grid.spacing
    return jnp.asarray(jnp.all(clear(sight, back[1:-2], back[2:-1])))
