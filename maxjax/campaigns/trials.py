"""Trials of the closed loop: where a flight begins and ends, as a pure function of (map, seed, index).

Trial i of (map, seed) flies in the city `make_scene(map, seed + i // 50)`: 50 trials share a city. Its ends are the
first pair, in a fixed order, of 512 points drawn uniformly at |x|, |y| ≤ 100 m and 3 to 15 m high, such that

- both stand 10 m clear of every solid horizontally (exact distance from the vertical through the point, no ground);
- they are 50 to 80 m apart (straight line in 3D);
- they are joined in the city's true voxel map (2 m) dilated by 2 m, the ground by one voxel: pairs that are not are
  passed over and counted, before anything flies.

Coordinates are multiples of 1/64 m: exact in float32 and in print. The trials of one city are made by one program, the
same for one trial and for ten thousand, so that trial 37 is the same bits in any company.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.core.grid import Grid
from maxjax.core.streams import named
from maxjax.core.threads import concurrently
from maxjax.fields.connectivity import flood
from maxjax.fields.occupancy import dilate
from maxjax.worlds.distance import distances, horizontal_distance
from maxjax.worlds.geoms import PLANE, Geoms
from maxjax.worlds.layouts import MAPS
from maxjax.worlds.scenes import make_scene, occupancy

CITY_TRIALS = 50
HALF_AREA = 100.0  # [m]
HEIGHT = (3.0, 15.0)  # [m]
APART = (50.0, 80.0)  # [m]
CLEARANCE = 10.0  # [m]
DILATION = 2.0  # [m]
# The true map holds every city with its turned corners and its highest roof below the topmost layer.
TRUTH = Grid((151, 151, 67), 2.0, (-150.0, -150.0, -2.0))

# A twentieth of the area is clear in the tightest city seen: 25 points, of whose 300 pairs a fifth are the right
# distance apart.
_CANDIDATES = 512
# The exact clearance is asked of the first so many points that are clear at their own height, which is cheap to know.
_ASKED = 64
_TICKS = 64  # a metre


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Trial:
    """One or more trials; batch axes lead.

    Attributes:
        start: [m], world frame.
        goal: [m], world frame.
        city: seed of the city: `make_scene(map, city)`.
        valid: whether a pair was found; where not, start and goal are NaN.
        excluded: pairs passed over because no path joins them.
    """

    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    city: Int32[Array, "*batch"]
    valid: Bool[Array, "*batch"]
    excluded: Int32[Array, "*batch"]


def draw(name: str, seed: int, index: int) -> Trial:
    """Trial `index` of a map and seed.

    Raises:
        ValueError: for an unknown map, or a negative seed or index.
    """
    trial: Trial = jax.tree.map(lambda a: a[0], draw_many(name, seed, [index]))
    return trial


def draw_many(name: str, seed: int, indices: Sequence[int]) -> Trial:
    """Trials of a map and seed, stacked in the order asked for; each the same bits as `draw` gives it alone.

    Args:
        name: one of `MAPS`.
        seed: the first city's.
        indices: which ones; an array or a range will do.

    Raises:
        ValueError: for an unknown map, a negative seed or index, or no indices.
    """
    if name not in MAPS:
        raise ValueError(f"map: expected one of {', '.join(MAPS)}, given {name!r}")
    wanted = np.asarray(indices, np.int64)
    if wanted.ndim != 1 or wanted.size == 0:
        raise ValueError(f"indices: expected a sequence of at least one, given {indices}")
    if seed < 0 or wanted.min() < 0 or wanted.max() >= 2**31 or seed + wanted.max() // CITY_TRIALS >= 2**31:
        raise ValueError(f"trial: expected seed and indices from 0 to 2^31 - 1, given seed {seed} and {indices}")
    groups, place = np.unique(wanted // CITY_TRIALS, return_inverse=True)
    key = named(jax.random.key(seed), f"trials {name}")
    tables = [
        draw_in(geoms, air, key, jnp.int32(CITY_TRIALS * group))
        for group, (geoms, air) in zip(groups, _truths(name, [int(seed + group) for group in groups]), strict=True)
    ]
    rows = jnp.asarray(CITY_TRIALS * place + wanted % CITY_TRIALS)
    start, goal, valid, excluded = (jnp.concatenate(column)[rows] for column in zip(*tables, strict=True))
    return Trial(start, goal, jnp.asarray(seed + wanted // CITY_TRIALS, jnp.int32), valid, excluded)


def _truths(name: str, cities: list[int]) -> Iterator[tuple[Geoms, Bool[Array, "nx ny nz"]]]:
    """Solids of each city, and the voxels that the open air above its roofs joins; maps are made early, in threads."""

    def voxels(geoms: Geoms) -> tuple[np.ndarray, np.ndarray]:
        return occupancy(geoms, TRUTH)

    geoms = [make_scene(name, city).geoms for city in cities]
    maps = concurrently(voxels, geoms, os.cpu_count() or 1)
    for solids, (occupied, ground) in zip(geoms, maps, strict=True):
        yield solids, open_air(jnp.asarray(occupied), jnp.asarray(ground))


@jax.jit
def open_air(occupied: Bool[Array, "nx ny nz"], ground: Bool[Array, "nx ny nz"]) -> Bool[Array, "nx ny nz"]:
    """The component of free voxels that holds the top layer, which no roof reaches.

    Two points in it are joined. Two points outside it could be joined with each other only under a roof; but above a
    point that is clear horizontally there is none.
    """
    blocked = dilate(occupied, DILATION, TRUTH, ground)
    return flood(~blocked, jnp.array([0, 0, TRUTH.shape[2] - 1], jnp.int32))


@jax.jit
def draw_in(
    geoms: Geoms, air: Bool[Array, "nx ny nz"], key: PRNGKeyArray, first: Int32[Array, ""]
) -> tuple[Array, Array, Array, Array]:
    """Start, goal, valid and excluded of the 50 trials from `first` on."""
    keys = jax.vmap(functools.partial(jax.random.fold_in, key))(first + jnp.arange(CITY_TRIALS))
    return jax.vmap(functools.partial(_first_pair, geoms, air))(keys)


def _first_pair(geoms: Geoms, air: Bool[Array, "nx ny nz"], key: PRNGKeyArray) -> tuple[Array, Array, Array, Array]:
    low = np.round(np.array([-HALF_AREA, -HALF_AREA, HEIGHT[0]]) * _TICKS).astype(np.int32)
    high = np.round(np.array([HALF_AREA, HALF_AREA, HEIGHT[1]]) * _TICKS).astype(np.int32)
    # Whole ticks, the bounds included: 16 random bits times their number, less 16 bits.
    bits = jax.random.bits(key, (_CANDIDATES, 3), jnp.uint32) >> 16
    ticks = jnp.asarray(low) + ((bits * (high - low + 1).astype(np.uint32)) >> 16).astype(jnp.int32)
    is_plane = np.array([kind == PLANE for kind in geoms.type])

    def hopeful(point: Float[Array, "3"]) -> Bool[Array, ""]:
        return jnp.all(is_plane | (distances(geoms, point) >= CLEARANCE))

    hope = jax.vmap(hopeful)(ticks.astype(jnp.float32) / _TICKS)
    asked = jnp.nonzero(hope, size=_ASKED, fill_value=0)[0]
    ticks = ticks[asked]
    points = ticks.astype(jnp.float32) / _TICKS
    clear = jax.vmap(lambda point: horizontal_distance(geoms, point))(points) >= CLEARANCE

    # Distances in ticks are whole numbers: no rounding decides. Points that fill up the list lie 0 m apart.
    i, j = jnp.triu_indices(_ASKED, k=1)
    gap = ticks[i] - ticks[j]
    squared = jnp.sum(gap * gap, axis=-1)
    near, far = (int(reach * _TICKS) ** 2 for reach in APART)
    candidate = clear[i] & clear[j] & (squared >= near) & (squared <= far)

    voxel = TRUTH.index_of(points)
    joined = air[voxel[:, 0], voxel[:, 1], voxel[:, 2]]
    solvable = candidate & joined[i] & joined[j]
    chosen = jnp.argmax(solvable)
    valid = solvable[chosen]
    passed = jnp.arange(len(i)) < jnp.where(valid, chosen, len(i))
    excluded = jnp.sum(candidate & ~solvable & passed, dtype=jnp.int32)
    start, goal = (jnp.where(valid, points[k[chosen]], jnp.nan) for k in (i, j))
    return start, goal, valid, excluded
