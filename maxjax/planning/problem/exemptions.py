"""Endpoint exemptions: an end that stands nearer than the radius may be left, keeping its own distance until it is.

    d = min over the obstacles' cubes of |x − cube|        own distance of an end's exact place x
    k = min(radius, d)                                     what is kept inside the end's exemption

    open to the end, if d < radius or x is beside the ground: voxels that are not occupied, whose centres keep k, and
                                                              that are not beside the ground unless x is

An end that keeps the radius and is not beside the ground has no exemption. That of level L holds voxels open to the end
whose centres are less than L voxels from that of its own; L is the least number, up to ⌈radius⌉ + 3, with which a
face-connected way of them leads from the end to a voxel that is free at the radius: a way straight off a wall has as
many voxels within the radius as ⌈radius⌉, and three more lead around a corner. Opened are those that such a way can
reach. So an exemption depends on what is around its end alone, neither on the other end nor on the rest of the map.

**The first step.** By `planning.problem.inflation` a path through boxes between centres that keep k keeps k. An end
that is not in such a box first goes straight to one of the 27 centres around it. Along the segment x + t s, t ∈ [0, 1],
the squared distance to a cube is convex; bisection of its derivative finds where it is least, and the centre is taken
only where this keeps k to all obstacles and touches nothing that is closed to the end.

Positions are index coordinates (whole numbers at voxel centres), distances [voxels].
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer, Shaped, UInt8

from maxjax.compile.lowering import shift_axis
from maxjax.core.grid import Index3
from maxjax.fields.stencil import cell
from maxjax.planning.path.line_of_sight import TOUCH, voxels_at
from maxjax.planning.problem.ends import End, free_place
from maxjax.planning.problem.inflation import least_quarters
from maxjax.planning.problem.surroundings import BESIDE, GROUND, NOTHING, OBSTACLE, Surroundings, cubes_within

# More than float32 coordinates round, and less than the verifier allows, by far [voxels].
_ROUNDING = 0.5 * TOUCH
# A level beyond all: bytes keep the loops over levels short of memory traffic.
_NEVER = np.uint8(255)
# Halvings of a segment: what is least is then found to less than 1e-6 of a squared voxel.
_HALVINGS = 12
_AROUND = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Radius:
    """A radius to keep, up to a static one.

    Attributes:
        value: [voxels].
        least: its `least_quarters`.
        last: the largest level of an exemption.
        widest: of the radii that a program is compiled for, the largest [voxels]. Static.
    """

    value: Float[Array, ""] | float
    least: Int32[Array, ""] | int
    last: Int32[Array, ""] | int
    widest: float = dataclasses.field(metadata={"static": True})

    @classmethod
    def of(cls, radius: float) -> Radius:
        """The radius, as its own largest."""
        return cls(radius, least_quarters(radius), last_level(radius), radius)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Exemption:
    """How an end is left; batch axes lead.

    Attributes:
        place: exact place of the end, off the faces of occupied voxels.
        first: the voxel whose centre it goes to, unless it has room where it is.
        needed: whether the end stands nearer than the radius, or beside the ground.
        leaves: whether it reaches a voxel that is free at the radius.
        level: of the exemption; 0 where no voxel is opened.
        opened: voxels of a box around the end.
        corner: the box's lowest voxel.
        reach: distance from the place within which a path passes by opened voxels.
        local: whether all that it depends on lies within the grid, so that a larger map would not change it.
    """

    place: Float[Array, "*batch 3"]
    first: Int32[Array, "*batch 3"]
    needed: Bool[Array, "*batch"]
    leaves: Bool[Array, "*batch"]
    level: Int32[Array, "*batch"]
    opened: Bool[Array, "*batch bx by bz"]
    corner: Int32[Array, "*batch 3"]
    reach: Float[Array, "*batch"]
    local: Bool[Array, "*batch"]

    def open_in(self, blocked: Bool[Array, "nx ny nz"]) -> Bool[Array, "nx ny nz"]:
        """Blocked voxels without those that one end opens."""
        box = lax.dynamic_slice(blocked, self.corner, self.opened.shape)
        return lax.dynamic_update_slice(blocked, box & ~self.opened, self.corner)


def last_level(radius: float) -> int:
    """The largest level of an exemption at a radius [voxels]: 0 at radius 0, where nothing needs one."""
    return min(math.ceil(radius) + 3, int(_NEVER) - 1) if radius > 0 else 0


@jax.named_scope("exemption")
def exemption(around: Surroundings, end: End, radius: Radius) -> Exemption:
    """The exemption of an end; `jit`- and `vmap`-safe."""
    place = free_place(around.occupied, end.exact)
    kind, centres = _cubes(around, end.index, cubes_within(radius.widest))
    own = jnp.sqrt(jnp.min(jnp.where(kind == OBSTACLE, _squared(place[:, None] - centres), jnp.inf)))
    kept = jnp.maximum(jnp.minimum(radius.value, own) - _ROUNDING, 0.0)
    _, at = voxels_at(around.kind.shape, place + around.halo)
    beside = jnp.any(around.kind[at] == BESIDE)
    needed = (beside & (jnp.asarray(radius.value) > 0)) | (own < radius.value - _ROUNDING)

    closed = jnp.where(beside, kind > BESIDE, kind > NOTHING)
    least = jnp.where(closed, _ROUNDING, 0.0)
    least = jnp.where(kind == OBSTACLE, jnp.maximum(least, kept), least)
    targets = end.index + _AROUND
    passes = _keeps(place, targets, centres, least)

    box, corner = _box(around.inflated, end.index, last_level(radius.widest))
    levels = _levels(around, end.index, corner, box, radius)
    quarters = lax.dynamic_slice(around.quarters, corner, box)
    own_kind = lax.dynamic_slice(around.kind, corner + around.halo, box)
    keeps = needed & (quarters >= 4 * kept**2) & (beside | (own_kind != BESIDE))
    levels = jnp.where((levels == 0) | keeps, levels, _NEVER)
    free = levels == 0

    outwards = _least_levels(levels, jnp.where(free, np.uint8(0), _NEVER), jnp.zeros_like(free))
    i, j, k = jnp.clip(targets - corner, 0, np.array(box) - 1).T
    inside = jnp.all((targets >= corner) & (targets < corner + np.array(box)), axis=1)
    found = jnp.where(passes & inside, outwards[i, j, k], _NEVER)
    level = jnp.min(found).astype(jnp.int32)
    first = targets[jnp.argmin(jnp.where(found == level, _squared((targets - place).T), jnp.inf))]
    leaves = level <= radius.last
    reached = _least_levels(levels, jnp.where(cell(box, first - corner), levels, _NEVER), free)
    opened = leaves & ~free & (reached <= level)
    reach = _reach(opened, corner, quarters < radius.least, place)
    level = jnp.where(leaves, level, 0)
    return Exemption(
        place,
        first,
        needed,
        leaves,
        level,
        opened,
        corner,
        reach,
        _is_local(around, end.index, (kind, centres), first, level),
    )


def exemptions(around: Surroundings, ends: End, radius: Radius) -> Exemption:
    """Those of several ends, by one program."""
    return jax.vmap(exemption, (None, 0, None))(around, ends, radius)


def open_exemptions(blocked: Bool[Array, "nx ny nz"], both: Exemption) -> Bool[Array, "nx ny nz"]:
    """Blocked voxels without those that the ends open."""
    for end in range(2):
        blocked = jax.tree.map(lambda x, end=end: x[end], both).open_in(blocked)
    return blocked


@functools.cache
def radii_below(radius: float) -> tuple[float, ...]:
    """Distances of centres from cubes that are less than a radius, largest first, and 0 [voxels]."""
    odd = [0, *((2 * k - 1) ** 2 for k in range(1, math.ceil(radius) + 2))]
    sums = {a + b + c for a in odd for b in odd for c in odd}
    return tuple(math.sqrt(q) / 2 for q in sorted(sums, reverse=True) if 0 <= q < least_quarters(radius))


def _box(volume: Shaped[Array, "nx ny nz"], index: Int32[Array, " 3"], half: int) -> tuple[Index3, Int32[Array, " 3"]]:
    """Shape and lowest voxel of a box around a voxel, pushed back into the volume."""
    nx, ny, nz = (min(2 * half + 1, n) for n in volume.shape)
    return (nx, ny, nz), jnp.clip(index - half, 0, np.array(volume.shape) - np.array([nx, ny, nz]))


def _cubes(
    around: Surroundings, index: Int32[Array, " 3"], half: int
) -> tuple[Integer[Array, " cubes"], Float[Array, "3 cubes"]]:
    """Kinds and centres of the voxels around a voxel, halo included."""
    box, corner = _box(around.kind, index + around.halo, half)
    kind = lax.dynamic_slice(around.kind, corner, box).reshape(-1)
    centres = corner[:, None] - around.halo + np.indices(box).reshape(3, -1)
    return kind, centres.astype(jnp.float32)


def _squared(offset: Float[Array, "3 ..."]) -> Float[Array, "..."]:
    """Squared distance to a cube of a point at an offset from its centre."""
    return jnp.sum(jnp.maximum(jnp.abs(offset) - 0.5, 0.0) ** 2, axis=0)


def _keeps(
    place: Float[Array, " 3"],
    targets: Int32[Array, "n 3"],
    centres: Float[Array, "3 cubes"],
    least: Float[Array, " cubes"],
) -> Bool[Array, " n"]:
    """Whether the segments from a place to some targets keep a least distance to each cube."""
    offset, step = (place[:, None] - centres)[:, None], (targets - place).T[:, :, None]

    def halve(_: Int32[Array, ""], bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bounds
        middle = 0.5 * (low + high)
        u = offset + middle * step
        rises = jnp.sum(jnp.maximum(jnp.abs(u) - 0.5, 0.0) * jnp.sign(u) * step, axis=0) > 0
        return jnp.where(rises, low, middle), jnp.where(rises, middle, high)

    nothing = jnp.zeros((len(targets), centres.shape[1]))
    bounds = lax.fori_loop(0, _HALVINGS, halve, (nothing, nothing + 1))
    nearest = functools.reduce(jnp.minimum, (_squared(offset + t * step) for t in bounds))
    return jnp.all(nearest >= least**2, axis=1)


def _levels(
    around: Surroundings, index: Int32[Array, " 3"], corner: Int32[Array, " 3"], box: Index3, radius: Radius
) -> UInt8[Array, "bx by bz"]:
    """Levels at which voxels of a box are opened, if at all; 0 where they are free at the radius."""
    squared = sum((corner[axis] + lax.broadcasted_iota(jnp.int32, box, axis) - index[axis]) ** 2 for axis in range(3))
    steps = np.arange(1, last_level(radius.widest) + 1)
    level = 1 + jnp.sum(jnp.asarray(squared)[..., None] >= steps**2, axis=-1, dtype=jnp.uint8)
    held = lax.dynamic_slice(around.occupied, corner, box)
    blocked = lax.dynamic_slice(around.inflated, corner, box)
    return jnp.where(blocked, jnp.where(held | (level > radius.last), _NEVER, level), np.uint8(0))


def _least_levels(
    levels: UInt8[Array, "bx by bz"], seeds: UInt8[Array, "bx by bz"], stops: Bool[Array, "bx by bz"]
) -> UInt8[Array, "bx by bz"]:
    """The least level with which a voxel is reached: that of the highest voxel on the lowest way to it.

    Args:
        levels: of the voxels.
        seeds: levels at which ways may begin.
        stops: voxels that a way may reach, but not pass.
    """

    def grow(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        before, _ = carry
        passing = jnp.where(stops, _NEVER, before)
        near = [shift_axis(passing, axis, step, int(_NEVER)) for axis in range(3) for step in (1, -1)]
        after = jnp.minimum(before, jnp.maximum(levels, functools.reduce(jnp.minimum, near)))
        return after, jnp.any(after < before)

    # Voxels that are stops may be seeds.
    first = jnp.where(stops, seeds, jnp.maximum(seeds, levels))
    found, _ = lax.while_loop(lambda carry: carry[1], grow, (first, jnp.any(first < _NEVER)))
    return found


def _reach(
    opened: Bool[Array, "bx by bz"],
    corner: Int32[Array, " 3"],
    near: Bool[Array, "bx by bz"],
    place: Float[Array, " 3"],
) -> Float[Array, ""]:
    """How far from a place a path may be that passes by opened voxels; 0 where there are none.

    Near an obstacle a path comes by the corners of the cell that it is in, so that all cells around an opened voxel
    count that is `near` one; of one that lies beside the ground the voxel alone.
    """
    half = jnp.where(near, 1.0, 0.5)
    offsets = (corner[axis] + lax.broadcasted_iota(jnp.int32, opened.shape, axis) - place[axis] for axis in range(3))
    farthest = sum((jnp.abs(offset) + half) ** 2 for offset in offsets)
    return jnp.sqrt(jnp.max(jnp.where(opened, farthest, 0.0)))


def _is_local(
    around: Surroundings,
    index: Int32[Array, " 3"],
    cubes: tuple[Integer[Array, " cubes"], Float[Array, "3 cubes"]],
    first: Int32[Array, " 3"],
    level: Int32[Array, ""],
) -> Bool[Array, ""]:
    """Whether nothing beyond the grid could change an exemption, which begins in a voxel and has this level.

    What is seen to be occupied there, as the ground below a window, could not.
    """
    shape, reach = np.array(around.inflated.shape), jnp.maximum(level - 1, 1)
    kind, centres = cubes
    offsets = jnp.max(jnp.abs(centres - index[:, None]), axis=0)
    beyond = jnp.any((centres < 0) | (centres >= shape[:, None]), axis=0)
    seen = jnp.max(offsets) >= reach
    closed = seen & ~jnp.any(beyond & (offsets <= reach) & (kind < GROUND))
    within = jnp.all((index >= reach) & (index < shape - reach))
    return within | closed | (jnp.all(first == index) & (level <= 1))
