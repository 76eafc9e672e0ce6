"""What the three cities share: their extent, one draw of random numbers, and a final turn."""

from __future__ import annotations

import math

import jax
from jaxtyping import Array, Float, PRNGKeyArray

from maxjax.worlds.geoms import Geoms, matmul, rotation_z

HALF_CITY = 120.0  # [m], before the turn
MAX_TURN = 0.35  # [rad]


def uniform(key: PRNGKeyArray, *shapes: tuple[int, ...]) -> list[Array]:
    """Uniform numbers in [0, 1) of several shapes from one draw: generators take long to compile."""
    sizes = [math.prod(shape) for shape in shapes]
    flat = jax.random.uniform(key, (sum(sizes),))
    stops = [sum(sizes[: i + 1]) for i in range(len(sizes))]
    return [flat[stop - n : stop].reshape(shape) for stop, n, shape in zip(stops, sizes, shapes, strict=True)]


def turn(geoms: Geoms, u: Float[Array, ""]) -> Geoms:
    """The whole scene turned about the world's z axis by a random angle of at most `MAX_TURN`."""
    rotation = rotation_z(MAX_TURN * (2.0 * u - 1.0))
    return Geoms(matmul(geoms.position, rotation.T), matmul(rotation, geoms.rotation), geoms.size, geoms.type)
