"""The common part of the procedural cities: their extent, one draw of random numbers, and a final rotation."""

from __future__ import annotations

import math

import jax
from jaxtyping import Array, Float, PRNGKeyArray

from maxjax.compile.lowering import matmul
from maxjax.sim.worlds.geoms import Geoms, rotation_z

HALF_CITY = 120.0  # half extent before the rotation [m]
MAX_TURN = 0.35  # greatest angle of the rotation [rad]


def uniform(key: PRNGKeyArray, *shapes: tuple[int, ...]) -> list[Array]:
    """Uniform numbers in [0, 1) of several shapes from one draw, since each call of a generator is compiled anew."""
    sizes = [math.prod(shape) for shape in shapes]
    flat = jax.random.uniform(key, (sum(sizes),))
    stops = [sum(sizes[: i + 1]) for i in range(len(sizes))]
    return [flat[stop - n : stop].reshape(shape) for stop, n, shape in zip(stops, sizes, shapes, strict=True)]


def turn(geoms: Geoms, u: Float[Array, ""]) -> Geoms:
    """The scene rotated about the world's z axis by (2 u − 1) `MAX_TURN`."""
    rotation = rotation_z(MAX_TURN * (2.0 * u - 1.0))
    return Geoms(matmul(geoms.position, rotation.T), matmul(rotation, geoms.rotation), geoms.size, geoms.type)
