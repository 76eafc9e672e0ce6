"""Cost-to-go around a vehicle among movers: dynamic programming on a window of voxels.

    V(x) = min over the 26 neighbours y of  V(y) + ½ (n(x) + n(y)) |x − y|
    V    = what the static way leaves           on the faces of the window, and 0 at a goal inside it
    n(x) = 1 + a (1 − d(x) / D)²₊ + b max over movers of (1 − d(x) / k)₊
                                                d: to where movers are likely to be when the vehicle can be at x
                                                k: what motions keep of that, for they allow for all that a mover may do

A way along a street leads round a crowd in it, where the static way leads through; and round what motions may not
enter: without b a slow mover ahead holds the vehicle up behind it, for the way leads past it nearer than any motion.

V guides: what is safe is decided by
the motions (`sim.movers.choice`). Its sweeps are those of Bellman and Ford, as many as a way in the window has voxels.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from maxjax.core.grid import Index3
from maxjax.sim.movers.reachable_sets import Tracks

_AROUND = tuple(o for o in itertools.product((-1, 0, 1), repeat=3) if any(o))
# Cost of what cannot be reached [m]: more than any way, and finite, so that it can be interpolated.
_FAR = 1e4
# Distance from the end of a way within which voxels are too coarse [voxels].
_CLOSE = 1.5


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Crowding:
    """Prices of a metre near movers; static.

    Attributes:
        price: a, the further cost of a metre at a mover.
        keeping: b, the further cost of a metre at a mover, by what motions keep of it.
        reach: D, distance from which on it costs nothing [m].
        sweeps: of the dynamic programming.
        shape: of the window, in cells of the dynamic programming.
        cell: edge of a cell, voxels of the map.
        wall: price of a cell that holds blocked voxels where cells are larger than voxels; else it is closed.
        beside: price of a cell beside blocked ones.
        earlier, later: the time at which the vehicle may be at a voxel [s], before and after the soonest.
    """

    price: float = 10.0
    keeping: float = 1.0
    reach: float = 3.0
    sweeps: int = 40
    shape: Index3 = (24, 24, 9)
    cell: int = 1
    wall: float = 8.0
    beside: float = 4.0
    earlier: float = 0.2
    later: float = 1.0


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LocalValue:
    """Cost-to-go at the voxels of a window; batch axes lead.

    Attributes:
        value: V [m].
        origin: centre of voxel (0, 0, 0) [m].
        end: of the way [m]; so near to it that a voxel is too coarse, the cost-to-go is the distance.
        spacing: [m]; static.
    """

    value: Float[Array, "*batch nx ny nz"]
    origin: Float[Array, "*batch 3"]
    end: Float[Array, "*batch 3"]
    spacing: float = dataclasses.field(metadata={"static": True})


def local_value(
    free: Bool[Array, "nx ny nz"],
    window: tuple[Float[Array, "3"], float],
    ends: tuple[Float[Array, "nx ny nz"], Float[Array, "3"]],
    price: Float[Array, "nx ny nz"],
    sweeps: int,
) -> LocalValue:
    """V of a window.

    Args:
        free: voxels that a way may lead through.
        window: centre of voxel (0, 0, 0) [m], and spacing [m], which is static.
        ends: cost-to-go where a way may end [m]: faces of the window, the goal; infinity elsewhere. And the goal [m].
        price: n.
        sweeps: static.
    """
    origin, spacing = window
    # With the axis of height in front: the last one is long then, and sweeps take a quarter of the time on a CPU.
    free, price, start = (jnp.moveaxis(x, 2, 0) for x in (free, price, jnp.minimum(ends[0], _FAR)))
    nz, nx, ny = free.shape
    wide = jnp.pad(jnp.where(free, price, _FAR), 1, constant_values=_FAR)

    def neighbours(values: Array) -> list[Array]:
        return [values[1 + k : 1 + k + nz, 1 + i : 1 + i + nx, 1 + j : 1 + j + ny] for i, j, k in _AROUND]

    lengths = [0.5 * spacing * math.hypot(*offset) for offset in _AROUND]
    edges = [length * (price + beside) for length, beside in zip(lengths, neighbours(wide), strict=True)]
    start = jnp.where(free, start, _FAR)

    def sweep(_: Array, value: Array) -> Array:
        around = neighbours(jnp.pad(value, 1, constant_values=_FAR))
        least = value
        for there, edge in zip(around, edges, strict=True):
            least = jnp.minimum(least, there + edge)
        return jnp.where(free, least, _FAR)

    value = jnp.moveaxis(lax.fori_loop(0, sweeps, sweep, start), 0, 2)
    return LocalValue(value, origin, ends[1], spacing)


def crowding(
    centres: Float[Array, "n 3"],
    place: Float[Array, "3"],
    speed: float,
    tracks: Tracks,
    kept: Float[Array, " s"],
    crowd: Crowding,
) -> Float[Array, " n"]:
    """N of voxels: by how near movers are likely to be when the vehicle, here now, can be there.

    Args:
        centres: of the voxels [m].
        place: of the vehicle [m].
        speed: of the vehicle [m/s]. Static.
        tracks: of the movers.
        kept: what motions keep of each [m]; 0: nothing.
        crowd: static.
    """
    soonest = jnp.linalg.norm(centres - place, axis=1) / speed
    nearest, share = jnp.full(len(centres), jnp.inf), jnp.zeros(len(centres))
    keeps = kept > 0.0
    velocity = jnp.where(tracks.rests[:, None], 0.0, tracks.velocity)
    for time in (soonest - crowd.earlier, soonest, soonest + 0.5 * crowd.later, soonest + crowd.later):
        likely = tracks.place + jnp.maximum(time, 0.0)[:, None, None] * velocity
        outside = jnp.maximum(jnp.abs(centres[:, None] - likely) - tracks.half, 0.0)
        squared = jnp.where(tracks.used, jnp.sum(outside * outside, axis=-1), jnp.inf)
        nearest = jnp.minimum(nearest, jnp.min(squared, axis=1, initial=jnp.inf))
        within = jnp.where(keeps, 1.0 - jnp.sqrt(squared) / jnp.where(keeps, kept, 1.0), 0.0)
        share = jnp.maximum(share, jnp.max(within, axis=1, initial=0.0))
    beside = jnp.square(jnp.maximum(1.0 - jnp.sqrt(nearest) / crowd.reach, 0.0))
    return 1.0 + crowd.price * beside + crowd.keeping * share


def cost_to_go(local: LocalValue, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """V between voxels that can be reached, trilinear [m]; outside the window that of the nearest place in it.

    Within a voxel and a half of the end of the way it is the distance to that.
    """
    last = np.asarray(local.value.shape) - 1
    whole = jnp.clip((points - local.origin) / local.spacing, 0.0, last - 1e-3)
    low = jnp.floor(whole).astype(jnp.int32)
    share = whole - low
    total, weights = jnp.zeros(len(points)), jnp.zeros(len(points))
    for corner in itertools.product((0, 1), repeat=3):
        weight = jnp.prod(jnp.where(np.array(corner) == 1, share, 1.0 - share), axis=1)
        i, j, k = (low + np.array(corner)).T
        value = local.value[i, j, k]
        weight = jnp.where(value < _FAR, weight, 0.0)
        total, weights = total + weight * value, weights + weight
    reached = weights > 0.0
    value = jnp.where(reached, total / jnp.where(reached, weights, 1.0), _FAR)
    left = jnp.linalg.norm(points - local.end, axis=1)
    return jnp.where(reached & (left < _CLOSE * local.spacing), left, value)
