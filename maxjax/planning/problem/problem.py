"""A planning problem on the voxel grid: a task as a planner takes it, its inputs checked.

    (maps, ends, distances) ↦ Problem        `formulate`, on the device

    blocked = inflated obstacles (`problem.inflation`) without what the ends' exemptions open (`problem.exemptions`)
    price   = n(d) of the distance d to the nearest obstacle, 1 from the margin on (`fields.price`); the ground has none

Of a part of a map, obstacles are seen beyond the part as well, in a halo as wide as the margin. Its problem is OK only
where it is what the whole map would make of it: with exemptions that nothing beyond the part could make smaller.

A path runs   exact start, start, …, goal, exact goal,   where start and goal have the room that a path keeps on the
way: they are the exact ends themselves, or the centres of voxels next to them.

Positions are index coordinates (whole numbers at voxel centres); of the grid only shape and spacing matter.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import materialise
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.connectivity import first_joined
from maxjax.planning.path.line_of_sight import stands_free, voxels_at
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.ends import End, locate
from maxjax.planning.problem.exemptions import Exemption, Radius, exemptions, last_level, open_exemptions, radii_below
from maxjax.planning.problem.inflation import least_quarters
from maxjax.planning.problem.surroundings import Surroundings, surroundings


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Problem:
    """A problem as a planner gets it; batch axes lead.

    Attributes:
        blocked: voxels that a path keeps out of.
        price: n ≥ 1, what a metre costs; None: 1 everywhere.
        start, goal: index coordinates, both with room.
        ends: the exact start and goal; where one lies on the face of an occupied voxel, it is moved off that face by
            less than a thousandth of a voxel.
        exemptions: their radii around the exact ends [m], outside of which a path keeps the radius; 0: none.
        levels: of the exemptions; 0 where no voxel is opened.
        goal_index: voxel of the goal.
        status: OK, or why there is nothing to plan.
        spacing: edge of a voxel [m].
        room: half the width of the box around each point of a path that meets free voxels only [voxels]
            (`planning.path.line_of_sight`). Static.
    """

    blocked: Bool[Array, "*batch nx ny nz"]
    price: Float[Array, "*batch nx ny nz"] | None
    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    ends: Float[Array, "*batch 2 3"]
    exemptions: Float[Array, "*batch 2"]
    levels: Int32[Array, "*batch 2"]
    goal_index: Int32[Array, "*batch 3"]
    status: Int32[Array, "*batch"]
    spacing: Float[Array, "*batch"]
    room: float = dataclasses.field(metadata={"static": True})


@jax.named_scope("formulate")
def formulate(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "2 3"],
    distances: Distances,
    grid: Grid,
    rim: Int32[Array, " 3"] | None = None,
) -> Problem:
    """Measure distances, open exemptions where they are needed, and check the inputs; `jit`- and `vmap`-safe.

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
    around = surroundings(occupied, ground, distances, grid)
    return problem_in(around if rim is None else around.inside(rim), ends, distances, grid)


def problem_in(around: Surroundings, ends: Float[Array, "2 3"], distances: Distances, grid: Grid) -> Problem:
    """The problem of two ends; arguments as in `formulate`."""
    both = exemptions(around, locate_all(ends, grid.shape), Radius.of(distances.radius / grid.spacing))
    blocked = materialise(open_exemptions(around.inflated, both))
    inner, radii = inner_places(blocked, both, distances, grid)
    joined = connection_status(around.occupied, blocked, both, distances.radius)
    if around.halo:
        joined = jnp.where(jnp.all(both.local), joined, Status.NO_VALID_PATH)
    fault = fault_of_ends(around.occupied, ends, grid)
    return Problem(
        blocked=blocked,
        price=around.price,
        start=inner[0],
        goal=inner[1],
        ends=both.place,
        exemptions=radii,
        levels=both.level,
        goal_index=both.first[1],
        status=jnp.where(fault == Status.OK, joined, fault).astype(jnp.int32),
        spacing=jnp.float32(grid.spacing),
        room=distances.room,
    )


def locate_all(ends: Float[Array, "n 3"], shape: tuple[int, ...]) -> End:
    """Where several ends are on a grid of this shape."""
    nx, ny, nz = shape
    return jax.vmap(lambda end: locate(end, (nx, ny, nz)))(ends)


