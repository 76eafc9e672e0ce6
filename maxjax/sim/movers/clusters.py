"""Clusters: returns that belong to a body, as connected components in the range image.

    p ~ q   ⟺   their pixels are at most 2 channels and 3 columns apart, and |p − q| ≤ gap + 1.3 · rise · range

`rise` is the angle between channels, the coarser one: what is one body is sampled no coarser. Taken are returns that
move, and all others around these and around where tracks are expected. A component no larger than a body can be, while
its surroundings were taken, stands free in the air: all of it is the body, if a part of it moves or a track is expected
there. What is larger is joined to a wall or the ground: of that the moving returns alone are clustered.

Labels: each return takes the least of its neighbours' labels, passes it on to the one whose label it had, and follows
labels to labels (pointer jumping); a few turns suffice for blobs, and what they leave apart is two clusters, not one
lost.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.sensors.range_image import rise

_ROWS, _COLUMNS = 2, 3
_GAP, _STEPS = 0.2, 1.3
_TURNS = 6
# Moving returns below which a cluster is none, unless a track expects it: of a body in the air, and of a part of
# something larger, which may be a beam of a building that was missed before.
_FEWEST, _FEWEST_ATTACHED = 2, 4
# How much larger than a body its returns may seem [m].
_SLACK = 0.2


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Signs:
    """Signs of each return; batch axes lead.

    Attributes:
        moves: nothing stood there before.
        expected: a track is expected there.
        around: it does, is, or has such a one within a body's size.
    """

    moves: Bool[Array, "*batch r"]
    expected: Bool[Array, "*batch r"]
    around: Bool[Array, "*batch r"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Clusters:
    """Returns of movers, gathered, and the cluster of each; batch axes lead.

    Attributes:
        ray: of each gathered return.
        cluster: of each, nearest first; as many as there can be: none.
        used: whether a cluster has returns.
        count: its returns.
        overflow: whether returns or clusters were left out.
    """

    ray: Int32[Array, "*batch p"]
    cluster: Int32[Array, "*batch p"]
    used: Bool[Array, "*batch d"]
    count: Int32[Array, "*batch d"]
    overflow: Bool[Array, "*batch"]


def cluster_returns(
    points: Float[Array, "r 3"], distance: Float[Array, " r"], signs: Signs, sight: TrackingSettings
) -> Clusters:
    """Clusters of returns that belong to bodies.

    Args:
        points: of all rays, world frame [m].
        distance: of all rays [m].
        signs: what is known of each return.
        sight: settings. Static.
    """
    size = sight.points
    ray, there, left_out = gather_rays(distance, signs.around, size)
    mine, far, moves = points[ray], distance[ray], signs.moves[ray]
    neighbour = _neighbours(mine, far, ray, there, sight.lidar)
    whole = _labels(neighbour)
    low = jnp.full((size, 3), jnp.inf).at[whole].min(mine)
    high = jnp.full((size, 3), -jnp.inf).at[whole].max(mine)
    free = jnp.all(high - low <= sight.bounds.edges + _SLACK, axis=1)[whole]
    # The moving ones alone: other returns are no one's neighbours.
    both = moves[:, None] & moves[neighbour]
    part = _labels(jnp.where(both, neighbour, jnp.arange(size, dtype=jnp.int32)[:, None]))
    label = jnp.where(free, whole, part)
    belongs = there & (free | moves)
    count = jnp.zeros(size, jnp.int32).at[label].add(belongs.astype(jnp.int32))
    moving = jnp.zeros(size, jnp.int32).at[label].add((belongs & moves).astype(jnp.int32))
    expected = jnp.zeros(size, bool).at[label].max(belongs & signs.expected[ray])
    nearest = jnp.full(size, jnp.inf).at[label].min(jnp.where(belongs, far, jnp.inf))
    loose = jnp.zeros(size, bool).at[label].max(belongs & free)
    kept = (moving >= jnp.where(loose, _FEWEST, _FEWEST_ATTACHED)) | (expected & (count > 0))
    # Nearest first: the rank of each kept root.
    value, root = lax.top_k(-jnp.where(kept, nearest, jnp.inf), sight.detections)
    used = value > -jnp.inf
    rank = jnp.full(size, sight.detections).at[root].set(jnp.where(used, np.arange(sight.detections), sight.detections))
    cluster = jnp.where(belongs, rank[label], sight.detections)
    return Clusters(ray, cluster, used, jnp.where(used, count[root], 0), left_out | (jnp.sum(kept) > sight.detections))


def gather_rays(
    distance: Float[Array, " r"], chosen: Bool[Array, " r"], size: int
) -> tuple[Int32[Array, " p"], Bool[Array, " p"], Bool[Array, ""]]:
    """Numbers of the nearest chosen rays, which of them are any, and whether some were left out."""
    chosen &= distance < jnp.inf

    def halve(_: Array | int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        fits = jnp.sum(chosen & (distance <= middle)) <= size
        return jnp.where(fits, middle, low), jnp.where(fits, high, middle)

    furthest = jnp.max(jnp.where(chosen, distance, 0.0))
    many = jnp.sum(chosen) > size
    limit, _ = lax.fori_loop(0, 16, halve, (jnp.zeros_like(furthest), furthest))
    within = chosen & (distance <= jnp.where(many, limit, furthest))
    ray = jnp.nonzero(within, size=size, fill_value=0)[0].astype(jnp.int32)
    return ray, jnp.arange(size) < jnp.sum(within), many


def _neighbours(
    points: Float[Array, "p 3"], distance: Float[Array, " p"], ray: Array, there: Array, lidar: Lidar
) -> Int32[Array, "p n"]:
    """Of each return those near to it in image and space; itself in place of others."""
    size, columns = ray.shape[0], lidar.columns
    own = jnp.arange(size, dtype=jnp.int32)
    at = jnp.full(lidar.rays, -1, jnp.int32).at[jnp.where(there, ray, lidar.rays)].set(own, mode="drop")
    offsets = [(i, j) for i in range(-_ROWS, _ROWS + 1) for j in range(-_COLUMNS, _COLUMNS + 1) if (i, j) != (0, 0)]
    di, dj = np.array(offsets, np.int32).T
    row, column = (ray // columns)[:, None] + di, ((ray % columns)[:, None] + dj) % columns
    inside = (row >= 0) & (row < lidar.channels)
    other = jnp.where(inside, at[jnp.clip(row, 0, lidar.channels - 1) * columns + column], -1)
    apart = sum((axis[:, None] - axis[other]) ** 2 for axis in points.T)
    gap = _GAP + 0.5 * _STEPS * rise(lidar) * (distance[:, None] + distance[other])
    return jnp.where((other >= 0) & there[:, None] & (apart <= gap * gap), other, own[:, None])


def _labels(neighbour: Int32[Array, "p n"]) -> Int32[Array, " p"]:
    def turn(_: Array | int, label: Array) -> Array:
        least = jnp.min(label[neighbour], axis=1)
        passed = jnp.minimum(label, least).at[label].min(least)
        return passed[passed][passed]

    label: Array = lax.fori_loop(0, _TURNS, turn, jnp.arange(neighbour.shape[0], dtype=jnp.int32))
    return label
