"""Geoms from footprints and heights.

An upright box is one row (x, y, half length, half width, bottom, top, yaw) [m, rad]; a row with top <= bottom
is absent. Rows stack, select and rotate as one array, so a recipe for a city block is a plain (n, 7) array.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from maxjax.compile.lowering import matmul
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, Geoms, concatenate, hide, rotation_z

Rows = Float[Array, "n 7"]

ABSENT = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)


def upright_boxes(rows: Rows) -> Geoms:
    """Upright boxes; absent rows become padding."""
    x, y, half_length, half_width, bottom, top, yaw = rows.T
    boxes = Geoms(
        jnp.stack([x, y, 0.5 * (bottom + top)], -1),
        rotation_z(yaw),
        jnp.stack([half_length, half_width, 0.5 * (top - bottom)], -1),
        (BOX,) * rows.shape[0],
    )
    return hide(boxes, top <= bottom)


def gable_roofs(rows: Rows, rise: Float[Array, " n"]) -> Geoms:
    """Pitched roofs of 45 degrees over upright boxes, each one box rolled about its ridge.

    The upper half of a square bar of half-diagonal `rise`, rolled by 45 degrees, is a gable above the top of the
    building (rows as given), with its ridge along the length; the lower half lies inside the building, which must be
    taller.
    """
    x, y, half_length, _, bottom, top, yaw = rows.T
    c = jnp.sqrt(0.5)
    roll = jnp.array([[1.0, 0.0, 0.0], [0.0, c, -c], [0.0, c, c]])
    roofs = Geoms(
        jnp.stack([x, y, top], -1),
        matmul(rotation_z(yaw), roll),
        jnp.stack([half_length, c * rise, c * rise], -1),
        (BOX,) * rows.shape[0],
    )
    return hide(roofs, top <= bottom)


def trees(u: Float[Array, "n 4"], position: Float[Array, "n 2"]) -> Geoms:
    """Trees of 5 to 12 m, ellipsoid crowns on capsule trunks, from four uniform numbers each."""
    n = position.shape[0]
    crown = jnp.stack([1.8 + 1.4 * u[:, 0], 1.8 + 1.4 * u[:, 1], 1.8 + 2.0 * u[:, 2]], -1)
    middle = 1.6 + 2.4 * u[:, 3] + crown[:, 2]
    yaw = jnp.pi * u[:, 0]
    crowns = Geoms(jnp.concatenate([position, middle[:, None]], -1), rotation_z(yaw), crown, (ELLIPSOID,) * n)
    # The trunk ends in the middle of the crown, so that there is no gap under a narrow one.
    return concatenate([crowns, poles(position, middle, radius=0.25)])


def vehicles(u: Float[Array, "n 2"], position: Float[Array, "n 2"], yaw: Float[Array, " n"]) -> Geoms:
    """Parked cars and vans, almost parallel to the kerb."""
    n = position.shape[0]
    van = jnp.where(u[:, 0] < 0.3, 1.0, 0.0)
    rows = [position[:, 0], position[:, 1], 2.1 + 0.8 * van, 0.9 + 0.1 * van, jnp.zeros(n), 1.45 + 1.1 * van]
    return upright_boxes(jnp.stack([*rows, yaw + 0.06 * (u[:, 1] - 0.5)], -1))


def poles(position: Float[Array, "n 2"], height: Float[Array, " n"], radius: float) -> Geoms:
    """Upright capsules from the ground to `height` [m]."""
    n = position.shape[0]
    return Geoms(
        jnp.concatenate([position, 0.5 * height[:, None]], -1),
        jnp.broadcast_to(jnp.eye(3), (n, 3, 3)),
        jnp.stack([jnp.full(n, radius), 0.5 * height - radius, jnp.zeros(n)], -1),
        (CAPSULE,) * n,
    )
