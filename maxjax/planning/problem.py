"""A planning problem on the voxel grid: a task as a path finder takes it, its inputs judged, its margin chosen.

    (maps, ends, margin) ↦ Problem        `formulate`, on the device

Positions are index coordinates (whole numbers at voxel centres); of the grid only shape and spacing matter.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.grid import Grid
from maxjax.core.lowering import materialise
from maxjax.core.status import Status
from maxjax.planning.ends import locate, placed
from maxjax.planning.margin import ladder, largest_joined
from maxjax.planning.sight import touched


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Dilated:
    """A map and the margin that it was dilated by, on a device or on the host; batch axes lead.

    Attributes:
        blocked: voxels within `margin` of an obstacle.
        margin: [m].
    """

    blocked: Bool[Array | np.ndarray, "*batch nx ny nz"]
    margin: Float[Array | np.ndarray, "*batch"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Problem:
    """What a path finder needs; batch axes lead.

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

    @property
    def dilated(self) -> Dilated:
        """The map that a path of this problem is judged in."""
        return Dilated(self.blocked, self.margin)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Faults:
    """What may be wrong with a start and a goal, in the order in which it counts.

    Attributes:
        nonfinite: one of them is NaN or infinite.
        start_outside, goal_outside: not inside the map.
        same: they are one point.
        start_inside, goal_inside: in an occupied voxel.
        apart: no margin joins them.
    """

    nonfinite: Bool[Array, "*n"]
    start_outside: Bool[Array, "*n"]
    goal_outside: Bool[Array, "*#n"]
    same: Bool[Array, "*n"]
    start_inside: Bool[Array, "*n"]
    goal_inside: Bool[Array, "*#n"]
    apart: Bool[Array, "*n"]

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
            "apart": Status.NO_VALID_PATH,
        }
        status = jnp.select([getattr(self, name) for name in codes], list(codes.values()), Status.OK)
        return status.astype(jnp.int32)


@jax.named_scope("formulate")
def formulate(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Float[Array, "2 3"],
    margin: float,
    grid: Grid,
    least: float = 0.0,
) -> Problem:
    """Choose the margin and judge the inputs; `jit`- and `vmap`-safe.

    Args:
        occupied: occupied voxels, ground included.
        ground: the voxels of `occupied` that are ground.
        ends: start and goal, index coordinates.
        margin: the margin asked for [m]. Static.
        grid: the grid, whose origin does not matter. Static.
        least: the margin below which rather no path is planned [m]. Static.
    """
    occupied, ground = materialise(occupied), materialise(ground)
    margins = ladder(occupied, ground, margin, grid, least)
    a, b = locate(ends[0], grid.shape), locate(ends[1], grid.shape)
    rung, joined = largest_joined(margins, a, b)
    (inside_a, at_a), (inside_b, at_b) = touched(grid.shape, a.off), touched(grid.shape, b.off)
    faults = Faults(
        nonfinite=~(a.finite & b.finite),
        start_outside=~inside_a,
        goal_outside=~inside_b,
        same=jnp.all(ends[0] == ends[1]),
        start_inside=~inside_a | jnp.any(occupied[at_a]),
        goal_inside=~inside_b | jnp.any(occupied[at_b]),
        apart=~joined,
    )
    blocked = materialise(margins.blocked(rung))
    exact = placed(blocked, a.exact), placed(blocked, b.exact)
    return Problem(blocked, margins.margins[rung], *exact, b.index, faults.status)
