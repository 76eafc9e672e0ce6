"""Starts and goals on the grid: the voxel that an end lies in, and what it may stand on.

Positions are index coordinates (whole numbers at voxel centres).
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.grid import Index3
from maxjax.planning.path.line_of_sight import TOUCH, stands_free


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class End:
    """A start or a goal on the grid.

    Attributes:
        exact: index coordinates; −1 where they are not finite.
        off: the same, by `move_off_faces`.
        index: its voxel; outside the grid for a point outside.
        finite: whether the point was.
    """

    exact: Float[Array, "*n 3"]
    off: Float[Array, "*n 3"]
    index: Int32[Array, "*n 3"]
    finite: Bool[Array, "*n"]


def move_off_faces(x: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """The point moved off the faces of its voxel, so that it touches no other voxel.

    A start at 3 m lies on a face of 2 m voxels. Touching the margin there must not cost the whole flight its margin.
    """
    centre = jnp.floor(x + 0.5)
    room = 0.5 - 1.5 * TOUCH
    return centre + jnp.clip(x - centre, -room, room)


def locate(point: Float[Array, " 3"], shape: Index3) -> End:
    """Where a point is on a grid of this shape; NaN and infinity are allowed."""
    exact = jnp.where(jnp.isfinite(point), point, -1.0)
    off = move_off_faces(exact)
    index = jnp.floor(jnp.clip(off, -1, max(shape)) + 0.5).astype(jnp.int32)
    return End(exact, off, index, jnp.all(jnp.isfinite(point)))


def free_place(blocked: Bool[Array, "nx ny nz"], x: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """The point itself where it stands free of blocked voxels, else off the faces of its voxel."""
    return jnp.where(stands_free(blocked, x), x, move_off_faces(x))
