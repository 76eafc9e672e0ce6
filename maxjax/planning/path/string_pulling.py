"""String pulling: the shortest or cheapest polyline through mutually visible points of a path.

    cost(i) = min over j > i with j visible from i of  ∫ n ds from x_i to x_j  +  cost(j)

is solved by dynamic programming over the points of the path, which never lengthens it and never leaves free space:
every new edge was found clear (`line_of_sight.clear`). Without a price n = 1 and the integral is |x_j − x_i|; with one
it is that of `clear_and_costs`, by which the path never becomes dearer. The points that survive are the corners of the
new path; extra points inserted along its edges then let the next round cut each corner closer to the obstacle, until
the string is taut.

Positions are index coordinates. A path is a fixed-length array whose last point is repeated to its end.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from maxjax.compile.lowering import costs_to_last
from maxjax.planning.path.line_of_sight import Sight, visibility

# Points that one round of dynamic programming joins: its cost is quadratic, its reach linear.
WINDOW = 64
# Of an edge, to break ties towards fewer corners, as on a straight line.
_TOLL = 1e-4


def _shorten(
    sight: Sight,
    points: Float[Array, "n 3"],
    price: Float[Array, "nx ny nz"] | None,
) -> tuple[Float[Array, "n 3"], Float[Array, ""]]:
    """One round of dynamic programming on n points, and its cost; consecutive points are taken as visible."""
    n = points.shape[0]
    seen, paid = visibility(sight, points, price=price)
    edge = jnp.where(seen | np.eye(n, k=1, dtype=bool), paid + _TOLL, jnp.inf)
    cost = costs_to_last(edge)
    # The end leads to itself.
    follow = jnp.argmin(edge + cost[None], axis=1).astype(jnp.int32).at[-1].set(n - 1)

    # The path 0, follow(0), follow(follow(0)), …: each turn doubles what is known of it.
    path = jnp.zeros(1, jnp.int32)
    while path.shape[0] < n:
        path, follow = jnp.concatenate([path, follow[path]]), follow[follow]
    path = path[:n]
    edges = jnp.sum(path[1:] != path[:-1]).astype(points.dtype)
    return points[path], (jnp.min(edge[0] + cost) - _TOLL * edges).astype(points.dtype)


def _unrepeat(points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Move repeated points to the end of the array."""
    n = points.shape[0]
    moved = jnp.concatenate([jnp.ones(1, bool), jnp.any(points[1:] != points[:-1], axis=1)])
    slot = jnp.where(moved, jnp.cumsum(moved) - 1, n)
    return jnp.broadcast_to(points[-1], points.shape).at[slot].set(points, mode="drop")


def _refine(points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Spend the repeated points at the end of a path on new points along its edges, evenly by length."""
    n = points.shape[0]
    length = jnp.linalg.norm(jnp.diff(points, axis=0), axis=1)
    edges = jnp.sum(length > 0)
    spare = n - 1 - edges
    share = jnp.where(length > 0, jnp.floor(spare * length / jnp.maximum(length.sum(), 1e-9)), 0).astype(jnp.int32)
    first = jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(jnp.where(length > 0, share + 1, 0))])
    slot = jnp.arange(n)
    edge = jnp.clip(jnp.sum(first[None] <= slot[:, None], axis=1) - 1, 0, n - 2)
    edge = jnp.minimum(edge, jnp.maximum(edges - 1, 0))
    fraction = ((slot - first[edge]) / (share[edge] + 1)).astype(points.dtype)
    start, end = points[edge], points[edge + 1]
    return jnp.where((fraction < 1)[:, None], start + fraction[:, None] * (end - start), end)


@jax.named_scope("tighten")
def tighten(
    sight: Sight, path: Float[Array, "n 3"], price: Float[Array, "nx ny nz"] | None = None, rounds: int = 4
) -> Float[Array, "n 3"]:
    """Pull a path taut.

    Args:
        sight: of the blocked voxels.
        path: index coordinates, start first, last point repeated; consecutive points visible from each other and at
            most a voxel apart along each axis.
        price: n ≥ 1 of a metre in each voxel, finite; none: 1.
        rounds: rounds over the whole path, after two that take it window by window. Static.

    Returns:
        A path of the same start, end and array length, never longer (dearer), every edge clear.
    """
    n = path.shape[0]
    room = -(-n // WINDOW) * WINDOW + WINDOW // 2
    points = _unrepeat(jnp.concatenate([path, jnp.broadcast_to(path[-1], (room - n, 3))]))
    used = jnp.sum(jnp.any(points[1:] != points[:-1], axis=1)) + 1
    # Window by window, and where there are seams once more across them; then all points that are left at a time, of
    # which the first such round, where there are prices, says what they cost.
    first = jnp.clip(-(-used // WINDOW), 1, room // WINDOW)
    second = jnp.where(used > WINDOW, -(-(used - WINDOW // 2) // WINDOW), 0)
    windows, joined = first + second, 0 if price is None else (second > 0).astype(jnp.int32)

    def round_(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        k, points, cost, _ = carry
        points = jnp.where(k == windows, _unrepeat(points), points)
        whole, fits = k >= windows, jnp.all(points[WINDOW - 1 :] == points[-1])
        at = jnp.where(k < first, k * WINDOW, (k - first) * WINDOW + WINDOW // 2)
        at = jnp.where(whole, 0, at)
        some = lax.dynamic_slice(points, (at, 0), (WINDOW, 3))
        refined = k >= windows + joined
        found, paid = _shorten(sight, jnp.where(refined, _refine(some), some), price)
        # What the parts of an edge cost is what the edge costs, but for the error of the quadrature.
        cheaper = True if price is None else ~refined | (paid <= cost)
        better = ~whole | (fits & cheaper)
        after = jnp.where(better, lax.dynamic_update_slice(points, found, (at, 0)), points)
        # A refined round that changes nothing would do so again.
        taut = refined & jnp.all(after == points)
        return k + 1, after, jnp.where(better, paid, cost), taut

    def going(carry: tuple[Array, Array, Array, Array]) -> Bool[Array, ""]:
        k, _, _, taut = carry
        return (k < windows + joined + rounds) & ~taut

    first_round = jnp.int32(0), points, jnp.zeros((), path.dtype), jnp.array(False)
    _, points, _, _ = lax.while_loop(going, round_, first_round)
    return jnp.asarray(points[:n])
