"""What a cluster of returns says of the body that it is seen of: sets for its middle and its faces.

A body with a middle (its mirror image in it is itself) reaches from l⁻ to l⁺ along any direction; its middle is
(l⁻ + l⁺) / 2. Seen are points from a to b, so with the body's greatest extent E (`Bounds.size` on each axis)

    l⁻ ∈ [max(a − δ⁻, b − E), a],   l⁺ ∈ [b, min(b + δ⁺, a + E)]

Across the line of sight δ is a step between beams where the beams beside the body passed it, two where one was lost,
and unbounded where something nearer, or as near, may hide the rest. Along it δ⁻ is small, for what is seen is the
front, and δ⁺ is unbounded. The set is the box around that in world axes, within the one of the axes' own points and
extents. It is widened by noise, pose error, and the time over which the returns were measured. The lowest and the
highest coordinate along each world axis have sets of their own (`_marked`).

It is a set at the middle of that time, `age` before the scan's end. A cluster larger than a body can be is of several
bodies, or breaks the assumption: then the set is of the middle of any body of which a point is in it.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from maxjax.programs.lowering import rotated
from maxjax.sim.lidar import Lidar, Scan, cast_at, directions
from maxjax.sim.moving.clusters import Clusters
from maxjax.sim.moving.marks import Marks
from maxjax.sim.moving.range_memory import margin
from maxjax.sim.moving.sight import MoverSight
from maxjax.sim.range_image import clear_range, rise

_SIGMAS = 4.0
# Standard deviation of the middle estimated from the front [m], in addition to what follows from beams.
_DEPTH = 0.05
# Where beams say nothing of how far a body reaches [m].
_FAR = 1e3
# Rounding of coordinates [m].
_ROUNDING = 2e-3


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Visible:
    """Bodies as one scan shows them; batch axes lead.

    Attributes:
        used: whether there is one.
        marks: sets of the middle and the faces, `age` before the scan's end [m].
        half: half edges of a box around the middle that holds the body [m].
        large: whether more is seen than a body can be.
        place: best estimate of the middle [m].
        variance: of that on each axis [m²].
        seen_low, seen_high: box of the returns [m].
        age: [s].
        count: returns.
    """

    used: Bool[Array, "*batch d"]
    marks: Marks
    half: Float[Array, "*batch d 3"]
    large: Bool[Array, "*batch d"]
    place: Float[Array, "*batch d 3"]
    variance: Float[Array, "*batch d 3"]
    seen_low: Float[Array, "*batch d 3"]
    seen_high: Float[Array, "*batch d 3"]
    age: Float[Array, "*batch d"]
    count: Float[Array, "*batch d"]

    @property
    def low(self) -> Float[Array, "*batch d 3"]:
        """Least coordinates of the middle [m]."""
        return self.marks.low[..., 0, :, :]

    @property
    def high(self) -> Float[Array, "*batch d 3"]:
        """Greatest coordinates of the middle [m]."""
        return self.marks.high[..., 0, :, :]


def visible(
    clusters: Clusters, scan: Scan, position: Float[Array, "3"], rotation: Float[Array, "3 3"], sight: MoverSight
) -> Visible:
    """The body behind each cluster.

    Args:
        clusters: of the scan's returns.
        scan: its distances.
        position: of the sensor, world frame [m].
        rotation: sensor frame -> world frame.
        sight: settings. Static.
    """
    group = _Group(clusters.cluster, sight.detections)
    distance = jnp.where(clusters.cluster < sight.detections, scan.distance[clusters.ray], 0.0)
    points = distance[:, None] * directions(sight.lidar)[clusters.ray]
    middle = group.total(points) / jnp.maximum(clusters.count, 1)[:, None]
    away = jnp.maximum(jnp.linalg.norm(middle, axis=1), 1e-3)
    axes = _axes(middle, away)  # (d, 3, 3): along the line of sight, to the left, up
    ages = (-cast_at(sight.lidar, jnp.zeros(())))[clusters.ray % sight.lidar.columns]
    youngest, oldest = group.least(ages), group.greatest(ages)

    from_middle = rotated(axes[group.index], points - middle[group.index])
    a, b = group.least(from_middle), group.greatest(from_middle)
    # A body's extent along a direction: that of the box that may hold it.
    to_world = jnp.swapaxes(rotated(rotation, axes), 1, 2)
    extent = jnp.maximum(jnp.sum(sight.bounds.edges[:, None] * jnp.abs(to_world), axis=1), b - a)
    before, after = _overlooked(clusters, group, scan, sight)
    across = _steps(middle, away, sight.lidar)
    beams = (1.0 + extent[:, :1] / away[:, None]) * across
    wider = 0.5 * beams[:, ::-1] + 0.5 * (b - a)[:, 1:] / away[:, None] * extent[:, :1]
    front = jnp.max(across, axis=1, keepdims=True)
    delta_low = jnp.concatenate([0.5 * front, before * beams + wider], axis=1)
    delta_high = jnp.concatenate([jnp.full_like(front, jnp.inf), after * beams + wider], axis=1)
    low = 0.5 * (jnp.maximum(a - delta_low, b - extent) + b)
    high = 0.5 * (a + jnp.minimum(b + delta_high, a + extent))

    # In world axes.
    origin = position + rotated(rotation, middle)
    world = position + rotated(rotation, points)
    seen_low, seen_high = group.least(world), group.greatest(world)
    size = sight.bounds.edges
    seen = seen_high - seen_low
    noise = _SIGMAS * sight.lidar.range_noise + sight.pose_error + _ROUNDING
    large = jnp.any(seen > size + 2.0 * noise, axis=1)
    one = ~large[:, None]
    box_low = jnp.where(one, seen_high, seen_low) - 0.5 * size
    box_high = jnp.where(one, seen_low, seen_high) + 0.5 * size
    across_low, across_high = _box(origin, to_world, low, high)
    narrow_low, narrow_high = jnp.maximum(box_low, across_low), jnp.minimum(box_high, across_high)
    narrow = one & jnp.all(narrow_low <= narrow_high, axis=1, keepdims=True)
    widened = (noise + 0.5 * sight.bounds.speed * (oldest - youngest))[:, None]
    place, spread = _estimated(a, b, (low, high), extent, across)
    spread = jnp.where(
        jnp.concatenate([jnp.ones_like(front, bool), (before <= 2) & (after <= 2)], 1), spread, high - low
    )
    variance = rotated(to_world**2, spread**2 + sight.lidar.range_noise**2)
    marks = _marked(
        (
            jnp.where(narrow, narrow_low, jnp.minimum(box_low, box_high)) - widened,
            jnp.where(narrow, narrow_high, jnp.maximum(box_low, box_high)) + widened,
        ),
        _SightLines(
            to_world,
            away[:, None],
            extent[:, :1],
            jnp.minimum(before * beams + 0.5 * beams[:, ::-1], _FAR),
            jnp.minimum(after * beams + 0.5 * beams[:, ::-1], _FAR),
            0.5 * front,
            jnp.maximum(b, -a)[:, 1:] / away[:, None],
        ),
        jnp.where(large[:, None], jnp.inf, widened),
        (seen_low, seen_high),
        sight,
    )
    return Visible(
        used=clusters.used,
        marks=marks,
        half=0.5 * jnp.where(large[:, None], jnp.maximum(size, seen), size),
        large=large & clusters.used,
        place=origin + rotated(to_world, place),
        variance=variance + widened**2 / 16.0,
        seen_low=seen_low,
        seen_high=seen_high,
        age=0.5 * (youngest + oldest),
        count=clusters.count.astype(jnp.float32),
    )


class _Group:
    """Reductions over the returns of each cluster; of none: 0."""

    def __init__(self, cluster: Array, count: int) -> None:
        self.cluster, self.count = cluster, count
        self.index = jnp.minimum(cluster, count - 1)

    def total(self, values: Array) -> Array:
        return jax.ops.segment_sum(values, self.cluster, self.count + 1)[:-1]

    def least(self, values: Array) -> Array:
        found = jax.ops.segment_min(values, self.cluster, self.count + 1)[:-1]
        return jnp.where(jnp.isfinite(found), found, 0.0)

    def greatest(self, values: Array) -> Array:
        return -self.least(-values)


def _axes(middle: Float[Array, "d 3"], away: Float[Array, " d"]) -> Float[Array, "d 3 3"]:
    """Unit vectors along the line of sight, to the left and up, in the sensor's frame, as rows."""
    along = middle / away[:, None]
    level = jnp.hypot(middle[:, 0], middle[:, 1])
    known = level > 1e-6 * away
    inverse = jnp.where(known, 1.0 / jnp.where(known, level, 1.0), 0.0)
    left = jnp.stack([-middle[:, 1] * inverse, jnp.where(known, middle[:, 0] * inverse, 1.0), jnp.zeros_like(level)], 1)
    return jnp.stack([along, left, jnp.cross(along, left)], axis=1)


