"""A planning problem on the voxel grid: its inputs judged, its safety margin chosen.

The margin is the largest of margin, margin − spacing, …, least (0 unless said otherwise) at which start and goal stand
in one component of free voxels. Flood fills decide (`fields.connectivity`), before anything is solved: a plan costs one
solve, and where no margin joins them that is proved.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.grid import Grid
from maxjax.core.lowering import materialise
from maxjax.core.status import Status
from maxjax.fields.connectivity import first_joined
from maxjax.fields.occupancy import blocked_within, reach_of, rungs, squared_distance
from maxjax.planning.sight import TOUCH, stands_free, touched


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Problem:
    """What a path planner needs.

    Attributes:
        blocked: voxels within `margin` of an obstacle.
        margin: the margin that was chosen [m]; the least one where none joins start and goal.
        start, goal: index coordinates; where one lies on the face of a blocked voxel, it is moved off that face by less
            than a thousandth of a voxel.
        goal_index: voxel of the goal.
        status: OK, or why there is nothing to plan.
    """

    blocked: Bool[Array, "*batch nx ny nz"]
    margin: Float[Array, "*batch"]
    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    goal_index: Int32[Array, "*batch 3"]
    status: Int32[Array, "*batch"]


def off_faces(x: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """The point moved off the faces of its voxel, so that it touches no other voxel.

    A start at 3 m lies on a face of 2 m voxels. Touching the margin there must not cost the whole flight its margin.
    """
    centre = jnp.floor(x + 0.5)
    room = 0.5 - 1.5 * TOUCH
    return centre + jnp.clip(x - centre, -room, room)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class End:
    """A start or a goal on the grid.

    Attributes:
        exact: index coordinates; −1 where they are not finite.
        off: the same, moved `off_faces`.
        index: its voxel; outside the grid for a point outside.
        finite: whether the point was.
    """

    exact: Float[Array, "*n 3"]
    off: Float[Array, "*n 3"]
    index: Int32[Array, "*n 3"]
    finite: Bool[Array, "*n"]


def locate(point: Float[Array, " 3"], grid: Grid) -> End:
    """Where a point [m] is on the grid."""
    exact = grid.fractional_index(point)
    exact = jnp.where(jnp.isfinite(exact), exact, -1.0)
    off = off_faces(exact)
    index = jnp.floor(jnp.clip(off, -1, max(grid.shape)) + 0.5).astype(jnp.int32)
    return End(exact, off, index, jnp.all(jnp.isfinite(point)))


def placed(blocked: Bool[Array, "nx ny nz"], x: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """The point itself where it stands free of blocked voxels, else off the faces of its voxel."""
    return jnp.where(stands_free(blocked, x), x, off_faces(x))


def verdict(
    nonfinite: Bool[Array, "*n"],
    start_outside: Bool[Array, "*n"],
    goal_outside: Bool[Array, "*#n"],
    same: Bool[Array, "*n"],
    start_inside: Bool[Array, "*n"],
    goal_inside: Bool[Array, "*#n"],
    apart: Bool[Array, "*n"],
) -> Int32[Array, "*n"]:
    """The `Status` of the first thing that is wrong with a start and a goal, in this order; OK if nothing is."""
    status = jnp.select(
        [nonfinite, start_outside, goal_outside, same, start_inside, goal_inside, apart],
        [
            Status.NONFINITE_INPUT,
            Status.START_OUTSIDE_MAP,
            Status.GOAL_OUTSIDE_MAP,
            Status.START_EQUALS_GOAL,
            Status.START_OCCUPIED,
            Status.GOAL_OCCUPIED,
            Status.NO_VALID_PATH,
        ],
        Status.OK,
    )
    return status.astype(jnp.int32)


@jax.named_scope("pose")
def pose(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    margin: float,
    grid: Grid,
    least: float = 0.0,
) -> Problem:
    """Choose the margin and judge the inputs; `jit`- and `vmap`-safe.

    Args:
        occupied: occupied voxels, ground included.
        ground: the voxels of `occupied` that are ground.
        start, goal: [m].
        margin: the margin asked for [m]. Static.
        grid: the grid. Static.
        least: the margin below which rather no path is planned [m]. Static.
    """
    ladder = jnp.asarray(rungs(margin, grid, least), jnp.float32)
    occupied, ground = materialise(occupied), materialise(ground)
    squared = squared_distance(occupied & ~ground, reach_of(margin, grid))
    below = squared_distance(ground, 1)
    a, b = locate(start, grid), locate(goal, grid)
    finite = a.finite & b.finite

    def blocked_at(rung: Int32[Array, ""]) -> Bool[Array, "nx ny nz"]:
        return blocked_within(squared, ground, below, ladder[rung], grid)

    inside_a, at_a = touched(grid.shape, a.off)
    inside_b, at_b = touched(grid.shape, b.off)

    def stand(rung: Int32[Array, ""]) -> Bool[Array, ""]:
        """Whether both ends are outside the margin; only the voxels that they touch are looked at."""
        near = [blocked_within(squared[at], ground[at], below[at], ladder[rung], grid) for at in (at_a, at_b)]
        return inside_a & inside_b & ~jnp.any(jnp.stack(near))

    in_a, in_b = ~inside_a | jnp.any(occupied[at_a]), ~inside_b | jnp.any(occupied[at_b])
    last = len(ladder) - 1
    # Rungs at which an end is inside the margin are passed over without a flood fill: mostly that decides.
    standing = jax.vmap(stand)(jnp.arange(last + 1, dtype=jnp.int32))
    first = jnp.where(jnp.any(standing), jnp.argmax(standing), last).astype(jnp.int32)

    rung, meet = first_joined(lambda rung: ~blocked_at(rung), first, last, b.index, a.index)
    ok = meet & jnp.any(standing)
    status = verdict(~finite, ~inside_a, ~inside_b, jnp.all(start == goal), in_a, in_b, ~ok)
    blocked = materialise(blocked_at(rung))
    return Problem(blocked, ladder[rung], placed(blocked, a.exact), placed(blocked, b.exact), b.index, status)
