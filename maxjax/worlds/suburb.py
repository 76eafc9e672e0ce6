"""The suburb: houses with pitched or stepped roofs in gardens, along four roads that share one bend.

    y_road(x) = y_0 + A sin(k x + phase)

Houses stand parallel to the road in front of them; behind them lie gardens with trees.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from maxjax.worlds.city import HALF_CITY, turn, uniform
from maxjax.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.worlds.solids import Rows, gable_roofs, poles, trees, upright_boxes, vehicles

_ROADS = 4
_HOUSES_A_SIDE = 8
_TREES = 20
_POLES = 14
_VEHICLES = 16


def suburb(key: PRNGKeyArray) -> Geoms:
    """Houses on both sides of four roads that share one bend, cut by two cross roads."""
    n = _ROADS * 2 * _HOUSES_A_SIDE
    u_road, bend, u, u_garage, v, u_garden, u_lamp, u_kerb, u_vehicle, u_turn = uniform(
        key,
        *[(_ROADS,), (3,), (n, 10), (len(range(0, n, 3)),), (_TREES, 6), (_TREES,)],
        *[(_POLES, 2), (_VEHICLES, 2), (_VEHICLES, 2), ()],
    )
    pitch = 2.0 * HALF_CITY / _ROADS
    road_y = -HALF_CITY + pitch * (jnp.arange(_ROADS) + 0.5) + 6.0 * (u_road - 0.5)
    amplitude, phase = 9.0 * bend[0], 2.0 * jnp.pi * bend[1]
    wavenumber = 2.0 * jnp.pi / (150.0 + 130.0 * bend[2])

    def bent(x: Float[Array, " n"], y: Float[Array, " n"]) -> tuple[Float[Array, "n 2"], Float[Array, " n"]]:
        """Position and direction [rad] at distance y across from the city's axis, following the bend."""
        shift = amplitude * jnp.sin(wavenumber * x + phase)
        slope = amplitude * wavenumber * jnp.cos(wavenumber * x + phase)
        return jnp.stack([x, y + shift], -1), jnp.arctan(slope)

    # Lots along a road: two, a cross road of 14 m, four, a cross road, two.
    cross = 14.0
    lot = (2.0 * HALF_CITY - 2.0 * cross) / _HOUSES_A_SIDE
    passed = jnp.array([0, 0, 1, 1, 1, 1, 2, 2])
    lot_x = -HALF_CITY + lot * (jnp.arange(_HOUSES_A_SIDE) + 0.5) + cross * passed

    index = jnp.arange(n)
    road, side = index // (2 * _HOUSES_A_SIDE), jnp.where((index // _HOUSES_A_SIDE) % 2 == 0, -1.0, 1.0)
    terrace = u[:, 0] < 0.35
    half_length = jnp.where(terrace, 9.0, 5.0) + 2.5 * u[:, 1]
    half_width = 4.0 + 1.2 * u[:, 2]
    slack = 0.5 * lot - 1.0 - half_length
    x = lot_x[index % _HOUSES_A_SIDE] + slack * (2.0 * u[:, 3] - 1.0)
    y = road_y[road] + side * (8.5 + half_width + 2.0 * u[:, 4])
    position, direction = bent(x, y)
    yaw = direction + 0.12 * (u[:, 5] - 0.5)
    eave = 5.2 + 3.0 * u[:, 6]
    vacant = u[:, 7] < 0.08
    zero = jnp.zeros(n)
    body = jnp.stack(
        [position[:, 0], position[:, 1], half_length, half_width, zero, jnp.where(vacant, 0.0, eave), yaw], -1
    )
    pitched = u[:, 8] < 0.6
    roofs = gable_roofs(body, jnp.minimum(half_width + 0.3, eave - 0.3))
    steps = upright_boxes(_stepped(body, u[:, 9]))
    roof = Geoms(
        jnp.where(pitched[:, None], roofs.position, steps.position),
        jnp.where(pitched[:, None, None], roofs.rotation, steps.rotation),
        jnp.where(pitched[:, None], roofs.size, steps.size),
        roofs.type,
    )
    # Every third house has a low garage or extension at its back.
    garage = _extension(body[::3], side[::3], u_garage)

    along = -HALF_CITY + 2.0 * HALF_CITY * (jnp.arange(_TREES) + v[:, 0]) / _TREES
    # Gardens lie between the backs of two rows of houses, midway between two roads.
    garden = 0.5 * (road_y[:-1] + road_y[1:])[jnp.argsort(u_garden) % (_ROADS - 1)]
    tree_position, _ = bent(along, garden + 3.5 * (2.0 * v[:, 1] - 1.0))

    def roadside(w: Float[Array, "m 2"], gap: float) -> tuple[Float[Array, "m 2"], Float[Array, " m"]]:
        count = w.shape[0]
        x = -HALF_CITY + 2.0 * HALF_CITY * (jnp.arange(count) + w[:, 0]) / count
        return bent(x, road_y[jnp.arange(count) % _ROADS] + gap * jnp.where(w[:, 1] < 0.5, -1.0, 1.0))

    lamp, _ = roadside(u_lamp, 5.5)
    parked, parked_yaw = roadside(u_kerb, 3.2)
    groups = [
        ground_plane(),
        upright_boxes(body),
        roof,
        garage,
        poles(lamp, jnp.full(_POLES, 7.0), radius=0.12),
        vehicles(u_vehicle, parked, parked_yaw),
        trees(v[:, 2:], tree_position),
    ]
    return turn(concatenate(groups), u_turn)


def _stepped(body: Rows, share: Float[Array, " n"]) -> Rows:
    """An upper storey, set back, in place of a pitched roof."""
    top = body[:, 5]
    factor = 0.55 + 0.3 * share
    storey = jnp.where(top > 0.0, top + 2.8, 0.0)
    return jnp.stack([body[:, 0], body[:, 1], factor * body[:, 2], factor * body[:, 3], top, storey, body[:, 6]], -1)


def _extension(body: Rows, side: Float[Array, " n"], u: Float[Array, " n"]) -> Geoms:
    """A garage that touches the garden side of each house."""
    x, y, half_length, half_width, _, top, yaw = body.T
    length, depth = 2.5 + u, 2.0 + u
    across = side * (half_width + depth)
    along = (half_length - length) * (2.0 * u - 1.0)
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    height = jnp.where(top > 0.0, 2.8 + 0.8 * u, 0.0)
    position = [x + c * along - s * across, y + s * along + c * across]
    return upright_boxes(jnp.stack([*position, length, depth, jnp.zeros_like(x), height, yaw], -1))
