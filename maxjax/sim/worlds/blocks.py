"""City blocks: seven recipes that fill one rectangular lot with at most eight upright boxes.

Every recipe maps (24 uniform random numbers, half extents (a, b) [m], height range [m]) to rows of
`solids.upright_boxes` in the lot's frame (origin at its middle). Arguments are numbers instead of a key, so that one
draw serves all recipes. All footprints lie inside the lot, so that the streets between lots are continuous.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from maxjax.sim.worlds.solids import ABSENT, Rows

SLOTS = 8
DRAWS = 24
Scalar = Float[Array, ""]
Draws = Float[Array, "24"]
Recipe = Callable[[Draws, Scalar, Scalar, Float[Array, "2"]], Rows]


def _pad(rows: list[list[Scalar | float]]) -> Rows:
    stacked = [jnp.stack([jnp.asarray(value, jnp.float32) for value in row]) for row in rows]
    stacked += [jnp.asarray(ABSENT, jnp.float32)] * (SLOTS - len(rows))
    return jnp.stack(stacked)


def _heights(u: Float[Array, " n"], height: Float[Array, "2"]) -> Float[Array, " n"]:
    """Heights within the range [m], low ones more frequent than high ones, as in cities."""
    return height[0] + (height[1] - height[0]) * u**1.7


def _inscribe(yaw: Scalar, a: Scalar, b: Scalar, x: Scalar, y: Scalar) -> tuple[Scalar, Scalar]:
    """Half extents (x, y) shrunk just enough for a box turned by `yaw` to stay inside half extents (a, b)."""
    c, s = jnp.abs(jnp.cos(yaw)), jnp.abs(jnp.sin(yaw))
    shrink = jnp.minimum(1.0, jnp.minimum(a / (x * c + y * s), b / (x * s + y * c)))
    return shrink * x, shrink * y


def podium_tower(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """A tower of two tiers, perhaps turned, on a podium that fills the lot."""
    top = jnp.maximum(_heights(u[20:21], height)[0], 0.5 * (height[0] + height[1]))
    podium = 5.0 + 8.0 * u[0]
    yaw = jnp.where(u[1] < 0.5, 0.0, (u[2] - 0.5) * 1.4)
    length, width = _inscribe(yaw, 0.92 * a, 0.92 * b, (0.5 + 0.25 * u[3]) * a, (0.5 + 0.25 * u[4]) * b)
    step = podium + (0.45 + 0.4 * u[5]) * (top - podium)
    x, y = 0.15 * a * (u[3] - 0.5), 0.15 * b * (u[4] - 0.5)
    return _pad(
        [
            [0.0, 0.0, a, b, 0.0, podium, 0.0],
            [x, y, length, width, podium, step, yaw],
            [x, y, 0.7 * length, 0.7 * width, step, top, yaw],
            [x, y, 0.2 * length, 0.2 * width, top, top + 4.0, yaw],
        ]
    )


def courtyard(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """Four wings around a court with a gate under the south wing; the north wing may be missing."""
    tops = _heights(u[20:], height)
    depth = 4.2 + 1.3 * u[0]
    inner = a - 2.0 * depth
    gate = 3.5 + 1.5 * u[1]
    center = (u[2] - 0.5) * (inner - gate)
    left, right = 0.5 * (inner + center - gate), 0.5 * (inner - center - gate)
    lintel = 6.0 + 2.0 * u[3]
    south = jnp.maximum(tops[2], lintel + 4.0)
    return _pad(
        [
            [-a + depth, 0.0, depth, b, 0.0, tops[0], 0.0],
            [a - depth, 0.0, depth, b, 0.0, tops[1], 0.0],
            [-inner + left, depth - b, left, depth, 0.0, south, 0.0],
            [inner - right, depth - b, right, depth, 0.0, south, 0.0],
            [center, depth - b, gate, depth, lintel, south, 0.0],
            [0.0, b - depth, inner, depth, 0.0, jnp.where(u[4] < 0.65, tops[3], 0.0), 0.0],
        ]
    )


def quarters(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """Two by two towers across alleys, each with a setback; some stand turned on their quarter."""
    tops = _heights(u[20:], height)
    alley = 2.0 + 1.5 * u[0]
    cross_x, cross_y = 0.3 * a * (u[1] - 0.5), 0.3 * b * (u[2] - 0.5)
    rows: list[list[Scalar | float]] = []
    for i, (sx, sy) in enumerate(((-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0))):
        half_x, half_y = 0.5 * (a - alley - sx * cross_x), 0.5 * (b - alley - sy * cross_y)
        yaw = jnp.where(u[4 + i] < 0.3, (u[8 + i] - 0.5) * 1.2, 0.0)
        length, width = _inscribe(yaw, half_x, half_y, half_x, half_y)
        x, y = sx * (a - half_x), sy * (b - half_y)
        step = (0.5 + 0.45 * u[12 + i]) * tops[i]
        rows.append([x, y, length, width, 0.0, step, yaw])
        rows.append([x, y, 0.72 * length, 0.72 * width, step, tops[i], yaw])
    return _pad(rows)


def slabs(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """Two parallel slabs, perhaps shifted, joined by a bridge high above a passage, with roof houses."""
    tops = jnp.maximum(_heights(u[22:], height), 14.0)
    depth = 5.0 + 2.0 * u[0]
    length = a * (0.75 + 0.2 * u[1:3])
    bridge = 7.0 + (jnp.min(tops) - 12.0) * u[3] * 0.7
    # The bridge lies where both slabs stand, for any shift.
    west = -a + length[0]
    east = a - length[1]
    return _pad(
        [
            [west, -b + depth, length[0], depth, 0.0, tops[0], 0.0],
            [east, b - depth, length[1], depth, 0.0, tops[1], 0.0],
            [0.4 * a * (u[4] - 0.5), 0.0, 2.5, b - 2.0 * depth, bridge, bridge + 4.0, 0.0],
            [west, -b + depth, 0.3 * length[0], 0.5 * depth, tops[0], tops[0] + 3.0, 0.0],
            [east, b - depth, 0.25 * length[1], 0.5 * depth, tops[1], tops[1] + 4.0, 0.0],
        ]
    )


def overhang(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """A building on four columns and a core: open underneath, a tower above."""
    top = jnp.maximum(_heights(u[20:21], height)[0], 30.0)
    under = 7.0 + 4.0 * u[0]
    slab = under + 8.0 + 6.0 * u[1]
    x, y = 0.85 * a, 0.85 * b
    columns: list[list[Scalar | float]] = [
        [sx * (x - 1.5), sy * (y - 1.5), 0.9, 0.9, 0.0, under, 0.0] for sx in (-1.0, 1.0) for sy in (-1.0, 1.0)
    ]
    return _pad(
        [
            *columns,
            [0.0, 0.0, 0.3 * a, 0.3 * b, 0.0, under, 0.0],
            [0.0, 0.0, x, y, under, slab, 0.0],
            [0.2 * a * (u[2] - 0.5), 0.2 * b * (u[3] - 0.5), 0.6 * x, 0.6 * y, slab, slab + 0.7 * top, 0.0],
        ]
    )


def terraces(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """Two rows of four party-wall houses of unequal depth and height, back to back across yards."""
    tops = _heights(u[16:], height).reshape(2, 4)
    widths = 0.6 + u[8:16].reshape(2, 4)
    widths = a * widths / jnp.sum(widths, axis=1, keepdims=True)
    centers = -a + 2.0 * jnp.cumsum(widths, axis=1) - widths
    depths = jnp.minimum(4.5 + 3.0 * u[:8].reshape(2, 4), 0.45 * b)
    return _pad(
        [
            [centers[r, i], side * (b - depths[r, i]), widths[r, i], depths[r, i], 0.0, tops[r, i], 0.0]
            for r, side in enumerate((-1.0, 1.0))
            for i in range(4)
        ]
    )


def square(u: Draws, a: Scalar, b: Scalar, height: Float[Array, "2"]) -> Rows:
    """An open square: a pavilion and an obelisk; the layout adds its trees."""
    x, y = 0.3 * a * (u[0] - 0.5), 0.3 * b * (u[1] - 0.5)
    yaw = 3.0 * u[2]
    return _pad(
        [
            [x - 0.3 * a, y, 3.0 + 2.0 * u[3], 3.0, 0.0, 4.0 + 2.0 * u[4], yaw],
            [x + 0.3 * a, y, 0.9, 0.9, 0.0, 9.0 + 0.1 * height[1], yaw],
        ]
    )


RECIPES: tuple[Recipe, ...] = (podium_tower, courtyard, quarters, slabs, overhang, terraces, square)


def build_block(
    u: Draws,
    facing: Int[Array, ""],
    kind: Int[Array, ""],
    center: Float[Array, "2"],
    half: Float[Array, "2"],
    height: Float[Array, "2"],
) -> Rows:
    """One lot filled by recipe `kind`, turned by `facing` right angles: rows in the city's frame."""
    sideways = facing % 2 == 1
    a, b = jnp.where(sideways, half[1], half[0]), jnp.where(sideways, half[0], half[1])
    # Under vmap a `switch` computes every branch anyway; a stack says so and compiles the same.
    rows = jnp.stack([recipe(u, a, b, height) for recipe in RECIPES])[kind]
    angle = 0.5 * jnp.pi * facing
    # Exact multiples of a right angle: round, so that walls stay exactly parallel to the lot.
    c, s = jnp.round(jnp.cos(angle)), jnp.round(jnp.sin(angle))
    x = center[0] + c * rows[:, 0] - s * rows[:, 1]
    y = center[1] + s * rows[:, 0] + c * rows[:, 1]
    half_length = jnp.where(sideways, rows[:, 3], rows[:, 2])
    half_width = jnp.where(sideways, rows[:, 2], rows[:, 3])
    return jnp.stack([x, y, half_length, half_width, *rows[:, 4:].T], -1)
