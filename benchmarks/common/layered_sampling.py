"""Paths through layers of random points, as GTMP finds thousands at once (Le et al. 2024, arXiv:2411.19393), in a page.

l layers of n points, uniform in the map; a segment between points of neighbouring layers is free if none of c points on
it lies in a blocked voxel;  V(goal) = 0,  V(x) = min over free segments to the next layer of |x − y| + V(y)

Values run back from the goal, and the path follows their minima. There is no clearance price and no certificate, and
what lies between the c points is not looked at: a verifier has to.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key

from maxjax.core.grid import Grid

_AT_A_TIME = 16  # paths, for memory's sake


@functools.partial(jax.jit, static_argnames=("grid", "sizes"))
def layered_paths(
    blocked: Bool[Array, "nx ny nz"],
    ends: Float[Array, "2 3"],
    keys: Key[Array, " p"],
    grid: Grid,
    sizes: tuple[int, int, int] = (3, 48, 32),
) -> Float[Array, "p t 3"]:
    """Paths [m], each in layers of its own; NaN where none is free.

    Args:
        blocked: voxels to keep out of.
        ends: start and goal [m].
        keys: one a path.
        grid: static.
        sizes: l, n and c; static.
    """
    layers, points, checks = sizes
    along = jnp.linspace(0, 1, checks)

    def free(x: Float[Array, "n 3"], y: Float[Array, "m 3"]) -> Bool[Array, "n m"]:
        on = x[:, None, None] + along[:, None] * (y[None, :, None] - x[:, None, None])
        at = grid.index_of(on)
        return ~jnp.any(blocked[at[..., 0], at[..., 1], at[..., 2]], axis=-1)

    def path(key: Key[Array, ""]) -> Float[Array, "t 3"]:
        drawn = jax.random.uniform(key, (layers, points, 3), minval=jnp.array(grid.lower), maxval=jnp.array(grid.upper))
        levels = [ends[:1], *drawn, ends[1:]]
        value, nexts = jnp.zeros(1), []
        for x, y in zip(levels[-2::-1], levels[:0:-1], strict=True):
            lengths = jnp.linalg.norm(x[:, None] - y, axis=-1)
            sums = jnp.where(free(x, y), lengths + value, jnp.inf)
            nexts.append(jnp.argmin(sums, axis=1))
            value = jnp.min(sums, axis=1)
        at, places = jnp.int32(0), [ends[0]]
        for level, nearest in zip(levels[1:], reversed(nexts), strict=True):
            at = nearest[at]
            places.append(level[at])
        return jnp.where(jnp.isfinite(value[0]), jnp.stack(places), jnp.nan)

    found: Float[Array, "p t 3"] = jax.lax.map(path, keys, batch_size=_AT_A_TIME)
    return found
