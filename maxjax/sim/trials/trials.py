"""Trials of the closed loop: start and goal as a pure function of (map, seed, index).

Trial i of (map, seed) flies in the city `make_scene(map, seed + i // 50)`: 50 trials share a city. Its ends are the
first pair, in a fixed order, of 512 points drawn uniformly at |x|, |y| ≤ 100 m and 3 to 15 m high, such that

- both stand 10 m clear of every solid horizontally (exact distance from the vertical through the point, no ground);
- they are 50 to 80 m apart (straight line in 3D);
- they are connected in the city's true voxel map (2 m) dilated by 2 m, the ground by one voxel; pairs that are not
  connected are rejected and counted, before any flight.

Coordinates are multiples of 1/64 m, exact in float32 and in decimal print. The trials of one city are drawn by one
program, the same for one trial and for ten thousand, so that each trial has the same bits in any selection.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.compile.executable import stored
from maxjax.compile.threads import concurrently
from maxjax.core.grid import Grid
from maxjax.core.rng_streams import named_key
from maxjax.fields.connectivity import flood
from maxjax.fields.occupancy import dilate
from maxjax.sim.worlds.geoms import PLANE, Geoms
from maxjax.sim.worlds.layouts import MAPS
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.sim.worlds.solid_distance import distances, horizontal_distance

CITY_TRIALS = 50
HALF_AREA = 100.0  # [m]
HEIGHT = (3.0, 15.0)  # [m]
APART = (50.0, 80.0)  # [m]
CLEARANCE = 10.0  # [m]
DILATION = 2.0  # [m]
# The true map contains every city after its rotation, the highest roof below the topmost layer.
TRUTH = Grid((151, 151, 67), 2.0, (-150.0, -150.0, -2.0))

# In the densest city seen a twentieth of the area is clear: 25 points, and a fifth of their 300 pairs are at a valid
# distance.
_CANDIDATES = 512
# The exact horizontal clearance is computed for the first points with enough clearance at their own height, which is
# cheaper to compute; at most this many.
_CHECKED = 64
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
        excluded: pairs rejected because no path joins them.
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
    """Trials of a map and seed, stacked in the order of the indices; each has the same bits as from `draw`.

    Args:
        name: one of `MAPS`.
        seed: the first city's.
        indices: of the trials.

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
    key = named_key(jax.random.key(seed), f"trials {name}")

    def draw_group(group: int) -> tuple[np.ndarray, ...]:
        geoms = make_scene(name, seed + group).geoms
        air = open_air(*map(jnp.asarray, occupancy(geoms, TRUTH)))
        return tuple(map(np.asarray, draw_in(geoms, air, key, jnp.int32(CITY_TRIALS * group))))

    # A city leaves cores and accelerators idle most of the time.
    tables = concurrently(draw_group, groups.tolist(), os.cpu_count() or 1)
    rows = CITY_TRIALS * place + wanted % CITY_TRIALS
    start, goal, valid, excluded = (jnp.asarray(np.concatenate(column)[rows]) for column in zip(*tables, strict=True))
    return Trial(start, goal, jnp.asarray(seed + wanted // CITY_TRIALS, jnp.int32), valid, excluded)


@stored("open air")
def open_air(occupied: Bool[Array, "nx ny nz"], ground: Bool[Array, "nx ny nz"]) -> Bool[Array, "nx ny nz"]:
    """The component of free voxels that contains the top layer, which lies above all roofs.

    Two points in it are connected. Points outside it lie under a roof; above a point with horizontal clearance there is
    none, so no connected pair is missed.
    """
    blocked = dilate(occupied, DILATION, TRUTH, ground)
    return flood(~blocked, jnp.array([0, 0, TRUTH.shape[2] - 1], jnp.int32))


@stored("trials")
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

    def clear_here(point: Float[Array, "3"]) -> Bool[Array, ""]:
        return jnp.all(is_plane | (distances(geoms, point) >= CLEARANCE))

    candidates_here = jax.vmap(clear_here)(ticks.astype(jnp.float32) / _TICKS)
    checked = jnp.nonzero(candidates_here, size=_CHECKED, fill_value=0)[0]
    ticks = ticks[checked]
    points = ticks.astype(jnp.float32) / _TICKS
    clear = jax.vmap(lambda point: horizontal_distance(geoms, point))(points) >= CLEARANCE

    # Distances in ticks are integers, compared without rounding. Padding of the list is 0 m from the first point.
    i, j = jnp.triu_indices(_CHECKED, k=1)
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