def _steps(middle: Float[Array, "d 3"], away: Float[Array, " d"], lidar: Lidar) -> Float[Array, "d 2"]:
    """Distances between beams at a place [m]: sideways, up."""
    level = jnp.hypot(middle[:, 0], middle[:, 1])
    return jnp.stack([level * (2.0 * np.pi / lidar.columns), away * rise(lidar)], axis=1)


def _overlooked(
    clusters: Clusters, group: _Group, scan: Scan, sight: MoverSight
) -> tuple[Float[Array, "d 2"], Float[Array, "d 2"]]:
    """Steps between beams that a body may reach beyond what is seen: right and below, left and above; or infinity."""
    lidar = sight.lidar
    row, column = clusters.ray // lidar.columns, clusters.ray % lidar.columns
    clear = clear_range(scan, lidar).reshape(-1)
    own = scan.distance[clusters.ray]
    of = jnp.full(lidar.rays, -1).at[clusters.ray].max(jnp.where(clusters.cluster < group.count, clusters.cluster, -1))

    def beside(rows: int, columns: int) -> Array:
        i, j = row + rows, (column + columns) % lidar.columns
        inside = (i >= 0) & (i < lidar.channels)
        other = jnp.clip(i, 0, lidar.channels - 1) * lidar.columns + j
        passed = inside & (clear[other] > own + margin(own, sight))
        steps = jnp.where(passed, jnp.where(scan.distance[other] < jnp.inf, 1.0, 2.0), jnp.inf)
        steps = jnp.where(inside & (of[other] == clusters.cluster), 0.0, steps)
        return jax.ops.segment_max(steps, clusters.cluster, group.count + 1)[:-1]

    before = jnp.stack([beside(0, -1), beside(-1, 0)], axis=1)
    after = jnp.stack([beside(0, 1), beside(1, 0)], axis=1)
    return jnp.maximum(before, 0.0), jnp.maximum(after, 0.0)


