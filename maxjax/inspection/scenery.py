"""What hides: the city's faces, or the boxes of its voxels, as the LiDAR's rays meet them.

    hidden(camera, point)  iff  the first surface on the ray is nearer than the point, by more than a centimetre

Rays are cast in bundles that lie side by side, each among what reaches into the box around it: memory is that of a
bundle, and the programs are few, since bundles and solids are filled up to powers of two.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64

from maxjax.core.voxel_map import VoxelMap
from maxjax.io.kinds.faces import Faces
from maxjax.sim.worlds.geoms import Geoms, concatenate
from maxjax.sim.worlds.raycast import cast_rays
from maxjax.sim.worlds.solids import ABSENT, upright_boxes
from maxjax.sim.worlds.triangle_geoms import triangle_geoms
from maxjax.sim.worlds.voxel_boxes import box_rows

TOUCH = 0.01
"""By which a point's own face, and what is drawn on it, does not hide it [m]."""
_LEAST = 64  # solids of a bundle
_BUNDLE = 64  # origins of a bundle
_CELL = 8.0  # edge of the cells in whose order origins are taken [m]
_BITS = 16  # of a cell's number along an axis


@dataclasses.dataclass(frozen=True, eq=False)
class Scenery:
    """Solids and surfaces of a city.

    Attributes:
        triangles: (n, 3, 3) corners of faces [m].
        boxes: (m, 7) rows of `sim.worlds.solids.upright_boxes` [m].
    """

    triangles: Float64[np.ndarray, "n 3 3"]
    boxes: Float64[np.ndarray, "m 7"]

    @classmethod
    def of(cls, where: VoxelMap, faces: Faces, *, by_voxels: bool) -> Scenery:
        """That of a map, by the faces of its file or by its voxels."""
        if by_voxels:
            return cls(np.zeros((0, 3, 3)), box_rows(np.asarray(where.occupied), where.grid))
        return cls(np.concatenate([faces.triangles, faces.terrain]), np.zeros((0, 7)))

    @functools.cached_property
    def _bounds(self) -> tuple[Float64[np.ndarray, "k 3"], Float64[np.ndarray, "k 3"]]:
        """Lowest and highest corner of each triangle, then of each box."""
        middle, half = self.boxes[:, :2], self.boxes[:, 2:4]
        low = np.column_stack([middle - half, self.boxes[:, 4]])
        high = np.column_stack([middle + half, self.boxes[:, 5]])
        return np.concatenate([self.triangles.min(axis=1), low]), np.concatenate([self.triangles.max(axis=1), high])

    def near(self, low: Float64[np.ndarray, "3"], high: Float64[np.ndarray, "3"]) -> Geoms:
        """Solids that reach into a box, in a frame about its middle, padded."""
        lowest, highest = self._bounds
        reach = np.flatnonzero(((highest >= low) & (lowest <= high)).all(axis=1))
        middle, count = 0.5 * (low + high), len(self.triangles)
        corners = self.triangles[reach[reach < count]] - middle
        found = []
        if count:
            found.append(triangle_geoms(corners, _slots(len(corners))))
        if len(self.boxes):
            shift = np.array([*middle[:2], 0.0, 0.0, middle[2], middle[2], 0.0])
            rows = self.boxes[reach[reach >= count] - count] - shift
            padding = np.tile(ABSENT, (_slots(len(rows)) - len(rows), 1))
            found.append(upright_boxes(jnp.asarray(np.concatenate([rows, padding]), jnp.float32)))
        return concatenate(found)

    def first_hits(
        self, origins: Float64[np.ndarray, "n 3"], directions: Float64[np.ndarray, "n 3"], reach: float
    ) -> Float64[np.ndarray, " n"]:
        """Distance from each origin along its own direction to the first surface within reach [m], else infinite."""
        found = np.full(len(origins), np.inf)
        for rows in bundles(origins, 16 * _BUNDLE):
            ends = origins[rows] + reach * directions[rows]
            both = np.concatenate([origins[rows], ends])
            found[rows] = self._cast(both.min(axis=0), both.max(axis=0), origins[rows], directions[rows, None])[:, 0]
        return np.asarray(np.where(found <= reach, found, np.inf))

    def visible(
        self, origins: Float64[np.ndarray, "b 3"], points: Float64[np.ndarray, "b k 3"], asked: Bool[np.ndarray, "b k"]
    ) -> Bool[np.ndarray, "b k"]:
        """Which points nothing hides from their origins.

        Args:
            origins: (b, 3), side by side [m].
            points: (b, k, 3), of each origin its own [m].
            asked: of which of them that is asked.
        """
        way = points - origins[:, None]
        length = np.linalg.norm(way, axis=2)
        both = np.concatenate([origins, points[asked]])
        unit = way / np.maximum(length, 1e-9)[..., None]
        found = self._cast(both.min(axis=0), both.max(axis=0), origins, unit)
        return np.asarray(asked & (found >= length - TOUCH))

    def _cast(
        self,
        low: Float64[np.ndarray, "3"],
        high: Float64[np.ndarray, "3"],
        origins: Float64[np.ndarray, "b 3"],
        directions: Float64[np.ndarray, "b k 3"],
    ) -> Float64[np.ndarray, "b k"]:
        """Distances to the first surface that reaches into a box."""
        count, width = directions.shape[:2]
        rows, columns = _power(count), _power(width)
        middle = 0.5 * (low + high)
        padded = np.zeros((rows, 3), np.float32), np.zeros((rows, columns, 3), np.float32)
        padded[1][..., 2] = 1.0
        padded[0][:count], padded[1][:count, :width] = origins - middle, directions
        found = _cast_bundle(self.near(low, high), jnp.asarray(padded[0]), jnp.asarray(padded[1]))
        return np.asarray(found, np.float64)[:count, :width]


def bundles(origins: Float64[np.ndarray, "n 3"], most: int = _BUNDLE) -> list[np.ndarray]:
    """Numbers of origins, in parts that lie side by side: in Morton's order of the cells that they are in."""
    cell = np.floor((origins - origins.min(axis=0, initial=np.inf)) / _CELL).astype(np.int64)
    code = np.zeros(len(cell), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.argsort(code, kind="stable")
    return [order[k : k + most] for k in range(0, len(order), most)]


def _slots(count: int) -> int:
    """How many solids there are with padding: 2^k or 3 · 2^k."""
    slots = _LEAST
    while slots < count:
        slots = slots * 3 // 2 if slots.bit_count() == 1 else slots * 4 // 3
    return slots


def _power(count: int) -> int:
    return 1 << max(count - 1, 0).bit_length()


@jax.jit
def _cast_bundle(geoms: Geoms, origins: Float[Array, "b 3"], directions: Float[Array, "b k 3"]) -> Float[Array, "b k"]:
    return jax.vmap(cast_rays, (None, 0, 0))(geoms, origins, directions)
