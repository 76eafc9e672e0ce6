"""Scans of simulated cities: what one shows, and what is there.

A sensor stands at a free place, 3 to 15 m above the ground. A voxel is *seen occupied* if a return lies in it, *seen
free* if a beam that returned passes its inside and no return lies in it, else *unseen*: of beams without a return
clouds do not tell the direction. The grid lies around the sensor, moved by whole voxels.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from maxjax.core.grid import Grid
from maxjax.fields.occupancy import voxelize
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.layouts import MAPS
from maxjax.sim.worlds.rasterize import occupancy
from maxjax.sim.worlds.scenes import make_scene

GRID = Grid((96, 96, 40), 2.0, (-96.0, -96.0, -8.0))
"""Around a sensor at (0, 0) [m]; heights are the city's."""
SEEN_FREE, SEEN_OCCUPIED, GROUND, OCCUPIED = 1, 2, 4, 8
"""Bits of a voxel: what was seen, what is known before, what is there."""

_LIDAR = Lidar()
_REACH, _LOW, _HIGH = 80.0, 3.0, 15.0  # of sensors from the middle of the city, and above the ground [m]
_TRIES = 1000


class Sighting(NamedTuple):
    """What one scan shows on a grid.

    Attributes:
        seen_occupied, seen_free: voxels.
        returns: [m], NaN where nothing returned.
    """

    seen_occupied: Bool[Array, "nx ny nz"]
    seen_free: Bool[Array, "nx ny nz"]
    returns: Float[Array, "r 3"]


@functools.partial(jax.jit, static_argnames="grid")
def look(geoms: Geoms, sensor: Float[Array, " 3"], key: Array, grid: Grid) -> Sighting:
    """What a level sensor sees of a city.

    Args:
        geoms: solids of the city.
        sensor: position [m].
        key: of the noise.
        grid: static.
    """
    points = scan(geoms, _LIDAR, sensor, jnp.eye(3), key).points
    occupied = voxelize(points, grid).occupied
    return Sighting(occupied, passed(sensor, points, grid) & ~occupied, points)


def passed(sensor: Float[Array, " 3"], returns: Float[Array, "r 3"], grid: Grid) -> Bool[Array, "nx ny nz"]:
    """Voxels that hold a point of a beam, taken every half voxel from the sensor to half a voxel before its return.

    Args:
        sensor: position [m].
        returns: ends of beams [m]; those that are not finite are left out.
        grid: static.
    """
    valid = jnp.all(jnp.isfinite(returns), axis=1)
    way = jnp.where(valid[:, None], returns - sensor, 0.0)
    length = jnp.linalg.norm(way, axis=1)
    direction = way / jnp.maximum(length, 1e-6)[:, None]
    step = 0.5 * grid.spacing
    count = int(np.ceil(_LIDAR.max_range / step))

    def mark(k: Array, seen: Bool[Array, "nx ny nz"]) -> Bool[Array, "nx ny nz"]:
        along = step * k.astype(jnp.float32)
        point = sensor + along * direction
        there = valid & (along <= length - step) & grid.contains(point)
        at = jnp.where(there[:, None], grid.index_of(point), -1)
        return seen.at[at[:, 0], at[:, 1], at[:, 2]].max(there, mode="drop", wrap_negative_indices=False)

    seen: Bool[Array, "nx ny nz"] = jax.lax.fori_loop(0, count, mark, jnp.zeros(grid.shape, bool))
    return seen


def draw_scene(name: str, seed: int, city: int, index: int) -> UInt8[np.ndarray, "nx ny nz"]:
    """The bits of a scan from a place in a city, around the sensor.

    Args:
        name: of `MAPS`.
        seed: of all.
        city: of the map, from `seed` on.
        index: of the place in the city.
    """
    scene = make_scene(name, seed + city)
    rng = np.random.default_rng([seed, MAPS.index(name), city, index])
    for _ in range(_TRIES):
        sensor = rng.uniform((-_REACH, -_REACH, _LOW), (_REACH, _REACH, _HIGH)).astype(np.float32)
        x, y = (GRID.spacing * np.round(v / GRID.spacing) for v in sensor[:2])
        grid = Grid(GRID.shape, GRID.spacing, (GRID.origin[0] + float(x), GRID.origin[1] + float(y), GRID.origin[2]))
        occupied, ground = occupancy(scene.geoms, grid)
        if not occupied[tuple(np.asarray(grid.index_of(jnp.asarray(sensor))))]:
            break
    # Of one shape and origin for all, so that one program serves them.
    shift = jnp.array([float(x), float(y), 0.0])
    moved = _moved(scene.geoms, shift)
    found = look(moved, jnp.asarray(sensor) - shift, jax.random.key(int(rng.integers(2**31))), GRID)
    seen_free, seen_occupied = np.asarray(found.seen_free), np.asarray(found.seen_occupied)
    return bits_of(seen_free, seen_occupied, ground, occupied & ~ground)


def bits_of(*volumes: Bool[np.ndarray, "nx ny nz"]) -> UInt8[np.ndarray, "nx ny nz"]:
    """One byte a voxel, of what was seen free, seen occupied, is ground, and is occupied."""
    bits = SEEN_FREE, SEEN_OCCUPIED, GROUND, OCCUPIED
    layers = [np.where(volume, np.uint8(bit), np.uint8(0)) for volume, bit in zip(volumes, bits, strict=True)]
    return np.asarray(np.bitwise_or.reduce(layers))


def _moved(geoms: Geoms, shift: Float[Array, " 3"]) -> Geoms:
    """The city with the shift taken from all positions."""
    return dataclasses.replace(geoms, position=geoms.position - shift)
