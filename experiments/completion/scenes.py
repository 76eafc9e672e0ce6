"""Scans of simulated cities: what one shows, and what is there.

A sensor stands at a free place, 3 to 15 m above the ground; `maxjax.fields.sighting` says what it sees. The grid lies
around the sensor, moved by whole voxels.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from maxjax.core.grid import Grid
from maxjax.fields.sighting import Sighting, sight
from maxjax.nn.completion import GRID
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.layouts import MAPS
from maxjax.sim.worlds.rasterize import occupancy
from maxjax.sim.worlds.scenes import make_scene

SEEN_FREE, SEEN_OCCUPIED, GROUND, OCCUPIED = 1, 2, 4, 8
"""Bits of a voxel: what was seen, what is known before, what is there."""

_LIDAR = Lidar()
_REACH, _LOW, _HIGH = 80.0, 3.0, 15.0  # of sensors from the middle of the city, and above the ground [m]
_TRIES = 1000


@functools.partial(jax.jit, static_argnames="grid")
def look(geoms: Geoms, sensor: Float[Array, " 3"], key: Array, grid: Grid) -> tuple[Sighting, Float[Array, "r 3"]]:
    """What a level sensor sees of a city, and its returns [m].

    Args:
        geoms: solids of the city.
        sensor: position [m].
        key: of the noise.
        grid: static.
    """
    points = scan(geoms, _LIDAR, sensor, jnp.eye(3), key).points
    return sight(sensor, points, grid, _LIDAR.max_range), points


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
    found, _ = look(moved, jnp.asarray(sensor) - shift, jax.random.key(int(rng.integers(2**31))), GRID)
    seen_free, seen_occupied = np.asarray(found.free), np.asarray(found.occupied)
    return bits_of(seen_free, seen_occupied, ground, occupied & ~ground)


def bits_of(*volumes: Bool[np.ndarray, "nx ny nz"]) -> UInt8[np.ndarray, "nx ny nz"]:
    """One byte a voxel, of what was seen free, seen occupied, is ground, and is occupied."""
    bits = SEEN_FREE, SEEN_OCCUPIED, GROUND, OCCUPIED
    layers = [np.where(volume, np.uint8(bit), np.uint8(0)) for volume, bit in zip(volumes, bits, strict=True)]
    return np.asarray(np.bitwise_or.reduce(layers))


def _moved(geoms: Geoms, shift: Float[Array, " 3"]) -> Geoms:
    """The city with the shift taken from all positions."""
    return dataclasses.replace(geoms, position=geoms.position - shift)
