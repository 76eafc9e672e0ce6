"""Swaps: the ends of a fleet, in pairs that fly to where the other one starts.

In a city they are a pure function of (map, seed, count): of 8,192 points drawn uniformly at |x|, |y| ≤ 100 m and 3 to
15 m high, those that stand 5 m clear of every solid, and are joined to the open air as trials are
(`sim.trials.trials`), are taken in order unless one before lies within 5 m; each is then paired with the first later
one that is left and 50 to 80 m away.

In free air, `antipodal`: opposite points of a circle, or of a sphere.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.compile.executable import stored
from maxjax.core.rng_streams import named_key
from maxjax.sim.trials.trials import APART, HALF_AREA, HEIGHT, TRUTH, open_air
from maxjax.sim.worlds.geoms import PLANE, Geoms
from maxjax.sim.worlds.layouts import MAPS
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.sim.worlds.solid_distance import distances

ALONE = 5.0
"""Distance between two ends, and from each to every solid [m]."""
_CANDIDATES = 8192
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclasses.dataclass(frozen=True)
class Swaps:
    """Ends of the vehicles of a fleet [m]: 2k and 2k + 1 swap their places."""

    start: Float[np.ndarray, "n 3"]
    goal: Float[np.ndarray, "n 3"]

    @classmethod
    def of(cls, ends: Float[np.ndarray, "m 3"], count: int) -> Swaps:
        """The first `count` vehicles between ends in pairs, [0, 1], [2, 3] and so on."""
        return cls(ends[:count], ends.reshape(-1, 2, 3)[:, ::-1].reshape(-1, 3)[:count])


def city_swaps(name: str, seed: int, count: int) -> Swaps:
    """Swaps in `make_scene(name, seed)`.

    Args:
        name: one of `MAPS`.
        seed: of the city, and of the draws.
        count: of vehicles; where it is odd, the last one flies to where nobody starts.

    Raises:
        ValueError: for an unknown map, a negative seed, fewer than two vehicles, or more than the city has room for.
    """
    if name not in MAPS:
        raise ValueError(f"map: expected one of {', '.join(MAPS)}, given {name!r}")
    if count < 2:
        raise ValueError(f"fleet: expected 2 vehicles or more, given {count}")
    if not 0 <= seed < 2**31:
        raise ValueError(f"seed: expected 0 to 2^31 - 1, given {seed}")
    geoms = make_scene(name, seed).geoms
    occupied, ground = occupancy(geoms, TRUTH)
    key = named_key(jax.random.key(seed), f"swaps {name}")
    points, fit = (np.asarray(x) for x in _points(geoms, open_air(jnp.asarray(occupied), jnp.asarray(ground)), key))
    pairs = _paired(_thinned(points[fit].astype(np.float64)))
    if 2 * len(pairs) < count:
        raise ValueError(f"fleet: expected at most {2 * len(pairs)} vehicles in {name}:{seed}, given {count}")
    return Swaps.of(np.concatenate(pairs[: (count + 1) // 2]), count)


def antipodal(count: int, radius: float, *, sphere: bool) -> Swaps:
    """Swaps between opposite points of a horizontal circle or of a sphere, around the origin.

    Args:
        count: of vehicles, even.
        radius: [m].
        sphere: whether the points are spread over a sphere.

    Raises:
        ValueError: for an odd count, or one below 2.
    """
    if count < 2 or count % 2:
        raise ValueError(f"antipodal: expected an even number of vehicles, at least 2, given {count}")
    k = np.arange(count // 2)
    height = (k + 0.5) / len(k) if sphere else np.zeros(len(k))
    turn = _GOLDEN_ANGLE if sphere else math.pi / len(k)
    level = np.sqrt(1.0 - height**2)
    unit = np.stack([level * np.cos(turn * k), level * np.sin(turn * k), height], -1)
    return Swaps.of(radius * np.stack([unit, -unit], 1).reshape(-1, 3), count)


@stored("swaps")
def _points(
    geoms: Geoms, air: Bool[Array, "nx ny nz"], key: PRNGKeyArray
) -> tuple[Float[Array, "n 3"], Bool[Array, " n"]]:
    """Points, and whether each stands clear and in the open air."""
    low, high = (jnp.array([x, x, z]) for x, z in zip((-HALF_AREA, HALF_AREA), HEIGHT, strict=True))
    points = jax.random.uniform(key, (_CANDIDATES, 3), minval=low, maxval=high)
    points = jnp.round(64.0 * points) / 64.0  # exact in decimal print
    is_plane = np.array([kind == PLANE for kind in geoms.type])
    clear = jax.vmap(lambda point: jnp.all(is_plane | (distances(geoms, point) >= ALONE)))(points)
    voxel = TRUTH.index_of(points)
    return points, clear & air[voxel[:, 0], voxel[:, 1], voxel[:, 2]]


def _thinned(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Points in order but those that lie near one before them."""
    kept = np.empty((0, 3))
    for point in points:
        if not np.any(np.linalg.norm(kept - point, axis=1) < ALONE):
            kept = np.concatenate([kept, point[None]])
    return kept


def _paired(points: Float[np.ndarray, "n 3"]) -> list[Float[np.ndarray, "2 3"]]:
    """Pairs of points at the distance that trials have."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    suits = np.triu((apart >= APART[0]) & (apart <= APART[1]))
    pairs = []
    for k in range(len(points)):
        if suits[k].any():
            other = int(np.argmax(suits[k]))
            pairs.append(points[[k, other]])
            suits[:, [k, other]] = False
            suits[other] = False
    return pairs
