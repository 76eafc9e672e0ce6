"""Midtown and downtown: 4 by 4 lots between streets, each lot one city block of `blocks`.

Lots fill the square |x|, |y| <= 120 m with streets of random width between them; every lot draws a recipe
from a fixed count, bridges join facades across streets, and the kerbs carry lamps and parked vehicles.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from maxjax.sim.worlds.blocks import DRAWS, RECIPES, build_block
from maxjax.sim.worlds.city import HALF_CITY, turn, uniform
from maxjax.sim.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.sim.worlds.solids import poles, trees, upright_boxes, vehicles

_LOTS = 4  # along each axis
_PAIRS = 2 * _LOTS * (_LOTS - 1)  # neighbours across a street
_SQUARES = 2  # of the lots
_TREES = 16
_POLES = 14
_VEHICLES = 16


@dataclasses.dataclass(frozen=True)
class BlockCity:
    """Parameters of a city of blocks.

    Attributes:
        lots: number of lots of each recipe, 16 in all.
        height: least and greatest height of buildings [m].
        street: least and greatest width of streets [m].
        staggered: whether cross streets are offset from row to row.
        bridges: whether footbridges cross streets.
    """

    lots: dict[str, int]
    height: tuple[float, float]
    street: tuple[float, float]
    staggered: bool
    bridges: bool


MIDTOWN = BlockCity(
    lots={"terraces": 5, "courtyard": 4, "slabs": 2, "quarters": 2, "podium_tower": 1, "square": 2},
    height=(9.0, 42.0),
    street=(16.0, 24.0),
    staggered=True,
    bridges=False,
)
DOWNTOWN = BlockCity(
    lots={"podium_tower": 4, "quarters": 4, "courtyard": 2, "slabs": 2, "overhang": 2, "square": 2},
    height=(20.0, 116.0),
    street=(18.0, 28.0),
    staggered=False,
    bridges=True,
)


def _partition(u: Float[Array, "2 lots"], street: tuple[float, float]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Middles and half widths [m] of the lots along one axis, streets of random width between them."""
    streets = street[0] + (street[1] - street[0]) * u[0, 1:]
    shares = 0.8 + 0.45 * u[1]
    widths = shares / jnp.sum(shares) * (2.0 * HALF_CITY - jnp.sum(streets))
    lower = -HALF_CITY + jnp.cumsum(widths) - widths + jnp.concatenate([jnp.zeros(1), jnp.cumsum(streets)])
    return lower + 0.5 * widths, 0.5 * widths


def _kerb(
    u: Float[Array, " n"],
    sides: Int[Array, " n"],
    center: Float[Array, "m 2"],
    half: Float[Array, "m 2"],
    gap: float,
) -> tuple[Float[Array, "n 2"], Float[Array, " n"]]:
    """Points `gap` [m] outside the given sides (4 a lot) of the lots, and the street's direction there [rad]."""
    lot, side = sides // 4, sides % 4
    axis, sign = side % 2, jnp.where(side < 2, -1.0, 1.0)
    along = 1.5 * (u - 0.5)
    normal = jax.nn.one_hot(axis, 2)
    reach = half[lot] * (normal * sign[:, None] + (1.0 - normal) * along[:, None])
    return center[lot] + reach + gap * normal * sign[:, None], jnp.where(axis == 0, 0.5 * jnp.pi, 0.0)


