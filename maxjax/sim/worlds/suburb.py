"""The suburb: houses with pitched or stepped roofs in gardens, along four roads that share one bend.

    y_road(x) = y_0 + A sin(k x + phase)

Houses stand parallel to the nearest road; gardens with trees lie at their backs.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from maxjax.sim.worlds.city import HALF_CITY, turn, uniform
from maxjax.sim.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.sim.worlds.solids import Rows, gable_roofs, poles, trees, upright_boxes, vehicles

_ROADS = 4
_HOUSES_A_SIDE = 8
_HOUSES = _ROADS * 2 * _HOUSES_A_SIDE
_TREES = 20
_POLES = 14
_VEHICLES = 16


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Roads:
    """Four roads that share one bend.

    Attributes:
        y: y_0 of each road [m].
        amplitude: A [m].
        wavenumber: k [rad/m].
        phase: [rad].
    """

    y: Float[Array, " roads"]
    amplitude: Float[Array, ""]
    wavenumber: Float[Array, ""]
    phase: Float[Array, ""]

    def bent(self, x: Float[Array, " n"], y: Float[Array, " n"]) -> tuple[Float[Array, "n 2"], Float[Array, " n"]]:
        """Positions [m] at distance y from the axis of the city, moved with the bend, and its direction there [rad]."""
        shift = self.amplitude * jnp.sin(self.wavenumber * x + self.phase)
        slope = self.amplitude * self.wavenumber * jnp.cos(self.wavenumber * x + self.phase)
        return jnp.stack([x, y + shift], -1), jnp.arctan(slope)

    def side(self, u: Float[Array, "n 2"], gap: float) -> tuple[Float[Array, "n 2"], Float[Array, " n"]]:
        """Positions `gap` [m] beside the roads' middles, in turn along each of them, and the direction there [rad]."""
        count = u.shape[0]
        x = -HALF_CITY + 2.0 * HALF_CITY * (jnp.arange(count) + u[:, 0]) / count
        return self.bent(x, self.y[jnp.arange(count) % _ROADS] + gap * jnp.where(u[:, 1] < 0.5, -1.0, 1.0))


def suburb(key: PRNGKeyArray) -> Geoms:
    """Houses on both sides of four roads that share one bend, cut by two cross roads."""
    u_road, bend, u_house, u_garage, u_tree, u_garden, u_lamp, u_kerb, u_vehicle, u_turn = uniform(
        key,
        *[(_ROADS,), (3,), (_HOUSES, 10), (len(range(0, _HOUSES, 3)),), (_TREES, 6), (_TREES,)],
        *[(_POLES, 2), (_VEHICLES, 2), (_VEHICLES, 2), ()],
    )
    pitch = 2.0 * HALF_CITY / _ROADS
    road_y = -HALF_CITY + pitch * (jnp.arange(_ROADS) + 0.5) + 6.0 * (u_road - 0.5)
    amplitude, phase = 9.0 * bend[0], 2.0 * jnp.pi * bend[1]
    wavenumber = 2.0 * jnp.pi / (150.0 + 130.0 * bend[2])
    roads = Roads(road_y, amplitude, wavenumber, phase)
    lamp, _ = roads.side(u_lamp, 5.5)
    parked, parked_yaw = roads.side(u_kerb, 3.2)
    groups = [
        ground_plane(),
        *_houses(u_house, u_garage, roads),
        poles(lamp, jnp.full(_POLES, 7.0), radius=0.12),
        vehicles(u_vehicle, parked, parked_yaw),
        _garden_trees(u_tree, u_garden, roads),
    ]
    return turn(concatenate(groups), u_turn)


def _houses(u: Float[Array, "n 10"], u_garage: Float[Array, " m"], roads: Roads) -> tuple[Geoms, Geoms, Geoms]:
    """Bodies, roofs, and a low garage or extension at the back of every third house."""
    # Lots along a road: two, a cross road of 14 m, four, a cross road, two.
    cross = 14.0
    lot = (2.0 * HALF_CITY - 2.0 * cross) / _HOUSES_A_SIDE
    passed = jnp.array([0, 0, 1, 1, 1, 1, 2, 2])
    lot_x = -HALF_CITY + lot * (jnp.arange(_HOUSES_A_SIDE) + 0.5) + cross * passed

    index = jnp.arange(_HOUSES)
    road, side = index // (2 * _HOUSES_A_SIDE), jnp.where((index // _HOUSES_A_SIDE) % 2 == 0, -1.0, 1.0)
    terrace = u[:, 0] < 0.35
    half_length = jnp.where(terrace, 9.0, 5.0) + 2.5 * u[:, 1]
    half_width = 4.0 + 1.2 * u[:, 2]
    slack = 0.5 * lot - 1.0 - half_length
    x = lot_x[index % _HOUSES_A_SIDE] + slack * (2.0 * u[:, 3] - 1.0)
    y = roads.y[road] + side * (8.5 + half_width + 2.0 * u[:, 4])
    position, direction = roads.bent(x, y)
    yaw = direction + 0.12 * (u[:, 5] - 0.5)
    eave = 5.2 + 3.0 * u[:, 6]
    vacant = u[:, 7] < 0.08
    zero = jnp.zeros(_HOUSES)
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
    return upright_boxes(body), roof, _extension(body[::3], side[::3], u_garage)


def _garden_trees(u: Float[Array, "n 6"], u_garden: Float[Array, " n"], roads: Roads) -> Geoms:
    """Trees in the gardens, which lie between the backs of two rows of houses, midway between two roads."""
    along = -HALF_CITY + 2.0 * HALF_CITY * (jnp.arange(_TREES) + u[:, 0]) / _TREES
    garden = 0.5 * (roads.y[:-1] + roads.y[1:])[jnp.argsort(u_garden) % (_ROADS - 1)]
    position, _ = roads.bent(along, garden + 3.5 * (2.0 * u[:, 1] - 1.0))
    return trees(u[:, 2:], position)


def _stepped(body: Rows, share: Float[Array, " n"]) -> Rows:
    """An upper storey, set back, in place of a pitched roof."""
    top = body[:, 5]
    factor = 0.55 + 0.3 * share
    storey = jnp.where(top > 0.0, top + 2.8, 0.0)
    return jnp.stack([body[:, 0], body[:, 1], factor * body[:, 2], factor * body[:, 3], top, storey, body[:, 6]], -1)


def _extension(body: Rows, side: Float[Array, " n"], u: Float[Array, " n"]) -> Geoms:
    """A garage in contact with the garden side of each house."""
    x, y, half_length, half_width, _, top, yaw = body.T
    length, depth = 2.5 + u, 2.0 + u
    across = side * (half_width + depth)
    along = (half_length - length) * (2.0 * u - 1.0)
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    height = jnp.where(top > 0.0, 2.8 + 0.8 * u, 0.0)
    position = [x + c * along - s * across, y + s * along + c * across]
    return upright_boxes(jnp.stack([*position, length, depth, jnp.zeros_like(x), height, yaw], -1))
