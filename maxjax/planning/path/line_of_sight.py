"""Line of sight: does a straight segment stay in free voxels, and how far from the blocked ones?

A point sees the voxels whose cubes the box  x ± room  meets. `room` is one of

    0     the point alone, faces included: a path may run along a wall, but never through it;
    1/2   an open box of one voxel: the corners of the *dual cell* (its corners are voxel centres) that holds the point,
          on a plane or a line of voxel centres only those on it. So a straight line through the centres of a corridor
          one voxel wide is clear, and whatever is clear keeps half a voxel from every blocked voxel along some axis.

The segment is cut into slabs along its longest axis: half a voxel thick without room, whole dual cells with it. Inside
a slab the two other coordinates change by at most the slab's thickness, so the segment meets a span of at most 2 x 2
voxels there (3 x 3 in two layers with room); it is clear when every span is free. The span covers the exact set of
voxels (it holds a few more where the segment crosses both other coordinates in the same slab), hence a clear segment is
clear in exact arithmetic too, and no corner is ever cut. Every slab costs one look-up, of `Sight.codes`: bits that say,
for each voxel and axis, which of the spans that start there are free.

Positions are index coordinates (whole numbers at voxel centres). Voxels outside the grid count as blocked.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Shaped, UInt

from maxjax.compile.lowering import every, materialise, shift_axis, total

# Rounding of float32 coordinates of a few hundred is far below this, and what matters in flight far above it [voxels].
# Without room, a segment closer than this to the face of a voxel touches the voxel on the other side, too. With room it
# is taken inwards, or centres of voxels would leave their corridor by rounding: a path keeps half a voxel − 2 TOUCH.
TOUCH = 2.5e-4

# The two other axes, in the order in which the codes store their extents.
_OTHERS = ((1, 2), (0, 2), (0, 1))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Sight:
    """Tables in which lines of sight are looked up.

    Attributes:
        codes: w is the width of the widest span, 2 without room and 3 with it. Bit w² a + w i + j of a voxel is set
            when the (1+i) x (1+j) span across axis a that starts there is not free; with room in this layer or in the
            next one along a, and then bit 27 is set when the voxel itself is not free.
        room: half a box's width. Static.
    """

    codes: UInt[Array, "nx ny nz"]
    room: float = dataclasses.field(metadata={"static": True})


def sight_of(blocked: Bool[Array, "nx ny nz"], room: float = 0.0) -> Sight:
    """The codes of a map. `room` is 0 or 1/2 and static."""
    if room not in (0, 0.5):
        raise ValueError(f"sight: expected room 0 or 0.5, given {room!r}")
    width = 3 if room else 2

    def widen(mask: UInt[Array, "nx ny nz"], axis: int, bits: int) -> UInt[Array, "nx ny nz"]:
        """Codes of `bits` bits for spans of one, two, … voxels along an axis. Beyond the grid is blocked."""
        found = span = mask
        for k in range(1, width):
            span = span | shift_axis(mask, axis, k, beyond=(1 << bits) - 1)
            found |= span << (bits * k)
        return found

    itself = blocked.astype(jnp.uint16)
    codes = itself.astype(jnp.uint32) << 27 if room else jnp.zeros_like(itself)
    for axis, (first, second) in enumerate(_OTHERS):
        layers = itself | shift_axis(itself, axis, 1, beyond=1) if room else itself
        rows = widen(layers, second, 1)
        spans = widen(materialise(rows) if room else rows, first, width)
        codes |= spans.astype(codes.dtype) << (width**2 * axis)
    return Sight(codes, room)


def _reach(room: float) -> float:
    """Voxels k with |k − x| ≤ 1/2 + reach are met."""
    return room - TOUCH if room else TOUCH


def voxels_at(
    shape: tuple[int, ...], x: Float[Array, " 3"], room: float = 0.0
) -> tuple[Bool[Array, ""], tuple[Int32[Array, "..."], Int32[Array, "..."], Int32[Array, "..."]]]:
    """The voxels that a point meets: whether all are inside the grid, and an index to a (2, 2, 2) array of them.

    Where the point meets one voxel along an axis, the array holds it twice. `shape` and `room` are static.
    """
    limits = jnp.asarray(shape, jnp.int32)
    low = jnp.floor(x + 0.5 - _reach(room)).astype(jnp.int32)
    high = jnp.floor(x + 0.5 + _reach(room)).astype(jnp.int32)
    inside = jnp.all(jnp.isfinite(x) & (low >= 0) & (high < limits))
    i, j, k = jnp.clip(jnp.stack([low, high], axis=1), 0, limits[:, None] - 1)
    return inside, (i[:, None, None], j[None, :, None], k[None, None, :])


def stands_free(blocked: Bool[Array, "nx ny nz"], x: Float[Array, " 3"], room: float = 0.0) -> Bool[Array, ""]:
    """Whether every voxel that the point meets is inside the grid and free. `room` is static."""
    inside, at = voxels_at(blocked.shape, x, room)
    return inside & ~jnp.any(blocked[at])


@dataclasses.dataclass(frozen=True)
class _Segments:
    """Segments with their coordinates in another order: the longest axis first and upwards, then the others.

    Attributes:
        low, high: ends, by coordinate.
        strides, limits: of the grid, by coordinate.
        longest: axis.
        first, last: slabs.
        alone: whether the segment is one voxel's centre. False without room.
    """

    low: list[Float[Array, "*k 1"]]
    high: list[Float[Array, "*k 1"]]
    strides: list[Int32[Array, "*k 1"]]
    limits: list[Int32[Array, "*k 1"]]
    longest: Int32[Array, "*k 1"]
    first: Int32[Array, "*k 1"]
    last: Int32[Array, "*k 1"]
    alone: Bool[Array, "*k 1"] | None

    @property
    def slabs(self) -> Int32[Array, "*k 1"]:
        return self.last - self.first + 1

    @property
    def run(self) -> Float[Array, "*k 1"]:
        """Length along the longest axis, 1 for a point."""
        length = self.high[0] - self.low[0]
        return jnp.where(length > 0, length, 1.0)

    def slope(self, k: int) -> Float[Array, "*k 1"]:
        """Of coordinate k by that along the longest axis."""
        return (self.high[k] - self.low[k]) / self.run


def _segments(shape: tuple[int, ...], room: float, a: Float[Array, "*#k 3"], b: Float[Array, "*#k 3"]) -> _Segments:
    _, ny, nz = shape
    reach = _reach(room)
    extent = jnp.abs(b - a)
    if room:
        # A segment that is hardly longer than the tolerance may lie in a plane of voxel centres: what counts is then an
        # axis along which it meets two voxels.
        low, high = jnp.floor(jnp.minimum(a, b) + 0.5 - reach), jnp.floor(jnp.maximum(a, b) + 0.5 + reach)
        extent = jnp.where(jnp.max(extent, axis=-1, keepdims=True) > 3 * TOUCH, extent, high - low)
    dx, dy, dz = jnp.moveaxis(extent, -1, 0)
    longest = jnp.where((dx >= dy) & (dx >= dz), 0, jnp.where(dy >= dz, 1, 2))
    order = jnp.asarray([(axis, *others) for axis, others in enumerate(_OTHERS)])[longest]
    rows = 3 * np.arange(longest.size).reshape(longest.shape)

    def order_axes(values: Shaped[Array | np.ndarray, "*#k 3"]) -> list[Shaped[Array, "*k 1"]]:
        """The longest axis first, then the two others in the order of the codes; with an axis for slabs."""
        flat = jnp.broadcast_to(values, (*longest.shape, 3)).reshape(-1)
        return [flat[(rows + order[..., k])[..., None]] for k in range(3)]

    start, end = order_axes(a), order_axes(b)
    flip = end[0] < start[0]
    lows = [jnp.where(flip, v, u) for u, v in zip(start, end, strict=True)]
    highs = [jnp.where(flip, u, v) for u, v in zip(start, end, strict=True)]
    strides, limits = order_axes(np.array([ny * nz, nz, 1])), order_axes(np.array(shape))
    first = jnp.floor(lows[0] + 0.5 - reach).astype(jnp.int32)
    last = jnp.floor(highs[0] + 0.5 + reach).astype(jnp.int32)
    alone = last == first if room else None
    if room:
        # Slab m lies between the layers m and m + 1.
        last = jnp.maximum(last - 1, first)
    return _Segments(lows, highs, strides, limits, longest[..., None], first, last, alone)


def _parts(room: float) -> int:
    """Parts that a slab is cut into."""
    return 1 if room else 2


def _along(
    s: _Segments, begin: Float[Array, "*k h"], end: Float[Array, "*k h"]
) -> tuple[Float[Array, "*k h"], Float[Array, "*k h"]]:
    """Where segments enter and leave the space between two coordinates of their longest axis, from their low end."""
    return jnp.clip(begin, s.low[0], s.high[0]) - s.low[0], jnp.clip(end, s.low[0], s.high[0]) - s.low[0]


def _hits(sight: Sight, s: _Segments, part: Int32[Array | np.ndarray, " h"]) -> Bool[Array, "*k h"]:
    """Whether parts of slabs, counted from the first one, meet voxels that are not free."""
    parts, reach = _parts(sight.room), _reach(sight.room)
    slab = s.first + part // parts
    # With room a slab is covered without its planes, whose layers belong to the slabs on both of their sides.
    spare = 0.0 if sight.room else TOUCH
    begin = slab + ((part % parts) / parts + sight.room - 0.5).astype(s.low[0].dtype)
    enter, leave = _along(s, begin - spare, begin + 1 / parts + spare)
    width = 3 if sight.room else 2
    flat, variant = slab * s.strides[0], width**2 * s.longest
    inside = (s.first >= 0) & (s.last < s.limits[0])
    for k, weight in ((1, width), (2, 1)):
        u, v = s.low[k] + s.slope(k) * enter, s.low[k] + s.slope(k) * leave
        floor = jnp.floor(jnp.minimum(u, v) + 0.5 - reach).astype(jnp.int32)
        ceil = jnp.floor(jnp.maximum(u, v) + 0.5 + reach).astype(jnp.int32)
        inside &= (slab > s.last) | ((floor >= 0) & (ceil < s.limits[k]))
        flat, variant = flat + floor * s.strides[k], variant + weight * (ceil - floor)
    if s.alone is not None:
        variant = jnp.where(s.alone, 27, variant)
    codes = sight.codes.reshape(-1)
    hit = (codes[jnp.clip(flat, 0, codes.size - 1)] >> variant.astype(codes.dtype)) & 1
    return (slab <= s.last) & (~inside | (hit != 0))


def _paid(
    price: Float[Array, "nx ny nz"], s: _Segments, layer: Int32[Array | np.ndarray, " h"]
) -> Float[Array, "*k h"]:
    """∫ n dx along the longest axis, within half a voxel of layers of voxels; counted from the first slab."""
    layer = s.first + layer
    enter, leave = _along(s, layer - 0.5, layer + 0.5)
    flat = [jnp.clip(layer, 0, s.limits[0] - 1) * s.strides[0]]
    weight: list[Array | float] = [leave - enter]
    for k in (1, 2):
        x = s.low[k] + s.slope(k) * (0.5 * (enter + leave))
        low = jnp.clip(jnp.floor(x).astype(jnp.int32), 0, s.limits[k] - 2)
        share = jnp.clip(x - low, 0, 1)
        flat = [at + (low + corner) * s.strides[k] for at in flat for corner in (0, 1)]
        weight = [w * part for w in weight for part in (1 - share, share)]
    prices = price.reshape(-1)
    return sum((w * prices[at] for w, at in zip(weight, flat, strict=True)), jnp.zeros(()))


def clear(
    sight: Sight, a: Float[Array, "*#k 3"], b: Float[Array, "*#k 3"], slabs: int | None = None
) -> Bool[Array, "*k"]:
    """Whether the closed segments a-b meet free voxels only.

    Args:
        sight: from `sight_of`.
        a, b: ends in index coordinates.
        slabs: slabs to cut at most along the longest axis; a longer segment is reported as not clear. Static.
    """
    slabs = max(sight.codes.shape) + 1 if slabs is None else slabs
    s = _segments(sight.codes.shape, sight.room, a, b)
    parts = _parts(sight.room)
    free = every(lambda part: ~_hits(sight, s, part), parts * slabs, parts * jnp.max(s.slabs))
    return free & (s.slabs <= slabs)[..., 0]


def clear_and_costs(
    sight: Sight,
    price: Float[Array, "nx ny nz"],
    a: Float[Array, "*#k 3"],
    b: Float[Array, "*#k 3"],
) -> tuple[Bool[Array, "*k"], Float[Array, "*k"]]:
    """`clear`, and ∫ n ds along the segments [voxels], be they clear or not.

    The segment passes layers of voxels across its longest axis. The price at the middle of its way within half a voxel
    of a layer, interpolated between the four voxels around it in the layer, stands for all of that way: the error,
    against the prices interpolated trilinearly, is at most the length times the greatest difference between
    neighbours, and of second order where the price is smooth. Beyond the grid it is that of the nearest voxel.

    Args:
        sight: from `sight_of`.
        price: n ≥ 1.
        a, b: ends in index coordinates.
    """
    slabs = max(sight.codes.shape) + 1
    s = _segments(sight.codes.shape, sight.room, a, b)
    parts = _parts(sight.room)

    def terms(number: Int32[Array | np.ndarray, " h"]) -> tuple[Array, Array]:
        return _hits(sight, s, number), _paid(price, s, number)

    # Layers are one more than dual cells.
    hits, paid = total(terms, parts * slabs + 1, parts * jnp.max(s.slabs) + 1)
    length = jnp.linalg.norm(b - a, axis=-1)
    return (hits == 0) & (s.slabs <= slabs)[..., 0], paid * length / s.run[..., 0]


def segment_costs(
    price: Float[Array, "nx ny nz"], a: Float[Array, "*#k 3"], b: Float[Array, "*#k 3"]
) -> Float[Array, "*k"]:
    """∫ n ds along segments [voxels], by the quadrature of `clear_and_costs`."""
    s = _segments(price.shape, 0.0, a, b)
    summed = total(lambda layer: _paid(price, s, layer), max(price.shape) + 1, jnp.max(s.slabs))
    return jnp.asarray(summed * jnp.linalg.norm(b - a, axis=-1) / s.run[..., 0])


def visibility(
    sight: Sight, points: Float[Array, "n 3"], price: Float[Array, "nx ny nz"] | None = None
) -> tuple[Bool[Array, "n n"], Float[Array, "n n"]]:
    """Pairwise `clear`, and the length or, with a price, ∫ n ds: the upper triangle; the rest is False, and 0."""
    # Constants of the program: computed on an accelerator, each step towards them would be a kernel.
    upper = np.triu(np.ones((points.shape[0],) * 2, bool), k=1)
    rows, columns = np.nonzero(upper)
    pair = np.maximum(np.cumsum(upper).reshape(upper.shape) - 1, 0)
    if price is None:
        seen = clear(sight, points[rows], points[columns])
        return seen[pair] & upper, jnp.where(upper, jnp.linalg.norm(points[:, None] - points[None], axis=-1), 0)
    seen, paid = clear_and_costs(sight, price, points[rows], points[columns])
    return seen[pair] & upper, jnp.where(upper, paid[pair], 0)