def inner_places(
    blocked: Bool[Array, "nx ny nz"], ends: Exemption, distances: Distances, grid: Grid
) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Where a path has room at each of some ends, and the radii of the exemptions around their exact places [m].

    An exemption is the ball around its end that holds opened voxels, and the first step to where there is room.
    """

    def one(end: Exemption) -> tuple[Array, Array]:
        at_home = jnp.max(jnp.abs(end.place - end.first)) <= 0.5  # A place on a face is at home on both its sides.
        stays = at_home & stands_free(blocked, end.place, distances.room)
        inner = jnp.where(stays, end.place, end.first)
        ball = jnp.where(end.needed, jnp.maximum(jnp.linalg.norm(end.place - inner), end.reach), 0.0)
        return inner, grid.spacing * ball

    return jax.vmap(one)(ends)


def connection_status(
    occupied: Bool[Array, "nx ny nz"], blocked: Bool[Array, "nx ny nz"], both: Exemption, radius: float
) -> Int32[Array, ""]:
    """Whether two ends are joined: OK; NO_SAFE_PATH where only radius 0 joins them, NO_VALID_PATH where nothing does.

    Args:
        occupied: occupied voxels.
        blocked: what a path keeps out of at the radius.
        both: exemptions of the ends.
        radius: static; 0 or not.
    """
    last = int(radius > 0)
    first = jnp.where(jnp.all(both.leaves), 0, last).astype(jnp.int32)
    way, met = first_joined(lambda k: ~blocked | ((k > 0) & ~occupied), first, last, both.first[0], both.first[1])
    kept = jnp.all(both.leaves) & (way == 0)
    return jnp.where(met, jnp.where(kept, Status.OK, Status.NO_SAFE_PATH), Status.NO_VALID_PATH).astype(jnp.int32)


def fault_of_ends(occupied: Bool[Array, "nx ny nz"], ends: Float[Array, "2 3"], grid: Grid) -> Int32[Array, ""]:
    """The first fault of a start and a goal by themselves; OK if there is none."""
    a, b = (locate(end, grid.shape) for end in ends)
    (inside_a, at_a), (inside_b, at_b) = (voxels_at(grid.shape, end.off) for end in (a, b))
    faults = {
        Status.NONFINITE_INPUT: ~(a.finite & b.finite),
        Status.START_OUTSIDE_MAP: ~inside_a,
        Status.GOAL_OUTSIDE_MAP: ~inside_b,
        Status.START_EQUALS_GOAL: jnp.all(ends[0] == ends[1]),
        Status.START_OCCUPIED: jnp.any(occupied[at_a]),
        Status.GOAL_OCCUPIED: jnp.any(occupied[at_b]),
    }
    return jnp.select(list(faults.values()), list(faults), Status.OK).astype(jnp.int32)


def largest_joining_radius(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "2 3"],
    distances: Distances,
    grid: Grid,
) -> Float[Array, ""]:
    """A radius [m] below the one asked for that joins two ends which radius 0 joins; as `formulate`.

    Of the radii that differ in their inflated obstacles, found by bisection: it is the largest one where no end needs
    an exemption, as all below a radius that joins two such ends do so, too. 0 where no other joins them.
    """
    radius = distances.radius / grid.spacing
    around = surroundings(occupied, ground, dataclasses.replace(distances, margin=distances.radius), grid)
    both, lower = locate_all(ends, grid.shape), radii_below(radius)
    least, last = (jnp.asarray([law(r) for r in lower], jnp.int32) for law in (least_quarters, last_level))
    values = jnp.asarray(lower, jnp.float32)

    def joins(k: Int32[Array, ""]) -> Bool[Array, ""]:
        inflated = around.with_radius(least[k])
        left = exemptions(inflated, both, Radius(values[k], least[k], last[k], radius))
        blocked = open_exemptions(inflated.inflated, left)
        return connection_status(around.occupied, blocked, left, 0.0) == Status.OK

    def halve(bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        worse, better = bounds
        middle = (worse + better) // 2
        found = joins(middle)
        return jnp.where(found, worse, middle), jnp.where(found, middle, better)

    bounds = jnp.int32(-1), jnp.int32(len(lower) - 1)
    _, best = lax.while_loop(lambda bounds: bounds[1] - bounds[0] > 1, halve, bounds)
    return grid.spacing * values[best]
