"""Geoms: the solids of a scene as arrays, in MuJoCo's conventions.

    x_world = position + rotation · x_geom

`type` is static, the arrays are traced: scenes with equal types differ in data only, so a batch of them is
one program. Sizes are half-extents: box (hx, hy, hz); ellipsoid semi-axes; sphere (r, 0, 0); capsule (r, h,
0), its axis along the geom's z, h from the centre to the centre of a cap; plane (0, 0, 1): infinite, solid
below its z = 0. A triangle, a surface without an inside, has a corner at its centre, another at (a, 0, 0) and the
third at (b, c, 0); its size is (a, b, c).

Coordinates are float32 in a local frame: the resolution is 8 µm at 100 m, 1 mm at 16 km and 0.25 to 0.5 m at national
coordinates (4·10⁶ to 8·10⁶ m). A real city is centred before its geoms are made (`real_city.crop`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

# Numbers of `mujoco.mjtGeom`, written out so that a city can be made without importing MuJoCo.
PLANE, SPHERE, CAPSULE, ELLIPSOID, BOX, TRIANGLE = 0, 2, 3, 4, 6, 108

# Padding lies below all rays above the ground and below all grids around the city.
_HIDDEN_POSITION = (0.0, 0.0, -1000.0)
_HIDDEN_SIZE = 0.01


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Geoms:
    """Solids of one scene; batch axes lead.

    Attributes:
        position: centres in the world frame [m].
        rotation: geom axes as columns, geom -> world.
        size: MuJoCo sizes [m], see the module.
        type: one `mujoco.mjtGeom` number a geom; static.
    """

    position: Float[Array, "*batch g 3"]
    rotation: Float[Array, "*batch g 3 3"]
    size: Float[Array, "*batch g 3"]
    type: tuple[int, ...] = dataclasses.field(metadata={"static": True})

    def of_type(self, geom_type: int) -> Geoms:
        """The geoms of one type, in order; under `jit` a static selection."""
        index = np.array([i for i, t in enumerate(self.type) if t == geom_type], dtype=np.int32)
        return Geoms(
            self.position[..., index, :],
            self.rotation[..., index, :, :],
            self.size[..., index, :],
            (geom_type,) * len(index),
        )


def concatenate(groups: Sequence[Geoms]) -> Geoms:
    """All groups as one scene, in the order given."""
    return Geoms(
        jnp.concatenate([g.position for g in groups], axis=-2),
        jnp.concatenate([g.rotation for g in groups], axis=-3),
        jnp.concatenate([g.size for g in groups], axis=-2),
        tuple(t for g in groups for t in g.type),
    )


def hide(geoms: Geoms, hidden: Bool[Array, "*batch g"]) -> Geoms:
    """The geoms with those under `hidden` replaced by padding, which keeps the number of geoms of a map fixed."""
    mask = hidden[..., None]
    return Geoms(
        jnp.where(mask, jnp.asarray(_HIDDEN_POSITION), geoms.position),
        jnp.where(mask[..., None], jnp.eye(3), geoms.rotation),
        jnp.where(mask, _HIDDEN_SIZE, geoms.size),
        geoms.type,
    )


def rotation_z(angle: Float[Array, "*batch"]) -> Float[Array, "*batch 3 3"]:
    """Rotation about the vertical, counter-clockwise seen from above [rad]."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    return jnp.stack([jnp.stack([c, -s, zero], -1), jnp.stack([s, c, zero], -1), jnp.stack([zero, zero, one], -1)], -2)


def quaternion(rotation: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 4"]:
    """Unit quaternions (w, x, y, z) of rotation matrices.

    The entries of R determine 4 q q^T; its row of largest diagonal, normalised, is q without cancellation.
    """
    r = rotation
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    rows = jnp.stack(
        [
            jnp.stack([1.0 + xx + yy + zz, wx, wy, wz], -1),
            jnp.stack([wx, 1.0 + xx - yy - zz, xy, xz], -1),
            jnp.stack([wy, xy, 1.0 - xx + yy - zz, yz], -1),
            jnp.stack([wz, xz, yz, 1.0 - xx - yy + zz], -1),
        ],
        -2,
    )
    largest = jnp.argmax(jnp.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    row = jnp.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    norm: Array = jnp.linalg.norm(row, axis=-1, keepdims=True)
    return row / norm


def ground_plane() -> Geoms:
    """The ground z = 0."""
    return Geoms(jnp.zeros((1, 3)), jnp.eye(3)[None], jnp.array([[0.0, 0.0, 1.0]]), (PLANE,))


def half_edges(solids: Geoms) -> Float[Array, "g 3"]:
    """Half edges of the box, along the world's axes, around each solid [m]."""
    size, rotation = solids.size, jnp.abs(solids.rotation)
    kinds = jnp.asarray(solids.type)[:, None]
    box = jnp.einsum("gij,gj->gi", rotation, size, precision="highest")
    capsule = size[:, :1] + rotation[:, :, 2] * size[:, 1:2]
    sphere = jnp.broadcast_to(size[:, :1], size.shape)
    known = [(BOX, box), (CAPSULE, capsule), (SPHERE, sphere)]
    return jnp.select([kinds == kind for kind, _ in known], [half for _, half in known], box)
