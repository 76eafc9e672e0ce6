"""The next viewpoint, for a path that leads into voxels no scan has seen.

    c* = argmin over voxels c nearby of |c − x| + |c − u₀| − n(c)

x is the position of the vehicle, u₀ the first unseen voxel of the path, n(c) the number of unseen voxels of the path
within the field of view at c. Candidates c are reached along a straight line through voxels seen free that keeps the
margin, and have u₀ within the field of view and in line of sight, so that the scan taken there covers u₀. The term n(c)
prefers viewpoints from which more of the path is visible. For a path straight up along a facade, for example, a level
sensor sees nothing above itself, and c* lies away from the facade.

Where no voxel has such a view, the candidate nearest to a point further along the path is chosen; and where the vehicle
is within the margin of a newly detected obstacle, the nearest voxel outside it.

Whether a scan sees a voxel free also depends on returns beside it, so the same viewpoint may fail repeatedly. Random
numbers between 0 and `jitter` voxels are therefore added to the costs, the more the more viewpoints were tried.

Positions are index coordinates of a box of the rolling map around the vehicle (`AROUND`), which is assumed to hover
level.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.fields.stencil import cell
from maxjax.planning.path.line_of_sight import clear, sight_of, stands_free
from maxjax.sim.sensors.lidar import Lidar

# Candidates are at most this many voxels away along each axis.
_REACH = 3
# Candidates are within `_REACH`, and what they look at within 8 slabs of them: so far along each axis the map counts
# [voxels].
AROUND = 12
# Without a view of u₀, a candidate has to be nearer to the path's further point than the vehicle by this [voxels].
_PROGRESS = 0.5
# Who stands on a face of a voxel is taken to be so far from its middle [voxels].
_WITHIN = 0.499
# Edges of the field of view left out [deg]: in wind the vehicle is not level.
_TILT = 5.0


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MapView:
    """The rolling map as far as viewpoints depend on it.

    Attributes:
        seen: voxels seen free.
        occupied: voxels that block the line of sight.
        blocked: obstacles dilated by the margin.
    """

    seen: Bool[Array, "nx ny nz"]
    occupied: Bool[Array, "nx ny nz"]
    blocked: Bool[Array, "nx ny nz"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class UnseenPath:
    """The part of a path that a viewpoint should show.

    Attributes:
        voxels: u, from the first unseen voxel of the path on.
        further: a point further along the path, for when no viewpoint shows u₀.
    """

    voxels: Int32[Array, "m 3"]
    further: Float[Array, "3"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Viewpoint:
    """Where to scan from: a voxel's centre, and whether any voxel qualifies."""

    position: Float[Array, "3"]
    exists: Bool[Array, ""]


def next_viewpoint(
    view: MapView,
    position: Float[Array, "3"],
    unseen: UnseenPath,
    lidar: Lidar,
    jitter: Float[Array, ""],
    key: PRNGKeyArray,
) -> Viewpoint:
    """The voxel c* of least cost.

    Args:
        view: the map.
        position: of the vehicle.
        unseen: what to look at.
        lidar: the sensor. Static.
        jitter: greatest random addition to a cost [voxels].
        key: of these random numbers.
    """
    reach = jnp.arange(-_REACH, _REACH + 1)
    offsets = jnp.stack(jnp.meshgrid(reach, reach, reach, indexing="ij"), -1).reshape(-1, 3)
    ends = (jnp.floor(position + 0.5).astype(jnp.int32) + offsets).astype(position.dtype)
    reachable = _reachable(view, position, ends)
    first = unseen.voxels[0].astype(position.dtype)

    sight = sight_of(view.occupied)
    in_field = _in_field(unseen.voxels - ends[:, None], lidar)
    shows = reachable & in_field[:, 0] & clear(sight, ends, first, slabs=2 * _REACH + 2)
    way = jnp.linalg.norm(ends - position, axis=1) + jnp.linalg.norm(ends - first, axis=1)
    viewing = way - jnp.sum(in_field, axis=1) + jitter * jax.random.uniform(key, (len(ends),))
    left = jnp.linalg.norm(ends - unseen.further, axis=1)
    nearer = reachable & (left < jnp.linalg.norm(position - unseen.further) - _PROGRESS)

    cost = jnp.where(jnp.any(shows), jnp.where(shows, viewing, jnp.inf), jnp.where(nearer, left, jnp.inf))
    leaving = jnp.where(reachable, jnp.linalg.norm(ends - position, axis=1), jnp.inf)
    cost = jnp.where(stands_free(view.blocked, position), cost, leaving)
    best = jnp.argmin(cost)
    return Viewpoint(ends[best], jnp.isfinite(cost[best]))


def still_reachable(view: MapView, position: Float[Array, "3"], viewpoint: Float[Array, "3"]) -> Bool[Array, ""]:
    """Whether the vehicle may continue to a viewpoint that it is on the way to."""
    return _reachable(view, position, viewpoint[None])[0]


def _reachable(view: MapView, position: Float[Array, "3"], ends: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    """Whether ends keep the margin, and the straight line to each was seen free and keeps it too.

    A vehicle within the margin may leave it: only the ends have to keep it then. One that stands on a face of its voxel
    meets no voxel beyond that before it moves.
    """
    seen, blocked = view.seen, view.blocked
    middle = jnp.floor(position + 0.5)
    position = middle + jnp.clip(position - middle, -_WITHIN, _WITHIN)
    own = cell(seen.shape, jnp.floor(position + 0.5).astype(jnp.int32))
    passable = seen & (~blocked | ~stands_free(blocked, position)) | own
    within = sight_of(~passable)
    i, j, k = jnp.clip(jnp.floor(ends + 0.5).astype(jnp.int32), 0, jnp.asarray(seen.shape) - 1).T
    return clear(within, position, ends, slabs=_REACH + 2) & ~blocked[i, j, k]


def _in_field(sight: Float[Array, "*n 3"], lidar: Lidar) -> Bool[Array, "*n"]:
    """Whether directions lie in the field of view of a level sensor."""
    elevation = jnp.rad2deg(jnp.arctan2(sight[..., 2], jnp.linalg.norm(sight[..., :2], axis=-1)))
    return (elevation >= lidar.elevation_min + _TILT) & (elevation <= lidar.elevation_max - _TILT)
