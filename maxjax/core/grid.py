"""The voxel grid: where array indices lie in the world.

    x_world = origin + spacing · index

World frame: ENU, metres, z up. Arrays index [x, y, z]. `origin` is the *centre* of voxel (0, 0, 0), so voxel i covers
[origin + (i - 1/2) spacing, origin + (i + 1/2) spacing). A `Grid` is static and hashable: under `jit` it is part of the
program, never data.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int32

Index3 = tuple[int, int, int]
Point3 = tuple[float, float, float]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Grid:
    """A regular grid of cubic voxels, axis-aligned in the world frame.

    Attributes:
        shape: voxels along x, y, z.
        spacing: edge of a voxel [m].
        origin: world position of the centre of voxel (0, 0, 0) [m], ENU.

    Raises:
        ValueError: for a shape that is not three positive integers, a spacing that is not a positive finite number or
            an origin that is not finite.
    """

    shape: Index3 = (101, 101, 101)
    spacing: float = 2.0
    origin: Point3 = (-100.0, -100.0, -100.0)

    def __post_init__(self) -> None:
        shape, origin, spacing = _numbers(self.shape), _numbers(self.origin), _numbers(self.spacing)
        if shape.shape != (3,) or not (np.isfinite(shape) & (shape >= 1) & (shape == np.floor(shape))).all():
            raise ValueError(f"Grid.shape: expected three positive integers, given {self.shape!r}")
        if spacing.shape != () or not (np.isfinite(spacing) and spacing > 0):
            raise ValueError(f"Grid.spacing: expected a positive number of metres, given {self.spacing!r}")
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise ValueError(f"Grid.origin: expected three finite coordinates [m], given {self.origin!r}")
        object.__setattr__(self, "shape", tuple(int(n) for n in shape))
        object.__setattr__(self, "spacing", float(spacing))
        object.__setattr__(self, "origin", tuple(float(x) for x in origin))

    @classmethod
    def centered(cls, center: Point3, shape: Index3 = (101, 101, 101), spacing: float = 2.0) -> Grid:
        """The grid of this shape whose middle lies at `center` [m]."""
        origin = tuple(float(c) - 0.5 * (n - 1) * spacing for c, n in zip(center, shape, strict=True))
        return cls(shape, spacing, (origin[0], origin[1], origin[2]))

    def index_of(self, points: Float[Array, "*batch 3"]) -> Int32[Array, "*batch 3"]:
        """Voxel that holds each point [m]; may lie outside the grid (see `contains`). NaN gives no meaningful index."""
        voxels = jnp.floor((points - jnp.asarray(self.origin, points.dtype)) / self.spacing + 0.5)
        # Far points are clipped so that the cast cannot overflow back into the grid.
        return jnp.clip(voxels, -1, max(self.shape)).astype(jnp.int32)

    def contains(self, points: Float[Array, "*batch 3"]) -> Bool[Array, "*batch"]:
        """Whether each point [m] lies in a voxel of the grid; NaN lies nowhere."""
        index = (points - jnp.asarray(self.origin, points.dtype)) / self.spacing + 0.5
        return jnp.all((index >= 0) & (index < jnp.asarray(self.shape)), axis=-1)

    def center_of(self, index: Int32[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """World position of each voxel's centre [m]."""
        return jnp.asarray(self.origin) + self.spacing * index

    def fractional_index(self, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Points [m] in index coordinates: whole numbers at voxel centres."""
        return (points - jnp.asarray(self.origin, points.dtype)) / self.spacing

    def to_world(self, fractional_index: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Inverse of `fractional_index` [m]."""
        return jnp.asarray(self.origin, fractional_index.dtype) + self.spacing * fractional_index

    def to_metres(self, fractional_index: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3"]:
        """`to_world` on the host, in float64."""
        world: Float64[np.ndarray, "*batch 3"] = np.array(self.origin) + self.spacing * np.asarray(fractional_index)
        return world

    @functools.cached_property
    def local(self) -> Grid:
        """The same grid with its origin at zero, which programs are compiled for wherever the map lies."""
        return Grid(self.shape, self.spacing, (0.0, 0.0, 0.0))

    @functools.cached_property
    def unit(self) -> Grid:
        """The grid of the same shape in index coordinates, for programs to which metres do not matter."""
        return Grid(self.shape, 1.0, (0.0, 0.0, 0.0))

    @property
    def lower(self) -> Point3:
        """Lowest corner of the volume that the voxels cover [m]."""
        x, y, z = self.origin
        half = 0.5 * self.spacing
        return (x - half, y - half, z - half)

    @property
    def upper(self) -> Point3:
        """Highest corner of the volume that the voxels cover [m]."""
        (x, y, z), (nx, ny, nz) = self.lower, self.shape
        return (x + nx * self.spacing, y + ny * self.spacing, z + nz * self.spacing)

    def check_volume(self, name: str, array: jax.Array | np.ndarray) -> None:
        """Raise a `ValueError` with both shapes unless `array` (batch axes lead) covers this grid."""
        if tuple(array.shape[-3:]) != self.shape:
            raise ValueError(
                f"{name}: expected shape (..., {', '.join(map(str, self.shape))}), given {tuple(array.shape)}"
            )


def _numbers(given: object) -> Float64[np.ndarray, "..."]:
    """Real numbers as an array; NaN for what are none."""
    try:
        numbers = np.asarray(given)
    except (ValueError, TypeError):
        return np.array(np.nan)
    return numbers.astype(np.float64) if numbers.dtype.kind in "iuf" else np.array(np.nan)
