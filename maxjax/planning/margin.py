"""The choice of the margin: the largest one at which free voxels join start and goal.

    margin, margin − spacing, …, least        the ladder (`fields.occupancy.rungs`)

Flood fills decide (`fields.connectivity`), before anything is solved: a plan costs one solve, and where no margin joins
the ends, that is proved.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer

from maxjax.core.grid import Grid
from maxjax.fields.connectivity import first_joined, flood
from maxjax.fields.occupancy import blocked_within, reach_of, rungs, squared_distance
from maxjax.planning.ends import End
from maxjax.planning.sight import stands_free, touched


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Ladder:
    """A map at every margin that may be chosen.

    Attributes:
        squared: squared distance to the nearest obstacle, ground left out [voxels²].
        ground: ground voxels.
        ground_squared: squared distance to the ground, one voxel at most [voxels²].
        margins: to try, largest first [m].
        grid: of the map. Static.
    """

    squared: Integer[Array, "nx ny nz"]
    ground: Bool[Array, "nx ny nz"]
    ground_squared: Integer[Array, "nx ny nz"]
    margins: Float[Array, " rungs"]
    grid: Grid = dataclasses.field(metadata={"static": True})

    @property
    def last(self) -> int:
        """Index of the least margin."""
        return self.margins.shape[0] - 1

    def blocked(self, rung: Int32[Array, ""]) -> Bool[Array, "nx ny nz"]:
        """The dilated map at one margin."""
        return blocked_within(self.squared, self.ground, self.ground_squared, self.margins[rung], self.grid)

    def blocked_at(self, rung: Int32[Array, ""], at: tuple[Array, ...]) -> Bool[Array, "..."]:
        """Some voxels of the dilated map."""
        near = self.squared[at], self.ground[at], self.ground_squared[at]
        return blocked_within(*near, self.margins[rung], self.grid)


def ladder(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    margin: float,
    grid: Grid,
    least: float = 0.0,
) -> Ladder:
    """The margins from `margin` down to `least` [m], both static, of a map whose `occupied` includes its ground."""
    squared = squared_distance(occupied & ~ground, reach_of(margin, grid))
    margins = jnp.asarray(rungs(margin, grid, least), jnp.float32)
    return Ladder(squared, ground, squared_distance(ground, 1), margins, grid)


def largest_joined(ladder: Ladder, start: End, goal: End) -> tuple[Int32[Array, ""], Bool[Array, ""]]:
    """The first rung at which both ends stand free and one component holds both; the last one if there is none.

    Returns:
        The rung, and whether it joins them.
    """
    shape = ladder.grid.shape
    ends = [touched(shape, end.off) for end in (start, goal)]
    inside = ends[0][0] & ends[1][0]

    def stand(rung: Int32[Array, ""]) -> Bool[Array, ""]:
        """Whether both ends are outside the margin; only the voxels that they touch are looked at."""
        return inside & ~jnp.any(jnp.stack([ladder.blocked_at(rung, at) for _, at in ends]))

    # Rungs at which an end is inside the margin are passed over without a flood fill: mostly that decides.
    standing = jax.vmap(stand)(jnp.arange(ladder.last + 1, dtype=jnp.int32))
    first = jnp.where(jnp.any(standing), jnp.argmax(standing), ladder.last).astype(jnp.int32)
    rung, meet = first_joined(lambda rung: ~ladder.blocked(rung), first, ladder.last, goal.index, start.index)
    return rung, meet & jnp.any(standing)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _DescentCarry:
    """Of `largest_joined_each`: the rung that is next, the one chosen for each start, and which have one."""

    rung: Int32[Array, ""]
    chosen: Int32[Array, " n"]
    joined: Bool[Array, " n"]


def largest_joined_each(
    ladder: Ladder, starts: End, goal: End, sound: Bool[Array, " n"]
) -> tuple[Int32[Array, " n"], Bool[Array, " n"]]:
    """`largest_joined` of many starts with one goal, by one flood fill a rung, from the goal.

    Args:
        ladder: of the map.
        starts, goal: ends.
        sound: starts to look at; the others get no rung.

    Returns:
        The rung of each start, and whether it joins it to the goal.
    """
    x, y, z = jnp.clip(starts.index, 0, jnp.asarray(ladder.grid.shape) - 1).T

    def lower(carry: _DescentCarry) -> _DescentCarry:
        blocked = ladder.blocked(carry.rung)
        now = flood(~blocked, goal.index)[x, y, z] & all_stand_free(blocked, starts) & stands_free(blocked, goal.off)
        chosen = jnp.where(now & ~carry.joined, carry.rung, carry.chosen)
        return _DescentCarry(carry.rung + 1, chosen, carry.joined | now)

    nobody = jnp.zeros_like(sound)
    descent = lax.while_loop(
        lambda carry: (carry.rung <= ladder.last) & jnp.any(sound & ~carry.joined),
        lower,
        _DescentCarry(jnp.int32(0), jnp.full(sound.shape, ladder.last, jnp.int32), nobody),
    )
    return descent.chosen, descent.joined


def all_stand_free(blocked: Bool[Array, "nx ny nz"], ends: End) -> Bool[Array, " n"]:
    """`stands_free` of each of several ends, moved off the faces of their voxels."""
    return jnp.asarray(jax.vmap(lambda x: stands_free(blocked, x))(ends.off))
