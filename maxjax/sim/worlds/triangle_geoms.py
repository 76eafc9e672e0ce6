"""Triangles as geoms: a corner as centre, the first edge along x, the third corner on the side of y.

corner = position + rotation · (0, 0, 0) | (a, 0, 0) | (b, c, 0),     size = (a, b, c)
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.io.geo.triangles import area_normals
from maxjax.sim.worlds.geoms import TRIANGLE, Geoms

_NOWHERE = -1e4  # of padding, below everything [m]
_LEAST = 1e-12  # of an area's square; what is smaller is no surface [m⁴]


def triangle_geoms(corners: Float[np.ndarray, "n 3 3"], slots: int) -> Geoms:
    """Triangles as geoms, padded, so that sets of about one size share a program.

    Args:
        corners: [m], near the origin: geoms are float32.
        slots: geoms in all; triangles without an area are padding, too.

    Raises:
        ValueError: for more triangles than slots.
    """
    if len(corners) > slots:
        raise ValueError(f"slots: expected at least {len(corners)}, one a triangle, given {slots}")
    padding = np.array([[0.0, 0.0, _NOWHERE], [1.0, 0.0, _NOWHERE], [0.0, 1.0, _NOWHERE]])
    normal = area_normals(corners)
    flat = np.einsum("nk,nk->n", normal, normal) <= _LEAST
    whole = np.concatenate(
        [np.where(flat[:, None, None], padding, corners), np.tile(padding, (slots - len(corners), 1, 1))]
    )
    first, last = whole[:, 1] - whole[:, 0], whole[:, 2] - whole[:, 0]
    normal = np.cross(first, last)
    x = first / np.linalg.norm(first, axis=1, keepdims=True)
    z = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    y = np.cross(z, x)
    size = np.stack([np.linalg.norm(first, axis=1), (last * x).sum(axis=1), (last * y).sum(axis=1)], axis=1)
    position, rotation, sizes = (
        jnp.asarray(one, jnp.float32) for one in (whole[:, 0], np.stack([x, y, z], axis=2), size)
    )
    return Geoms(position, rotation, sizes, (TRIANGLE,) * slots)