def _bridges(
    u: Float[Array, "pairs 8 2"],
    rows: Float[Array, "lots slots 7"],
    center: Float[Array, "lots 2"],
    half: Float[Array, "lots 2"],
) -> Geoms:
    """Footbridges across streets: one a pair of neighbouring lots at most, where two facades face each other.

    Each pair draws eight candidates (offset along the street, height) and builds the first whose ends, a
    metre inside both lots, lie inside buildings.
    """
    lots = jnp.arange(_LOTS * _LOTS).reshape(_LOTS, _LOTS)
    first = jnp.concatenate([lots[:-1].ravel(), lots[:, :-1].ravel()])
    second = jnp.concatenate([lots[1:].ravel(), lots[:, 1:].ravel()])
    axis = jnp.repeat(jnp.arange(2), _LOTS * (_LOTS - 1))

    def inside(lot: Int[Array, ""], point: Float[Array, "3"]) -> Bool[Array, ""]:
        x, y, half_length, half_width, bottom, top, yaw = rows[lot].T
        # Rotated facades recede from the street: bridges join only buildings aligned with the lot.
        within = (jnp.abs(point[0] - x) < half_length - 2.0) | (jnp.abs(point[1] - y) < half_width - 2.0)
        within &= (jnp.abs(point[0] - x) < half_length) & (jnp.abs(point[1] - y) < half_width)
        return jnp.any(within & (yaw == 0.0) & (point[2] - 1.0 > bottom) & (point[2] + 4.0 < top))

    def pair(u: Float[Array, "8 2"], i: Int[Array, ""], j: Int[Array, ""], axis: Int[Array, ""]) -> Float[Array, "7"]:
        start = center[i, axis] + half[i, axis]
        end = center[j, axis] - half[j, axis]
        across = center[i, 1 - axis] + half[i, 1 - axis] * 1.5 * (u[:, 0] - 0.5)
        z = 8.0 + 20.0 * u[:, 1]

        def point(along: Float[Array, ""]) -> Float[Array, "8 3"]:
            along = jnp.broadcast_to(along, across.shape)
            return jnp.stack([jnp.where(axis == 0, along, across), jnp.where(axis == 0, across, along), z], -1)

        good = jax.vmap(inside, (None, 0))(i, point(start - 1.0)) & jax.vmap(inside, (None, 0))(j, point(end + 1.0))
        best = jnp.argmax(good)
        length = 0.5 * (end - start) + 1.0
        middle = 0.5 * (start + end)
        return jnp.stack(
            [
                jnp.where(axis == 0, middle, across[best]),
                jnp.where(axis == 0, across[best], middle),
                jnp.where(axis == 0, length, 1.8),
                jnp.where(axis == 0, 1.8, length),
                z[best],
                jnp.where(good[best], z[best] + 3.5, 0.0),
                0.0,
            ]
        )

    return upright_boxes(jax.vmap(pair)(u, first, second, axis))


def block_city(key: PRNGKeyArray, city: BlockCity) -> Geoms:
    """A city of 4 by 4 lots; `blocks` lists the recipes of a lot."""
    n = _LOTS * _LOTS
    u_y, u_x, u_kind, u_facing, u_rows, u_bridge, u_side, u_lamp, u_kerb, u_vehicle, u_tree, u_turn = uniform(
        key,
        *[(2, _LOTS), (_LOTS if city.staggered else 1, 2, _LOTS), (n,), (n,), (n, DRAWS), (_PAIRS, 8, 2)],
        *[(4 * n,), (_POLES,), (_VEHICLES,), (_VEHICLES, 2), (_TREES, 6), ()],
    )
    y_middle, y_half = _partition(u_y, city.street)
    x_middle, x_half = jax.vmap(lambda u: _partition(u, city.street))(jnp.broadcast_to(u_x, (_LOTS, 2, _LOTS)))
    # Lots in [x, y] order, as arrays index.
    center = jnp.stack([x_middle.T, jnp.broadcast_to(y_middle, (_LOTS, _LOTS))], -1).reshape(-1, 2)
    half = jnp.stack([x_half.T, jnp.broadcast_to(y_half, (_LOTS, _LOTS))], -1).reshape(-1, 2)

    names = [recipe.__name__ for recipe in RECIPES]
    kinds = jnp.array([names.index(name) for name, count in city.lots.items() for _ in range(count)])
    kind = kinds[jnp.argsort(u_kind)]
    facing = jnp.floor(4.0 * u_facing).astype(jnp.int32)
    rows = jax.vmap(build_block, (0, 0, 0, 0, 0, None))(u_rows, facing, kind, center, half, jnp.array(city.height))
    groups = [ground_plane(), upright_boxes(rows.reshape(-1, 7))]
    if city.bridges:
        groups.append(_bridges(u_bridge, rows, center, half))

    # Every side of a lot holds at most one item, so that items do not intersect.
    sides = jnp.argsort(u_side)
    lamp, _ = _kerb(u_lamp, sides[:_POLES], center, half, 1.0)
    groups.append(poles(lamp, jnp.full(_POLES, 8.0), radius=0.12))
    parked, yaw = _kerb(u_kerb, sides[_POLES : _POLES + _VEHICLES], center, half, 3.0)
    groups.append(vehicles(u_vehicle, parked, yaw))

    squares = jnp.nonzero(kind == names.index("square"), size=_SQUARES)[0]
    groups.append(_square_trees(u_tree, center[squares], half[squares]))
    return turn(concatenate(groups), u_turn)


def _square_trees(u: Float[Array, "n 6"], center: Float[Array, "s 2"], half: Float[Array, "s 2"]) -> Geoms:
    """Trees in a ring along the edges of the squares, the same number in each."""
    each = _TREES // center.shape[0]
    angle = 2.0 * jnp.pi * (jnp.arange(_TREES) % each + 0.5 * u[:, 0]) / each
    ring = jnp.stack([jnp.cos(angle), jnp.sin(angle)], -1) * (0.72 + 0.08 * u[:, 1:2])
    position = jnp.repeat(center, each, axis=0) + ring * jnp.repeat(half, each, axis=0)
    return trees(u[:, 2:], position)
