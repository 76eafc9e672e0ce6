"""Where to step for another view, when a path leads into what no scan has shown.

    c* = argmin over voxels c nearby of |c − here| + |c − u₀| − n(c)      u: the path from its first voxel never seen on

c is reached straight through what was seen free, keeps the margin, and has u₀ in the sensor's field of view and in line
of sight; so the scan from there shows u₀, and the flight gets on. n(c) counts the points u in its field of view: a step
further back shows more of the way. Straight up a facade, for one, a level sensor sees nothing, and c lies away from it.
Where no voxel has such a view, the one nearest to the way ahead must do; and within the margin, where a wall turned up
late, the nearest one out of it.

What a scan shows of a voxel also depends on returns beside it, so a view may disappoint, again and again from the same
place. `restless` adds as much chance to the choice as looks were in vain.

All positions are index coordinates of one window; the vehicle hovers level.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.fields.stencil import cell
from maxjax.planning.sight import clear, span_codes, stands_free
from maxjax.sim.lidar import Lidar

# Steps lead to a voxel at most so many away along each axis, and where u stays hidden, so much nearer to the way ahead.
_REACH, _NEARER = 3, 0.5
# Degrees at the edges of the field of view that are not counted on: a vehicle in wind is not quite level.
_TILT = 5.0


def step_to(
    seen: Bool[Array, "nx ny nz"],
    occupied: Bool[Array, "nx ny nz"],
    blocked: Bool[Array, "nx ny nz"],
    here: Float[Array, " 3"],
    hidden: Int32[Array, "m 3"],
    ahead: Float[Array, " 3"],
    lidar: Lidar,
    restless: Float[Array, ""],
    key: PRNGKeyArray,
) -> tuple[Float[Array, " 3"], Bool[Array, ""]]:
    """The voxel to step to, and whether there is one.

    Args:
        seen: voxels seen free.
        occupied: what blocks the view.
        blocked: obstacles with their margin.
        here: position.
        hidden: voxels u of the path to look at.
        ahead: a point of the path.
        lidar: the sensor. Static.
        restless: most that chance adds to a cost [voxels].
        key: of that chance.
    """
    reach = jnp.arange(-_REACH, _REACH + 1)
    offsets = jnp.stack(jnp.meshgrid(reach, reach, reach, indexing="ij"), -1).reshape(-1, 3)
    ends = (jnp.floor(here + 0.5).astype(jnp.int32) + offsets).astype(here.dtype)
    reachable = _reachable(seen, blocked, here, ends)
    first = hidden[0].astype(here.dtype)

    sight = span_codes(occupied)
    in_field = _in_field(hidden - ends[:, None], lidar)
    shows = reachable & in_field[:, 0] & clear(sight, ends, first, slabs=2 * _REACH + 2)
    way = jnp.linalg.norm(ends - here, axis=1) + jnp.linalg.norm(ends - first, axis=1)
    looks = way - jnp.sum(in_field, axis=1) + restless * jax.random.uniform(key, (len(ends),))
    left = jnp.linalg.norm(ends - ahead, axis=1)
    nearer = reachable & (left < jnp.linalg.norm(here - ahead) - _NEARER)

    cost = jnp.where(jnp.any(shows), jnp.where(shows, looks, jnp.inf), jnp.where(nearer, left, jnp.inf))
    leaves = jnp.where(reachable, jnp.linalg.norm(ends - here, axis=1), jnp.inf)
    cost = jnp.where(stands_free(blocked, here), cost, leaves)
    best = jnp.argmin(cost)
    return ends[best], jnp.isfinite(cost[best])


def still_open(
    seen: Bool[Array, "nx ny nz"], blocked: Bool[Array, "nx ny nz"], here: Float[Array, " 3"], end: Float[Array, " 3"]
) -> Bool[Array, ""]:
    """Whether a step that is under way may go on to its end; arguments as of `step_to`."""
    return _reachable(seen, blocked, here, end[None])[0]


def _reachable(
    seen: Bool[Array, "nx ny nz"], blocked: Bool[Array, "nx ny nz"], here: Float[Array, " 3"], ends: Float[Array, "n 3"]
) -> Bool[Array, " n"]:
    """Whether voxels keep the margin, and the straight way there was seen free and keeps it too, if `here` does."""
    room = seen & (~blocked | ~stands_free(blocked, here)) | cell(seen.shape, jnp.floor(here + 0.5).astype(jnp.int32))
    bits = span_codes(~room)
    i, j, k = jnp.clip(jnp.floor(ends + 0.5).astype(jnp.int32), 0, jnp.asarray(seen.shape) - 1).T
    return clear(bits, here, ends, slabs=_REACH + 2) & ~blocked[i, j, k]


def _in_field(sight: Float[Array, "*n 3"], lidar: Lidar) -> Bool[Array, "*n"]:
    """Whether directions lie in the field of view of a level sensor."""
    elevation = jnp.rad2deg(jnp.arctan2(sight[..., 2], jnp.linalg.norm(sight[..., :2], axis=-1)))
    return (elevation >= lidar.elevation_min + _TILT) & (elevation <= lidar.elevation_max - _TILT)
