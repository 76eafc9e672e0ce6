"""Balls around the ends: where an end stands nearer than the radius, the way to it is opened, and no more than that.

    ball of level k = voxels that are not occupied, with their centres less than k voxels from that of the end's voxel

Level 0 opens nothing, level 1 the end's own voxel, and so on up to `levels` = ⌈radius⌉ + 3: a way straight off a wall
has as many voxels within the radius as ⌈radius⌉, and three more lead around a corner. Floods choose the levels: first
the least one at which the hard set with a ball around either end joins them; then the start's by itself, with the
goal's as it is, and then the goal's.

Positions are index coordinates (whole numbers at voxel centres), distances [voxels].
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer, UInt8

from maxjax.core.status import Status
from maxjax.fields.connectivity import first_joined
from maxjax.planning.ends import End
from maxjax.planning.inflation import hard_set, least_quarters
from maxjax.programs.lowering import materialise


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Opened:
    """The hard set with the balls that join two ends; batch axes lead.

    Attributes:
        blocked: voxels that a path keeps out of.
        levels: of the balls around start and goal; 0 where an end needs none.
        least: whether they are so by the ends' own voxels, so that no larger map would need smaller ones.
        status: OK; NO_SAFE_PATH where only radius 0 joins the ends, NO_VALID_PATH where nothing does.
    """

    blocked: Bool[Array, "*batch nx ny nz"]
    levels: Int32[Array, "*batch 2"]
    least: Bool[Array, "*batch"]
    status: Int32[Array, "*batch"]


def last_level(radius: float) -> int:
    """The largest ball that may be opened at a radius [voxels]: 0 at radius 0, where no ball opens anything."""
    return math.ceil(radius) + 3 if radius > 0 else 0


@jax.named_scope("balls")
def opened(
    hard: Bool[Array, "nx ny nz"],
    occupied: Bool[Array, "nx ny nz"],
    start: Int32[Array, " 3"],
    goal: Int32[Array, " 3"],
    radius: float,
) -> Opened:
    """Open the smallest balls that join two ends; `jit`- and `vmap`-safe.

    Args:
        hard: the hard set.
        occupied: occupied voxels, ground included.
        start, goal: voxels; nothing joins an end outside the grid or in an occupied voxel.
        radius: of the hard set [voxels]. Static.
    """
    top = last_level(radius)
    a, b = (materialise(_least_level(hard, occupied, end, top)) for end in (start, goal))
    either = jnp.minimum(a, b)
    # Where an end's own voxel is in the hard set, level 0 joins nothing.
    own_voxels = jnp.stack([_at(either, start), _at(either, goal)]).astype(jnp.int32)
    alone = jnp.where(jnp.sum(own_voxels) == 0, 0, min(top, 1)).astype(jnp.int32)
    # One map more than there are levels: all that is not occupied.
    common, met = first_joined(lambda k: either <= k, alone, top + (radius > 0), start, goal)
    joined, common = met & (common <= top), jnp.minimum(common, top)

    def smallest(free: Callable[[Int32[Array, ""]], Bool[Array, "nx ny nz"]]) -> Int32[Array, ""]:
        """The least level at which the ends are joined, at most the common one; it takes no flood where that is 0."""
        level, _ = first_joined(free, jnp.where(joined & (common > 0), 0, top + 1).astype(jnp.int32), top, start, goal)
        return jnp.minimum(level, common)

    own = smallest(lambda k: (a <= k) | (b <= common))
    other = smallest(lambda k: (a <= own) | (b <= k))
    blocked = materialise(~((a <= own) | (b <= other)))
    status = jnp.where(joined, Status.OK, jnp.where(met, Status.NO_SAFE_PATH, Status.NO_VALID_PATH))
    levels = jnp.stack([own, other])
    return Opened(blocked, levels, jnp.all(levels == own_voxels), status.astype(jnp.int32))


def _least_level(
    hard: Bool[Array, "nx ny nz"], occupied: Bool[Array, "nx ny nz"], end: Int32[Array, " 3"], top: int
) -> UInt8[Array, "nx ny nz"]:
    """The least level of a ball around an end at which a voxel is free.

    0 where it always is; `top` + 1 beyond the largest ball, `top` + 2 where it is occupied.
    """
    squared = jnp.zeros(hard.shape, jnp.int32)
    for axis in range(3):
        # Farther than the largest ball is all the same.
        offset = jnp.clip(lax.broadcasted_iota(jnp.int32, hard.shape, axis) - end[axis], -top, top)
        squared = squared + offset**2
    level = 1 + sum((squared >= k**2).astype(jnp.uint8) for k in range(1, top + 1))
    return jnp.where(occupied, top + 2, jnp.where(hard, level, 0)).astype(jnp.uint8)


def _at(volume: UInt8[Array, "nx ny nz"], index: Int32[Array, " 3"]) -> UInt8[Array, ""]:
    """A voxel's value; that of the nearest one for an index outside."""
    x, y, z = jnp.clip(index, 0, jnp.asarray(volume.shape) - 1)
    return volume[x, y, z]


