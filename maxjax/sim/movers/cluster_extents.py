"""A cluster of returns along its line of sight, to the left and up: what is seen of a body, and where its middle is.

Seen are points from a to b, so with the body's greatest extent E along each direction

    l⁻ ∈ [max(a − δ⁻, b − E), a],   l⁺ ∈ [b, min(b + δ⁺, a + E)],   middle = (l⁻ + l⁺) / 2

Across the line of sight δ is a step between beams where the beams beside the body passed it, two where one was lost,
and unbounded where something nearer, or as near, may hide the rest. Along it δ⁻ is small, for what is seen is the
front, and δ⁺ is unbounded.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from maxjax.compile.lowering import rotate
from maxjax.sim.movers.clusters import Clusters
from maxjax.sim.movers.range_memory import margin
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Lidar, Scan
from maxjax.sim.sensors.range_image import clear_range, rise

# Standard deviation of the middle estimated from the front [m], in addition to what follows from beams.
_DEPTH = 0.05
# Where beams say nothing of how far a body reaches [m].
_FAR = 1e3


@dataclasses.dataclass(frozen=True)
class BeamFrames:
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


@dataclasses.dataclass(frozen=True)
class ClusterExtents:
    """Extents of each body along its line of sight, to the left of it and up [m].

    Attributes:
        middle: of the returns, in the sensor's frame.
        away: its distance.
        to_world: from these axes to the world's.
        a, b: least and greatest coordinates of the returns, from that middle.
        extent: of a body at most, E.
        across: between beams, where the body is: sideways, up.
        before, after: steps between beams that it may reach beyond what is seen: right and below, left and above.
    """

    middle: Float[Array, "d 3"]
    away: Float[Array, " d"]
    to_world: Float[Array, "d 3 3"]
    a: Float[Array, "d 3"]
    b: Float[Array, "d 3"]
    extent: Float[Array, "d 3"]
    across: Float[Array, "d 2"]
    before: Float[Array, "d 2"]
    after: Float[Array, "d 2"]

    @property
    def beams(self) -> Float[Array, "d 2"]:
        """Between beams at the far end of the body."""
        return (1.0 + self.extent[:, :1] / self.away[:, None]) * self.across

    @property
    def front(self) -> Float[Array, "d 1"]:
        """Between beams, the greater of both ways."""
        return jnp.max(self.across, axis=1, keepdims=True)

    def middles(self) -> tuple[Float[Array, "d 3"], Float[Array, "d 3"]]:
        """Least and greatest coordinates that the middle of a body may have."""
        a, b, extent, beams = self.a, self.b, self.extent, self.beams
        wider = 0.5 * beams[:, ::-1] + 0.5 * (b - a)[:, 1:] / self.away[:, None] * extent[:, :1]
        delta_low = jnp.concatenate([0.5 * self.front, self.before * beams + wider], axis=1)
        delta_high = jnp.concatenate([jnp.full_like(self.front, jnp.inf), self.after * beams + wider], axis=1)
        low = 0.5 * (jnp.maximum(a - delta_low, b - extent) + b)
        return low, 0.5 * (a + jnp.minimum(b + delta_high, a + extent))

    def lines(self) -> BeamFrames:
        """How a body is seen from where the sensor stands."""
        beams, away = self.beams, self.away[:, None]
        return BeamFrames(
            self.to_world,
            away,
            self.extent[:, :1],
            jnp.minimum(self.before * beams + 0.5 * beams[:, ::-1], _FAR),
            jnp.minimum(self.after * beams + 0.5 * beams[:, ::-1], _FAR),
            0.5 * self.front,
            jnp.maximum(self.b, -self.a)[:, 1:] / away,
        )

    def estimate(self, sets: tuple[Array, Array]) -> tuple[Float[Array, "d 3"], Float[Array, "d 3"]]:
        """Likely middle within its sets, and its standard deviation; where beams say nothing, the width of the set."""
        a, b, across = self.a, self.b, self.across
        # As deep as it is wide.
        deep = jnp.clip(0.25 * jnp.sum((b - a)[:, 1:] + across, axis=1), 0.0, 0.5 * self.extent[:, 0])
        place = jnp.concatenate([(a[:, 0] + deep)[:, None], 0.5 * (a + b)[:, 1:]], axis=1)
        step = jnp.concatenate([0.5 * jnp.mean(across, axis=1, keepdims=True), across], axis=1)
        spread = step / np.sqrt(12.0) + _DEPTH * np.array([1.0, 0.0, 0.0])
        bounded = jnp.concatenate([jnp.ones_like(self.front, bool), (self.before <= 2) & (self.after <= 2)], 1)
        return jnp.clip(place, sets[0], jnp.maximum(*sets)), jnp.where(bounded, spread, sets[1] - sets[0])


def cluster_extents(
    clusters: Clusters, group: Group, points: Array, scan: Scan, rotation: Array, sight: TrackingSettings
) -> ClusterExtents:
    """The clusters of returns at these points of the sensor's frame."""
    middle = group.total(points) / jnp.maximum(clusters.count, 1)[:, None]
    away = jnp.maximum(jnp.linalg.norm(middle, axis=1), 1e-3)
    axes = _axes(middle, away)  # (d, 3, 3): along the line of sight, to the left, up
    from_middle = rotate(axes[group.index], points - middle[group.index])
    a, b = group.least(from_middle), group.greatest(from_middle)
    to_world = jnp.swapaxes(rotate(rotation, axes), 1, 2)
    # A body's extent along a direction: that of the box that may hold it.
    extent = jnp.maximum(jnp.sum(sight.bounds.edges[:, None] * jnp.abs(to_world), axis=1), b - a)
    return ClusterExtents(
        middle,
        away,
        to_world,
        a,
        b,
        extent,
        _steps(middle, away, sight.lidar),
        *_overlooked(clusters, group, scan, sight),
    )


class Group:
    """Reductions over the returns of each cluster; of none: 0."""

    def __init__(self, cluster: Array, count: int) -> None:
        self.cluster, self.count = cluster, count
        self.index = jnp.minimum(cluster, count - 1)

    def total(self, values: Array) -> Array:
        """Sums."""
        return jax.ops.segment_sum(values, self.cluster, self.count + 1)[:-1]

    def least(self, values: Array) -> Array:
        """Least values."""
        found = jax.ops.segment_min(values, self.cluster, self.count + 1)[:-1]
        return jnp.where(jnp.isfinite(found), found, 0.0)

    def greatest(self, values: Array) -> Array:
        """Greatest values."""
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
    clusters: Clusters, group: Group, scan: Scan, sight: TrackingSettings
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
