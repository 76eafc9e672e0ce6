"""Clusters: returns of movers that belong together, as connected components in the range image.

    p ~ q   ⟺   their pixels are at most 2 channels and 3 columns apart, and |p − q| ≤ gap + 1.3 · rise · range

`rise` is the angle between channels, the coarser one: what is one body is sampled no coarser. Returns are first gathered
into a list of fixed length, the nearest ones. Labels: each takes the least of its neighbours' labels, passes it on to
the one whose label it had, and follows labels to labels (pointer jumping); a few turns suffice for blobs, and what they
leave apart is two clusters, not one lost.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.sim.lidar import Lidar
from maxjax.sim.moving.sight import Sight
from maxjax.sim.range_image import rise

_ROWS, _COLUMNS = 2, 3
_GAP, _STEPS = 0.2, 1.3
_TURNS = 6
# Returns below which a cluster is none, unless a track expects it.
_FEWEST = 2


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


def clustered(
    points: Float[Array, "r 3"], distance: Float[Array, " r"], chosen: Bool[Array, " r"], expected: Array, sight: Sight
) -> Clusters:
    """Connected components of the chosen returns.

    Args:
        points: of all rays, in any frame [m].
        distance: of all rays [m].
        chosen: rays that returned from a mover.
        expected: of those, returns where a track is expected: one such makes a cluster.
        sight: settings. Static.
    """
    ray, there, left_out = gathered(distance, chosen, sight.points)
    label = _labels(points, distance, ray, there, sight.lidar)
    size = sight.points
    count = jnp.zeros(size, jnp.int32).at[label].add(there.astype(jnp.int32))
    awaited = jnp.zeros(size, bool).at[label].max(there & expected[ray])
    nearest = jnp.full(size, jnp.inf).at[label].min(jnp.where(there, distance[ray], jnp.inf))
    kept = (count >= _FEWEST) | awaited
    # Nearest first: the rank of each kept root.
    value, root = lax.top_k(-jnp.where(kept, nearest, jnp.inf), sight.detections)
    used = value > -jnp.inf
    rank = jnp.full(size, sight.detections).at[root].set(jnp.where(used, np.arange(sight.detections), sight.detections))
    cluster = jnp.where(there, rank[label], sight.detections)
    return Clusters(ray, cluster, used, jnp.where(used, count[root], 0), left_out | (jnp.sum(kept) > sight.detections))


def gathered(
    distance: Float[Array, " r"], chosen: Bool[Array, " r"], size: int
) -> tuple[Int32[Array, " p"], Bool[Array, " p"], Bool[Array, ""]]:
    """Numbers of the nearest chosen rays, which of them are any, and whether some were left out."""
    chosen &= distance < jnp.inf

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
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


def _labels(
    points: Float[Array, "r 3"], distance: Float[Array, " r"], ray: Array, there: Array, lidar: Lidar
) -> Int32[Array, " p"]:
    size, columns = ray.shape[0], lidar.columns
    own = jnp.arange(size, dtype=jnp.int32)
    at = jnp.full(lidar.rays, -1, jnp.int32).at[jnp.where(there, ray, lidar.rays)].set(own, mode="drop")
    offsets = [(i, j) for i in range(-_ROWS, _ROWS + 1) for j in range(-_COLUMNS, _COLUMNS + 1) if (i, j) != (0, 0)]
    di, dj = np.array(offsets, np.int32).T
    row, column = (ray // columns)[:, None] + di, ((ray % columns)[:, None] + dj) % columns
    inside = (row >= 0) & (row < lidar.channels)
    other = jnp.where(inside, at[jnp.clip(row, 0, lidar.channels - 1) * columns + column], -1)
    mine, far = points[ray], distance[ray]
    apart = jnp.sum((mine[:, None] - mine[other]) ** 2, axis=-1)
    gap = _GAP + 0.5 * _STEPS * rise(lidar) * (far[:, None] + far[other])
    neighbour = jnp.where((other >= 0) & there[:, None] & (apart <= gap * gap), other, own[:, None])

    def turn(_: int, label: Array) -> Array:
        least = jnp.min(label[neighbour], axis=1)
        passed = jnp.minimum(label, least).at[label].min(least)
        return passed[passed][passed]

    return lax.fori_loop(0, _TURNS, turn, own)
