"""Detections: from a cluster of returns to sets for the middle and the faces of its body.

A body with a middle (its mirror image in it is itself) reaches from l⁻ to l⁺ along any direction; its middle is
(l⁻ + l⁺) / 2. What is seen bounds both along the line of sight and across it (`sighted`). The set of the middle is the
box around that in world axes, within the one of the axes' own points and extents. It is widened by noise, pose error,
and the time over which the returns were measured. The lowest and the highest coordinate along each world axis have sets
of their own (`_marked`).

It is a set at the middle of that time, `age` before the scan's end. A cluster larger than a body can be is of several
bodies, or breaks the assumption: then the set is of the middle of any body of which a point is in it.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from maxjax.compile.lowering import rotate
from maxjax.sim.movers.body_marks import Marks
from maxjax.sim.movers.cluster_extents import BeamFrames, Group, cluster_extents
from maxjax.sim.movers.clusters import Clusters
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Scan, cast_at, directions

_SIGMAS = 4.0
# Rounding of coordinates [m].
_ROUNDING = 2e-3


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Detections:
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


def detect_bodies(
    clusters: Clusters, scan: Scan, position: Float[Array, "3"], rotation: Float[Array, "3 3"], sight: TrackingSettings
) -> Detections:
    """The body behind each cluster.

    Args:
        clusters: of the scan's returns.
        scan: its distances.
        position: of the sensor, world frame [m].
        rotation: sensor frame -> world frame.
        sight: settings. Static.
    """
    group = Group(clusters.cluster, sight.detections)
    distance = jnp.where(clusters.cluster < sight.detections, scan.distance[clusters.ray], 0.0)
    points = distance[:, None] * directions(sight.lidar)[clusters.ray]
    ages = (-cast_at(sight.lidar, jnp.zeros(())))[clusters.ray % sight.lidar.columns]
    youngest, oldest = group.least(ages), group.greatest(ages)
    along = cluster_extents(clusters, group, points, scan, rotation, sight)
    low, high = along.middles()

    # In world axes.
    origin = position + rotate(rotation, along.middle)
    world = position + rotate(rotation, points)
    seen = group.least(world), group.greatest(world)
    noise = _SIGMAS * sight.lidar.range_noise + sight.pose_error + _ROUNDING
    large = jnp.any(seen[1] - seen[0] > sight.bounds.edges + 2.0 * noise, axis=1)
    widened = (noise + 0.5 * sight.bounds.speed * (oldest - youngest))[:, None]
    middle = _narrowed(seen, _box(origin, along.to_world, low, high), large, sight)
    lines = along.lines()
    marks = _marked(
        (middle[0] - widened, middle[1] + widened), lines, jnp.where(large[:, None], jnp.inf, widened), seen, sight
    )
    place, spread = along.estimate((low, high))
    variance = rotate(along.to_world**2, spread**2 + sight.lidar.range_noise**2)
    size = sight.bounds.edges
    return Detections(
        used=clusters.used,
        marks=marks,
        half=0.5 * jnp.where(large[:, None], jnp.maximum(size, seen[1] - seen[0]), size),
        large=large & clusters.used,
        place=origin + rotate(along.to_world, place),
        variance=variance + widened**2 / 16.0,
        seen_low=seen[0],
        seen_high=seen[1],
        age=0.5 * (youngest + oldest),
        count=clusters.count.astype(jnp.float32),
    )


def _narrowed(
    seen: tuple[Array, Array], across: tuple[Array, Array], large: Bool[Array, " d"], sight: TrackingSettings
) -> tuple[Float[Array, "d 3"], Float[Array, "d 3"]]:
    """The box of a middle by the world's axes alone, within the one across the line of sight where they meet."""
    size, one = sight.bounds.edges, ~large[:, None]
    low = jnp.where(one, seen[1], seen[0]) - 0.5 * size
    high = jnp.where(one, seen[0], seen[1]) + 0.5 * size
    narrow_low, narrow_high = jnp.maximum(low, across[0]), jnp.minimum(high, across[1])
    narrow = one & jnp.all(narrow_low <= narrow_high, axis=1, keepdims=True)
    return (
        jnp.where(narrow, narrow_low, jnp.minimum(low, high)),
        jnp.where(narrow, narrow_high, jnp.maximum(low, high)),
    )


def _box(
    origin: Float[Array, "d 3"], to_world: Float[Array, "d 3 3"], low: Float[Array, "d 3"], high: Float[Array, "d 3"]
) -> tuple[Float[Array, "d 3"], Float[Array, "d 3"]]:
    """The box in world axes around one in others."""
    middle = origin + rotate(to_world, 0.5 * (low + high))
    half = rotate(jnp.abs(to_world), 0.5 * (high - low))
    return middle - half, middle + half


def _marked(
    middle: tuple[Array, Array],
    lines: BeamFrames,
    widened: Float[Array, "d 1"],
    seen: tuple[Array, Array],
    sight: TrackingSettings,
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
