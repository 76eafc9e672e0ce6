"""Surroundings of a vehicle among movers: what its motions keep away from, and where its way leads.

    map, still returns of the last scan  ─→  hard set        static way, tracks  ─→  cost-to-go

Both are of plain values, for a simulated flight (`sim.movers.avoidance`) and for a vehicle of one's own
(`sim.movers.lookout`) alike. Frame: that of the map.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from maxjax.core.grid import Index3
from maxjax.planning.windows.windowed_route import corner_around, cut_box
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.choice import Keeping
from maxjax.sim.movers.hard_set import HardSet, hard_set
from maxjax.sim.movers.local_value import Crowding, LocalValue, crowding, local_value
from maxjax.sim.movers.motions import MotionSet
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, reachable

Box = tuple[tuple[float, float, float], tuple[float, float, float]]

# Cost of a metre beside the static way, in metres of it.
_ASIDE = 1.5
# Time that it takes to confirm a mover [s]: two looks, and the time of a scan.
_CONFIRMING = 0.3


@runtime_checkable
class Rules(Protocol):
    """Rules of flying among movers, as `sim.movers.avoidance.Avoidance` has them; static."""

    @property
    def bounds(self) -> Bounds:
        """Bounds that movers are assumed to keep."""
        ...

    @property
    def choice(self) -> MotionSet:
        """Motions that are tried."""
        ...

    @property
    def keeping(self) -> Keeping:
        """Distances that motions keep."""
        ...

    @property
    def crowd(self) -> Crowding:
        """Prices of nearness."""
        ...

    @property
    def within(self) -> Box | None:
        """Least and greatest coordinates of the air that may be flown in [m]; None: any."""
        ...


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Knowledge:
    """What a vehicle knows of what stands still, and its way; batch axes lead.

    Attributes:
        rolling_map: what scans have shown.
        blocked: voxels of the map that no way may lead through.
        returns: of the last scan, but those of movers [m]; infinity in place of others. None: each scan is in the map.
        way: points of the static way, evenly along it [m].
        left: length of the way from each of them to its end [m].
        spacing: of these points [m]; static.
    """

    rolling_map: mapping.RollingMap
    blocked: Bool[Array, "*batch nx ny nz"]
    returns: Float[Array, "*batch r 3"] | None
    way: Float[Array, "*batch m 3"]
    left: Float[Array, "*batch m"]
    spacing: float = dataclasses.field(metadata={"static": True})


def obstacles_around(known: Knowledge, place: Float[Array, "3"], rules: Rules) -> tuple[HardSet, Bool[Array, ""]]:
    """The map as far as motions lead, with what the last scan met; and whether that is new, and near.

    The map learns of a scan once a second. Until then, and until it is confirmed as a mover, what was met is blocked.
    """
    rolling_map, spacing = known.rolling_map, known.rolling_map.spacing
    furthest = rules.choice.speed * rules.choice.horizon
    half = math.ceil(furthest / spacing) + 1
    shape = (2 * half + 1,) * 3
    corner = corner_around((place - mapping.origin(rolling_map)) / spacing, half)
    origin = mapping.origin(rolling_map) + spacing * corner
    blocked, seen = (
        cut_box(known.blocked, corner, shape, beyond=True),
        cut_box(mapping.seen(rolling_map), corner, shape),
    )
    if known.returns is None:
        return hard_set(blocked, seen, origin, spacing), jnp.array(False)
    met = voxels_of_points(known.returns, origin, spacing, shape)
    # Air that was free, with nothing beside it that the map knows.
    beside = lax.reduce_window(blocked, False, lax.bitwise_or, (3, 3, 3), (1, 1, 1), "SAME")
    centres = jnp.stack(jnp.meshgrid(*(jnp.arange(n) - n // 2 for n in shape), indexing="ij"), -1)
    near = spacing * jnp.max(jnp.abs(centres), axis=-1) < rules.keeping.radius + _CONFIRMING * rules.bounds.speed
    return hard_set(blocked | met, seen, origin, spacing), jnp.any(met & seen & ~beside & near)


def voxels_of_points(
    points: Float[Array, "r 3"], origin: Float[Array, "3"], spacing: float, shape: Index3
) -> Bool[Array, "bx by bz"]:
    """Voxels of a box that hold points; points elsewhere, and at infinity, are in none.

    Args:
        points: [m].
        origin: centre of voxel (0, 0, 0) [m].
        spacing: [m]. Static.
        shape: of the box, voxels. Static.
    """
    index = jnp.floor((points - origin) / spacing + 0.5)
    inside = jnp.all((index >= 0) & (index < np.asarray(shape)), axis=1)
    voxel = jnp.where(inside[:, None], index, -1.0).astype(jnp.int32)
    flat = (voxel[:, 0] * shape[1] + voxel[:, 1]) * shape[2] + voxel[:, 2]
    size = math.prod(shape)
    met = jnp.zeros(size, bool).at[jnp.where(inside, flat, size)].set(True, mode="drop")
    return met.reshape(shape)


def way_around(known: Knowledge, place: Float[Array, "3"], tracks: Tracks, rules: Rules) -> LocalValue:
    """Cost-to-go around a place, dearer near those who move: where the window ends, along the static way."""
    crowd, voxel = rules.crowd, known.rolling_map.spacing
    cells, size, spacing = crowd.shape, crowd.cell, crowd.cell * voxel
    base = mapping.origin(known.rolling_map)
    corner = jnp.floor((place - base) / voxel + 0.5).astype(jnp.int32)
    corner -= jnp.asarray([size * (n // 2) + size // 2 for n in cells])
    blocked = cut_box(known.blocked, corner, (size * cells[0], size * cells[1], size * cells[2]), beyond=size == 1)
    # A large cell is dear where some of it is blocked, and closed where most is.
    share = jnp.mean(blocked.reshape(cells[0], size, cells[1], size, cells[2], size), axis=(1, 3, 5))
    origin = base + voxel * (corner + 0.5 * (size - 1))
    centres = origin + spacing * jnp.stack(jnp.meshgrid(*map(jnp.arange, cells), indexing="ij"), -1).reshape(-1, 3)
    free = (share <= 0.5) & _within(centres, rules).reshape(cells)

    every = max(round(spacing / 2 / known.spacing), 1)
    points, left = known.way[::every], known.left[::every]
    aside = jnp.linalg.norm(centres[:, None] - points, axis=-1)
    ends = jnp.min(left + _ASIDE * aside, axis=1).reshape(cells)
    inner = jnp.zeros(cells, bool).at[1:-1, 1:-1, 1:-1].set(True)
    # The end of the way: where it lies in the window, a way may end.
    close = (jnp.linalg.norm(centres - known.way[-1], axis=1) < spacing).reshape(cells)
    ends = jnp.where(inner & ~close, jnp.inf, ends)
    kept = clearance_to_movers(tracks, rules)
    price = crowding(centres, place, rules.choice.speed, tracks, kept, crowd).reshape(cells)
    # Beside a wall there is hardly room, and none at its corners. But where the static way leads along walls, through a
    # passage, it knew of them: were that dear here, the face above would seem nearer to its end, and once there, below.
    beside = lax.reduce_window(share, -jnp.inf, lax.max, (3, 3, 3), (1, 1, 1), "SAME")
    on_way = (jnp.min(aside, axis=1) < spacing).reshape(cells) & (size == 1)
    walls = jnp.where(on_way, 0.0, crowd.wall * share + crowd.beside * beside)
    return local_value(free, (origin, spacing), (ends, points[-1]), price + walls, crowd.sweeps)


def clearance_to_movers(tracks: Tracks, rules: Rules) -> Float[Array, " s"]:
    """How far motions keep, until they rest, from where each mover is likely to be [m]; from no confirmed one: 0."""
    time = rules.choice.lasts
    least, greatest = reachable(tracks, jnp.array([time]), rules.bounds)
    likely = tracks.place + time * jnp.where(tracks.rests[:, None], 0.0, tracks.velocity)
    further = jnp.maximum(greatest[0] - tracks.half - likely, likely - least[0] - tracks.half)
    distance = rules.keeping.radius + jnp.maximum(jnp.max(further, axis=1), 0.0)
    return jnp.where(tracks.used & tracks.confirmed, distance, 0.0)


def _within(points: Float[Array, "n 3"], rules: Rules) -> Bool[Array, " n"]:
    """Whether points lie in the air that may be flown in."""
    if rules.within is None:
        return jnp.ones(len(points), bool)
    low, high = (jnp.asarray(x, points.dtype) for x in rules.within)
    return jnp.all((points >= low) & (points <= high), axis=1)