def ball_radius(
    barred: Bool[Array, "nx ny nz"],
    quarters: Integer[Array, "nx ny nz"],
    end: End,
    level: Int32[Array, ""],
    radius: float,
) -> Float[Array, ""]:
    """The ball around an end that holds all that its opened voxels bring a path too near to.

    Near an obstacle a path comes by the corners of the cell that it is in, so the ball holds all cells around every
    opened voxel that is nearer than the radius; of one that lies beside the ground it holds the voxel alone.

    Args:
        barred: voxels of the hard set that are not occupied.
        quarters: `distance.cube_distance` of the obstacles, exact up to the radius.
        end: the end.
        level: of its ball.
        radius: static.
    """
    reach = max(last_level(radius) - 1, 0)
    axes = [jnp.clip(end.index[k] + np.arange(-reach, reach + 1), 0, n - 1) for k, n in enumerate(barred.shape)]
    x, y, z = jnp.meshgrid(*axes, indexing="ij", sparse=True)
    around = jnp.where(quarters[x, y, z] < least_quarters(radius), 1.0, 0.5)
    inside = sum((v - c) ** 2 for v, c in zip((x, y, z), end.index, strict=True)) < level**2
    farthest = sum((jnp.abs(v - u) + around) ** 2 for v, u in zip((x, y, z), end.exact, strict=True))
    return jnp.sqrt(jnp.max(jnp.where(inside & barred[x, y, z], farthest, 0.0)))


def largest_radius(
    quarters: Integer[Array, "nx ny nz"],
    ground_squared: Integer[Array, "nx ny nz"],
    occupied: Bool[Array, "nx ny nz"],
    start: Int32[Array, " 3"],
    goal: Int32[Array, " 3"],
    radius: float,
) -> Float[Array, ""]:
    """The largest radius below `radius`, of those that differ in their hard sets, whose balls join two ends [voxels].

    For ends that radius 0 joins, which is also returned where nothing else does. Found by bisection, since a radius
    that joins them has no larger one that does not above it, but for the balls, which grow by whole voxels.

    Args:
        quarters, ground_squared: as in `hard_set`.
        occupied, start, goal, radius: as in `opened`.
    """
    lower = _radii(radius)
    least = jnp.asarray([least_quarters(r) for r in lower], jnp.int32)
    tops = jnp.asarray([last_level(r) for r in lower], jnp.int32)
    top = last_level(radius)

    def joins(k: Int32[Array, ""]) -> Bool[Array, ""]:
        hard = hard_set(quarters, ground_squared, least[k])
        levels = jnp.minimum(*(_least_level(hard, occupied, end, top) for end in (start, goal)))
        return first_joined(lambda _: levels <= tops[k], jnp.int32(0), 0, start, goal)[1]

    def halve(bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        worse, better = bounds
        middle = (worse + better) // 2
        found = joins(middle)
        return jnp.where(found, worse, middle), jnp.where(found, middle, better)

    bounds = jnp.int32(-1), jnp.int32(len(lower) - 1)
    _, best = lax.while_loop(lambda bounds: bounds[1] - bounds[0] > 1, halve, bounds)
    return jnp.asarray(lower, jnp.float32)[best]


@functools.cache
def _radii(radius: float) -> tuple[float, ...]:
    """Distances of centres from cubes that are less than a radius, largest first, and 0 [voxels]."""
    odd = [0, *((2 * k - 1) ** 2 for k in range(1, math.ceil(radius) + 2))]
    sums = {a + b + c for a in odd for b in odd for c in odd}
    return tuple(math.sqrt(q) / 2 for q in sorted(sums, reverse=True) if 0 <= q < least_quarters(radius))
