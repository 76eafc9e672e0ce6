"""A planning problem on the voxel grid: a task as a path finder takes it, its inputs judged.

    (maps, ends, distances) ↦ Problem        `formulate`, on the device

    blocked = hard set (`planning.inflation`), with a ball opened around an end that needs one (`planning.exemptions`)
    price   = n(d) of the distance d to the nearest obstacle, 1 from the margin on (`fields.price`); the ground has none

Of a part of a map, obstacles are seen beyond the part as well, in a halo as wide as the margin. Its problem is OK only
where it is what the whole map would make of it: with balls that are no larger than the ends' own voxels ask for. A part
may reach beyond the *rim* where the map ends: nothing is there to keep a distance from, and no path leads there.

A path runs   exact start, start, …, goal, exact goal,   where start and goal have the room that a path keeps on the
way: they are the exact ends themselves, or the centres of their voxels.

Positions are index coordinates (whole numbers at voxel centres); of the grid only shape and spacing matter.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer, Shaped

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.distance import cube_distance, farthest, metres
from maxjax.fields.occupancy import squared_distance
from maxjax.planning.distances import Distances
from maxjax.planning.ends import inward, locate, placed
from maxjax.planning.exemptions import Opened, ball_radius, largest_radius, opened
from maxjax.planning.inflation import hard_set, least_quarters
from maxjax.planning.line_of_sight import stands_free, touched
from maxjax.programs.lowering import materialise


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Problem:
    """What a path finder needs; batch axes lead.

    Attributes:
        blocked: voxels that a path keeps out of.
        price: n ≥ 1, what a metre costs; None: 1 everywhere.
        start, goal: index coordinates, both with room.
        ends: the exact start and goal; where one lies on the face of an occupied voxel, it is moved off that face by
            less than a thousandth of a voxel.
        balls: radii of the balls around the exact ends [m], outside of which a path keeps the radius.
        levels: of these balls (`planning.exemptions`).
        goal_index: voxel of the goal.
        status: OK, or why there is nothing to plan.
        room: half the width of the box around each point of a path that meets free voxels only
        (`planning.line_of_sight`)
            [voxels]. Static.
    """

    blocked: Bool[Array, "*batch nx ny nz"]
    price: Float[Array, "*batch nx ny nz"] | None
    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    ends: Float[Array, "*batch 2 3"]
    balls: Float[Array, "*batch 2"]
    levels: Int32[Array, "*batch 2"]
    goal_index: Int32[Array, "*batch 3"]
    status: Int32[Array, "*batch"]
    room: float = dataclasses.field(metadata={"static": True})


class Surroundings(NamedTuple):
    """What all problems of one map share.

    Attributes:
        occupied: occupied voxels, ground included.
        quarters: `distance.cube_distance` of the obstacles (ground left out), exact up to the margin.
        hard: the hard set.
        price: as in `Problem`.
    """

    occupied: Bool[Array, "nx ny nz"]
    quarters: Integer[Array, "nx ny nz"]
    hard: Bool[Array, "nx ny nz"]
    price: Float[Array, "nx ny nz"] | None

    def inside(self, rim: Int32[Array, " 3"]) -> Surroundings:
        """The same, closed from `rim` on."""
        shape = self.hard.shape
        beyond = functools.reduce(
            operator.or_, (lax.broadcasted_iota(jnp.int32, shape, axis) >= rim[axis] for axis in range(3))
        )
        return self._replace(occupied=self.occupied | beyond, hard=self.hard | beyond)


class Placement(NamedTuple):
    """Where the ends of a problem are, as in `Problem`; batch axes lead."""

    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    ends: Float[Array, "*batch 2 3"]
    balls: Float[Array, "*batch 2"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Faults:
    """What may be wrong with a start and a goal, in the order in which it counts.

    Attributes:
        nonfinite: one of them is NaN or infinite.
        start_outside, goal_outside: not inside the map.
        same: they are one point.
        start_inside, goal_inside: in an occupied voxel.
    """

    nonfinite: Bool[Array, "*n"]
    start_outside: Bool[Array, "*n"]
    goal_outside: Bool[Array, "*#n"]
    same: Bool[Array, "*n"]
    start_inside: Bool[Array, "*n"]
    goal_inside: Bool[Array, "*#n"]

    @property
    def status(self) -> Int32[Array, "*n"]:
        """The `Status` of the first fault; OK if there is none."""
        codes = {
            "nonfinite": Status.NONFINITE_INPUT,
            "start_outside": Status.START_OUTSIDE_MAP,
            "goal_outside": Status.GOAL_OUTSIDE_MAP,
            "same": Status.START_EQUALS_GOAL,
            "start_inside": Status.START_OCCUPIED,
            "goal_inside": Status.GOAL_OCCUPIED,
        }
        status = jnp.select([getattr(self, name) for name in codes], list(codes.values()), Status.OK)
        return status.astype(jnp.int32)


@jax.named_scope("formulate")
def formulate(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "2 3"],
    distances: Distances,
    grid: Grid,
    rim: Int32[Array, " 3"] | None = None,
) -> Problem:
    """Measure distances, open balls where they are needed, and judge the inputs; `jit`- and `vmap`-safe.

    Args:
        occupied: occupied voxels, ground included: of the grid, or of the grid and a halo around it.
        ground: the voxels of `occupied` that are ground.
        ends: start and goal, index coordinates.
        distances: asked for. Static.
        grid: the grid, whose origin does not matter. Static.
        rim: how many of the grid's voxels along each axis belong to the map, lowest first; None: all.

    Returns:
        The problem. With a halo its status is NO_VALID_PATH, too, where only the whole map can tell.
    """
    part = occupied.shape != grid.shape
    around = surroundings(occupied, ground, distances, grid)
    return problem_in(around if rim is None else around.inside(rim), ends, distances, grid, part=part)


def surroundings(
    occupied: Bool[Array, "nx ny nz"], ground: Bool[Array, "nx ny nz"], distances: Distances, grid: Grid
) -> Surroundings:
    """The hard set, the distances and the price of a map; arguments as in `formulate`."""
    halo = (occupied.shape[0] - grid.shape[0]) // 2
    occupied, ground = materialise(occupied), materialise(ground)
    quarters = _inside(cube_distance(occupied & ~ground, distances.margin / grid.spacing), halo)
    beside = _inside(squared_distance(ground, 1), halo)
    hard = hard_set(quarters, beside, least_quarters(distances.radius / grid.spacing))
    price = None
    if distances.priced:
        price = materialise(distances.price_at(metres(quarters, grid.spacing)))
    return Surroundings(_inside(occupied, halo), quarters, materialise(hard), price)


def _inside(volume: Shaped[Array, "hx hy hz"], halo: int) -> Shaped[Array, "nx ny nz"]:
    """A volume without its halo."""
    return volume[halo:-halo, halo:-halo, halo:-halo] if halo else volume


def halo_of(distances: Distances, grid: Grid) -> int:
    """How many voxels beyond a part of a map obstacles or ground count in it, at least 1."""
    return max(farthest(distances.margin / grid.spacing), 1)


def problem_in(
    around: Surroundings, ends: Float[Array, "2 3"], distances: Distances, grid: Grid, *, part: bool = False
) -> Problem:
    """The problem of two ends; arguments as in `formulate`, and whether the map goes on beyond what is around."""
    a, b = (locate(end, grid.shape) for end in ends)
    faults = faults_of(around.occupied, ends, grid)
    way = opened(around.hard, around.occupied, a.index, b.index, distances.radius / grid.spacing)
    place = placement(around, way, ends, distances, grid)
    found = jnp.where(way.least, way.status, Status.NO_VALID_PATH) if part else way.status
    return Problem(
        blocked=way.blocked,
        price=around.price,
        start=place.start,
        goal=place.goal,
        ends=place.ends,
        balls=place.balls,
        levels=way.levels,
        goal_index=b.index,
        status=jnp.where(faults.status == Status.OK, found, faults.status).astype(jnp.int32),
        room=distances.room,
    )


def placement(
    around: Surroundings, way: Opened, ends: Float[Array, "2 3"], distances: Distances, grid: Grid
) -> Placement:
    """Where two ends are, and the balls that hold what is opened around each, and its way to where it has room."""
    radius = distances.radius / grid.spacing
    barred = around.hard & ~around.occupied
    exact, inner, balls = [], [], []
    for end, level in zip((locate(x, grid.shape) for x in ends), way.levels, strict=True):
        x = placed(around.occupied, end.exact)
        y = inward(way.blocked, x, distances.room)
        _, at = touched(grid.shape, x, distances.room)
        near = jnp.any(around.quarters[at] < least_quarters(radius)) | ~stands_free(way.blocked, x)
        aside = jnp.where(near, jnp.linalg.norm(x - y), 0.0)
        exact.append(x)
        inner.append(y)
        balls.append(jnp.maximum(aside, ball_radius(barred, around.quarters, end, level, radius)))
    return Placement(inner[0], inner[1], jnp.stack(exact), grid.spacing * jnp.stack(balls))


def faults_of(occupied: Bool[Array, "nx ny nz"], ends: Float[Array, "2 3"], grid: Grid) -> Faults:
    """What is wrong with two ends by themselves."""
    a, b = (locate(end, grid.shape) for end in ends)
    (inside_a, at_a), (inside_b, at_b) = (touched(grid.shape, end.off) for end in (a, b))
    return Faults(
        nonfinite=~(a.finite & b.finite),
        start_outside=~inside_a,
        goal_outside=~inside_b,
        same=jnp.all(ends[0] == ends[1]),
        start_inside=~inside_a | jnp.any(occupied[at_a]),
        goal_inside=~inside_b | jnp.any(occupied[at_b]),
    )


def largest_joining(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "2 3"],
    distances: Distances,
    grid: Grid,
) -> Float[Array, ""]:
    """The largest radius [m] below the one asked for that joins two ends which radius 0 joins; as `formulate`."""
    quarters = cube_distance(occupied & ~ground, distances.radius / grid.spacing)
    a, b = (locate(end, grid.shape).index for end in ends)
    around = quarters, squared_distance(ground, 1), occupied
    return grid.spacing * largest_radius(*around, a, b, distances.radius / grid.spacing)