def _box(
    origin: Float[Array, "d 3"], to_world: Float[Array, "d 3 3"], low: Float[Array, "d 3"], high: Float[Array, "d 3"]
) -> tuple[Float[Array, "d 3"], Float[Array, "d 3"]]:
    """The box in world axes around one in others."""
    middle = origin + rotated(to_world, 0.5 * (low + high))
    half = rotated(jnp.abs(to_world), 0.5 * (high - low))
    return middle - half, middle + half


@dataclasses.dataclass(frozen=True)
class _SightLines:
    """How a body is seen from where the sensor stands.

    Attributes:
        to_world: from along the line of sight, left and up.
        away: distance [m].
        depth: extent along the line of sight at most [m].
        before, after: how far the body may reach beyond what is seen: right and below, left and above [m].
        front: how much nearer than seen it may reach [m].
        angle: of what is seen, to each side of the line of sight [rad].
    """

    to_world: Float[Array, "d 3 3"]
    away: Float[Array, "d 1"]
    depth: Float[Array, "d 1"]
    before: Float[Array, "d 2"]
    after: Float[Array, "d 2"]
    front: Float[Array, "d 1"]
    angle: Float[Array, "d 2"]


def _marked(
    middle: tuple[Array, Array],
    lines: _SightLines,
    widened: Float[Array, "d 1"],
    seen: tuple[Array, Array],
    sight: MoverSight,
) -> Marks:
    """Sets of the middle, the lowest and the highest coordinate along each world axis [m].

    A point of the body is seen, up to beams, or hidden behind one that is, by the body's depth at most along a ray u:
    beyond what is seen along a direction n lies at most depth · max(0, n · u). So nothing is hidden of a face that
    looks at the sensor. Noise is along rays, so that of a face across them is none.
    """
    along, aside = lines.to_world[..., 0], lines.to_world[..., 1:]
    angle = jnp.sum(jnp.abs(aside) * lines.angle[:, None], axis=-1)
    further = jnp.sum(jnp.abs(aside) * (jnp.maximum(lines.before, lines.after) / lines.away)[:, None], axis=-1)
    noise = widened - _SIGMAS * sight.lidar.range_noise * (1.0 - jnp.minimum(jnp.abs(along) + angle, 1.0))

    def beyond(sign: float) -> Array:
        left_up, right_down = jnp.maximum(sign * aside, 0.0), jnp.maximum(-sign * aside, 0.0)
        lateral = jnp.sum(left_up * lines.after[:, None] + right_down * lines.before[:, None], axis=-1)
        return lateral + jnp.abs(along) * lines.front + lines.depth * jnp.maximum(sign * along + angle + further, 0.0)

    size, (low, high) = sight.bounds.edges, seen
    lowest = jnp.minimum(jnp.maximum(low - beyond(-1.0), high - size), low)
    highest = jnp.maximum(jnp.minimum(high + beyond(1.0), low + size), high)
    return Marks(
        jnp.stack([middle[0], lowest - noise, high - noise]), jnp.stack([middle[1], low + noise, highest + noise])
    )


def _estimated(
    a: Array, b: Array, sets: tuple[Array, Array], extent: Array, across: Float[Array, "d 2"]
) -> tuple[Float[Array, "d 3"], Float[Array, "d 3"]]:
    """Likely middle from its returns, and its standard deviation: as deep as it is wide."""
    width = (b - a)[:, 1:] + across
    deep = jnp.clip(0.25 * jnp.sum(width, axis=1), 0.0, 0.5 * extent[:, 0])
    place = jnp.concatenate([(a[:, 0] + deep)[:, None], 0.5 * (a + b)[:, 1:]], axis=1)
    step = jnp.concatenate([0.5 * jnp.mean(across, axis=1, keepdims=True), across], axis=1)
    return jnp.clip(place, sets[0], jnp.maximum(*sets)), step / np.sqrt(12.0) + _DEPTH * np.array([1.0, 0.0, 0.0])
